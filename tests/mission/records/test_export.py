import csv
import json
import math

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from config.presets import load_turbine
from config.settings import Settings
from mission.cli.main import app
from mission.flight.command import PhotoCommand
from mission.records.export import CannotExport, export
from mission.records.files import MANIFEST, manifest
from mission.records.photo_moment import BladeThen, PhotoMoment
from mission.records.photos import PhotoSite, store
from mission.records.verify import check_manifest
from mission.remote.messages import PhotoTakenMessage
from perception.geometry import rotation_from_quaternion

TURBINE = load_turbine("windpact-1.5")
HUB = np.array([0.0, 0.0, 84.0])
DOWN = np.array([0.0, 0.0, -1.0])


def keep(folder, photo_id, metre, side="PS", velocity_mps=0.5, settings=None):
    """Store a photo of a hanging blade at a metre, from 12 m before it."""
    root = HUB + TURBINE.hub_radius_m * DOWN
    foot = root + metre * DOWN
    moment = PhotoMoment(
        foot + np.array([0.0, -12.2, 0.1]),
        (math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)),
        velocity_mps * DOWN,
        math.pi / 2,
        0.0,
        0.01,
        BladeThen(
            HUB, np.array([0.0, 1.0, 0.0]), root, DOWN, 0.0, None, np.zeros(3), 0.04 * np.eye(3)
        ),
    )
    taken = PhotoTakenMessage(
        command=PhotoCommand(photo_id, "A", side, metre, 12.0), url="", index=photo_id,
        stamp_s=100.0 + photo_id, utc=f"2026-03-01T10:20:{photo_id:02d}.500Z",
        position_w=(0.0, 0.0, 0.0), quaternion_wb=(1.0, 0.0, 0.0, 0.0), gimbal_yaw_rad=math.pi / 2,
        gimbal_pitch_rad=0.0, foot_w=tuple(foot.tolist()), distance_m=12.0, shutter_s=1 / 2000,
        latitude_deg=54.0, longitude_deg=6.5, altitude_m=100.0,
    )  # fmt: skip
    rng = np.random.default_rng(photo_id)
    picture = np.clip(rng.normal(135, 6, (486, 648)), 0, 255).astype(np.uint8)
    jpeg = cv2.imencode(".jpg", picture)[1].tobytes()
    site = PhotoSite("hill-3", TURBINE)
    return store(jpeg, taken, site, settings or Settings(), folder, moment).record


@pytest.fixture
def mission(tmp_path):
    folder = tmp_path / "mission"
    for photo_id, metre in ((1, 10.0), (2, 12.0), (3, 14.0)):
        assert keep(folder, photo_id, metre).kept
    keep(folder, 4, 20.0, side="SS")
    assert not keep(folder, 5, 16.0, velocity_mps=4.0).kept
    return folder


def test_photos_are_sorted_and_indexed(mission, tmp_path):
    done = export(mission, tmp_path / "out")
    assert (done.photos, done.poses) == (4, 4)
    rows = list(csv.DictReader((tmp_path / "out" / "index.csv").read_text().splitlines()))
    assert [(row["side"], float(row["metre"])) for row in rows] == [
        ("PS", pytest.approx(10.0, abs=0.05)),
        ("PS", pytest.approx(12.0, abs=0.05)),
        ("PS", pytest.approx(14.0, abs=0.05)),
        ("SS", pytest.approx(20.0, abs=0.05)),
    ]
    assert all((tmp_path / "out" / row["file"]).is_file() for row in rows)
    points = json.loads((tmp_path / "out" / "index.geojson").read_text())["features"]
    assert points[0]["geometry"]["coordinates"] == [6.5, 54.0, 100.0]
    assert check_manifest(tmp_path / "out").changed == ()


def test_rejected_photos_come_only_when_asked_for(mission, tmp_path):
    assert export(mission, tmp_path / "all", rejected=True).photos == 5


