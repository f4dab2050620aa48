"""Missions flown in memory, recorded as the processes record them, and computed again."""

import json
import re

import numpy as np
import pytest
from typer.testing import CliRunner

from benchmarks.virtual_flight import TERMINAL, VirtualFlight
from benchmarks.virtual_turbine import Truth
from config.inspection import Inspection
from config.presets import load_turbine
from config.settings import Settings
from config.turbine import Site
from drivers.bus import Key
from drivers.codecs import decode_points, encode_points
from mission.cli.main import app
from mission.flight.guard import Surroundings
from mission.records.recording import Recording
from mission.remote.messages import Intent, TickRecord
from mission.replay.commands import replay_commands
from mission.replay.difference import first_difference
from mission.replay.recorded import NotARecording, RecordedMission

SECOND = 1_000_000_000


def flown(path):
    """Fly one side of one blade in an unsteady place and record it; returns the recording."""
    turbine = load_turbine("v27")
    settings = Settings(
        inspection=Inspection(sides=("PS",), blades=("A",)),
        sites=(Site(name="t1", turbine="v27", tower_north_m=46.5, tower_east_m=-2.0),),
    )
    truth = Truth(tower_w=(0.0, 43.5, 0.0), position_noise_m=0.03, angle_noise_deg=0.2)
    seen, told = [], []
    recording = Recording(path, settings, turbine)

    def hook(flight, observation):
        """Keep what is known, and give the guard its surroundings as the bus would."""
        if flight.tick % 4 == 1:
            near = flight._surroundings.points_w[::5].astype(np.float32)
            cloud = encode_points(near, flight.now_s)
            points, stamp_s = decode_points(cloud)
            recording.add(Key.OCCUPANCY, cloud, round(flight.now_s * SECOND))
            told[:] = [Surroundings(points.astype(np.float64), stamp_s)]
        flight._surroundings = told[0]
        seen.append((observation, told[0].stamp_s))
        return observation

    flight = VirtualFlight(settings, settings.sites[0], turbine, truth, hook)
    flight.start(sides=("PS",), blades=("A",))
    intent = Intent(kind="start", id="1", site="t1", blades=("A",), sides=("PS",))
    recording.add(Key.INTENT, intent.model_dump_json().encode(), 0)
    result = flight.run(limit_s=0.0)
    while not seen or flight.machine.state not in TERMINAL:
        guarded = flight.one_tick(result)
        observation, stamp_s = seen[-1]
        record = TickRecord.model_construct(
            observation=observation,
            command=guarded.command,
            refused=guarded.reason,
            sent=guarded.command.setpoint is not None,
            surroundings_s=stamp_s,
        )
        at = round(flight.now_s * SECOND)
        recording.add(Key.COMMAND, record.model_dump_json().encode(), at)
    recording.close()
    return path


@pytest.fixture(scope="module")
def calm(tmp_path_factory):
    return flown(tmp_path_factory.mktemp("calm") / "recording.mcap")


def test_every_command_comes_out_again(calm):
    replay = replay_commands(RecordedMission(calm))
    assert replay.first is None
    assert replay.equal == replay.ticks > 1900
    assert replay.state == "completed"
    assert replay.without_surroundings == 0
    assert replay.speed > 20


def test_occupancy_that_was_overtaken_by_its_tick_is_found(calm, tmp_path):
    mission = RecordedMission(calm)
    late = Recording(tmp_path / "r.mcap", mission.mission.settings, mission.mission.turbine)
    held = []
    for message in mission.messages():
        if message.key == Key.OCCUPANCY:
            held.append(message)
            continue
        for one in (message, *(held if message.key == Key.COMMAND else ())):
            late.add(one.key, one.payload, round(one.mission_s * SECOND))
        held = held if message.key != Key.COMMAND else []
    late.close()
    replay = replay_commands(RecordedMission(tmp_path / "r.mcap"))
    assert replay.first is None
    assert replay.without_surroundings == 0


def test_occupancy_from_before_the_recording_spoils_nothing_that_follows(calm, tmp_path):
    held = []

    def without_the_first(message):
        if message.key == Key.OCCUPANCY and len(held) < 2:
            held.append(message)
            return None
        return message.payload

    path = rewritten(calm, tmp_path / "r.mcap", without_the_first)
    replay = replay_commands(RecordedMission(path))
    assert replay.without_surroundings == 8
    assert replay.equal == replay.ticks


def test_occupancy_that_is_not_there_is_counted(calm, tmp_path):
    path = rewritten(
        calm, tmp_path / "r.mcap", lambda m: None if m.key == Key.OCCUPANCY else m.payload
    )
    assert replay_commands(RecordedMission(path)).without_surroundings > 1000


