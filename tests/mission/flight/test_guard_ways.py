"""The guard where one rule alone sees what is wrong: ways, directions, small and single things."""

import math

import numpy as np
import pytest

from mission.flight.command import Phase
from mission.flight.guard import (
    CORRIDOR_M,
    NEAR_M,
    REST_S,
    RETREAT_MPS,
    TICK_S,
    Guard,
    _without_closing,
)
from mission.flight.seen_space import LOOKS, SeenSpace
from tests.mission.flight.test_guard_bounds import (
    AIRFRAME,
    HERE,
    INSIDE,
    RADIUS,
    SETTINGS,
    SPHERE,
    Wall,
    ahead,
    airspace,
    around,
    check,
    command,
    flying,
    observe,
)


class Ball:
    """A turbine that is a ball: what the guard asks of a model, in numbers one can do by hand."""

    def __init__(self, centre_w, radius_m):
        self.centre_w, self.radius_m = np.array(centre_w), radius_m

    def distance(self, points_w):
        away = np.linalg.norm(np.atleast_2d(points_w) - self.centre_w, axis=1)
        return away - self.radius_m

    def nearest(self, point_w):
        distance = self.distance(point_w)
        toward = self.centre_w - point_w
        return distance, point_w + (toward / np.linalg.norm(toward) * distance)[None]


def ball_ahead(clearance, radius_m=2.0):
    """A ball to the east whose surface is so far from the airframe's outermost point."""
    return Ball((clearance + AIRFRAME + radius_m, 0.0, 50.0), radius_m)


def passes(guarded):
    return not guarded.refused and guarded.reason == ""


# --- the way, not only its ends -------------------------------------------------------------------


@pytest.mark.parametrize(("clearance", "clear"), [(8.03, False), (8.06, True)])
def test_a_way_that_is_too_near_in_its_middle_alone_is_not_clear(clearance, clear):
    # From 1 m on one side to 1.3 m on the other: both ends are farther off than the middle.
    velocity = (-0.095, 2.2, 0.0)
    asked = command((0.1, -0.99, 50.0), velocity)
    beside = around((clearance + RADIUS, 0.155, 50.0))
    guarded = check(asked, surroundings=beside, previous=flying(velocity))
    assert passes(guarded) is clear
    assert guarded.refused is not clear
    assert guarded.reason == ("" if clear else "the way there is not clear")


@pytest.mark.parametrize("by_model", [False, True])
@pytest.mark.parametrize(("clearance", "clear"), [(8.8, False), (9.1, True)])
@pytest.mark.parametrize("behind_m", [0.0, 0.3])
@pytest.mark.parametrize("heading_rad", [0.0, math.pi / 4])
def test_a_place_too_near_is_not_asked_for_with_a_speed_that_leads_back(
    clearance, clear, by_model, behind_m, heading_rad
):
    # Lead and speed cancel, so nothing closes; the place is passed all the same. Beside the
    # world's origin too, where a place and its way are as small as their difference.
    way, home = np.array([math.cos(heading_rad), math.sin(heading_rad), 0.0]), (0.0, 0.0, -50.0)
    here, back = tuple(-behind_m * way), tuple(-0.9 / REST_S * way)
    if by_model:
        ball = Ball((clearance + AIRFRAME + 2.0 - behind_m) * way, 2.0)
        space, points = airspace(home_w=home, model=ball), around()
    else:
        space, points = airspace(home_w=home), around((clearance + RADIUS - behind_m) * way)
    asked = command((0.9 - behind_m) * way, back)
    guarded = check(asked, observe(here), points, space, flying(back))
    assert guarded.clearance_m == pytest.approx(clearance)
    assert passes(guarded) is clear
    if not clear:
        assert guarded.refused
        assert guarded.reason == "the way there is not clear"
        assert guarded.command.setpoint.position_w == here


@pytest.mark.parametrize("speed", [0.2, 0.4])
def test_too_near_the_way_out_counts_to_where_it_ends(speed):
    # Outward by 0.3 m, with a speed that leads back: at 0.4 m/s past where the vehicle is.
    asked = command((-0.3, 0.0, 50.0), (speed, 0.0, 0.0))
    space = airspace(model=ball_ahead(6.0))
    outward = speed * REST_S < 0.3
    assert check(asked, space=space, previous=flying((speed, 0, 0))).refused is not outward
    assert check(asked, surroundings=ahead(6.0), previous=flying((speed, 0, 0))).refused is (
        not outward
    )


