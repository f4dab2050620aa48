"""`bladescout.simulate` hands the simulation the settings that its arguments stand for."""

from importlib.resources import files

import pytest

from bladescout import simulate
from config.errors import ConfigError
from mission.flight.command import MissionState
from mission.processes import simulation
from mission.records.files import MISSION


@pytest.fixture
def asked(monkeypatch, tmp_path):
    settings = []

    def flown(given, on_state, on_event):
        settings.append(given)
        on_state("a state")
        on_event("an event")
        (tmp_path / MISSION).write_text('{"state": "completed"}')
        return simulation.Outcome(MissionState.COMPLETED, "done", tmp_path, {}, tmp_path)

    monkeypatch.setattr(simulation, "simulate", flown)
    monkeypatch.setattr("mission.records.summary.add_truth", lambda folder, _: {"folder": folder})
    return settings


def test_arguments_become_settings_and_the_outcome_comes_back(asked, tmp_path):
    heard = []
    flown = simulate(
        "quick",
        seed=7,
        speed=2,
        out=tmp_path / "here",
        settings=["guard.max_height_m=140", "simulation.speed=9"],
        on_state=heard.append,
        on_event=heard.append,
    )
    (given,) = asked
    assert given.simulation.seed == 7
    assert given.simulation.speed == 2
    assert given.guard.max_height_m == 140
    assert given.missions_dir == str(tmp_path / "here")
    assert (flown.state, flown.words, flown.folder) == ("completed", "done", tmp_path)
    assert flown.mission == {"folder": tmp_path}
    assert heard == ["a state", "an event"]


def test_a_scenario_that_is_not_known_is_told_with_what_may_be_meant(asked):
    with pytest.raises(ConfigError, match="did you mean 'quick'"):
        simulate("quik")
    assert asked == []


@pytest.mark.parametrize("name", ["bladescout", "config", "drivers", "mission", "perception"])
def test_every_package_tells_type_checkers_that_it_is_typed(name):
    assert (files(name) / "py.typed").is_file()
