import json
import math
from dataclasses import replace

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from config.presets import load_turbine
from config.settings import Settings
from mission.cli.main import app
from mission.flight.command import PhotoCommand
from mission.flight.observation import BladeTrack
from mission.records.files import MANIFEST, manifest
from mission.records.jpeg_segments import picture_data
from mission.records.locate import OutsidePicture, locate
from mission.records.photo_judge import blade_mask
from mission.records.photo_moment import BladeThen, PhotoMoment
from mission.records.photo_record import NotARecord, read_record
from mission.records.photo_view import view_of
from mission.records.photos import PhotoSite, store
from mission.records.verify import NoManifest, check_manifest
from mission.remote.messages import PhotoTakenMessage
from perception.blade_in_picture import outline_px

TURBINE = load_turbine("windpact-1.5")
HUB = np.array([0.0, 0.0, 84.0])
METRE = 15.0
SITE = PhotoSite("hill-3", TURBINE, (("A", "SN-17"),))


def a_moment(**changes):
    """12 m before the pressure side of a blade that hangs straight down, at metre 15."""
    axis = np.array([0.0, 0.0, -1.0])
    root = HUB + TURBINE.hub_radius_m * axis
    foot = root + METRE * axis
    track = BladeTrack(
        10.0, "A", tuple(foot.tolist()), (0.0, 0.0, -1.0), 12.0, 500.0, (0.0, 0.0, 0.0), 0.05
    )
    blade = BladeThen(
        HUB, np.array([0.0, 1.0, 0.0]), root, axis, 0.0, track, np.zeros(3), 0.04 * np.eye(3)
    )
    values = {
        "position_w": foot + np.array([0.0, -12.2, 0.1]),
        "quaternion_wb": (math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)),
        "velocity_w": np.array([0.0, 0.0, -1.0]),
        "gimbal_yaw_rad": math.pi / 2,
        "gimbal_pitch_rad": 0.0,
        "turning_rps": 0.01,
        "blade": blade,
    }
    return PhotoMoment(**(values | changes))


def taken(photo_id=7, **changes):
    values = {
        "command": PhotoCommand(photo_id, "A", "PS", 14.6, 12.0),
        "url": "http://camera/7.jpg",
        "index": 6,
        "stamp_s": 120.5,
        "utc": "2026-03-01T10:20:30.500Z",
        "position_w": (0.0, -12.2, 68.0),
        "quaternion_wb": (1.0, 0.0, 0.0, 0.0),
        "gimbal_yaw_rad": math.pi / 2,
        "gimbal_pitch_rad": 0.0,
        "foot_w": (0.0, 0.0, float(HUB[2]) - TURBINE.hub_radius_m - METRE),
        "distance_m": 12.0,
        "shutter_s": 1 / 2000,
    }
    return PhotoTakenMessage(**(values | changes))


def a_picture(grey=135):
    rng = np.random.default_rng(grey)
    picture = np.clip(rng.normal(grey, 6, (486, 648)), 0, 255).astype(np.uint8)
    return cv2.imencode(".jpg", picture)[1].tobytes()


@pytest.fixture
def photo(tmp_path):
    return store(a_picture(), taken(), SITE, Settings(), tmp_path, a_moment())


def test_the_metre_is_where_the_optical_axis_meets_the_blade(photo):
    record = photo.record
    assert record.kept, record.reason
    assert record.metre == pytest.approx(METRE, abs=0.01)
    assert record.metre_asked == 14.6
    assert 0.2 < record.metre_sigma_m < 0.3
    assert "_A_PS_015.0_" in record.file
    assert record.serial == "SN-17"
    assert read_record(photo.path) == record


def test_a_pixel_says_what_it_shows(photo):
    found = locate(photo.path, (324.0, 243.0), None)
    place = found.place
    assert (found.blade, found.side, found.serial) == ("A", "PS", "SN-17")
    assert place.shows == "blade"
    assert place.face == "PS"
    assert place.metre == pytest.approx(METRE, abs=0.01)
    assert place.mm_per_px == pytest.approx(11.8 / (20 / 7.6 * 648) * 1000, rel=0.03)
    # The blade hangs tip down: lower in the picture is farther out.
    assert locate(photo.path, (324.0, 400.0), None).place.metre > METRE + 0.8


def test_the_two_edges_are_named_and_lie_a_chord_apart(photo):
    view = read_record(photo.path).view
    outline = outline_px(view.blade(), view.camera(), view.lens(648, 486))
    near = outline[np.abs(outline[:, 1] - 243) < 60]
    left, right = float(near[:, 0].min()) + 4, float(near[:, 0].max()) - 4
    line = locate(photo.path, (left, 243.0), (right, 243.0))
    # Clockwise from upwind, hanging down: the blade moves to the viewer's left.
    assert (line.place.near, line.to.near) == ("leading edge", "trailing edge")
    chord = np.interp(METRE / TURBINE.blade_length_m, TURBINE.blade.span, TURBINE.blade.chord_m)
    assert line.length_mm == pytest.approx(chord * 1000, rel=0.1)
    assert not line.flat


