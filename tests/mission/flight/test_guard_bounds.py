"""The guard at its boundaries: on either side of each, and what it answers then."""

import dataclasses
import math

import numpy as np
import pytest

from config.presets import load_turbine
from config.sensors import Lidar
from config.settings import Settings
from mission.flight.command import (
    Command,
    MissionState,
    Phase,
    Progress,
    SensingMode,
    SensingTask,
    Setpoint,
)
from mission.flight.guard import (
    CORRIDOR_M,
    LEAVING,
    NEAR_M,
    NOTHING_AROUND,
    POINT_ERROR_M,
    POSITION_STALE_S,
    REST_S,
    RETREAT_MPS,
    STILL_M,
    TICK_S,
    Airspace,
    Guard,
    Surroundings,
    _without_closing,
)
from mission.flight.observation import ClearanceState, FlightMode, Observation, Vehicle
from mission.flight.rotor_model import MeasuredBlade, rotor_model
from mission.flight.seen_space import LOOKS, SeenSpace
from perception.clearance import OccupancyMemory

SETTINGS = Settings()
GUARD = Guard(SETTINGS)
BOUNDS = SETTINGS.guard
AIRFRAME = SETTINGS.airframe.radius_m
#: From the body's middle to a point that counts as touching: it may be nearer than it was seen.
RADIUS = AIRFRAME + POINT_ERROR_M
NOW, HERE = 100.0, (0.0, 0.0, 50.0)
E = 1e-3


class Wall:
    """A turbine that is everything east of 10 m."""

    def distance(self, points_w):
        return 10.0 - np.atleast_2d(points_w)[:, 0]

    def nearest(self, point_w):
        gap = 10.0 - point_w[0]
        return np.array([gap]), point_w[None] + np.array([gap, 0.0, 0.0])


def observe(position=HERE, velocity=(0.0, 0.0, 0.0), scan_age=0.05, repeated=False, **changes):
    vehicle = Vehicle(
        stamp_s=NOW, position_w=position, velocity_w=velocity,
        quaternion_wb=(1.0, 0.0, 0.0, 0.0), yaw_rad=0.25, mode=FlightMode.OFFBOARD,
        mode_stamp_s=NOW, armed=True, in_air=True, landed=False, heartbeat_stamp_s=NOW,
    )  # fmt: skip
    scan = ClearanceState(NOW - scan_age, 1, None, None, repeated=repeated)
    return Observation(NOW, 1, dataclasses.replace(vehicle, **changes), clearance=scan)


def command(position, velocity=(0.0, 0.0, 0.0), phase=Phase.TRACK, yaw=0.1):
    setpoint = Setpoint(tuple(map(float, position)), tuple(map(float, velocity)), yaw)
    progress = Progress(phase, MissionState.RUNNING, "")
    return Command(1, setpoint, None, None, None, None, SensingTask(SensingMode.IDLE, 0), progress)


def airspace(**changes):
    open_sky = Airspace(None, 0.0, True, None, np.zeros((0, 3)), (0.0, 0.0, 0.0))
    return dataclasses.replace(open_sky, **changes)


def around(*points):
    return Surroundings(np.array(points, float).reshape(-1, 3), NOW)


def check(asked, observation=None, surroundings=None, space=None, previous=None):
    return GUARD.check(
        asked, observation or observe(), surroundings or around(), space or airspace(), previous
    )


def flying(velocity):
    return Setpoint(HERE, velocity, 0.0)


def rests(setpoint):
    return np.array(setpoint.position_w) + REST_S * np.array(setpoint.velocity_w)


