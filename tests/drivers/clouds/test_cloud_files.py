"""Clouds of every format give the points that were written, by another's writer where there is one.

Each way in which a file can be wrong is one sentence with its name, what is wrong and a remedy.
"""

import contextlib
import struct
from pathlib import Path

import numpy as np
import pytest

from drivers.bad_file import BadFile
from drivers.clouds.read import READERS, read_cloud
from drivers.open3d_runtime import load_open3d

FOLDER = Path(__file__).parents[2] / "clouds"
WHOLE = {path.name: path.read_bytes() for path in FOLDER.iterdir() if path.suffix in READERS}


@pytest.fixture(scope="module")
def stored():
    with np.load(FOLDER / "ascent.npz") as file:
        return file["points"][file["time_s"] > 18.0]


@pytest.mark.parametrize("name", sorted(n for n in WHOLE if n.endswith((".pcd", ".ply"))))
def test_points_are_those_that_open3d_wrote(name, stored):
    cloud = read_cloud(FOLDER / name)
    assert cloud.points.dtype == np.float64
    assert np.allclose(cloud.points, stored, atol=2e-4)
    assert cloud.viewpoint is None
    assert not cloud.in_sensor_frame
    assert cloud.step_m < 1e-3


def test_an_archive_says_viewpoint_and_times(stored):
    cloud = read_cloud(FOLDER / "ascent.npz")
    assert cloud.points.shape == cloud.viewpoint.shape
    assert len(cloud.time_s) == len(cloud.points) > len(stored)


def test_a_compressed_file_with_runs_is_unpacked(tmp_path):
    """Even coordinates pack into references, long ones and overlapping ones among them."""
    open3d = load_open3d()
    rng = np.random.default_rng(0)
    points = np.repeat(rng.integers(0, 4, (40, 3)), rng.integers(1, 400, 40), axis=0)
    points = points.astype(np.float32)
    path = tmp_path / "runs.pcd"
    cloud = open3d.t.geometry.PointCloud(open3d.core.Tensor(points))
    open3d.t.io.write_point_cloud(str(path), cloud, compressed=True)
    assert path.stat().st_size < 0.2 * points.nbytes
    assert np.array_equal(read_cloud(path).points, points)


def test_other_columns_viewpoint_and_big_endian_are_understood(tmp_path):
    pcd = tmp_path / "wide.pcd"
    pcd.write_bytes(
        b"VERSION .7\nFIELDS intensity x _ y z\nSIZE 1 8 1 4 4\nTYPE U F U F F\nCOUNT 1 1 3 1 1\n"
        b"WIDTH 2\nHEIGHT 1\nVIEWPOINT 1 2 3 1 0 0 0\nDATA binary\n"
        + struct.pack("<Bd3xff", 7, 1.5, 2.5, 3.5)
        + struct.pack("<Bd3xff", 8, -1.0, 0.0, 9.0)
    )
    cloud = read_cloud(pcd)
    assert cloud.points.tolist() == [[1.5, 2.5, 3.5], [-1.0, 0.0, 9.0]]
    assert cloud.viewpoint.tolist() == [1, 2, 3]
    ply = tmp_path / "big.ply"
    ply.write_bytes(
        b"ply\nformat binary_big_endian 1.0\nelement vertex 1\nproperty double x\n"
        b"property float y\nproperty uchar red\nproperty short z\nend_header\n"
        + struct.pack(">dfBh", 1.5, 2.5, 255, -4)
    )
    assert read_cloud(ply).points.tolist() == [[1.5, 2.5, -4.0]]


def test_nan_in_a_text_is_a_point_that_was_not_measured(tmp_path):
    path = tmp_path / "nan.pcd"
    path.write_text(
        "FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 2\nHEIGHT 1\nDATA ascii\nnan nan nan\n1 2 3\n"
    )
    points = read_cloud(path).points
    assert np.isnan(points[0]).all()
    assert points[1].tolist() == [1, 2, 3]


def test_large_coordinates_in_32_bits_show_their_steps(tmp_path):
    path = tmp_path / "grid.npz"
    np.savez(path, points=np.full((9, 3), 5_900_000.0, np.float32))
    assert read_cloud(path).step_m == 0.5
    np.savez(path, points=np.full((9, 3), 5_900_000.0))
    assert read_cloud(path).step_m < 1e-6


def npz(**arrays):
    def write(path):
        np.savez(path, **arrays)

    return write


def content(name, change):
    return lambda path: path.write_bytes(change(WHOLE[name]))


def cut(share):
    return lambda whole: whole[: int(share * len(whole))]