def test_colmap_gets_world_to_camera(mission, tmp_path):
    export(mission, tmp_path / "out")
    (camera,) = (tmp_path / "out/colmap/cameras.txt").read_text().splitlines()[1:]
    assert camera.split()[1:4] == ["OPENCV", "648", "486"]
    assert float(camera.split()[4]) == pytest.approx(20 / 7.6 * 648)
    lines = (tmp_path / "out/colmap/images.txt").read_text().splitlines()[1:]
    first = lines[0].split()
    assert lines[1] == ""
    turn = rotation_from_quaternion([float(value) for value in first[1:5]])
    centre = -turn.T @ np.array([float(value) for value in first[5:8]])
    root = HUB + TURBINE.hub_radius_m * DOWN
    np.testing.assert_allclose(centre, root + 10.0 * DOWN + [0.0, -12.0, 0.0], atol=0.01)
    # The optical axis looks north at the blade.
    np.testing.assert_allclose(turn.T @ [0.0, 0.0, 1.0], [0.0, 1.0, 0.0], atol=1e-6)
    assert (tmp_path / "out" / first[9]).is_file()


def test_a_lens_with_a_third_term_is_written_whole(tmp_path):
    camera = Settings().camera.model_copy(update={"distortion": (-0.1, 0.02, 0.001, 0.0, 0.01)})
    keep(tmp_path / "m", 1, 10.0, settings=Settings().model_copy(update={"camera": camera}))
    export(tmp_path / "m", tmp_path / "out", rejected=True)
    line = (tmp_path / "out/colmap/cameras.txt").read_text().splitlines()[1]
    assert line.split()[1] == "FULL_OPENCV"
    assert line.split()[-8:] == ["-0.1", "0.02", "0.001", "0", "0.01", "0", "0", "0"]


def test_metashape_gets_places_and_angles(mission, tmp_path):
    export(mission, tmp_path / "out")
    row = (tmp_path / "out/metashape.csv").read_text().splitlines()[1].split(",")
    assert [float(value) for value in row[1:7]] == pytest.approx([6.5, 54.0, 100.0, 0.0, 90.0, 0.0])


def test_too_little_overlap_is_said(mission, tmp_path):
    done = export(mission, tmp_path / "out")
    # 2 m apart in pictures that show 3.3 m of the blade.
    assert done.overlap == pytest.approx(1 - 2.0 / 3.3, abs=0.06)
    assert "at least 60%" in done.words
    assert "tracking.overlap=0.7" in done.words
    assert done.words[1:] in (tmp_path / "out" / "README.txt").read_text()


def test_photos_that_were_changed_since_they_were_stored_are_named(mission, tmp_path):
    paths = [path for path in mission.rglob("*") if path.is_file()]
    (mission / MANIFEST).write_text(manifest(mission, paths))
    assert export(mission, tmp_path / "good").doubts == ""
    photos = sorted((mission / "photos").glob("**/*.jpg"))
    photos[1].write_bytes(photos[0].read_bytes())
    done = export(mission, tmp_path / "out", rejected=True)
    name = photos[1].relative_to(mission).as_posix()
    assert done.changed == (name,)
    assert f"hanged since they were stored: {name}" in (tmp_path / "out/README.txt").read_text()
    shown = CliRunner().invoke(
        app, ["export", str(mission), "--to", str(tmp_path / "shown"), "--rejected"]
    )
    assert shown.exit_code == 0
    assert name in shown.stdout


def test_a_mission_without_sums_is_exported_with_a_word_of_it(mission, tmp_path):
    assert "not known" in export(mission, tmp_path / "out").doubts


def test_mistakes_are_told(mission, tmp_path):
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "a").touch()
    with pytest.raises(CannotExport, match="empty"):
        export(mission, tmp_path / "full")
    with pytest.raises(CannotExport, match="no photos"):
        export(tmp_path / "nothing", tmp_path / "out")
    shown = CliRunner().invoke(app, ["export", str(mission), "--to", str(tmp_path / "full")])
    assert shown.exit_code == 2
    told = CliRunner().invoke(
        app, ["export", str(mission), "--to", str(tmp_path / "out"), "--json"]
    )
    assert json.loads(told.stdout)["photos"] == 4