def test_what_the_rest_is_measured_by():
    # PX4: 1 / MPC_XY_P; the plan's corridors; near; the dead-man; a walking pace outward.
    assert pytest.approx(1 / 0.95) == REST_S
    assert (CORRIDOR_M, NEAR_M, POSITION_STALE_S) == (6.0, 25.0, 0.5)
    assert (RETREAT_MPS, TICK_S, STILL_M) == (0.5, 0.05, 0.05)
    # Half a voxel of what is remembered of the scans.
    assert OccupancyMemory()._voxel_m / 2 == POINT_ERROR_M == 0.25
    assert {Phase.STAND_OFF, Phase.RETURN} == LEAVING
    assert NOTHING_AROUND.points_w.shape == (0, 3)
    assert NOTHING_AROUND.stamp_s == -math.inf


# --- what is not answered at all --------------------------------------------------------------


def test_silence_stays_silence():
    silent = dataclasses.replace(command(HERE), setpoint=None)
    guarded = check(silent)
    assert guarded.command == silent
    assert (guarded.reason, guarded.refused, guarded.clearance_m) == ("", False, None)


@pytest.mark.parametrize(("age", "sent"), [(0.0, True), (0.5, True), (0.501, False)])
def test_an_old_position_is_no_position(age, sent):
    guarded = check(command((0.3, 0.0, 50.0)), observe(stamp_s=NOW - age))
    assert (guarded.command.setpoint is not None) is sent
    assert guarded.refused is not sent
    assert bool(guarded.reason) is not sent


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_a_vehicle_that_is_nowhere_is_sent_nothing(bad):
    for seen in (observe((bad, 0.0, 50.0)), observe(yaw_rad=bad)):
        guarded = check(command((0.3, 0.0, 50.0)), seen)
        assert guarded.command.setpoint is None
        assert guarded.refused
        assert "not a number" in guarded.reason


def test_a_refusal_turns_as_asked_but_not_to_nowhere():
    wall = around((5.0, 0.0, 50.0), (-5.0, 0.0, 50.0))
    assert check(command((0.5, 0.0, 50.0)), surroundings=wall).command.setpoint.yaw_rad == 0.1
    nowhere = check(command((0.5, 0.0, 50.0), yaw=math.nan))
    assert nowhere.command.setpoint.yaw_rad == 0.25
    assert nowhere.reason == "the setpoint is not a number"
    assert nowhere.refused


# --- what is trimmed --------------------------------------------------------------------------


@pytest.mark.parametrize(("lead", "words"), [(1.0, ""), (1.0 + E, "lead trimmed")])
def test_the_lead(lead, words):
    guarded = check(command((lead, 0.0, 50.0)))
    assert guarded.reason == words
    assert not guarded.refused
    assert guarded.command.setpoint.position_w[0] == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("near", "speed", "words"),
    [
        (False, 6.0, ""), (False, 6.0 + E, "speed trimmed"),
        (True, 2.0, ""), (True, 2.0 + E, "speed trimmed"),
    ],
)  # fmt: skip
def test_the_speed(near, speed, words):
    space = airspace(sphere_w=np.array([20.0, 0.0, 90.0])) if near else airspace()
    asked = command(HERE, (0.0, speed, 0.0))
    guarded = check(asked, space=space, previous=flying((0.0, speed, 0.0)))
    assert guarded.reason == words
    limit = 2.0 if near else 6.0
    assert guarded.command.setpoint.velocity_w[1] == pytest.approx(min(speed, limit))


@pytest.mark.parametrize(("grown", "words"), [(1.0, ""), (1.02, "acceleration trimmed")])
def test_the_growth_of_speed(grown, words):
    most = 1.5 * SETTINGS.airframe.max_acceleration_mps2 * TICK_S
    asked = command(HERE, (0.0, 0.5 + grown * most, 0.0))
    guarded = check(asked, previous=flying((0.0, 0.5, 0.0)))
    assert guarded.reason == words
    assert guarded.command.setpoint.velocity_w[1] == pytest.approx(0.5 + most)


def test_braking_is_as_hard_as_it_is_asked_for():
    guarded = check(command(HERE, (0.0, 0.2, 0.0)), previous=flying((0.0, 2.0, 0.0)))
    assert guarded.reason == ""
    assert guarded.command.setpoint.velocity_w == (0.0, 0.2, 0.0)


