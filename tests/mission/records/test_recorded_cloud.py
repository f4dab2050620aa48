"""Points of a moving sensor are put where it was when each was measured, or left out and told."""

import numpy as np
import pytest

from config.sensors import Lidar
from drivers.bad_file import BadFile
from drivers.livox.lvx2 import write_lvx2
from drivers.livox.packets import POINTS_PER_PACKET
from drivers.livox.recording import RecordedPacket
from drivers.simulated.mid360_wire import pack_points
from mission.records.recorded_cloud import load_cloud
from perception.geometry import lidar_in_body, quaternion_from_rotation, rotation_from_euler

MARK_W = np.array([30.0, 4.0, 12.0])
LIDAR = Lidar(nose_down_deg=20.0, offset_m=(0.2, 0.0, 0.1))
SECONDS = 4.0


def pose_at(t):
    """A vehicle that flies north at 3 m/s and turns at 10 deg/s."""
    place = np.array([0.0, 3.0 * t, 10.0])
    return place, rotation_from_euler(0.02, -0.03, np.radians(10.0 * t))


def seen_at(t, mounting, offset):
    place, body = pose_at(t)
    return ((MARK_W - place) @ body - offset) @ mounting


def lines(times, separator=" "):
    rows = []
    for t in times:
        place, body = pose_at(t)
        w, x, y, z = quaternion_from_rotation(body)
        rows.append(separator.join(f"{v:.7f}" for v in (100.0 + t, *place, x, y, z, w)))
    return "\n".join(rows) + "\n"


def packets(mounting, offset):
    made = []
    for k in range(round(SECONDS * 100)):
        t = 0.01 * k
        points = np.tile(seen_at(t, mounting, offset), (POINTS_PER_PACKET, 1)).astype(np.float32)
        flags = np.zeros(POINTS_PER_PACKET, np.uint8)
        packed = pack_points(points, flags + 40, flags, np.ones(POINTS_PER_PACKET, bool))
        stamp = round((100.0 + t) * 1e9)
        made.append(RecordedPacket(stamp, 475_000, k, 1, packed.tobytes()))
    return made


@pytest.fixture
def recording(tmp_path):
    path = tmp_path / "a.lvx2"
    write_lvx2(path, packets(lidar_in_body(20.0), np.array(LIDAR.offset_m)))
    poses = tmp_path / "a.tum"
    poses.write_text(lines(np.arange(0.0, SECONDS + 0.1, 0.05)))
    return path, poses


def test_every_point_lands_on_what_was_seen(recording):
    placed = load_cloud(recording[0], LIDAR, poses_path=recording[1])
    assert len(placed.cloud.points_w) == SECONDS * 100 * POINTS_PER_PACKET
    # 3 m/s and 10 deg/s over the half millisecond of a packet, and millimetres on the wire.
    assert np.abs(placed.cloud.points_w - MARK_W).max() < 0.02
    moved = np.ptp(placed.cloud.origins_w[:, 1])
    assert moved == pytest.approx(3.0 * SECONDS, abs=0.2)
    assert placed.notes == ()


def test_a_mounting_in_the_file_comes_before_the_settings(tmp_path, recording):
    mounting, offset = rotation_from_euler(0.0, np.radians(-35.0), 0.3), np.array([0, 0.4, -0.2])
    path = tmp_path / "b.lvx2"
    write_lvx2(path, packets(mounting, offset))
    data = bytearray(path.read_bytes())
    angles = np.degrees([0.0, np.radians(-35.0), 0.3])
    data[29 + 38 : 29 + 63] = b"\1" + np.array([*angles, *offset], "<f4").tobytes()
    path.write_bytes(data)
    placed = load_cloud(path, LIDAR, poses_path=recording[1])
    assert np.abs(placed.cloud.points_w - MARK_W).max() < 0.02


def test_points_in_a_gap_of_the_poses_are_left_out_and_told(recording):
    times = np.concatenate([np.arange(0, 1.0, 0.05), np.arange(2.5, SECONDS + 0.1, 0.05)])
    recording[1].write_text(lines(times))
    placed = load_cloud(recording[0], LIDAR, poses_path=recording[1])
    share = len(placed.cloud.points_w) / (SECONDS * 100 * POINTS_PER_PACKET)
    assert share == pytest.approx(1.0 - 1.35 / SECONDS, abs=0.02)
    assert np.abs(placed.cloud.points_w - MARK_W).max() < 0.3
    assert "34% of the points have no pose" in placed.notes[0]


def test_clocks_that_do_not_meet_are_told_with_both_spans(recording):
    path, poses = recording
    poses.write_text(lines(np.arange(50.0, 60.0, 0.5)))
    with pytest.raises(BadFile, match=r"from 150\.000 to 159\.500 s, the points from 100\.000"):
        load_cloud(path, LIDAR, poses_path=poses)
    shifted = load_cloud(path, LIDAR, poses_path=poses, time_offset_s=50.0)
    assert len(shifted.cloud.points_w) > 0


def test_a_viewpoint_given_comes_before_the_file_s(tmp_path):
    path = tmp_path / "a.npz"
    np.savez(path, points=np.ones((5, 3)), viewpoint=np.zeros(3))
    given = load_cloud(path, LIDAR, viewpoint_w=np.array([1.0, 2, 3]))
    assert given.cloud.origins_w.tolist() == [1, 2, 3]
    assert load_cloud(path, LIDAR).cloud.origins_w.tolist() == [0, 0, 0]