# --- too near -------------------------------------------------------------------------------------


def test_what_is_within_the_airframe_is_fled_at_full_speed():
    for guarded in (
        check(command(HERE), surroundings=around((0.5, 0.0, 50.0))),
        check(command(HERE), space=airspace(model=Ball((2.5, 0.0, 50.0), 2.0))),
        # Inside the model, out is away from its middle.
        check(command(HERE), space=airspace(model=Ball((1.5, 0.0, 50.0), 2.0))),
    ):
        sent = guarded.command.setpoint
        assert sent.position_w == pytest.approx((-0.8, 0.0, 50.0))
        assert sent.velocity_w == pytest.approx((-RETREAT_MPS, 0.0, 0.0))


def test_on_the_very_surface_of_the_model_no_way_leads_out_and_it_holds():
    here = (10.0, 0.0, 50.0)
    guarded = check(command(here), observe(here), space=airspace(model=Wall()))
    assert guarded.refused
    assert guarded.command.setpoint.position_w == here
    assert guarded.command.setpoint.velocity_w == (0.0, 0.0, 0.0)


def test_the_way_out_is_away_from_where_the_model_has_drifted_to():
    # A ball ahead that has drifted aside: it is north-east now, and out is south-west.
    drifted = airspace(model=Ball((6.0, 0.0, 50.0), 2.0), drift_w=np.array([0.0, 6.0, 0.0]))
    sent = check(command(HERE), space=drifted).command.setpoint
    way = 0.8 * math.sqrt(0.5)
    assert sent.position_w == pytest.approx((-way, -way, 50.0))


@pytest.mark.parametrize(("moves_mm", "is_a_move"), [(0.95, False), (1.0, True)])
def test_a_move_of_less_than_a_millimetre_is_no_way_out(moves_mm, is_a_move):
    guarded = check(command((-moves_mm / 1e3, 0.0, 50.0)), surroundings=ahead(6.0))
    assert guarded.refused is not is_a_move


@pytest.mark.parametrize(("nearer_mm", "clear"), [(0.0, True), (0.95, True), (1.05, False)])
def test_too_near_it_may_go_along_what_is_near(nearer_mm, clear):
    # Two millimetres aside: what that gains is nothing, and a millimetre nearer is none either.
    along = command((nearer_mm / 1e3, 0.002, 50.0))
    assert check(along, surroundings=ahead(6.0)).refused is not clear


@pytest.mark.parametrize(("gained", "goes"), [(0.19, False), (0.21, True)])
def test_a_retreat_is_worth_going_where_it_gains_a_fifth_of_a_metre(gained, goes):
    # What is behind comes nearer by all of the retreat, so the room there is what it gains.
    ends = 0.8 + REST_S * RETREAT_MPS
    behind = -(6.5 + gained + ends + RADIUS)
    both = around((6.5 + RADIUS, 0.0, 50.0), (behind, 0.0, 50.0))
    sent = check(command(HERE), surroundings=both).command.setpoint
    assert (sent.position_w[0] < -0.5) is goes


# --- what is asked --------------------------------------------------------------------------------


def test_one_obstacle_closed_on_too_fast_is_enough():
    toward = observe(velocity=(1.8, 0.0, 0.0))
    both = around((9.5 + RADIUS, 0.0, 50.0), (-9.5 - RADIUS, 0.0, 50.0))
    guarded = check(command(HERE), toward, both)
    assert guarded.refused
    assert guarded.reason == "closing too fast to stop in time"


def test_what_may_pass_passes_to_the_last_bit():
    # Beside something, so that closing is looked at; a place whose difference does not add up.
    here = (0.2, 0.0, 50.0)
    asked = command((0.9, 0.0, 50.0))
    guarded = check(asked, observe(here), around((12.0, 0.0, 50.0)))
    assert guarded.command == asked
    assert passes(guarded)


