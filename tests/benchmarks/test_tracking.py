"""The tracking bench: what it draws, what it senses, and a mission flown from start to end."""

import dataclasses

import numpy as np
import pytest

from benchmarks.tracking import Mission, rows
from benchmarks.tracking_flight import TrackingFlight, caster_of, wanted_square_m
from benchmarks.tracking_judge import PhotoFigures, SideFigures, judge
from benchmarks.tracking_kept import keep_missions, read_missions
from benchmarks.tracking_trials import MODELS, draw_trial
from config.inspection import Inspection
from config.simulation import Simulation, TruthDraws, Wind
from config.turbine import Site
from drivers.simulated.scene import draw_scene
from mission.flight.command import MissionState


def test_the_same_number_draws_the_same_mission():
    assert draw_trial(3, 7).scene == draw_trial(3, 7).scene
    assert draw_trial(3, 7).scene != draw_trial(3, 8).scene


def test_ten_missions_hold_ten_turbines_and_every_wind():
    trials = [draw_trial(1, number) for number in range(10)]
    assert {trial.model.split(" ")[0] for trial in trials} == {name for name, _ in MODELS}
    assert {trial.wind for trial in trials} == {"5 m/s", "9 m/s", "gust to 15"}
    lengths = [trial.turbine.blade_length_m for trial in trials]
    assert min(lengths) == pytest.approx(40.0, abs=0.6)
    assert max(lengths) == pytest.approx(80.0, abs=0.6)
    assert sum(trial.straight for trial in trials) == 4


def test_a_fifth_of_the_rotors_stands_upright_and_a_fifth_upside_down():
    angles = np.array([draw_trial(1, number).scene.stop_angle_deg for number in range(200)])
    assert np.mean(angles == 0.0) == pytest.approx(0.2, abs=0.08)
    assert np.mean(angles == 60.0) == pytest.approx(0.2, abs=0.08)


@pytest.fixture(scope="module")
def small():
    """A 13 m blade, one side, in still air: the shortest whole mission."""
    trial = draw_trial(1, 0)
    site = Site(name="bench", turbine="v27")
    simulation = Simulation(
        seed=5,
        truth=TruthDraws(stop_angle_deg=20.0, pitch_deg=2.0, launch_bearing_from_rotor_deg=0.0),
        wind=Wind(mean_mps=2.0, turbulence=0.05),
    )
    inspection = Inspection(blades=("A",), sides=("PS",))
    settings = trial.settings.model_copy(
        update={"sites": (site,), "simulation": simulation, "inspection": inspection}
    )
    trial = dataclasses.replace(trial, settings=settings, scene=draw_scene(settings))
    caster = caster_of(trial)
    flight = TrackingFlight(trial, caster, blades=("A",), sides=("PS",))
    return trial, caster, flight.run(), flight


def test_what_is_wanted_of_a_leaning_view_is_its_distance_square_to_the_blade(small):
    leg = small[3].machine.plan.legs[0]
    for lean_deg in (-25.0, 0.0, 25.0):
        lean = np.deg2rad(lean_deg)
        view = np.cos(lean) * leg.view_w + np.sin(lean) * leg.axis_w
        leaning = dataclasses.replace(leg, view_w=view)
        arm = leaning.position(6.0) - leg.root_w - leg.centre(6.0)
        beside_m = float(arm @ leg.axis_w)
        square_m = float(np.linalg.norm(arm - beside_m * leg.axis_w))
        assert wanted_square_m(leaning, beside_m) == pytest.approx(square_m, abs=0.15)


def test_a_mission_is_flown_whole_and_keeps_its_clearance(small):
    _, _, flown, _ = small
    assert flown.machine.report().state is MissionState.COMPLETED
    assert flown.least_clearance_m >= 8.0
    assert len(flown.stills) >= 4


def test_the_distance_is_held_and_the_pictures_hold_the_blade(small):
    trial, caster, flown, _ = small
    errors = [sample.distance_m - sample.wanted_m for sample in flown.samples]
    assert np.sqrt(np.mean(np.square(errors))) < 0.4
    judged = judge(trial, flown, caster)
    assert all(photo.off_centre is not None for photo in judged.photos)
    assert all(abs(photo.metre_error_m) < 1.5 for photo in judged.photos)
    side = next(one for one in judged.sides if (one.blade, one.side) == ("A", "PS"))
    assert side.reachable_share > 0.9
    assert side.own > 0.5
    other = next(one for one in judged.sides if (one.blade, one.side) == ("B", "SS"))
    assert other.whole < 0.1


