"""A recording of a MID-360 that is no mission's, replayed by TUM poses and by a PX4 log."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from drivers.clouds.pose_file import read_poses
from drivers.frames import swap_attitude, swap_enu_ned
from mission.cli.main import app
from tests.clouds.make_ulog import ulog

FOLDER = Path(__file__).parents[2] / "clouds"
TRUTH = json.loads((FOLDER / "truth.json").read_text())
KNOWN = ("--turbine", TRUTH["turbine"], "--scale", str(TRUTH["scale"]))


def replay(*words):
    return CliRunner().invoke(app, ["replay", *(str(word) for word in words)])


@pytest.fixture(scope="module")
def px4_log(tmp_path_factory):
    """The poses of the recording as the autopilot would have logged them."""
    poses = read_poses(FOLDER / "hover.tum")
    places = [
        (round(1e6 * p.stamp_s), swap_enu_ned(tuple(p.position_w)), swap_enu_ned((0.0, 0.0, 0.0)))
        for p in poses
    ]
    turns = [(round(1e6 * p.stamp_s), swap_attitude(tuple(p.quaternion_wb))) for p in poses]
    path = tmp_path_factory.mktemp("px4") / "flight.ulg"
    path.write_bytes(ulog(places, turns))
    return path


def test_the_workers_say_what_they_would_have_said_in_flight(px4_log):
    half_a_second = ("--set", "estimation.accumulate_s=0.5", "--json")
    found = [
        json.loads(replay(FOLDER / name, "--poses", poses, *KNOWN, *half_a_second).stdout)
        for name, poses in (("hover.lvx2", FOLDER / "hover.tum"), ("hover.lvx2", px4_log))
    ]
    for one in found:
        assert one["scans"] >= 11
        assert one["points"] > 3000
        assert one["rotor"]["stop_angle_deg"] == pytest.approx(TRUTH["stop_angle_deg"], abs=1.0)
        assert one["nearest_m"]["min"] > 10.0
        assert len(one["estimates"]) >= 2
    by_tum, by_log = found
    assert by_log["nearest_m"]["min"] == pytest.approx(by_tum["nearest_m"]["min"], abs=0.01)
    assert by_log["rotor"]["stop_angle_deg"] == pytest.approx(
        by_tum["rotor"]["stop_angle_deg"], abs=0.05
    )


def test_what_is_wrong_is_a_sentence():
    alone = replay(FOLDER / "hover.lvx2")
    assert alone.exit_code == 2
    assert "add --poses FILE" in alone.stderr
    unknown = replay(FOLDER / "hover.lvx2", "--poses", FOLDER / "hover.tum", "--turbine", "x")
    assert unknown.exit_code == 2
    missing = replay(FOLDER / "hover.lvx2", "--poses", FOLDER / "none.ulg")
    assert missing.exit_code == 2
    assert "no such file" in missing.stderr
