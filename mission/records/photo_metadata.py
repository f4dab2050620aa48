"""EXIF and XMP of a photo, and the sidecar: which blade, side and metre it shows.

The picture data is not touched: metadata segments are inserted into the JPEG as it came.
"""

from __future__ import annotations

import math
from fractions import Fraction
from xml.sax.saxutils import quoteattr

import piexif
from pydantic import BaseModel, ConfigDict

from config.sensors import Camera

_XMP_HEADER = b"http://ns.adobe.com/xap/1.0/\0"


class NotAJpeg(ValueError):
    """What the camera delivered is not a JPEG picture."""


class PhotoRecord(BaseModel):
    """The sidecar of one photo: everything known of it."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    version: int = 1
    photo_id: int
    still_index: int
    file: str
    """Relative to the mission folder."""
    kept: bool
    reason: str
    """Why it was rejected; empty when kept."""
    marks: tuple[str, ...]
    turbine: str
    blade: str
    side: str
    metre: float
    utc: str
    mission_s: float
    distance_m: float | None
    gsd_mm: float | None
    """Of the file as stored."""
    gsd_full_mm: float | None
    """At the camera's full size."""
    width_px: int
    height_px: int
    focal_px: float
    position_w: tuple[float, float, float]
    """Optical centre's body position, local ENU, metres."""
    quaternion_wb: tuple[float, float, float, float]
    gimbal_yaw_deg: float
    """Compass heading of the optical axis."""
    gimbal_pitch_deg: float
    flight_yaw_deg: float
    latitude_deg: float | None
    longitude_deg: float | None
    altitude_m: float | None
    relative_altitude_m: float
    ev: float | None
    shutter_s: float | None
    mean_grey: float | None
    """Of the blade in the stored picture."""
    exposure_in_range: bool | None
    sharpness: float | None


def _rational(value: float, limit: int = 1_000_000) -> tuple[int, int]:
    fraction = Fraction(value).limit_denominator(limit)
    return fraction.numerator, fraction.denominator


def _degrees(value: float) -> tuple[tuple[int, int], tuple[int, int], tuple[int, int]]:
    value = abs(value)
    minutes = (value % 1) * 60
    return (int(value), 1), (int(minutes), 1), _rational((minutes % 1) * 60, 10_000)


def exif_bytes(record: PhotoRecord, camera: Camera) -> bytes:
    """Return the EXIF block of a photo."""
    moment = record.utc[:19].replace("-", ":").replace("T", " ")
    exif: dict[int, object] = {
        piexif.ExifIFD.DateTimeOriginal: moment,
        piexif.ExifIFD.OffsetTimeOriginal: "+00:00",
        piexif.ExifIFD.FocalLength: _rational(camera.focal_length_mm),
        piexif.ExifIFD.PixelXDimension: record.width_px,
        piexif.ExifIFD.PixelYDimension: record.height_px,
    }
    if record.shutter_s:
        exif[piexif.ExifIFD.ExposureTime] = _rational(record.shutter_s)
    if record.ev is not None:
        exif[piexif.ExifIFD.ExposureBiasValue] = _rational(record.ev, 100)
    gps: dict[int, object] = {}
    if record.latitude_deg is not None and record.longitude_deg is not None:
        gps = {
            piexif.GPSIFD.GPSVersionID: (2, 3, 0, 0),
            piexif.GPSIFD.GPSLatitudeRef: "N" if record.latitude_deg >= 0 else "S",
            piexif.GPSIFD.GPSLatitude: _degrees(record.latitude_deg),
            piexif.GPSIFD.GPSLongitudeRef: "E" if record.longitude_deg >= 0 else "W",
            piexif.GPSIFD.GPSLongitude: _degrees(record.longitude_deg),
            piexif.GPSIFD.GPSImgDirectionRef: "T",
            piexif.GPSIFD.GPSImgDirection: _rational(record.gimbal_yaw_deg % 360, 1000),
        }
        if record.altitude_m is not None:
            gps[piexif.GPSIFD.GPSAltitudeRef] = 0 if record.altitude_m >= 0 else 1
            gps[piexif.GPSIFD.GPSAltitude] = _rational(abs(record.altitude_m), 1000)
    words = f"turbine {record.turbine}, blade {record.blade}, {record.side}, {record.metre:.1f} m"
    zeroth = {
        piexif.ImageIFD.ImageDescription: words,
        piexif.ImageIFD.Software: "bladescout",
        piexif.ImageIFD.DateTime: moment,
    }
    return bytes(piexif.dump({"0th": zeroth, "Exif": exif, "GPS": gps}))


def xmp_packet(record: PhotoRecord) -> bytes:
    """Return the XMP packet: the names drone photogrammetry reads, and our own."""
    drone: dict[str, str] = {
        "GimbalYawDegree": f"{_signed(record.gimbal_yaw_deg):+.2f}",
        "GimbalPitchDegree": f"{record.gimbal_pitch_deg:+.2f}",
        "GimbalRollDegree": "+0.00",
        "FlightYawDegree": f"{_signed(record.flight_yaw_deg):+.2f}",
        "RelativeAltitude": f"{record.relative_altitude_m:+.2f}",
    }
    if record.altitude_m is not None:
        drone["AbsoluteAltitude"] = f"{record.altitude_m:+.2f}"
    own: dict[str, object] = {
        "Turbine": record.turbine,
        "Blade": record.blade,
        "Side": record.side,
        "Metre": f"{record.metre:.2f}",
        "Distance": record.distance_m,
        "GSD": record.gsd_mm,
        "Kept": record.kept,
    }
    pairs = [f"drone-dji:{name}={quoteattr(value)}" for name, value in drone.items()]
    pairs += [f"bs:{name}={quoteattr(str(v))}" for name, v in own.items() if v is not None]
    text = (
        '<?xpacket begin="\ufeff" id="W5M0MpCehiHzreSzNTczkc9d"?>'
        '<x:xmpmeta xmlns:x="adobe:ns:meta/">'
        '<rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">'
        '<rdf:Description rdf:about="" xmlns:drone-dji="http://www.dji.com/drone-dji/1.0/" '
        f'xmlns:bs="https://bladescout.invalid/ns/1.0/" {" ".join(pairs)}/>'
        '</rdf:RDF></x:xmpmeta><?xpacket end="w"?>'
    )
    return text.encode()


def _signed(heading_deg: float) -> float:
    return math.remainder(heading_deg, 360.0)


def with_metadata(jpeg: bytes, record: PhotoRecord, camera: Camera) -> bytes:
    """Return the JPEG with EXIF and XMP inserted; the picture data is byte for byte the same.

    Raises `NotAJpeg`.
    """
    if not jpeg.startswith(b"\xff\xd8"):
        raise NotAJpeg("the file does not begin as a JPEG")
    body = jpeg[2:]
    # A JFIF header stays first, as readers expect it.
    head = b""
    if body.startswith(b"\xff\xe0"):
        length = 2 + int.from_bytes(body[2:4], "big")
        head, body = body[:length], body[length:]
    return (
        b"\xff\xd8"
        + head
        + _segment(exif_bytes(record, camera))
        + _segment(_XMP_HEADER + xmp_packet(record))
        + body
    )


def _segment(content: bytes) -> bytes:
    return b"\xff\xe1" + (len(content) + 2).to_bytes(2, "big") + content
