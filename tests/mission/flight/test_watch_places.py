import itertools
import math

import numpy as np
import pytest

from mission.flight.watch_places import (
    FRONT,
    WatchPlace,
    place_of,
    place_w,
    watch_places,
    way_between,
)

HUB = np.array([10.0, -20.0, 110.0])
FRONT_RAD = 0.4
ROOM = (80.0, 170.0)


def tips(stop_deg, radius_m):
    """(3, 3): of a rotor that faces FRONT_RAD, seen from the hub."""
    across = np.array([-math.sin(FRONT_RAD), math.cos(FRONT_RAD), 0.0])
    angles = np.radians(stop_deg + np.array([0.0, 120.0, 240.0]))
    down = np.array([0.0, 0.0, -1.0])
    return radius_m * (np.cos(angles)[:, None] * down + np.sin(angles)[:, None] * across)


@pytest.mark.parametrize("rotor_m", [65.0, 80.0, 100.0])
@pytest.mark.parametrize("stop_deg", range(0, 120, 10))
@pytest.mark.parametrize("here_deg", [-100.0, 60.0])
def test_from_one_of_the_places_a_tip_is_near(rotor_m, stop_deg, here_deg):
    radius = rotor_m + 15.0
    places = watch_places(FRONT_RAD + math.radians(here_deg), FRONT_RAD, radius, 70.0, (200, 200))
    eyes = [place_w(np.zeros(3), radius, FRONT_RAD, place) for place in places]
    apart = [np.linalg.norm(tips(stop_deg, rotor_m) - eye, axis=1).min() for eye in eyes]
    assert min(apart) < 0.45 * rotor_m + 22.0
    assert apart[-1] > 1.3 * rotor_m, "from the front none is"


def test_a_small_rotor_is_watched_from_the_front_first():
    places = watch_places(FRONT_RAD + 2.0, FRONT_RAD, 50.0, 70.0, ROOM)
    assert places[0] == FRONT
    assert len(places) == 4


def test_a_large_one_first_from_the_side_on_which_the_vehicle_is():
    for side in (-1.0, 1.0):
        places = watch_places(FRONT_RAD + 1.7 * side, FRONT_RAD, 90.0, 70.0, ROOM)
        assert places[-1] == FRONT
        assert all(place.turn_rad * side > 1.0 for place in places[:-1])


def test_the_places_keep_off_the_ground_and_below_the_height_limit():
    places = watch_places(0.0, FRONT_RAD, 90.0, 70.0, (30.0, 5.0))
    raised_m = [90.0 * math.sin(place.raised_rad) for place in places]
    assert min(raised_m) == pytest.approx(-30.0)
    assert max(raised_m) == 0.0


@pytest.mark.parametrize(
    ("start", "end"),
    [
        (WatchPlace(1.1, 0.0), WatchPlace(1.1, -0.6)),
        (WatchPlace(1.1, -0.6), WatchPlace(1.1, 0.6)),
        (WatchPlace(1.1, 0.6), FRONT),
        (FRONT, WatchPlace(-1.1, 0.5)),
    ],
)
def test_the_way_between_two_places_stays_outside_the_sphere(start, end):
    way = way_between(HUB, 90.0, FRONT_RAD, start, end)
    line = np.concatenate([np.linspace(a, b, 20) for a, b in itertools.pairwise(way)])
    assert np.linalg.norm(line - HUB, axis=1).min() > 89.8
    assert way[0] == pytest.approx(place_w(HUB, 90.0, FRONT_RAD, start))
    assert way[-1] == pytest.approx(place_w(HUB, 90.0, FRONT_RAD, end))


@pytest.mark.parametrize("place", [FRONT, WatchPlace(1.1, -0.6), WatchPlace(-2.0, 0.3)])
@pytest.mark.parametrize("apart_m", [85.0, 90.0, 120.0])
def test_a_vehicle_is_beside_the_place_on_the_same_line_from_the_hub(place, apart_m):
    here = place_w(HUB, apart_m, FRONT_RAD, place)
    found = place_of(HUB, FRONT_RAD, here)
    assert (found.turn_rad, found.raised_rad) == pytest.approx((place.turn_rad, place.raised_rad))
