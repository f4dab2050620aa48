"""Poses out of a PX4 log: frames, clocks, and logs that cannot be used."""

import math

import numpy as np
import pytest

from drivers.bad_file import BadFile
from drivers.clouds.pose_file import read_poses
from tests.clouds.make_ulog import ulog

HALF = math.sqrt(0.5)
NORTH_UP_10 = (5.0, 2.0, -10.0)
#: Of a vehicle that heads east: FRD turned by 90 deg about down.
HEADS_EAST = (HALF, 0.0, 0.0, HALF)


def a_log(utc_us=None):
    places = [(1_000_000 + 20_000 * k, NORTH_UP_10, (1.0, 0.0, -0.5)) for k in range(50)]
    turns = [(1_004_000 + 10_000 * k, HEADS_EAST) for k in range(100)]
    return ulog(places, turns, utc_us)


@pytest.fixture
def written(tmp_path):
    def write(data, name="flight.ulg"):
        path = tmp_path / name
        path.write_bytes(data)
        return path

    return write


def test_position_speed_and_attitude_come_in_our_frames(written):
    poses = read_poses(written(a_log()))
    assert len(poses) == 50
    assert poses[0].position_w == pytest.approx((2.0, 5.0, 10.0))
    assert poses[0].velocity_w == pytest.approx((0.0, 1.0, 0.5))
    # Forward, left, up along east, north, up: nothing is turned.
    assert np.abs(poses[0].quaternion_wb) == pytest.approx((1.0, 0.0, 0.0, 0.0), abs=1e-6)
    assert [pose.stamp_s for pose in poses[:2]] == pytest.approx([1.0, 1.02])


def test_stamps_are_utc_where_gps_tells_it(written):
    utc = [(500_000, 0), (900_000, 1_772_360_000_900_000), (1_100_000, 1_772_360_001_100_000)]
    poses = read_poses(written(a_log(utc)))
    assert poses[0].stamp_s == pytest.approx(1_772_360_001.0, abs=1e-3)


def test_a_log_that_is_cut_short_is_read_as_far_as_it_goes(written):
    data = a_log()
    assert 10 < len(read_poses(written(data[: len(data) // 2]))) < 50


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"not a log", "is not a PX4 log"),
        (ulog([], [(1, HEADS_EAST)]), "holds no vehicle_local_position"),
        (ulog([(1, NORTH_UP_10, (0, 0, 0))], []), "holds no vehicle_attitude"),
        (a_log().replace(b"float x;", b"float X;"), "has no field x"),
        (a_log().replace(b"float[4] q;", b"float[4] Q;"), "has no field q"),
        (
            ulog([(1, NORTH_UP_10, (0, 0, 0))], [(9_000_000, HEADS_EAST)]),
            "no position with an attitude",
        ),
    ],
)
def test_what_is_wrong_is_said(written, data, words):
    with pytest.raises(BadFile, match=words):
        read_poses(written(data))


def test_damaged_logs_give_poses_or_a_sentence(written):
    data, draw = a_log([(1, 2)]), np.random.default_rng(5)
    read = 0
    for _ in range(150):
        damaged = bytearray(data)
        for at in draw.integers(0, len(data), 12):
            damaged[at] = draw.integers(0, 256)
        try:
            poses = read_poses(written(bytes(damaged)))
        except BadFile:
            continue
        read += 1
        assert all(np.isfinite(pose.position_w).all() for pose in poses)
    assert read > 20
