import cv2
import numpy as np
import piexif
import pytest

from config.sensors import Camera
from config.settings import Settings
from mission.flight.command import PhotoCommand
from mission.records.jpeg_segments import NotAJpeg, picture_data, take_apart
from mission.records.photo_metadata import exif_bytes, with_metadata, xmp_packet
from mission.records.photos import PhotoSite, store
from mission.remote.messages import PhotoTakenMessage

CAMERA_XMP = (
    b'<?xpacket begin="" id="W5M0MpCehiHzreSzNTczkc9d"?><x:xmpmeta xmlns:x="adobe:ns:meta/">'
    b'<rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">'
    b'<rdf:Description rdf:about="" xmlns:drone-dji="http://www.dji.com/drone-dji/1.0/" '
    b'drone-dji:CamReverse="0"/></rdf:RDF></x:xmpmeta><?xpacket end="w"?>'
)


def a_picture():
    picture = np.random.default_rng(1).normal(130, 6, (486, 648)).astype(np.uint8)
    return cv2.imencode(".jpg", picture)[1].tobytes()


@pytest.fixture
def record(tmp_path):
    taken = PhotoTakenMessage(
        command=PhotoCommand(7, "B", "SS", 21.25, 12.0), url="http://camera/7.jpg", index=6,
        stamp_s=120.5, utc="2026-03-01T10:20:30.500Z", position_w=(10.0, 20.0, 80.0),
        quaternion_wb=(1.0, 0.0, 0.0, 0.0), gimbal_yaw_rad=0.0, gimbal_pitch_rad=0.1,
        foot_w=(22.2, 20.0, 81.2), distance_m=12.0, ev=0.33, shutter_s=1 / 2000,
        latitude_deg=-47.5, longitude_deg=8.25, altitude_m=580.0,
    )  # fmt: skip
    return store(a_picture(), taken, PhotoSite("t-1"), Settings(), tmp_path).record


def test_photogrammetry_finds_lens_angles_and_accuracy(record):
    text = xmp_packet(record, Camera()).decode()
    assert 'Camera:Yaw="90.000"' in text
    # Level is 90 degrees from straight down.
    assert 'Camera:Pitch="95.730"' in text
    assert 'Camera:PerspectiveFocalLength="20.0000"' in text
    assert 'Camera:PrincipalPoint="3.80000,2.85000"' in text
    assert 'Camera:PerspectiveDistortion="0,0,0,0,0"' in text
    assert 'Camera:GPSXYAccuracy="0.286"' in text


def test_the_pixel_s_size_follows_from_exif(record):
    exif = piexif.load(exif_bytes(record, Camera()))["Exif"]
    across, unit = exif[piexif.ExifIFD.FocalPlaneXResolution], 10.0
    assert exif[piexif.ExifIFD.FocalPlaneResolutionUnit] == 3
    assert record.width_px / (across[0] / across[1]) * unit == pytest.approx(7.6)
    assert exif[piexif.ExifIFD.SubSecTimeOriginal] == b"500"
    assert exif[piexif.ExifIFD.FocalLengthIn35mmFilm] == 91


def test_what_the_camera_wrote_is_kept_and_completed(record):
    own = piexif.dump(
        {
            "0th": {piexif.ImageIFD.Make: b"Maker", piexif.ImageIFD.Model: b"M-1"},
            "Exif": {piexif.ExifIFD.ISOSpeedRatings: 200, piexif.ExifIFD.MakerNote: b"secret"},
        }
    )
    jpeg = take_apart(a_picture()).joined(own, CAMERA_XMP)
    stored = with_metadata(jpeg, record, Camera(maker="other"))
    parts = take_apart(stored)
    exif = piexif.load(parts.exif)
    assert exif["0th"][piexif.ImageIFD.Make] == b"Maker"
    assert exif["Exif"][piexif.ExifIFD.ISOSpeedRatings] == 200
    assert exif["Exif"][piexif.ExifIFD.MakerNote] == b"secret"
    assert exif["GPS"][piexif.GPSIFD.GPSLatitudeRef] == b"S"
    assert b'drone-dji:CamReverse="0"' in parts.xmp
    assert b"drone-dji:GimbalYawDegree" not in parts.xmp
    assert b'bs:Blade="B"' in parts.xmp
    assert stored.count(b"Exif\0\0") == 1
    assert stored.count(b"http://ns.adobe.com/xap/1.0/\0") == 1
    assert picture_data(stored) == picture_data(jpeg)


def test_a_broken_exif_block_is_replaced(record):
    jpeg = take_apart(a_picture()).joined(b"Exif\0\0MM\0\x2a\xff\xff\xff\xff", b"")
    exif = piexif.load(with_metadata(jpeg, record, Camera(maker="other")))
    assert exif["0th"][piexif.ImageIFD.Make] == b"other"


def test_other_segments_stay_where_they_are(record):
    jpeg = a_picture()
    at = jpeg.index(b"\xff\xdb")
    noted = jpeg[:at] + b"\xff\xe2\x00\x06ICC!" + jpeg[at:]
    stored = with_metadata(noted, record, Camera())
    assert b"\xff\xe2\x00\x06ICC!" in stored
    assert picture_data(stored) == picture_data(jpeg)


@pytest.mark.parametrize("data", [b"", b"PNG", b"\x89PNG\r\n"])
def test_what_is_no_jpeg_is_refused(record, data):
    with pytest.raises(NotAJpeg):
        with_metadata(data, record, Camera())
