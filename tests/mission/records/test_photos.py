import json

import cv2
import numpy as np
import piexif
import pytest

from config.settings import Settings
from mission.flight.command import PhotoCommand
from mission.records.jpeg_segments import NotAJpeg
from mission.records.photos import PhotoLost, PhotoSite, fetch, store
from mission.remote.messages import PhotoTakenMessage


def a_picture(grey=135, width=1296, height=972):
    rng = np.random.default_rng(1)
    picture = np.clip(rng.normal(grey, 6, (height, width)), 0, 255).astype(np.uint8)
    return cv2.imencode(".jpg", picture)[1].tobytes()


def taken(**changes):
    values = {
        "command": PhotoCommand(7, "B", "SS", 21.25, 12.0),
        "url": "http://camera/7.jpg",
        "index": 6,
        "stamp_s": 120.5,
        "utc": "2026-03-01T10:20:30.500Z",
        "position_w": (10.0, 20.0, 80.0),
        "quaternion_wb": (1.0, 0.0, 0.0, 0.0),
        "gimbal_yaw_rad": 0.0,
        "gimbal_pitch_rad": 0.1,
        "foot_w": (22.2, 20.0, 81.2),
        "distance_m": 12.0,
        "ev": 0.33,
        "shutter_s": 1 / 2000,
        "latitude_deg": -47.5,
        "longitude_deg": 8.25,
        "altitude_m": 580.0,
    }
    return PhotoTakenMessage(**(values | changes))


def test_a_photo_knows_its_blade_side_and_metre(tmp_path):
    photo = store(a_picture(), taken(), PhotoSite("t-1"), Settings(), tmp_path)
    assert photo.record.kept
    assert photo.record.file == "photos/B/SS/t-1_B_SS_021.2_20260301T102030.500Z.jpg"
    sidecar = json.loads((tmp_path / photo.record.file).with_suffix(".json").read_text())
    assert (sidecar["blade"], sidecar["side"], sidecar["metre"]) == ("B", "SS", 21.25)
    assert sidecar["still_index"] == 6
    # 12 m through a 20 mm lens on 7.6 mm: 0.88 mm a pixel at 5184 pixels.
    assert sidecar["gsd_full_mm"] == pytest.approx(0.88, abs=0.01)
    assert sidecar["gsd_mm"] == pytest.approx(4 * sidecar["gsd_full_mm"])


def test_heights_count_from_the_take_off_wherever_the_autopilots_origin_lies(tmp_path):
    moved = store(a_picture(), taken(height_m=95.0), PhotoSite("t-1"), Settings(), tmp_path)
    assert moved.record.relative_altitude_m == pytest.approx(95.0)


def test_exif_says_where_when_and_how(tmp_path):
    photo = store(a_picture(), taken(), PhotoSite("t-1"), Settings(), tmp_path)
    exif = piexif.load(str(tmp_path / photo.record.file))
    assert exif["GPS"][piexif.GPSIFD.GPSLatitudeRef] == b"S"
    degrees = [a / b for a, b in exif["GPS"][piexif.GPSIFD.GPSLatitude]]
    assert degrees[0] + degrees[1] / 60 + degrees[2] / 3600 == pytest.approx(47.5, abs=1e-6)
    assert exif["Exif"][piexif.ExifIFD.DateTimeOriginal] == b"2026:03:01 10:20:30"
    assert exif["Exif"][piexif.ExifIFD.ExposureTime] == (1, 2000)
    assert b"blade B, SS, 21.2 m" in exif["0th"][piexif.ImageIFD.ImageDescription]
    data = (tmp_path / photo.record.file).read_bytes()
    assert b'drone-dji:GimbalPitchDegree="+5.73"' in data
    assert b'drone-dji:GimbalYawDegree="+90.00"' in data
    assert b'bs:Blade="B"' in data


def test_the_picture_itself_is_not_altered(tmp_path):
    jpeg = a_picture()
    photo = store(jpeg, taken(), PhotoSite("t-1"), Settings(), tmp_path)
    stored = (tmp_path / photo.record.file).read_bytes()
    # From the quantisation tables on, it is the camera's file byte for byte.
    assert stored.endswith(jpeg[jpeg.index(b"\xff\xdb") :])
    np.testing.assert_array_equal(
        cv2.imdecode(np.frombuffer(stored, np.uint8), 0),
        cv2.imdecode(np.frombuffer(jpeg, np.uint8), 0),
    )


@pytest.mark.parametrize(
    ("jpeg", "changes", "reason"),
    [
        (a_picture(255), {}, "overexposed"),
        (a_picture(0), {}, "black"),
        (a_picture(), {"foot_w": (10.0, 60.0, 80.0)}, "not in the picture"),
        (a_picture(), {"foot_w": (-22.0, 20.0, 80.0)}, "not in the picture"),
    ],
)
def test_a_photo_that_shows_nothing_is_rejected_with_the_reason(tmp_path, jpeg, changes, reason):
    photo = store(jpeg, taken(**changes), PhotoSite("t-1"), Settings(), tmp_path)
    assert not photo.record.kept
    assert reason in photo.record.reason
    assert (tmp_path / photo.record.file).exists()


def test_a_photo_out_of_the_wanted_range_is_kept_and_says_so(tmp_path):
    photo = store(a_picture(70), taken(), PhotoSite("t-1"), Settings(), tmp_path)
    assert photo.record.kept
    assert photo.record.exposure_in_range is False


@pytest.mark.parametrize("data", [b"", b"no picture", b"\xff\xd8\xff\xd9"])
def test_what_is_no_picture_is_refused(tmp_path, data):
    with pytest.raises(NotAJpeg):
        store(data, taken(), PhotoSite("t-1"), Settings(), tmp_path)


@pytest.mark.parametrize("url", ["file:///etc/hosts", "", "ftp://camera/1.jpg"])
def test_only_http_is_fetched(url):
    with pytest.raises(PhotoLost, match="only http"):
        fetch(url)


def test_a_camera_that_does_not_answer_is_named():
    with pytest.raises(PhotoLost, match=r"127\.0\.0\.1:9"):
        fetch("http://127.0.0.1:9/1.jpg")
