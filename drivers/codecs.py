"""What sensor data looks like on the bus: Protobuf Foxglove messages.

The same bytes go unchanged into the recording. Message time is mission time.
"""

from __future__ import annotations

import struct

import cv2
import numpy as np
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.PackedElementField_pb2 import PackedElementField
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from google.protobuf.message import DecodeError

from perception.values import Frame, Scan

POINT_CLOUD = "application/protobuf;foxglove.PointCloud"
COMPRESSED_IMAGE = "application/protobuf;foxglove.CompressedImage"

_POINT = np.dtype(
    [("xyz", "<f4", 3), ("age", "<f4"), ("reflectivity", "u1"), ("tag", "u1"), ("pad", "u1", 2)]
)
_FIELDS = (
    ("x", 0, PackedElementField.FLOAT32),
    ("y", 4, PackedElementField.FLOAT32),
    ("z", 8, PackedElementField.FLOAT32),
    ("age_s", 12, PackedElementField.FLOAT32),
    ("reflectivity", 16, PackedElementField.UINT8),
    ("tag", 17, PackedElementField.UINT8),
)
_XYZ = np.dtype("<f4")
_SEQUENCE = struct.Struct("<QI")
_MOST_US = 2**32 - 1


class BadMessage(ValueError):
    """Bytes on the bus that are not what their key promises."""


def _stamped(message: PointCloud | CompressedImage, stamp_s: float) -> None:
    nanoseconds = round(stamp_s * 1e9)
    message.timestamp.seconds, message.timestamp.nanos = divmod(nanoseconds, 1_000_000_000)


def _stamp_of(message: PointCloud | CompressedImage) -> float:
    return float(message.timestamp.seconds) + float(message.timestamp.nanos) * 1e-9


def _beside(attachment: bytes | None) -> tuple[int, int]:
    """Return the two numbers that come beside a scan or a frame; zeros where nothing came."""
    if attachment is None:
        return 0, 0
    if len(attachment) != _SEQUENCE.size:
        raise BadMessage(f"attachment of {len(attachment)} bytes, expected {_SEQUENCE.size}")
    first, second = _SEQUENCE.unpack(attachment)
    return int(first), int(second)


def encode_scan(scan: Scan) -> tuple[bytes, bytes]:
    """Return (PointCloud bytes, attachment with sequence and lost packets)."""
    points = np.zeros(len(scan.points_l), _POINT)
    points["xyz"] = scan.points_l
    points["age"] = scan.age_s
    points["reflectivity"] = scan.reflectivity
    points["tag"] = scan.tag
    cloud = PointCloud(frame_id="lidar", point_stride=_POINT.itemsize, data=points.tobytes())
    for name, offset, kind in _FIELDS:
        cloud.fields.add(name=name, offset=offset, type=kind)
    cloud.pose.orientation.w = 1.0
    _stamped(cloud, scan.stamp_s)
    return cloud.SerializeToString(), _SEQUENCE.pack(scan.sequence, scan.lost_packets)


def decode_scan(payload: bytes, attachment: bytes | None) -> Scan:
    """Return the scan of a message. Raises `BadMessage`."""
    try:
        cloud = PointCloud.FromString(payload)
    except DecodeError as error:
        raise BadMessage(f"not a foxglove.PointCloud: {error}") from error
    if cloud.point_stride != _POINT.itemsize or len(cloud.data) % _POINT.itemsize:
        raise BadMessage(f"point stride {cloud.point_stride}, expected {_POINT.itemsize}")
    sequence, lost = _beside(attachment)
    points = np.frombuffer(cloud.data, _POINT)
    return Scan(
        stamp_s=_stamp_of(cloud),
        sequence=sequence,
        points_l=np.ascontiguousarray(points["xyz"]),
        age_s=np.ascontiguousarray(points["age"]),
        reflectivity=np.ascontiguousarray(points["reflectivity"]),
        tag=np.ascontiguousarray(points["tag"]),
        lost_packets=lost,
    )


def encode_points(
    points_w: np.ndarray[tuple[int, ...], np.dtype[np.float32]], stamp_s: float
) -> bytes:
    """Return the PointCloud bytes of (N, 3) points in the world."""
    data = np.ascontiguousarray(points_w, _XYZ).tobytes()
    cloud = PointCloud(frame_id="world", point_stride=12, data=data)
    for name, offset, kind in _FIELDS[:3]:
        cloud.fields.add(name=name, offset=offset, type=kind)
    cloud.pose.orientation.w = 1.0
    _stamped(cloud, stamp_s)
    return cloud.SerializeToString()


def decode_points(
    payload: bytes,
) -> tuple[np.ndarray[tuple[int, ...], np.dtype[np.float32]], float]:
    """Return ((N, 3) points, stamp) of a message. Raises `BadMessage`."""
    try:
        cloud = PointCloud.FromString(payload)
    except DecodeError as error:
        raise BadMessage(f"not a foxglove.PointCloud: {error}") from error
    if cloud.point_stride != 12 or len(cloud.data) % 12:
        raise BadMessage(f"point stride {cloud.point_stride}, expected 12")
    return np.frombuffer(cloud.data, _XYZ).reshape(-1, 3), _stamp_of(cloud)


def encode_frame(frame: Frame, quality: int = 80) -> tuple[bytes, bytes]:
    """Return (CompressedImage bytes with a grey JPEG, attachment with sequence and age)."""
    _, jpeg = cv2.imencode(".jpg", frame.grey, [cv2.IMWRITE_JPEG_QUALITY, quality])
    image = CompressedImage(frame_id="camera", data=jpeg.tobytes(), format="jpeg")
    _stamped(image, frame.stamp_s)
    age_us = min(max(round(frame.age_s * 1e6), 0), _MOST_US)
    return image.SerializeToString(), _SEQUENCE.pack(frame.sequence, age_us)


def _image(payload: bytes) -> CompressedImage:
    try:
        return CompressedImage.FromString(payload)
    except DecodeError as error:
        raise BadMessage(f"not a foxglove.CompressedImage: {error}") from error


def jpeg_of(payload: bytes) -> bytes:
    """Return the JPEG of a frame's message as it came. Raises `BadMessage`."""
    return bytes(_image(payload).data)


def frame_times(payload: bytes, attachment: bytes | None) -> tuple[float, float]:
    """Return when a frame was taken and when decoded (mission time). Raises `BadMessage`."""
    image = _image(payload)
    _, age_us = _beside(attachment)
    return _stamp_of(image), _stamp_of(image) + age_us * 1e-6


def decode_frame(payload: bytes, attachment: bytes | None) -> Frame:
    """Return the frame of a message. Raises `BadMessage`."""
    image = _image(payload)
    data = np.frombuffer(image.data, np.uint8)
    grey = cv2.imdecode(data, cv2.IMREAD_GRAYSCALE) if len(data) else None
    if grey is None:
        raise BadMessage("the picture cannot be decoded")
    sequence, age_us = _beside(attachment)
    return Frame(_stamp_of(image), sequence, np.asarray(grey, np.uint8), age_us * 1e-6)
