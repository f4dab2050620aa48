"""Poses as text: TUM, or CSV by its names; what is wrong is said with its line."""

from pathlib import Path

import numpy as np
import pytest

from drivers.bad_file import BadFile
from drivers.clouds.pose_file import read_poses

FOLDER = Path(__file__).parents[2] / "clouds"
ROOT_HALF = 0.7071068


def test_tum_and_csv_hold_the_same(tmp_path):
    tum, csv = read_poses(FOLDER / "hover.tum"), read_poses(FOLDER / "hover.csv")
    assert len(tum) == len(csv) > 10
    for a, b in zip(tum, csv, strict=True):
        assert np.allclose(a.position_w, b.position_w)
        assert np.allclose(a.quaternion_wb, b.quaternion_wb)


def test_the_quaternion_is_turned_to_w_first_and_speeds_are_those_between(tmp_path):
    path = tmp_path / "poses.csv"
    path.write_text(
        "qw, qx, qy, qz, z, y, x, time\n"
        f"{ROOT_HALF},0,0,{ROOT_HALF},3,2,1,10.5\n{ROOT_HALF},0,0,{ROOT_HALF},3,2,2,11.0\n"
    )
    first, last = read_poses(path)
    assert first.stamp_s == 10.5
    assert first.position_w.tolist() == [1, 2, 3]
    assert first.quaternion_wb == pytest.approx([ROOT_HALF, 0, 0, ROOT_HALF])
    assert last.velocity_w == pytest.approx([2.0, 0, 0])


def test_order_is_put_right_and_repeated_times_count_once(tmp_path):
    path = tmp_path / "poses.txt"
    path.write_text("2 0 0 0 0 0 0 1\n1 0 0 0 0 0 0 1\n\n# a remark\n2 9 9 9 0 0 0 1\n")
    assert [pose.stamp_s for pose in read_poses(path)] == [1.0, 2.0]


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("# nothing\n", "holds no poses"),
        ("1 2 3\n", "line 1 has 3 columns, not 8"),
        ("1 0 0 0 0 0 0 1\n2 0 0 0 0 0 1\n", "line 2 has 7 columns"),
        ("1 0 0 0 0 0 0 1\na b c\n", "line 2 holds words"),
        ("t_s,x,y,z,roll,pitch,yaw\n", "has no column qx, qy, qz, qw"),
        ("1 0 0 0 0 0 0 2\n", "length 2.00, not 1"),
        ("1 nan 0 0 0 0 0 1\n", "pose 1 is not finite"),
    ],
)
def test_what_is_wrong_is_said(tmp_path, text, told):
    path = tmp_path / "poses.txt"
    path.write_text(text)
    with pytest.raises(BadFile, match=told) as refused:
        read_poses(path)
    assert str(path) in str(refused.value)
