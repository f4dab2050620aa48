"""The tracking bench's missions on the wire: the same draw as a scenario, and what is read back."""

import json
import tomllib
from types import SimpleNamespace

import pytest

from benchmarks import missions, tracking_wire
from benchmarks.tracking_trials import draw_trial
from config.settings import Settings
from drivers.simulated.scene import draw_scene

SIDES = {"PS": 0.96, "SS": 0.97, "LE": 0.95, "TE": 0.85}


def flown_side(photos, rms_error):
    return {
        "blade": "A", "side": "PS", "length_m": 40.0, "planned_m": 40.0, "coverage": 0.9,
        "coverage_reachable": 0.9, "distance_m": {"rms_error": rms_error, "mean": 12.0},
        "clearance_m": {"min": 9.0}, "photos": photos, "rejected": 0,
    }  # fmt: skip


TOLD = {
    "schema": 1, "version": "0.1.0", "state": "completed", "words": "landed", "simulated": True,
    "vehicle": "drone-1", "site": "bench", "turbine": "v90-2.0", "operator": "bench",
    "rotor_locked": True, "started_utc": "2026-11-22T10:00:00Z",
    "ended_utc": "2026-11-22T10:15:00Z", "duration_s": 900.0, "swaps": 1, "phases": [],
    "method": "rotor_fit", "rotor": None, "coverage": 0.9, "clearance_m": {"min": 8.9},
    "gsd_mm": 0.9, "photos": {"kept": 40, "rejected": 0, "lost": 0}, "photo_list": [],
    "exposure": {
        "method": "predictive", "range": [110, 160], "frames": 9, "frames_out_of_range": 0,
        "stills": 40, "stills_out_of_range": 0,
    },
    "timing": {},
    "passes": [flown_side(10, 0.1), flown_side(30, 0.2), flown_side(0, None)],
    "errors": {"photo_metres": {"p95_m": 0.27}},
    "truth": {
        "min_clearance_m": 8.9, "stills_centred": 0.96,
        "coverage": dict.fromkeys("ABC", SIDES), "coverage_reachable": dict.fromkeys("ABC", SIDES),
    },
}  # fmt: skip


@pytest.mark.parametrize("number", range(10))
def test_the_scenario_of_a_mission_draws_the_same_turbine_wind_and_stop_angle(number):
    trial = draw_trial(3, number)
    told = Settings.model_validate(tomllib.loads(tracking_wire.scenario_of(trial)))
    assert draw_scene(told) == trial.scene
    assert told.simulation.wind == trial.settings.simulation.wind
    assert told.simulation.position_profile == trial.profile


@pytest.fixture
def flights(monkeypatch):
    """Stand in for the command; the second flight ends without a word of JSON."""
    begun = []

    def run(words, **_):
        begun.append(words)
        if len(begun) == 2:
            return SimpleNamespace(stdout="", stderr="error: the port is taken\n", returncode=5)
        return SimpleNamespace(stdout=json.dumps(TOLD), stderr="", returncode=0)

    monkeypatch.setattr(missions.subprocess, "run", run)
    return begun


def test_each_mission_is_flown_from_its_own_file_and_summed_by_what_it_says(flights, tmp_path):
    flown = list(tracking_wire.fly(1, [0, 1], tmp_path))
    assert [one.state for one in flown] == ["completed", "failed"]
    assert flown[1].words == "error: the port is taken"
    assert str(tmp_path / "tracking-1-0.toml") in flights[0]
    by_name = {row.name: row for row in tracking_wire.rows(flown)}
    assert by_name["completed, share"].value == 0.5
    rms = by_name[f"distance RMS error as measured, {flown[0].wind}, m"].value
    assert rms == pytest.approx((0.25 * 0.1**2 + 0.75 * 0.2**2) ** 0.5)
    assert by_name["blade within 5 % of the middle"].met is True
    assert by_name[f"blade within 5 % of the middle, {flown[0].profile}"].value == 0.96
    assert by_name["coverage TE, whole, mean"].met is False
    assert by_name["least true clearance, m"].met is True
    assert by_name["minutes a turbine, mean"].value == 15.0


def test_without_a_single_report_only_that_is_said():
    failed = tracking_wire.Wired(0, "x", "5 m/s", "rtk", "failed", "no end")
    assert [row.name for row in tracking_wire.rows([failed])] == ["completed, share"]