def test_without_a_setpoint_before_speed_grows_from_nothing():
    guarded = check(command(HERE, (0.0, 1.0, 0.0)))
    assert guarded.command.setpoint.velocity_w[1] == pytest.approx(0.075)


# --- where it may be --------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("here", "to", "passes"),
    [
        ((249.5, 0.0, 50.0), (250.0, 0.0, 50.0), True),
        ((249.5, 0.0, 50.0), (250.0 + E, 0.0, 50.0), False),
        ((251.0, 0.0, 50.0), (250.5, 0.0, 50.0), True),
        ((251.0, 0.0, 50.0), (251.5, 0.0, 50.0), False),
        ((0.0, 0.0, 299.5), (0.0, 0.0, 300.0), True),
        ((0.0, 0.0, 299.5), (0.0, 0.0, 300.0 + E), False),
        ((0.0, 0.0, 301.0), (0.0, 0.0, 300.5), True),
        ((0.0, 0.0, 301.0), (0.3, 0.0, 301.0), True),
        ((0.0, 0.0, 2.5), (0.0, 0.0, 2.0), True),
        ((0.0, 0.0, 2.5), (0.0, 0.0, 2.0 - E), False),
        ((0.0, 0.0, 1.0), (0.0, 0.0, 1.5), True),
        ((0.0, 0.0, 1.0), (0.5, 0.0, 1.0), True),
    ],
)
def test_cylinder_height_and_ground(here, to, passes):
    guarded = check(command(to), observe(here))
    assert guarded.refused is not passes
    assert bool(guarded.reason) is not passes


def test_bounds_are_those_of_where_it_comes_to_rest():
    speed = 0.9 / REST_S
    far = command((249.0, 0.0, 50.0), (speed, 0.0, 0.0))
    farther = command((249.0, 0.0, 50.0), (1.2 / REST_S, 0.0, 0.0))
    before = flying((1.0, 0.0, 0.0))
    assert not check(far, observe((249.0, 0.0, 50.0)), previous=before).refused
    assert check(farther, observe((249.0, 0.0, 50.0)), previous=before).refused


def test_bounds_are_about_home():
    home = airspace(home_w=(100.0, 50.0, 20.0))
    at = (349.5, 50.0, 60.0)
    assert check(command((350.1, 50.0, 60.0)), observe(at), space=home).refused
    assert not check(command((349.9, 50.0, 60.0)), observe(at), space=home).refused
    above = (100.0, 50.0, 319.6)
    assert check(command((100.0, 50.0, 320.1)), observe(above), space=home).refused
    nobody = airspace(home_w=None)
    assert check(command((250.4, 0.0, 50.0)), observe((249.9, 0.0, 50.0)), space=nobody).refused


# --- blind --------------------------------------------------------------------------------------

NEAR = {"sphere_w": np.array([NEAR_M - 1.0, 0.0, 200.0]), "sphere_radius_m": 30.0}


@pytest.mark.parametrize(
    ("options", "passes"),
    [
        ({"scan_age": 0.5}, True),
        ({"scan_age": 0.5 + E}, False),
        ({"scan_age": 0.05, "repeated": True}, False),
    ],
)
def test_beside_the_tower_nothing_moves_without_a_fresh_scan(options, passes):
    guarded = check(command((0.3, 0.0, 50.0)), observe(**options), space=airspace(**NEAR))
    assert guarded.refused is not passes
    assert guarded.reason == ("" if passes else "no fresh scan")


def test_without_any_scan_nothing_moves_either():
    blind = dataclasses.replace(observe(), clearance=None)
    assert check(command((0.3, 0.0, 50.0)), blind, space=airspace(**NEAR)).refused
    assert not check(command((0.3, 0.0, 50.0)), blind).refused


