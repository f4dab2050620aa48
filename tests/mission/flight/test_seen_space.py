"""What the LiDAR never saw is not taken for free."""

import math

import numpy as np
import pytest

from config.sensors import Lidar
from mission.flight.seen_space import LOOKS, REACH_M, SeenSpace

HERE = np.array([100.0, -40.0, 60.0])
LEVEL = (1.0, 0.0, 0.0, 0.0)


def looked(times=LOOKS, quaternion=LEVEL, places=(HERE,)):
    space = SeenSpace(Lidar())
    for place in places:
        for _ in range(times):
            space.look(np.asarray(place), quaternion)
    return space


def at(azimuth_deg, elevation_deg, distance_m=12.0):
    a, e = math.radians(azimuth_deg), math.radians(elevation_deg)
    flat = math.cos(e)
    return HERE + distance_m * np.array([flat * math.cos(a), flat * math.sin(a), math.sin(e)])


def test_before_the_first_look_nothing_is_seen():
    assert not SeenSpace(Lidar()).seen(HERE[None])


@pytest.mark.parametrize(
    ("azimuth", "elevation", "seen"),
    [
        (0, 0, True), (0, -22, True), (0, 20, True), (0, 45, False), (0, -45, False),
        (90, 0, True), (90, 30, True), (90, -30, False), (-90, 0, True),
        (180, 0, False), (180, 25, True), (180, 60, True), (0, 89, False), (0, -89, False),
    ],
)  # fmt: skip
def test_the_band_is_the_sensors_nose_down(azimuth, elevation, seen):
    assert looked().seen(at(azimuth, elevation)[None]) is seen


def test_a_glance_is_no_look():
    assert not looked(LOOKS - 1).seen(at(0, 0)[None])
    assert looked(LOOKS).seen(at(0, 0)[None])


def test_it_turns_with_the_vehicle():
    turned = (math.cos(math.pi / 2), 0.0, 0.0, math.sin(math.pi / 2))
    assert looked(quaternion=turned).seen(at(180, 0)[None])
    assert not looked(quaternion=turned).seen(at(0, 0)[None])


def test_where_it_flew_is_free():
    assert looked(1).seen(HERE[None])
    above = HERE + np.array([0.0, 0.0, 6.0])
    assert not looked().seen(above[None])
    assert looked(places=(HERE, above)).seen(above[None])


def test_one_place_never_seen_spoils_all():
    both = np.stack([at(0, 0), at(0, 89)])
    assert not looked().seen(both)


def test_beyond_its_reach_and_beyond_its_box_nothing_is_seen():
    assert not looked().seen(at(0, 0, REACH_M + 6.0)[None])
    assert not looked().seen(at(0, 0, 5000.0)[None])
    away = at(0, 0, 5000.0)
    assert not looked(places=(HERE, away)).seen(HERE[None]), "long ago"


@pytest.mark.parametrize("ahead_w", [(1.0, 0.0, 0.0), (-0.8, -0.6, 0.0), (0.0, 0.6, 0.2)])
def test_however_far_it_has_flown_it_knows_what_it_saw_lately(ahead_w):
    space, step = SeenSpace(Lidar()), 1.5 * np.array(ahead_w)
    for k in range(400):
        space.look(HERE + k * step, LEVEL)
    there = HERE + 399 * step
    ahead, behind = np.array([12.0, 0.0, 0.0]), np.array([-12.0, 0.0, 40.0])
    assert space.seen((there + ahead)[None])
    assert space.seen((there - 20.0 * step)[None]), "flown through"
    assert not space.seen((there + behind)[None])