def test_speed_grows_as_the_airframe_in_use_can():
    agile = SETTINGS.airframe.model_copy(update={"max_acceleration_mps2": 2.0})
    guard = Guard(SETTINGS.model_copy(update={"airframe": agile}))
    guarded = guard.check(command(HERE, (0.0, 1.0, 0.0)), observe(), around(), airspace())
    assert guarded.command.setpoint.velocity_w[1] == pytest.approx(1.5 * 2.0 * TICK_S)


def test_a_corner_may_be_turned_at_the_same_speed():
    turned = command(HERE, (0.0, 1.0, 0.0))
    guarded = check(turned, previous=flying((1.0, 0.0, 0.0)))
    assert passes(guarded)
    assert guarded.command == turned


def test_hemmed_in_what_is_only_passed_along_stops_nothing():
    # A narrowing gap to scale down for, above and below walls as near as may be: the way leads
    # along them, or towards one by less than a thousandth of a millimetre per second.
    a = math.radians(80.0)
    gap = [[math.cos(a), math.sin(a), 0.0], [math.cos(a), -math.sin(a), 0.0]]
    lead, allowed = np.array([0.6, 0.05, 0.0]), np.array([0.02, 0.02, 0.0])
    for upward in (0.0, 9.5e-7):
        fed = np.array([0.9, -0.1, upward])
        less, less_fed = _without_closing(lead, fed, np.array([*gap, [0.0, 0.0, 1.0]]), allowed)
        closing = np.array(gap) @ (0.95 * less + less_fed)
        assert closing.max() == pytest.approx(0.02, abs=1e-6)
        assert less @ lead > 0


# --- where it may be ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("here", "to", "inside"),
    [
        ((100.0, 50.0, 319.6), (100.0, 50.0, 319.9), True),
        ((100.0, 50.0, 319.6), (100.0, 50.0, 320.1), False),
        ((100.0, 50.0, 22.5), (100.0, 50.0, 22.1), True),
        ((100.0, 50.0, 22.5), (100.0, 50.0, 21.9), False),
    ],
)
def test_heights_are_above_home(here, to, inside):
    home = airspace(home_w=(100.0, 50.0, 20.0))
    assert check(command(to), observe(here), space=home).refused is not inside


def test_staying_where_one_is_breaks_no_bound():
    # Driven out of the cylinder, or inside the closed sphere: neither is left by standing still.
    outside = (251.0, 0.0, 50.0)
    assert passes(check(command(outside), observe(outside)))
    inside = airspace(sphere_w=np.array([10.0, 0.0, 50.0]), sphere_radius_m=30.0, open=False)
    assert passes(check(command(HERE), space=inside))


def test_one_near_place_of_the_corridors_is_enough():
    corridor = np.array([[0.3, CORRIDOR_M, 50.0], [0.3, 90.0, 50.0]])
    space = airspace(**SPHERE, open=True, corridor_w=corridor)
    assert passes(check(command((0.3, 0.0, 50.0)), space=space))


def test_the_measured_rotor_is_near_wherever_the_hub_was_supposed():
    elsewhere = {"sphere_w": np.array([0.0, 200.0, 50.0]), "sphere_radius_m": 30.0}
    away, blind = command((-0.3, 0.0, 50.0)), observe(scan_age=2.0)
    beside = airspace(**elsewhere, model=ball_ahead(NEAR_M - 1.0))
    assert check(away, blind, space=beside).reason == "no fresh scan"
    apart = airspace(**elsewhere, model=ball_ahead(NEAR_M + 1.0))
    assert passes(check(away, blind, space=apart))


@pytest.mark.parametrize(("up", "enters"), [(0.2, True), (0.5, False)])
def test_the_outermost_point_reaches_as_far_beyond_a_short_way(up, enters):
    # The LiDAR's flown cells end at 52 m, and the airframe 0.9 m above where it rests.
    seen = SeenSpace(SETTINGS.lidar)
    for _ in range(LOOKS):
        seen.look(np.array(HERE), (1.0, 0.0, 0.0, 0.0))
    here = (0.0, 0.0, 50.8)
    space = airspace(**INSIDE, corridor_w=np.array([here]), seen=seen)
    asked = command((0.0, 0.0, 50.8 + up), phase=Phase.TRACK)
    assert check(asked, observe(here), space=space).refused is not enters
