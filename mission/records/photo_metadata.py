"""EXIF and XMP of a photo: which blade, side and metre it shows, from where, how exposed.

Metadata is inserted into the JPEG as it came; the picture data stays byte for byte the same. What
the camera itself wrote is kept and completed. Three XMP vocabularies: `drone-dji`, which drone
tools read; Pix4D's `Camera`, which photogrammetry reads; and our own, `bs`.
"""

from __future__ import annotations

import math
from fractions import Fraction
from xml.sax.saxutils import quoteattr

import piexif

from config.sensors import Camera
from mission.records.jpeg_segments import take_apart
from mission.records.photo_record import PhotoRecord

_NAMESPACES = {
    "drone-dji": "http://www.dji.com/drone-dji/1.0/",
    "Camera": "http://pix4d.com/camera/1.0/",
    "bs": "https://bladescout.invalid/ns/1.0/",
}
_FULL_FRAME_MM = 43.2666
_CENTIMETRE = 3
_RDF_END = b"</rdf:RDF>"

Tags = dict[int, object]


def with_metadata(jpeg: bytes, record: PhotoRecord, camera: Camera) -> bytes:
    """Return the JPEG with EXIF and XMP; the picture data is byte for byte the same.

    Raises `NotAJpeg`.
    """
    parts = take_apart(jpeg)
    exif = exif_bytes(record, camera, parts.exif)
    return parts.joined(exif, xmp_packet(record, camera, parts.xmp))


def exif_bytes(record: PhotoRecord, camera: Camera, before: bytes = b"") -> bytes:
    """Return the EXIF block of a photo; ``before``: the camera's own, which is completed."""
    blocks = _loaded(before)
    own = blocks["0th"].get(piexif.ImageIFD.Make) is not None
    moment = record.utc[:19].replace("-", ":").replace("T", " ")
    words = f"turbine {record.turbine}, blade {record.blade}, {record.side}, {record.metre:.1f} m"
    zeroth: Tags = {
        piexif.ImageIFD.ImageDescription: words.encode(),
        piexif.ImageIFD.Software: b"bladescout",
        piexif.ImageIFD.DateTime: moment.encode(),
    }
    if not own and camera.maker:
        zeroth[piexif.ImageIFD.Make] = camera.maker.encode()
    if not own and camera.model:
        zeroth[piexif.ImageIFD.Model] = camera.model.encode()
    blocks["0th"] |= zeroth
    blocks["Exif"] |= _exposure_tags(record, camera, moment)
    blocks["GPS"] |= _gps_tags(record)
    return bytes(piexif.dump(blocks))


def _loaded(before: bytes) -> dict[str, Tags]:
    """Return the camera's own EXIF, empty where there is none or it cannot be read."""
    empty: dict[str, Tags] = {"0th": {}, "Exif": {}, "GPS": {}, "1st": {}}
    if not before:
        return empty
    try:
        loaded = piexif.load(before)
        piexif.dump(loaded)  # what cannot be written again is not taken over
    except Exception:  # noqa: BLE001 - the library raises whatever a broken block makes it trip on
        return empty
    kept = {name: dict(loaded.get(name) or {}) for name in empty}
    if loaded.get("thumbnail"):
        kept["thumbnail"] = loaded["thumbnail"]
    return kept


def _exposure_tags(record: PhotoRecord, camera: Camera, moment: str) -> Tags:
    diagonal_mm = math.hypot(camera.sensor_width_mm, camera.sensor_height_mm)
    ifd = piexif.ExifIFD
    tags: Tags = {
        ifd.DateTimeOriginal: moment.encode(),
        ifd.SubSecTimeOriginal: (record.utc[20:].rstrip("Z") or "0").encode(),
        ifd.OffsetTimeOriginal: b"+00:00",
        ifd.FocalLength: _rational(camera.focal_length_mm),
        ifd.FocalLengthIn35mmFilm: round(camera.focal_length_mm * _FULL_FRAME_MM / diagonal_mm),
        # Pixels a centimetre of the sensor: from these photogrammetry knows the pixel's size.
        ifd.FocalPlaneXResolution: _rational(record.width_px / camera.sensor_width_mm * 10),
        ifd.FocalPlaneYResolution: _rational(record.height_px / camera.sensor_height_mm * 10),
        ifd.FocalPlaneResolutionUnit: _CENTIMETRE,
        ifd.PixelXDimension: record.width_px,
        ifd.PixelYDimension: record.height_px,
    }
    if record.distance_m is not None:
        tags[ifd.SubjectDistance] = _rational(record.distance_m, 1000)
    if record.shutter_s:
        tags[ifd.ExposureTime] = _rational(record.shutter_s)
    if record.ev is not None:
        tags[ifd.ExposureBiasValue] = _rational(record.ev, 100)
    return tags


def _gps_tags(record: PhotoRecord) -> Tags:
    if record.latitude_deg is None or record.longitude_deg is None:
        return {}
    ifd = piexif.GPSIFD
    hours, minutes, seconds = record.utc[11:13], record.utc[14:16], record.utc[17:].rstrip("Z")
    tags: Tags = {
        ifd.GPSVersionID: (2, 3, 0, 0),
        ifd.GPSLatitudeRef: b"N" if record.latitude_deg >= 0 else b"S",
        ifd.GPSLatitude: _degrees(record.latitude_deg),
        ifd.GPSLongitudeRef: b"E" if record.longitude_deg >= 0 else b"W",
        ifd.GPSLongitude: _degrees(record.longitude_deg),
        ifd.GPSMapDatum: b"WGS-84",
        ifd.GPSDateStamp: record.utc[:10].replace("-", ":").encode(),
        ifd.GPSTimeStamp: ((int(hours), 1), (int(minutes), 1), _rational(float(seconds), 1000)),
        ifd.GPSImgDirectionRef: b"T",
        ifd.GPSImgDirection: _rational(record.gimbal_yaw_deg % 360, 1000),
    }
    if record.altitude_m is not None:
        tags[ifd.GPSAltitudeRef] = 0 if record.altitude_m >= 0 else 1
        tags[ifd.GPSAltitude] = _rational(abs(record.altitude_m), 1000)
    if record.gps_sigma_m is not None:
        tags[ifd.GPSHPositioningError] = _rational(_horizontal(record.gps_sigma_m), 1000)
    return tags


