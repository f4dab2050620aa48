"""Data packets, byte by byte."""

import struct
import zlib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from drivers.livox.packets import (
    DataType,
    Header,
    ImuSample,
    decode_imu,
    decode_points,
    read_header,
)

HEADER_TYPE_1 = bytes.fromhex(
    "00 6405 8e12 6000 ffff 00 01 00 000000000000000000000000 00000000 15cd5b0700000000"
)
# x 1.000 m, y -2.000 m, z 0.500 m, reflectivity 100, tag 0x04 (maybe fog)
POINT_TYPE_1 = bytes.fromhex("e8030000 30f8ffff f4010000 64 04")
NO_RETURN = bytes.fromhex("00000000 00000000 00000000 00 00")
OUTSIDE_WINDOW = bytes.fromhex("00000000 00000000 00000000 3c 00")
POINT_TYPE_2 = bytes.fromhex("6400 38ff 3200 64 04")
# 10 m at 60 deg from straight up, 90 deg to the left
POINT_TYPE_3 = bytes.fromhex("10270000 7017 2823 64 04")


def payload(*points):
    return np.frombuffer(b"".join(points), np.uint8).reshape(1, -1)


def test_the_header_of_a_point_packet_is_read_field_by_field():
    packet = HEADER_TYPE_1 + POINT_TYPE_1 * 96
    assert len(packet) == 1380
    assert read_header(packet, 1380) == Header(1, 96, 65535, 123456789, 475_000)


@pytest.mark.parametrize(
    ("kind", "point", "expected"),
    [
        (1, POINT_TYPE_1, (1.0, -2.0, 0.5)),
        (2, POINT_TYPE_2, (1.0, -2.0, 0.5)),
        (3, POINT_TYPE_3, (0.0, 8.6603, 5.0)),
    ],
)
def test_a_point_of_each_type_is_decoded_to_metres(kind, point, expected):
    points = decode_points(payload(point), kind)
    np.testing.assert_allclose(points.points_l, [expected], atol=1e-4)
    assert points.points_l.dtype == np.float32
    assert (points.reflectivity[0], points.tag[0]) == (100, 4)


def test_rays_without_return_are_left_out_and_the_place_of_the_others_is_known():
    points = decode_points(payload(NO_RETURN, POINT_TYPE_1, OUTSIDE_WINDOW, POINT_TYPE_1), 1)
    assert points.place.tolist() == [1, 3]


@pytest.mark.parametrize(("kind", "size"), [(1, 1380), (2, 804), (3, 996)])
def test_a_full_packet_of_each_type_has_its_published_size(kind, size):
    header = struct.pack("<BHHHHBBB12xIQ", 0, size, 4750, 96, 3, 0, kind, 0, 0, 5)
    assert read_header(header + bytes(size - 36), size) is not None
    assert read_header(header + bytes(size - 35), size + 1) is None


def test_a_check_sum_is_verified_only_where_there_is_one():
    packet = bytearray(HEADER_TYPE_1 + POINT_TYPE_1 * 96)
    packet[24:28] = zlib.crc32(packet[28:]).to_bytes(4, "little")
    assert read_header(packet, len(packet)) is not None
    packet[24] ^= 1
    assert read_header(packet, len(packet)) is None


def imu_packet(values=(0.1, -0.2, 0.3, 0.0, 0.0, 1.0)):
    tail = struct.pack("<Q6f", 42, *values)
    return struct.pack("<BHHHHBBB12xI", 0, 60, 0, 1, 7, 0, 0, 0, zlib.crc32(tail)) + tail


def test_an_imu_packet_is_60_bytes_and_its_check_sum_counts():
    packet = imu_packet()
    assert len(packet) == 60
    sample = decode_imu(packet)
    assert isinstance(sample, ImuSample)
    assert sample.stamp_ns == 42
    assert sample.acc_g == (0.0, 0.0, 1.0)
    assert decode_imu(packet[:-1] + b"\x7f") is None


@pytest.mark.parametrize("bad", [float("nan"), float("inf")])
def test_an_imu_sample_that_is_no_number_is_refused(bad):
    assert decode_imu(imu_packet((0, 0, bad, 0, 0, 1))) is None


@given(st.binary(max_size=1500), st.integers(-1, 1600))
def test_no_header_whatever_raises(data, size):
    read_header(data, size)
    decode_imu(data)


@given(st.binary(min_size=36, max_size=60), st.sampled_from([60, 804, 996, 1380]))
def test_a_right_size_with_wild_content_does_not_raise(data, size):
    packet = data.ljust(size, b"\xa5")
    read_header(packet, size)
    decode_imu(packet)


@settings(max_examples=50)
@given(arrays(np.uint8, st.tuples(st.integers(0, 3), st.integers(0, 70))), st.integers(0, 9))
def test_no_points_whatever_raise_and_what_comes_out_is_finite(data, kind):
    points = decode_points(data, kind)
    if points is not None:
        assert kind in set(DataType) - {DataType.IMU}
        assert np.isfinite(points.points_l).all()
        assert len(points.points_l) == len(points.tag) == len(points.reflectivity)