@pytest.mark.parametrize(("moves", "passes"), [(0.049, True), (STILL_M, False)])
def test_blind_it_may_stay(moves, passes):
    guarded = check(command((moves, 0.0, 50.0)), observe(scan_age=2.0), space=airspace(**NEAR))
    assert guarded.refused is not passes


@pytest.mark.parametrize(("off", "near"), [(NEAR_M - E, True), (NEAR_M, False)])
def test_near_is_within_25_m_of_the_towers_axis(off, near):
    space = airspace(sphere_w=np.array([0.0, off, 200.0]), sphere_radius_m=30.0)
    guarded = check(command((0.3, 0.0, 50.0)), observe(scan_age=2.0), space=space)
    assert guarded.refused is near


@pytest.mark.parametrize(("radius", "near"), [(60.0 + E, True), (60.0, False)])
def test_near_is_inside_the_sphere(radius, near):
    space = airspace(sphere_w=np.array([60.0, 0.0, 50.0]), sphere_radius_m=radius)
    guarded = check(command((-0.3, 0.0, 50.0)), observe(scan_age=2.0), space=space)
    assert guarded.refused is near


@pytest.fixture(scope="module")
def model():
    turbine = load_turbine("v27")
    hub, normal = np.array([60.0, 0.0, 50.0]), np.array([1.0, 0.0, 0.0])
    angles = np.radians([20.0, 140.0, 260.0])
    blades = [
        MeasuredBlade(name, (0.0, float(-np.sin(a)), float(-np.cos(a))), 0.0)
        for name, a in zip("ABC", angles, strict=True)
    ]
    return rotor_model(hub, normal, blades, turbine)


def before_the_hub(model, clearance):
    """A place in front of the hub whose airframe is so far from the model."""
    x = 60.0 - clearance - AIRFRAME
    for _ in range(50):
        x += float(model.distance(np.array([[x, 0.0, 50.0]]))[0]) - AIRFRAME - clearance
    return (x, 0.0, 50.0)


@pytest.mark.parametrize(("clearance", "near"), [(NEAR_M - 0.01, True), (NEAR_M + 0.01, False)])
def test_near_is_within_25_m_of_the_model(model, clearance, near):
    here = before_the_hub(model, clearance)
    away = (here[0] - 0.3, *here[1:])
    space = airspace(model=model)
    assert check(command(away), observe(here, scan_age=2.0), space=space).refused is near


def test_who_leaves_may_follow_the_known_way_blind(model):
    here = before_the_hub(model, 12.0)
    inward = (here[0] + 0.3, *here[1:])
    known = airspace(model=model, corridor_w=np.array([[here[0] + 1.0, *here[1:]]]))
    blind = observe(here, scan_age=9.0)
    assert not check(command(inward, phase=Phase.STAND_OFF), blind, space=known).refused
    assert check(command(inward), blind, space=known).refused


def test_inside_the_sphere_and_beside_the_model_is_near_all_the_same(model):
    here = before_the_hub(model, 12.0)
    both = airspace(model=model, sphere_w=np.array([60.0, 0.0, 50.0]), sphere_radius_m=1.0)
    away = command((here[0] - 0.3, *here[1:]))
    assert check(away, observe(here, scan_age=2.0), space=both).refused


def test_who_leaves_may_move_outward_blind(model):
    here = before_the_hub(model, 12.0)
    out, inward = (here[0] - 0.3, *here[1:]), (here[0] + 0.3, *here[1:])
    blind, space = observe(here, scan_age=9.0), airspace(model=model)
    assert not check(command(out, phase=Phase.STAND_OFF), blind, space=space).refused
    assert not check(command(out, phase=Phase.RETURN), blind, space=space).refused
    assert check(command(inward, phase=Phase.STAND_OFF), blind, space=space).refused
    assert check(command(out), blind, space=space).refused


# --- the sphere ---------------------------------------------------------------------------------