def xmp_packet(record: PhotoRecord, camera: Camera, before: bytes = b"") -> bytes:
    """Return the XMP packet; ``before``: the camera's own, into which ours is put."""
    tables = {
        "drone-dji": _drone(record),
        "Camera": _photogrammetry(record, camera),
        "bs": _own(record),
    }
    # A vocabulary in which the camera itself speaks is left to it.
    said = [name for name in tables if name != "bs" and f"xmlns:{name}=".encode() in before]
    spaces = {name: uri for name, uri in _NAMESPACES.items() if name not in said}
    names = " ".join(f'xmlns:{name}="{uri}"' for name, uri in spaces.items())
    pairs = " ".join(
        f"{space}:{name}={quoteattr(value)}"
        for space in spaces
        for name, value in tables[space].items()
    )
    description = f'<rdf:Description rdf:about="" {names} {pairs}/>'.encode()
    if before.count(_RDF_END) == 1:
        return before.replace(_RDF_END, description + _RDF_END)
    return (
        '<?xpacket begin="\ufeff" id="W5M0MpCehiHzreSzNTczkc9d"?>'
        '<x:xmpmeta xmlns:x="adobe:ns:meta/">'
        '<rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">'.encode()
        + description
        + b'</rdf:RDF></x:xmpmeta><?xpacket end="w"?>'
    )


def _drone(record: PhotoRecord) -> dict[str, str]:
    tags = {
        "GimbalYawDegree": f"{_signed(record.gimbal_yaw_deg):+.2f}",
        "GimbalPitchDegree": f"{record.gimbal_pitch_deg:+.2f}",
        "GimbalRollDegree": "+0.00",
        "FlightYawDegree": f"{_signed(record.flight_yaw_deg):+.2f}",
        "RelativeAltitude": f"{record.relative_altitude_m:+.2f}",
    }
    for name, value in (
        ("FlightPitchDegree", record.flight_pitch_deg),
        ("FlightRollDegree", record.flight_roll_deg),
        ("AbsoluteAltitude", record.altitude_m),
    ):
        if value is not None:
            tags[name] = f"{value:+.2f}"
    for name, value in (
        ("GpsLatitude", record.latitude_deg),
        ("GpsLongitude", record.longitude_deg),
    ):
        if value is not None:
            tags[name] = f"{value:+.8f}"
    return tags


def _photogrammetry(record: PhotoRecord, camera: Camera) -> dict[str, str]:
    """Return Pix4D's tags: lens in millimetres, angles (pitch 0: straight down), errors."""
    scale = camera.sensor_width_mm / record.width_px
    tags = {
        "Yaw": f"{record.gimbal_yaw_deg % 360:.3f}",
        "Pitch": f"{record.gimbal_pitch_deg + 90:.3f}",
        "Roll": "0.000",
        "ModelType": "perspective",
        "PerspectiveFocalLength": f"{camera.focal_length_mm:.4f}",
    }
    if record.gps_sigma_m is not None:
        tags["GPSXYAccuracy"] = f"{_horizontal(record.gps_sigma_m):.3f}"
        tags["GPSZAccuracy"] = f"{record.gps_sigma_m:.3f}"
    view = record.view
    if view is not None:
        k1, k2, p1, p2, k3 = view.distortion
        tags |= {
            "PrincipalPoint": f"{view.matrix[0][2] * scale:.5f},{view.matrix[1][2] * scale:.5f}",
            "PerspectiveDistortion": f"{k1:g},{k2:g},{k3:g},{p1:g},{p2:g}",
            "IMUYawAccuracy": f"{view.yaw_sigma_deg:.2f}",
            "IMUPitchAccuracy": f"{view.pitch_sigma_deg:.2f}",
        }
    return tags


def _own(record: PhotoRecord) -> dict[str, str]:
    numbers = {
        "Metre": (record.metre, 2),
        "MetreSigma": (record.metre_sigma_m, 2),
        "Distance": (record.distance_m, 2),
        "GSD": (record.gsd_mm, 3),
        "GSDFullSize": (record.gsd_full_mm, 3),
    }
    tags = {
        "Turbine": record.turbine,
        "Blade": record.blade,
        "Serial": record.serial,
        "Side": record.side,
        "Kept": str(record.kept),
        "Reason": record.reason,
    }
    tags |= {name: f"{one:.{k}f}" for name, (one, k) in numbers.items() if one is not None}
    return {name: value for name, value in tags.items() if value}


def _rational(value: float, limit: int = 1_000_000) -> tuple[int, int]:
    fraction = Fraction(value).limit_denominator(limit)
    return fraction.numerator, fraction.denominator


def _degrees(value: float) -> tuple[tuple[int, int], tuple[int, int], tuple[int, int]]:
    value = abs(value)
    minutes = (value % 1) * 60
    return (int(value), 1), (int(minutes), 1), _rational((minutes % 1) * 60, 10_000)


def _horizontal(sigma_m: float) -> float:
    """Return the error in the plane of one that is so large along each axis."""
    return math.sqrt(2) * sigma_m


def _signed(heading_deg: float) -> float:
    return math.remainder(heading_deg, 360.0)