def test_beside_the_blade_is_background_and_a_length_to_it_is_flat(photo):
    found = locate(photo.path, (324.0, 243.0), (640.0, 243.0))
    assert found.to.shows == "background"
    assert found.to.beside_px > 50
    assert found.to.metre is None
    assert found.flat
    mm_per_px = found.place.mm_per_px
    assert found.length_mm == pytest.approx(316 * mm_per_px, rel=0.02)


def test_the_mapping_in_the_sidecar_says_the_same(photo):
    sidecar = json.loads(photo.path.with_suffix(".json").read_text())
    grid = sidecar["view"]["mapping"]
    column, row = len(grid["columns_px"]) // 2, len(grid["rows_px"]) // 2
    pixel = (grid["columns_px"][column], grid["rows_px"][row])
    place = locate(photo.path, pixel, None).place
    assert grid["metre"][row][column] == pytest.approx(place.metre, abs=2e-3)
    assert grid["chord"][row][column] == pytest.approx(place.chord_share, abs=2e-3)
    assert grid["metre"][row][0] is None
    assert len(sidecar["view"]["mask_px"]) > 10


def test_mistakes_are_told_in_a_sentence(photo, tmp_path):
    with pytest.raises(OutsidePicture, match="648 x 486"):
        locate(photo.path, (700.0, 10.0), None)
    with pytest.raises(NotARecord, match="no photo"):
        locate(tmp_path / "nothing.jpg", (1.0, 1.0), None)
    with pytest.raises(NotARecord, match="does not end in"):
        locate(photo.path.with_suffix(".json"), (1.0, 1.0), None)
    lonely = tmp_path / "lonely.jpg"
    lonely.write_bytes(photo.path.read_bytes())
    with pytest.raises(NotARecord, match="no sidecar"):
        locate(lonely, (1.0, 1.0), None)
    lonely.with_suffix(".json").write_text("{}")
    with pytest.raises(NotARecord, match="not the sidecar"):
        locate(lonely, (1.0, 1.0), None)
    blind = store(a_picture(), taken(8), PhotoSite("x"), Settings(), tmp_path)
    with pytest.raises(NotARecord, match="where the blade is"):
        locate(blind.path, (1.0, 1.0), None)


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"velocity_w": np.array([0.0, 0.0, -3.5])}, "blurred by motion"),
        ({"turning_rps": 0.3}, "blurred by motion"),
        ({"gimbal_yaw_rad": math.pi / 2 + 0.13}, "aimed beside"),
        ({"gimbal_yaw_rad": math.pi / 2 + 0.5}, "not in the picture"),
        ({"gimbal_yaw_rad": -math.pi / 2}, "not in the picture"),
    ],
)
def test_a_photo_is_rejected_for_what_the_moment_tells(tmp_path, changes, reason):
    photo = store(a_picture(), taken(), SITE, Settings(), tmp_path, a_moment(**changes))
    assert not photo.record.kept
    assert reason in photo.record.reason


@pytest.mark.parametrize("turned_rad", [0.13, -0.13])
def test_a_row_of_a_blade_wider_than_the_picture_is_kept(tmp_path, turned_rad):
    wide = PhotoSite("hill-4", load_turbine("windpact-1.5", 2.0))
    moment = a_moment(gimbal_yaw_rad=math.pi / 2 + turned_rad)
    photo = store(a_picture(), taken(), wide, Settings(), tmp_path, moment)
    assert photo.record.aim_error > 0.3
    assert photo.record.blade_share > 0.5
    assert photo.record.kept


@pytest.mark.parametrize(("turned_rad", "kept"), [(0.01, True), (0.06, False)])
def test_a_blade_that_fills_little_of_the_picture_is_kept_where_its_outline_is_found(
    tmp_path, turned_rad, kept
):
    photos = Settings().photos.model_copy(update={"min_blade_share": 0.6})
    strict = Settings().model_copy(update={"photos": photos})
    photo = store(blade_turned_by(turned_rad), taken(), SITE, strict, tmp_path, a_moment())
    assert photo.record.kept is kept
    assert photo.record.blade_share < 0.6
    beside = store(a_picture(), taken(8), SITE, strict, tmp_path, a_moment())
    assert "not in the picture" in beside.record.reason