SPHERE = {"sphere_w": np.array([50.0, 0.0, 50.0]), "sphere_radius_m": 50.2}


@pytest.mark.parametrize(
    ("to", "sphere", "passes"),
    [
        (-0.3, {"open": False}, True),
        (0.3, {"open": False}, False),
        (0.3, {"open": True}, False),
        (0.3, {"open": True, "corridor_w": np.array([[0.3 + CORRIDOR_M - E, 0.0, 50.0]])}, True),
        (0.3, {"open": True, "corridor_w": np.array([[0.3 + CORRIDOR_M + E, 0.0, 50.0]])}, False),
        (0.3, {"open": False, "corridor_w": np.array([[0.3, 0.0, 50.0]])}, False),
    ],
)
def test_the_sphere_and_its_corridors(to, sphere, passes):
    guarded = check(command((to, 0.0, 50.0)), space=airspace(**SPHERE, **sphere))
    assert guarded.refused is not passes


def test_who_leaves_keeps_to_the_corridors_of_a_closed_sphere():
    corridor = np.array([[0.3, 0.0, 50.0]])
    closed = airspace(**SPHERE, open=False, corridor_w=corridor)
    assert not check(command((0.3, 0.0, 50.0), phase=Phase.STAND_OFF), space=closed).refused
    nowhere = airspace(**SPHERE, open=False)
    assert check(command((0.3, 0.0, 50.0), phase=Phase.STAND_OFF), space=nowhere).refused


@pytest.mark.parametrize(("drifted", "passes"), [(9.0, True), (0.0, False), (-9.0, False)])
def test_the_plans_corridors_move_with_the_drift_of_the_position(drifted, passes):
    corridor = np.array([[0.3 - 9.0, 0.0, 50.0]])
    drift = np.array([drifted, 0.0, 0.0])
    space = airspace(**SPHERE, open=True, corridor_w=corridor, drift_w=drift)
    assert check(command((0.3, 0.0, 50.0)), space=space).refused is not passes


@pytest.mark.parametrize(("drifted", "passes"), [(9.0, True), (0.0, False), (-9.0, False)])
def test_the_known_way_out_moves_with_the_drift_of_the_position(drifted, passes):
    known = airspace(
        sphere_w=np.array([10.0, 0.0, 50.0]), sphere_radius_m=30.0, open=False,
        corridor_w=np.array([[-0.3 - 9.0, 0.0, 50.0]]), drift_w=np.array([drifted, 0.0, 0.0]),
    )  # fmt: skip
    out = command((-0.3, 0.0, 50.0), phase=Phase.STAND_OFF)
    # A point behind, so near that even the way out is no way outward.
    behind = around((-12.0, 0.0, 50.0))
    guarded = check(out, observe(scan_age=9.0), behind, known)
    assert guarded.refused is not passes


@pytest.mark.parametrize(("radius", "passes"), [(49.7, True), (49.7 + E, False)])
def test_the_sphere_ends_at_its_radius(radius, passes):
    space = airspace(sphere_w=np.array([50.0, 0.0, 50.0]), sphere_radius_m=radius, open=False)
    assert check(command((0.3, 0.0, 50.0)), space=space).refused is not passes


def test_inside_one_may_go_out_and_along():
    inside = airspace(sphere_w=np.array([10.0, 0.0, 50.0]), sphere_radius_m=30.0, open=False)
    assert not check(command((-0.3, 0.0, 50.0)), space=inside).refused
    assert not check(command((0.0, 0.3, 50.0)), space=inside).refused
    assert check(command((0.1, 0.0, 50.0)), space=inside).refused


# --- never seen -----------------------------------------------------------------------------------


@pytest.fixture
def seen():
    """One that has looked ahead (east) from here, and never up or down."""
    space = SeenSpace(Lidar())
    for _ in range(LOOKS):
        space.look(np.array(HERE), (1.0, 0.0, 0.0, 0.0))
    return space