def rewritten(path, target, change):
    """Copy a recording with its messages changed; None leaves a message out."""
    mission = RecordedMission(path)
    recording = Recording(target, mission.mission.settings, mission.mission.turbine)
    for message in mission.messages():
        payload = change(message)
        if payload is not None:
            recording.add(message.key, payload, round(message.mission_s * SECOND))
    recording.close()
    return target


def tick_changed(number, change):
    """Change one tick; a change that returns False leaves it out."""

    def of(message):
        if message.key != Key.COMMAND or b'"tick":%d,' % number not in message.payload:
            return message.payload
        tick = json.loads(message.payload)
        return None if change(tick) is False else json.dumps(tick).encode()

    return of


@pytest.fixture(scope="module")
def shorter(calm, tmp_path_factory):
    """The same recording without tick 700."""
    path = tmp_path_factory.mktemp("shorter") / "recording.mcap"
    return rewritten(calm, path, tick_changed(700, lambda _: False))


def test_a_command_that_was_not_decided_so_is_named_with_its_tick(calm, tmp_path):
    def nudge(tick):
        tick["command"]["setpoint"]["yaw_rad"] += 1e-12

    replay = replay_commands(
        RecordedMission(rewritten(calm, tmp_path / "r.mcap", tick_changed(900, nudge)))
    )
    assert replay.ticks - replay.equal == 1
    assert replay.first.tick == 900
    assert replay.first.field == "setpoint.yaw_rad"
    assert "tick 900" in replay.first.words()


def test_a_tick_that_is_missing_is_named(shorter):
    replay = replay_commands(RecordedMission(shorter))
    assert replay.first.field == "tick"
    assert replay.first.tick == 701


def test_a_recording_cut_short_is_replayed_as_far_as_it_goes(calm, tmp_path):
    cut = tmp_path / "recording.mcap"
    data = calm.read_bytes()
    cut.write_bytes(data[: len(data) // 2])
    recorded = RecordedMission(tmp_path)
    replay = replay_commands(recorded)
    assert recorded.cut_short
    assert replay.equal == replay.ticks > 500


def test_another_setting_is_asked_on_the_same_observations(calm):
    settings = RecordedMission(calm).mission.settings
    wider = settings.model_copy(
        update={"guard": settings.guard.model_copy(update={"min_clearance_m": 11.5})}
    )
    replay = replay_commands(RecordedMission(calm), wider)
    assert replay.first is not None
    assert replay.refused_anew > replay.refused


def test_the_command_line_exits_with_the_first_difference(shorter):
    run = CliRunner().invoke(app, ["replay", str(shorter), "--only", "commands", "--json"])
    assert run.exit_code == 6
    assert "tick 701" in json.loads(run.output)["commands"]["first"]


def test_the_command_line_tells_what_another_setting_would_have_done(calm):
    options = ["--only", "commands", "--set", "guard.min_clearance_m=11.5"]
    run = CliRunner().invoke(app, ["replay", str(calm), *options])
    assert run.exit_code == 0
    assert re.search(r"guard +replaced \d+ setpoints, as flown 0", run.output)
    assert re.search(r"commands +\d+ of \d+ ticks equal", run.output)


@pytest.mark.parametrize(
    ("options", "words"),
    [(["--method", "nonsense"], "nonsense"), (["--set", "guard.nonsense=1"], "guard.nonsense")],
)
def test_what_cannot_be_asked_is_refused_in_one_sentence(calm, options, words):
    run = CliRunner().invoke(app, ["replay", str(calm), *options])
    assert run.exit_code == 2
    assert words in run.output


def test_what_is_no_recording_is_refused(tmp_path):
    with pytest.raises(NotARecording, match=r"holds no recording\.mcap"):
        RecordedMission(tmp_path)
    (tmp_path / "recording.mcap").write_bytes(b"nothing of the kind")
    with pytest.raises(NotARecording, match="no MCAP file"):
        _ = RecordedMission(tmp_path).mission


def test_the_first_difference_is_found_by_its_path():
    left = {"a": (1.0, float("nan")), "b": [{"c": 1}]}
    assert first_difference(left, {"a": (1.0, float("nan")), "b": [{"c": 1}]}) is None
    assert first_difference(left, {"a": (1.0, 2.0), "b": [{"c": 1}]})[0] == "a[1]"
    assert first_difference(left, {"a": (1.0, float("nan")), "b": [{"c": 2}]}) == ("b[0].c", 1, 2)
    assert first_difference((1,), (1, 2))[0] == ""