def blade_turned_by(turned_rad):
    """Return a picture that a camera took which really looks so far west of where it is said to."""
    plain = np.full((486, 648), 60, np.uint8)
    moment = a_moment(gimbal_yaw_rad=math.pi / 2 + turned_rad)
    really = view_of(moment, SITE.turbine, Settings(), plain)
    picture = np.where(blade_mask(really) > 0, 170, 60)
    noisy = np.clip(np.random.default_rng(3).normal(picture, 4), 0, 255).astype(np.uint8)
    return cv2.imencode(".jpg", noisy)[1].tobytes()


def test_the_picture_tells_how_far_beside_its_middle_the_blade_lies(tmp_path):
    # The blade shows to the east.
    jpeg = blade_turned_by(0.03)
    photo = store(jpeg, taken(), SITE, Settings(), tmp_path, a_moment())
    assert photo.beside_w == pytest.approx([0.03 * 12.2, 0.0, 0.0], abs=0.06)
    assert photo.record.aim_error == pytest.approx(0.03 * 12.2 / 4.6, abs=0.02)
    assert store(a_picture(), taken(8), SITE, Settings(), tmp_path, a_moment()).beside_w is None


def test_what_is_rejected_is_a_setting(tmp_path):
    strict = Settings().model_copy(
        update={"photos": Settings().photos.model_copy(update={"max_blur_px": 0.3})}
    )
    photo = store(a_picture(), taken(), SITE, strict, tmp_path, a_moment())
    assert "blurred" in photo.record.reason
    sharp = Settings().model_copy(
        update={"photos": Settings().photos.model_copy(update={"min_sharpness": 1e5})}
    )
    assert "sharp" in store(a_picture(), taken(), SITE, sharp, tmp_path, a_moment()).record.reason


def test_a_blade_that_cannot_be_placed_loses_no_photo(tmp_path):
    moment = a_moment()
    broken = replace(moment, blade=replace(moment.blade, drift_w=np.zeros(2)))
    photo = store(a_picture(), taken(), SITE, Settings(), tmp_path, broken)
    assert photo.path.is_file()
    assert photo.record.view.stations == ()
    assert photo.record.metre == 14.6


def test_the_same_picture_twice_is_rejected(tmp_path):
    seen = {}
    first = store(a_picture(), taken(1), SITE, Settings(), tmp_path, a_moment(), seen)
    second = store(a_picture(), taken(2), SITE, Settings(), tmp_path, a_moment(), seen)
    third = store(a_picture(136), taken(3), SITE, Settings(), tmp_path, a_moment(), seen)
    assert first.record.kept
    assert second.record.reason == "the same picture as photo 1"
    assert third.record.kept


def test_the_command_prints_words_or_json(photo):
    shown = CliRunner().invoke(app, ["locate", str(photo.path), "324", "243"])
    assert shown.exit_code == 0
    assert "blade A (SN-17), side PS" in shown.output
    assert "metre 15.0" in shown.output
    told = CliRunner().invoke(
        app, ["locate", str(photo.path), "324", "243", "--to", "330", "243", "--json"]
    )
    assert json.loads(told.stdout)["length_mm"] > 0
    sky = CliRunner().invoke(app, ["locate", str(photo.path), "640", "243"])
    assert "sky or background" in sky.output
    wrong = CliRunner().invoke(app, ["locate", str(photo.path), "3240", "243"])
    assert wrong.exit_code == 2


def test_verify_finds_what_was_changed_and_what_is_missing(photo, tmp_path):
    other = store(
        a_picture(140), taken(2, utc="2026-03-01T10:20:31.500Z"), SITE, Settings(), tmp_path
    )
    (tmp_path / MANIFEST).write_text(manifest(tmp_path, [photo.path, other.path]))
    assert CliRunner().invoke(app, ["verify", str(tmp_path)]).exit_code == 0
    photo.path.write_bytes(photo.path.read_bytes() + b" ")
    other.path.rename(other.path.with_name("renamed.jpg"))
    found = check_manifest(tmp_path)
    assert found.good == 0
    assert found.changed == (photo.record.file,)
    assert found.missing == (other.record.file,)
    assert found.unlisted == ("photos/A/PS/renamed.jpg",)
    assert CliRunner().invoke(app, ["verify", str(tmp_path)]).exit_code == 6


@pytest.mark.parametrize("text", [None, "no sum\n", f"{'0' * 64}  ../secret\n"])
def test_a_manifest_that_cannot_be_read_is_told(tmp_path, text):
    if text is not None:
        (tmp_path / MANIFEST).write_text(text)
    with pytest.raises(NoManifest):
        check_manifest(tmp_path)


def test_the_picture_data_of_a_stored_photo_is_the_camera_s(photo):
    assert picture_data(photo.path.read_bytes()) == picture_data(a_picture())