INSIDE = {"sphere_w": np.array([40.0, 0.0, 50.0]), "sphere_radius_m": 60.0, "open": True}


def test_inside_the_sphere_nothing_is_entered_that_was_never_seen(seen):
    corridor = np.array([[1.0, 0.0, 50.0], [0.0, 0.0, 53.0]])
    space = airspace(**INSIDE, corridor_w=corridor, seen=seen)
    up = command((0.0, 0.0, 51.0), (0.0, 0.0, 1.5))
    fast = flying((0.0, 0.0, 1.5))
    assert not check(command((0.8, 0.0, 50.0)), space=space).refused
    refused = check(up, space=space, previous=fast)
    assert refused.refused
    assert refused.reason == "a place never seen"
    assert not check(up, space=dataclasses.replace(space, seen=None), previous=fast).refused
    leaving = dataclasses.replace(
        up, progress=dataclasses.replace(up.progress, phase=Phase.STAND_OFF)
    )
    assert not check(leaving, space=space, previous=fast).refused
    assert not check(command((0.0, 0.0, 50.04)), space=space, previous=fast).refused


def test_where_nothing_was_seen_one_may_stay():
    space = airspace(**INSIDE, corridor_w=np.array([HERE]), seen=SeenSpace(Lidar()))
    assert not check(command((0.04, 0.0, 50.0)), space=space).refused
    assert check(command((STILL_M, 0.0, 50.0)), space=space).refused


def test_it_is_the_outermost_point_that_must_be_seen(seen):
    corridor = np.array([[0.0, 0.0, 51.0]])
    space = airspace(**INSIDE, corridor_w=corridor, seen=seen)
    # Flown cells reach to 52 m; the airframe to 0.9 m beyond where it rests.
    assert not check(command((0.0, 0.0, 51.0)), space=space).refused
    fast = flying((0.0, 0.0, 1.0))
    assert check(command((0.0, 0.0, 51.0), (0.0, 0.0, 0.4)), space=space, previous=fast).refused


def test_outside_the_sphere_the_rule_is_another(seen):
    outside = airspace(sphere_w=np.array([200.0, 0, 50.0]), sphere_radius_m=30.0, seen=seen)
    up = command((0.0, 0.0, 51.0), (0.0, 0.0, 1.5))
    assert not check(up, space=outside, previous=flying((0.0, 0.0, 1.5))).refused
    on_it = airspace(
        sphere_w=np.array([40.0, 0, 50.0]), sphere_radius_m=40.5, seen=SeenSpace(Lidar())
    )
    assert not check(command((-0.5, 0.0, 50.0)), space=on_it).refused
    nowhere = airspace(seen=seen)
    assert not check(up, space=nowhere, previous=flying((0.0, 0.0, 1.5))).refused


# --- clearance ------------------------------------------------------------------------------------


def ahead(clearance):
    return around((clearance + RADIUS, 0.0, 50.0))


@pytest.mark.parametrize("distance", [8.2, 8.5, 9.0, 9.5, 10.0, 11.0, 12.0])
@pytest.mark.parametrize("share", [0.98, 1.02])
def test_closing_is_slowed_to_the_boundary_of_its_rule(distance, share):
    allowed = -2.2 + math.sqrt(4.84 + 4 * (distance - 8))
    speed = min(share * allowed, 2.0)
    asked = command(HERE, (speed, 0.0, 0.0))
    guarded = check(asked, surroundings=ahead(distance), previous=flying((speed, 0.0, 0.0)))
    assert not guarded.refused
    assert guarded.command.setpoint.velocity_w[0] == pytest.approx(min(speed, allowed), abs=1e-5)
    slowed = speed > allowed + 1e-6
    assert guarded.reason == ("slowed towards an obstacle" if slowed else "")


