import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.codecs import (
    BadMessage,
    decode_frame,
    decode_points,
    decode_scan,
    encode_frame,
    encode_points,
    encode_scan,
    frame_times,
)
from perception.values import Frame, Scan


def a_scan(count=1000, seed=0):
    rng = np.random.default_rng(seed)
    return Scan(
        stamp_s=12.345678,
        sequence=77,
        points_l=rng.normal(size=(count, 3)).astype(np.float32),
        age_s=rng.uniform(0, 0.1, count).astype(np.float32),
        reflectivity=rng.integers(0, 256, count).astype(np.uint8),
        tag=rng.integers(0, 64, count).astype(np.uint8),
        lost_packets=3,
    )


@pytest.mark.parametrize("count", [0, 1, 20_000])
def test_a_scan_comes_back_as_it_went(count):
    scan = a_scan(count)
    back = decode_scan(*encode_scan(scan))
    np.testing.assert_array_equal(back.points_l, scan.points_l)
    np.testing.assert_array_equal(back.age_s, scan.age_s)
    np.testing.assert_array_equal(back.reflectivity, scan.reflectivity)
    np.testing.assert_array_equal(back.tag, scan.tag)
    assert (back.sequence, back.lost_packets) == (77, 3)
    assert back.stamp_s == pytest.approx(scan.stamp_s, abs=1e-8)


def test_points_come_back_as_they_went():
    points = np.arange(12, dtype=np.float32).reshape(4, 3)
    back, stamp_s = decode_points(encode_points(points, 1.25))
    np.testing.assert_array_equal(back, points)
    assert stamp_s == 1.25


def test_a_frame_comes_back_close_to_what_it_was():
    grey = np.tile(np.linspace(0, 255, 320), (240, 1)).astype(np.uint8)
    back = decode_frame(*encode_frame(Frame(3.5, 9, grey, 0.057)))
    assert (back.stamp_s, back.sequence, back.age_s) == (3.5, 9, pytest.approx(0.057))
    assert frame_times(*encode_frame(Frame(3.5, 9, grey, 0.057))) == (3.5, pytest.approx(3.557))
    assert np.abs(back.grey.astype(int) - grey).max() < 12


@given(st.binary(max_size=200), st.one_of(st.none(), st.binary(max_size=20)))
def test_bytes_that_are_no_message_are_refused_by_name(payload, attachment):
    for decode in (decode_scan, decode_frame):
        try:
            decode(payload, attachment)
        except BadMessage:
            continue
    try:
        decode_points(payload)
    except BadMessage:
        return
