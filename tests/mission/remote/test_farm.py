import pytest

from config.errors import ConfigError
from mission.flight.command import MissionState, Phase, Progress
from mission.remote.farm import (
    FORGOTTEN_S,
    Farm,
    Ledger,
    Stage,
    Start,
    VehicleView,
    after_states,
    is_over,
    load_farm,
    next_starts,
    waits_for,
)
from mission.remote.messages import StateMessage

OF_X = 'turbines = [{name = "t", vehicles = ["x"]}]\n'


def farm(turbines=("t1", "t2", "t3"), vehicles=("heron", "stork"), **changes):
    table = {
        "operator": "Ada",
        "vehicles": [{"name": name} for name in vehicles],
        "turbines": [
            t if isinstance(t, dict) else {"name": t, "rotor_locked": True} for t in turbines
        ],
    }
    return Farm.model_validate(table | changes)


def view(state=MissionState.IDLE, folder="", battery=1.0, link=True, turbines=("t1", "t2", "t3")):
    return VehicleView(
        StateMessage(
            vehicle="x",
            mission_dir=folder,
            site="",
            mission_s=1.0,
            factor=1.0,
            progress=Progress(Phase.IDLE, state, "words"),
            battery=battery,
            link_ok=link,
        ),
        frozenset(turbines),
    )


def flying(turbine="t1", vehicle="heron", tries=1):
    return Ledger().with_record(
        turbine,
        stage=Stage.FLYING,
        vehicle=vehicle,
        request_id="r",
        mission_dir="/m/1",
        tries=tries,
        started_utc_s=100.0,
    )


def test_each_free_vehicle_gets_the_next_turbine_of_the_queue():
    starts = next_starts(farm(), Ledger(), {"heron": view(), "stork": view()})
    assert starts == (Start("t1", "heron"), Start("t2", "stork"))


@pytest.mark.parametrize(
    "busy",
    [
        view(MissionState.RUNNING),
        view(MissionState.PAUSED),
        view(battery=0.7),
        view(battery=None),
        view(link=False),
        view(turbines=()),
    ],
)
def test_a_vehicle_that_flies_is_empty_or_knows_the_turbine_not_gets_none(busy):
    starts = next_starts(farm(), Ledger(), {"heron": busy, "stork": view()})
    assert starts == (Start("t1", "stork"),)


def test_a_vehicle_that_was_just_given_one_gets_no_second_before_it_says_so():
    starts = next_starts(farm(), flying(), {"heron": view(), "stork": view()})
    assert starts == (Start("t2", "stork"),)


def test_a_turbine_may_name_its_vehicles():
    only = farm(({"name": "t1", "vehicles": ["stork"], "rotor_locked": True}, "t2"))
    starts = next_starts(only, Ledger(), {"heron": view(), "stork": view()})
    assert starts == (Start("t1", "stork"), Start("t2", "heron"))


def test_no_turbine_is_flown_without_the_operators_word():
    mixed = farm(({"name": "t1"}, "t2"))
    assert waits_for(mixed, Ledger()) == ("t1",)
    assert next_starts(mixed, Ledger(), {"heron": view()}) == (Start("t2", "heron"),)
    assert is_over(mixed, Ledger().with_record("t2", stage=Stage.COMPLETED))


def test_a_completed_mission_completes_its_turbine():
    done = after_states(farm(), flying(), {"heron": view(MissionState.COMPLETED, "/m/1")}, 200.0)
    assert done.of("t1").stage is Stage.COMPLETED
    assert done.of("t1").words == "completed: words"


def test_an_unfinished_one_is_flown_again_and_given_up_after_its_tries():
    ended = {"heron": view(MissionState.ENDED_SAFELY, "/m/1")}
    again = after_states(farm(), flying(tries=1), ended, 200.0)
    assert again.of("t1").stage is Stage.WAITING
    given_up = after_states(farm(), flying(tries=2), ended, 200.0)
    assert given_up.of("t1").stage is Stage.GIVEN_UP


def test_how_the_last_mission_ended_says_nothing_of_this_one():
    before = {"heron": view(MissionState.COMPLETED, "/m/0")}
    assert after_states(farm(), flying(), before, 101.0) == flying()
    forgotten = after_states(farm(), flying(), before, 101.0 + FORGOTTEN_S)
    assert forgotten.of("t1").stage is Stage.WAITING
    assert "knows nothing" in forgotten.of("t1").words


def test_a_vehicle_that_is_silent_changes_nothing():
    assert after_states(farm(), flying(), {}, 1e9) == flying()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("operator = ", "Invalid value"),
        ('operator = "A"\n', "vehicles"),
        (
            'operator = "A"\nvehicles = [{name = "h"}, {name = "h"}]\nturbines = [{name = "t"}]\n',
            "named twice",
        ),
        (
            'operator = "A"\nvehicles = [{name = "h"}]\n' + OF_X,
            "no vehicle 'x'",
        ),
    ],
)
def test_a_farm_file_that_cannot_be_used_is_told_with_its_place(tmp_path, text, words):
    path = tmp_path / "farm.toml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=words):
        load_farm(path)


def test_a_file_that_is_not_there_is_told(tmp_path):
    with pytest.raises(ConfigError, match=r"farm\.toml"):
        load_farm(tmp_path / "farm.toml")