def test_the_lead_counts_as_speed():
    # 0.95 of the lead is flown as speed: at 0.5 m of room 0.42 m/s is allowed.
    guarded = check(command((0.6, 0.0, 50.0)), surroundings=ahead(8.5))
    allowed = -2.2 + math.sqrt(4.84 + 2.0)
    assert guarded.command.setpoint.position_w[0] == pytest.approx(allowed / 0.95, abs=1e-5)


@pytest.mark.parametrize(("excess", "refused"), [(0.29, False), (0.31, True)])
def test_a_vehicle_faster_than_it_may_be_is_stopped(excess, refused):
    allowed = -2.2 + math.sqrt(4.84 + 4 * 1.5)
    flown = observe(velocity=(allowed + excess, 0.0, 0.0))
    guarded = check(command((0.05, 0.0, 50.0)), flown, ahead(9.5))
    assert guarded.refused is refused
    assert ("too fast" in guarded.reason) is refused


def test_it_slides_along_what_is_near():
    asked = command((0.4, 0.4, 50.0))
    sent = check(asked, surroundings=ahead(8.05)).command.setpoint
    assert sent.position_w[1] == pytest.approx(0.4)
    assert sent.position_w[0] < 0.1


def test_the_speed_slides_like_the_lead():
    asked = command((0.1, 0.1, 50.0), (0.5, 0.5, 0.0))
    sent = check(asked, surroundings=ahead(8.02), previous=flying((0.5, 0.5, 0.0))).command.setpoint
    assert sent.velocity_w[1] == pytest.approx(0.5)
    assert 0.0 <= sent.velocity_w[0] < 0.05


def test_what_cannot_slide_is_scaled_as_a_whole():
    # A narrowing gap: whatever slides along one wall runs into the other.
    a = math.radians(80.0)
    units = np.array([[math.cos(a), math.sin(a), 0.0], [math.cos(a), -math.sin(a), 0.0]])
    allowed = np.full(2, 0.02)
    lead, fed = np.array([0.6, 0.05, 0.0]), np.array([0.9, -0.1, 0.2])
    less, less_fed = _without_closing(lead, fed, units, allowed)
    closing = units @ (0.95 * less + less_fed)
    assert closing.max() == pytest.approx(0.02, abs=1e-6)
    assert np.linalg.norm(np.cross(less, lead)) == pytest.approx(0.0, abs=1e-9)
    assert np.linalg.norm(np.cross(less_fed, fed)) == pytest.approx(0.0, abs=1e-9)
    assert less @ lead > 0
    assert less_fed @ fed > 0


def test_hemmed_in_it_slows_as_a_whole():
    reach = 8.06 + RADIUS
    fan = [
        (reach * math.cos(a), off * math.cos(b), 50.0 + off * math.sin(b))
        for a in np.radians([5.0, 15.0, 25.0, 35.0])
        for b in np.radians(np.arange(0, 360, 40))
        for off in [reach * math.sin(a)]
    ]
    guarded = check(command((0.9, 0.0, 50.0)), surroundings=around(*fan))
    sent = guarded.command.setpoint
    assert 0.0 <= sent.position_w[0] < 0.07
    assert abs(sent.position_w[1]) < 0.07
    assert not guarded.refused


def test_a_way_past_something_may_not_lead_nearer_than_the_clearance():
    # Beside the way, not ahead: hardly closed on, but passed too near.
    beside = around((2.0, 8.0 + RADIUS - 0.02, 50.0))
    asked = command((1.0, 0.0, 50.0), (1.0, 0.0, 0.0))
    guarded = check(asked, surroundings=beside, previous=flying((1.0, 0.0, 0.0)))
    sent = rests(guarded.command.setpoint)
    assert np.linalg.norm(sent - [2.0, 8.0 + RADIUS - 0.02, 50.0]) - RADIUS >= 8.0 - 1e-3