def test_the_flight_is_told_how_far_beside_the_middle_the_blade_truly_was(small):
    trial, _, flown, flight = small
    told = [flight._outline_found(still) for still in flown.stills for _ in range(5)]
    found = np.array([beside for beside in told if beside is not None])
    assert 0.6 * len(told) < len(found) < len(told)
    blade = flight.senses.blades["A"].frame.axis_w
    assert np.abs(found @ blade).max() < 1e-6
    width_m = 12.0 * trial.settings.camera.sensor_width_mm / trial.settings.camera.focal_length_mm
    assert np.median(np.linalg.norm(found, axis=1)) < 0.05 * width_m


def test_what_the_lidar_tells_lies_on_the_true_turbine(small):
    trial, caster, _, flight = small
    points = flight.senses.surroundings.points_w
    true = points + np.asarray(trial.scene.launch_w) - np.asarray(flight.aircraft.error.position)
    high = true[points[:, 2] > 5.0]
    if len(high):
        off = caster.clearance_m(high.astype(np.float32), 0.0)
        assert np.median(off) < 1.0


@pytest.fixture
def flown_once():
    side = SideFigures("A", "PS", 0.97, 0.99, 1.0, 0.98, 1.0, 0.96, 120.0)
    bare = SideFigures("A", "SS", 0.0, 0.0, 1.0, 0.0, 1.0, None, 12.0)
    photo = PhotoFigures("A", "PS", 3.0, None, 0.01, 0.3, 0.2, 12.0, again=False, in_rows=True)
    return Mission(
        number=4, model="x", wind="5 m/s", profile="rtk", straight=True, blade_m=40.0,
        stop_angle_deg=0.0, pitch_deg=2.0, state="completed", words="", minutes=15.0, packs=1,
        cpu_s=10.0, least_clearance_m=7.5, least_in="", rejected=0, photos=(photo,),
        sides=(side, bare), errors_m=(0.1, -0.1, 1.2), wanted_m=(12.0, 12.0, 12.0),
        settled_s=None, events={"end": 1},
    )  # fmt: skip


def test_the_rows_compare_with_their_goals(flown_once):
    by_name = {row.name: row for row in rows([flown_once])}
    assert by_name["least true clearance, m"].met is False
    assert by_name["coverage PS, whole, mean of the completed"].met is True
    assert by_name["covered area at <= 1.0 mm/px"].value == 0.96
    assert by_name["within 11-13 m of a wanted 12, 5 m/s"].value == pytest.approx(2 / 3)
    assert by_name["times real time, one core"].value == pytest.approx(90.0)


def test_a_mission_that_was_ended_does_not_count_for_how_well_sides_are_seen(flown_once):
    side = SideFigures("A", "PS", 0.2, 0.2, 1.0, 0.2, 1.0, 0.96, 120.0)
    ended = dataclasses.replace(flown_once, state="ended_safely", sides=(side,))
    by_name = {row.name: row for row in rows([flown_once, ended])}
    assert by_name["coverage PS, whole, mean of the completed"].value == 0.97
    assert by_name["completed, share"].value == 0.5


def test_what_is_kept_of_a_seed_is_read_again_and_a_line_cut_short_is_flown_again(
    flown_once, tmp_path
):
    kept = tmp_path / "bench" / "kept.jsonl"
    assert read_missions(kept, 7) == {}
    assert list(keep_missions(kept, 7, [flown_once])) == [flown_once]
    list(keep_missions(kept, 8, [dataclasses.replace(flown_once, number=5)]))
    whole = kept.read_bytes()
    kept.write_bytes(whole + whole[:200])
    assert read_missions(kept, 7) == {4: flown_once}
    six = dataclasses.replace(flown_once, number=6)
    list(keep_missions(kept, 7, [six]))
    assert read_missions(kept, 7) == {4: flown_once, 6: six}
    kept.write_text("not a mission\n")
    with pytest.raises(ValueError, match="JSON"):
        read_missions(kept, 7)