BAD = [
    ("none.pcd", lambda path: None, "no such file"),
    ("folder.pcd", lambda path: path.mkdir(), "is a folder"),
    ("empty.ply", lambda path: path.write_bytes(b""), "is empty"),
    ("scan.las", lambda path: path.write_bytes(b"LASF"), "'.las' is not known"),
    ("scan", lambda path: path.write_bytes(b"LASF"), "has no ending"),
    ("half.npz", content("ascent.npz", cut(0.5)), "no whole NPZ archive"),
    ("text.npz", lambda path: path.write_bytes(b"hello"), "no whole NPZ archive"),
    ("xyz.npz", npz(xyz=np.zeros((9, 3))), "no array 'points' (it has xyz)"),
    ("flat.npz", npz(points=np.zeros((9, 4))), "of shape (9, 4)"),
    ("words.npz", npz(points=np.full((9, 3), "a")), "of shape (9, 3)"),
    ("objects.npz", npz(points=np.array([None])), "Python objects"),
    ("eye.npz", npz(points=np.zeros((9, 3)), viewpoint=np.zeros(2)), "'viewpoint' is float64"),
    ("time.npz", npz(points=np.zeros((9, 3)), time_s=np.zeros(8)), "'time_s' is float64"),
    ("half.pcd", content("hover-binary.pcd", cut(0.5)), "announces 3260 points and holds 16"),
    ("half2.pcd", content("hover-ascii.pcd", cut(0.5)), "announces 3260 points and holds 16"),
    ("half3.pcd", content("hover-compressed.pcd", cut(0.9)), "cut off or damaged"),
    (
        "dirt.pcd",
        content("hover-compressed.pcd", lambda w: w[:400] + b"\xff" * 90 + w[490:]),
        "cut off or damaged",
    ),
    ("other.pcd", content("hover-binary.ply", lambda w: w), "no DATA line"),
    ("type.pcd", content("hover-binary.pcd", lambda w: w.replace(b"TYPE F", b"TYPE Q")), "Q"),
    (
        "columns.pcd",
        content("hover-binary.pcd", lambda w: w.replace(b"FIELDS x y z", b"FIELDS u v w")),
        "no column x nor y nor z (it has u, v, w)",
    ),
    (
        "word.pcd",
        content("hover-ascii.pcd", lambda w: w.replace(b"-2.559500694", b"abc")),
        "no numbers",
    ),
    ("half.ply", content("hover-binary.ply", cut(0.5)), "announces 3260 points and holds 16"),
    ("half2.ply", content("hover-ascii.ply", cut(0.5)), "announces 3260 points and holds 16"),
    ("other.ply", content("hover-binary.pcd", lambda w: w), "no PLY header"),
    (
        "type.ply",
        content("hover-binary.ply", lambda w: w.replace(b"float z", b"quad z")),
        "PLY header cannot be used (quad)",
    ),
    (
        "columns.ply",
        content("hover-binary.ply", lambda w: w.replace(b"float z", b"float w")),
        "no column z (it has x, y, w)",
    ),
    ("half.lvx2", content("hover.lvx2", cut(0.0002)), "ends within its"),
    ("lvx1.lvx2", content("hover.lvx2", lambda w: w[:16] + b"\1\1" + w[18:]), "LVX of version 1"),
    ("other.lvx2", content("hover.pcap", lambda w: w), "its signature is missing"),
    (
        "dirt.lvx2",
        content("hover.lvx2", lambda w: w[:92] + bytes(24) + w[116:]),
        "no frame begins at byte 92",
    ),
    (
        "dirt2.lvx2",
        content("hover.lvx2", lambda w: w[:116] + bytes(27) + w[143:]),
        "the frame at byte 92 is damaged",
    ),
    ("none.lvx2", content("hover.lvx2", lambda w: w[:92]), "holds no points"),
    ("other.pcap", content("hover.lvx2", lambda w: w), "neither PCAP nor PCAPNG"),
    ("head.pcap", content("hover.pcap", lambda w: w[:24]), "no point packet of a MID-360 among 0"),
]


@pytest.mark.parametrize(("name", "make", "told"), BAD, ids=[name for name, _, _ in BAD])
def test_a_bad_file_is_one_sentence(tmp_path, name, make, told):
    path = tmp_path / name
    make(path)
    with pytest.raises(BadFile) as refused:
        read_cloud(path)
    sentence = str(refused.value)
    assert sentence.startswith(f"{path}: ")
    assert told in sentence
    assert "; " in sentence
    assert "\n" not in sentence


@pytest.mark.parametrize("name", sorted(WHOLE))
def test_no_damage_is_answered_with_another_error(tmp_path, name):
    """Cut off anywhere, or with bytes overwritten: a cloud or a sentence, nothing else."""
    rng = np.random.default_rng(len(name))
    whole = np.frombuffer(WHOLE[name], np.uint8)
    path = tmp_path / name
    for _ in range(25):
        damaged = whole[: rng.integers(1, len(whole))].copy()
        places = rng.integers(0, min(len(damaged), 600), 4)
        damaged[places] = rng.integers(0, 256, 4)
        path.write_bytes(damaged.tobytes())
        with contextlib.suppress(BadFile):
            assert read_cloud(path).points.shape[1] == 3