@pytest.mark.parametrize(("clearance", "refused"), [(8.0 + E, False), (8.0 - E, True)])
def test_nearer_than_the_clearance_one_does_not_stay(clearance, refused):
    guarded = check(command(HERE), surroundings=ahead(clearance))
    assert guarded.refused is refused
    if refused:
        sent = guarded.command.setpoint
        assert sent.position_w == pytest.approx((-0.8, 0.0, 50.0))
        assert sent.velocity_w == pytest.approx((-RETREAT_MPS, 0.0, 0.0))
        assert guarded.reason == "nearer than the clearance"


def test_a_retreat_goes_where_it_is_free_or_stays():
    # Behind, farther off than what is ahead: there is room for half a metre, not for a metre.
    for behind, goes in ((7.6, False), (9.0, True)):
        both = around((6.5 + RADIUS, 0.0, 50.0), (-behind - RADIUS, 0.0, 50.0))
        sent = check(command(HERE), surroundings=both).command.setpoint
        assert (sent.position_w[0] < -0.5) is goes


@pytest.mark.parametrize(("x", "passes"), [(-0.3, True), (0.3, False)])
def test_too_near_only_the_way_out_passes(x, passes):
    guarded = check(command((x, 0.0, 50.0)), surroundings=ahead(6.0))
    assert guarded.refused is not passes
    assert (guarded.command.setpoint.position_w[0] == x) is passes


@pytest.mark.parametrize("distance", [9.0, 20.0])
def test_the_clearance_is_told_from_the_outermost_point(distance):
    guarded = check(command(HERE), surroundings=ahead(distance))
    assert guarded.clearance_m == pytest.approx(distance)


def test_with_nothing_near_there_is_no_clearance_to_tell():
    assert check(command(HERE)).clearance_m is None
    far = around((NEAR_M + 5.0, 0.0, 50.0))
    assert check(command(HERE), surroundings=far).clearance_m is None
    within = around((NEAR_M + 5.0 - E, 0.0, 50.0))
    assert check(command(HERE), surroundings=within).clearance_m is not None


def test_the_model_counts_like_what_is_seen(model):
    here = before_the_hub(model, 8.3)
    guarded = check(command((here[0] + 0.8, *here[1:])), observe(here), space=airspace(model=model))
    assert guarded.clearance_m == pytest.approx(8.3, abs=1e-6)
    allowed = -2.2 + math.sqrt(4.84 + 4 * 0.3)
    lead = guarded.command.setpoint.position_w[0] - here[0]
    assert lead == pytest.approx(allowed / 0.95, abs=0.01)


def test_inside_the_model_the_way_out_is_away_from_its_middle(model):
    x, y, z = (float(part) for part in model.tower_top_w)
    here = (x + 0.4, y, z - 10.0)
    sent = check(command(here), observe(here), space=airspace(model=model)).command.setpoint
    assert sent.position_w[0] > here[0]


def test_the_least_of_points_and_model_counts(model):
    here = before_the_hub(model, 12.0)
    point = around((here[0] - 9.0 - RADIUS, 0.0, 50.0))
    guarded = check(command(here), observe(here), point, airspace(model=model))
    assert guarded.clearance_m == pytest.approx(9.0)


@pytest.mark.parametrize(("clearance", "passes"), [(8.05, False), (9.0, True)])
def test_the_way_out_of_the_models_reach_leads_not_too_near_to_what_is_seen(
    model, clearance, passes
):
    """The model is inflated: nearer to it than 8 m, points at 8 m bind all the same."""
    here = before_the_hub(model, 7.5)
    seen = around((here[0] - clearance - RADIUS, here[1], here[2]))
    out = command((here[0] - 0.4, *here[1:]))
    guarded = check(out, observe(here), seen, airspace(model=model))
    assert guarded.refused is not passes
    if not passes:
        held = guarded.command.setpoint
        assert held.position_w == tuple(here)
        assert held.velocity_w == (0.0, 0.0, 0.0)
