import dataclasses
import math

import numpy as np
import pytest

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
    REST_S,
    Airspace,
    Guard,
    Surroundings,
    allowed_closing_mps,
)
from mission.flight.observation import ClearanceState, FlightMode, Observation, Vehicle
from tests.mission.flight.test_guard_bounds import Wall

SETTINGS = Settings()
GUARD = Guard(SETTINGS)
RADIUS = SETTINGS.airframe.radius_m
NOW = 100.0
NOWHERE = np.zeros((0, 3))


def observe(position=(0.0, 0.0, 50.0), velocity=(0.0, 0.0, 0.0), scan_age=0.05, **changes):
    vehicle = Vehicle(
        stamp_s=NOW,
        position_w=position,
        velocity_w=velocity,
        quaternion_wb=(1.0, 0.0, 0.0, 0.0),
        yaw_rad=0.0,
        mode=FlightMode.OFFBOARD,
        mode_stamp_s=NOW,
        armed=True,
        in_air=True,
        landed=False,
        heartbeat_stamp_s=NOW,
    )
    vehicle = dataclasses.replace(vehicle, **changes)
    return Observation(NOW, 1, vehicle, clearance=ClearanceState(NOW - scan_age, 1, None, None))


def command(position, velocity=(0.0, 0.0, 0.0), phase=Phase.TRACK, yaw=0.0):
    setpoint = Setpoint(tuple(position), tuple(velocity), yaw)
    progress = Progress(phase, MissionState.RUNNING, "")
    task = SensingTask(SensingMode.IDLE, 0)
    return Command(1, setpoint, None, None, None, None, task, progress)


def airspace(**changes):
    open_sky = Airspace(None, 0.0, True, None, NOWHERE, (0.0, 0.0, 0.0))
    return dataclasses.replace(open_sky, **changes)


def around(*points):
    return Surroundings(np.array(points, float).reshape(-1, 3), NOW)


def check(asked, observation=None, surroundings=None, space=None, previous=None):
    return GUARD.check(
        asked, observation or observe(), surroundings or around(), space or airspace(), previous
    )


def wall_at(clearance):
    """A point ahead (east) whose clearance from the airframe is as told."""
    return around((clearance + RADIUS, 0.0, 50.0))


def is_hold(guarded):
    setpoint = guarded.command.setpoint
    return setpoint.position_w == (0.0, 0.0, 50.0) and setpoint.velocity_w == (0.0, 0.0, 0.0)


def test_in_the_open_a_setpoint_passes_unchanged():
    asked = command((0.5, 0.0, 50.0), (0.05, 0.0, 0.0))
    guarded = check(asked)
    assert guarded.command == asked
    assert guarded.reason == ""


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("where", ["position", "velocity", "yaw"])
def test_a_setpoint_that_is_not_a_number_becomes_a_hold(bad, where):
    asked = command(
        (bad if where == "position" else 0.0, 0.0, 50.0),
        (0.0, bad if where == "velocity" else 0.0, 0.0),
        yaw=bad if where == "yaw" else 0.0,
    )
    guarded = check(asked)
    assert guarded.refused
    assert is_hold(guarded)


def test_without_a_position_nothing_is_sent():
    asked = command((0.5, 0.0, 50.0))
    assert check(asked, observe(stamp_s=NOW - 0.6)).command.setpoint is None
    assert check(asked, observe((math.nan, 0.0, 50.0))).command.setpoint is None
    nothing = Observation(NOW, 1)
    assert check(asked, nothing).command.setpoint is None


def test_the_lead_is_trimmed_to_a_metre():
    guarded = check(command((3.0, 0.0, 50.0)))
    assert guarded.command.setpoint.position_w == pytest.approx((1.0, 0.0, 50.0))
    assert not guarded.refused


def test_speed_near_the_turbine_is_trimmed_to_its_bound():
    near = airspace(sphere_w=np.array([10.0, 0.0, 50.0]), corridor_w=np.array([[1.0, 0.0, 50.0]]))
    before = Setpoint((0.0, 0.0, 50.0), (2.0, 0.0, 0.0), 0.0)
    guarded = check(command((0.0, 0.0, 50.0), (0.0, 3.0, 0.0)), space=near, previous=before)
    assert np.linalg.norm(guarded.command.setpoint.velocity_w) <= 2.0 + 1e-9


def test_speed_does_not_grow_faster_than_the_vehicle_may_accelerate():
    guarded = check(command((0.0, 0.0, 50.0), (2.0, 0.0, 0.0)))
    assert 0 < guarded.command.setpoint.velocity_w[0] <= 0.1
    before = Setpoint((0.0, 0.0, 50.0), (2.0, 0.0, 0.0), 0.0)
    braking = check(command((0.0, 0.0, 50.0), (0.0, 0.0, 0.0)), previous=before)
    assert braking.command.setpoint.velocity_w == (0.0, 0.0, 0.0)


def test_the_allowed_closing_speed_is_the_boundary_of_its_rule():
    speeds = np.array([0.2, 0.5, 1.0, 1.5, 2.0, 3.0])
    distances = 8 + 1.1 * speeds + speeds**2 / 4
    assert allowed_closing_mps(distances, 8.0) == pytest.approx(speeds)
    assert (allowed_closing_mps(np.array([8.0, 5.0]), 8.0) == 0.0).all()


@pytest.mark.parametrize(("clearance", "passes"), [(12.2, True), (9.3, True), (8.05, False)])
def test_a_way_must_end_where_it_is_clear(clearance, passes):
    before = Setpoint((0.0, 0.0, 50.0), (0.0, 1.0, 0.0), 0.0)
    asked = command((0.3, 0.0, 50.0), (0.2, 0.0, 0.0))
    guarded = check(asked, surroundings=wall_at(clearance), previous=before)
    moved = guarded.command.setpoint.position_w[0]
    if passes:
        assert moved == pytest.approx(0.3)
    else:
        assert moved < 0.05


def test_a_vehicle_that_closes_too_fast_is_pulled_back():
    flying = observe(velocity=(2.0, 0.0, 0.0))
    guarded = check(command((0.2, 0.0, 50.0)), flying, wall_at(9.5))
    assert guarded.refused
    assert guarded.command.setpoint.position_w[0] < -0.5
    assert guarded.command.setpoint.velocity_w[0] < 0


def test_a_vehicle_that_closes_too_fast_with_something_behind_it_is_stopped():
    flying = observe(velocity=(2.0, 0.0, 0.0))
    hemmed = around((9.5 + RADIUS, 0.0, 50.0), (-9.6 - RADIUS, 0.0, 50.0))
    guarded = check(command((0.2, 0.0, 50.0)), flying, hemmed)
    assert guarded.refused
    assert is_hold(guarded)


def test_nearer_than_the_clearance_it_moves_outward():
    guarded = check(command((0.5, 0.0, 50.0)), surroundings=wall_at(6.0))
    assert guarded.refused
    assert guarded.command.setpoint.position_w[0] < -0.5
    assert guarded.command.setpoint.velocity_w[0] < 0


def test_nearer_than_the_clearance_an_outward_setpoint_passes():
    asked = command((-0.5, 0.0, 50.0), (-0.05, 0.0, 0.0))
    assert check(asked, surroundings=wall_at(6.0)).command == asked


def test_between_two_obstacles_it_holds():
    both = around((6.0, 0.0, 50.0), (-6.0, 0.0, 50.0))
    guarded = check(command((0.5, 0.0, 50.0)), surroundings=both)
    assert is_hold(guarded)


def test_the_closed_sphere_is_not_entered_until_it_is_open():
    sphere = {"sphere_w": np.array([50.5, 0.0, 50.0]), "sphere_radius_m": 50.0}
    asked = command((0.8, 0.0, 50.0))
    assert check(asked, space=airspace(**sphere, open=False)).refused
    assert check(asked, space=airspace(**sphere, open=True)).refused
    corridor = np.array([[3.0, 0.0, 50.0]])
    opened = airspace(**sphere, open=True, corridor_w=corridor)
    assert not check(asked, space=opened).refused
    closed_again = airspace(**sphere, open=False, corridor_w=corridor)
    assert check(asked, space=closed_again).refused
    assert not check(command((-0.5, 0.0, 50.0)), space=airspace(**sphere, open=False)).refused


@pytest.mark.parametrize(("age", "passes"), [(0.05, True), (0.5, True), (0.51, False)])
def test_near_the_turbine_nothing_moves_on_an_old_scan(age, passes):
    near = airspace(sphere_w=np.array([20.0, 0.0, 50.0]))
    guarded = check(command((0.5, 0.0, 50.0)), observe(scan_age=age), space=near)
    assert guarded.refused is not passes


def test_on_an_old_scan_the_known_way_out_stays_open_to_who_leaves():
    near = airspace(sphere_w=np.array([20.0, 0.0, 50.0]), corridor_w=np.array([[-1.0, 0.0, 50.0]]))
    asked = command((0.0, 0.5, 50.0), phase=Phase.STAND_OFF)
    assert not check(asked, observe(scan_age=5.0), space=near).refused
    assert check(command((0.0, 0.5, 50.0)), observe(scan_age=5.0), space=near).refused


@pytest.mark.parametrize(
    ("position", "asked"),
    [((249.9, 0.0, 50.0), (250.4, 0.0, 50.0)), ((0.0, 0.0, 299.8), (0.0, 0.0, 300.5))],
)
def test_cylinder_and_height_are_not_left_but_may_be_come_back_into(position, asked):
    assert check(command(asked), observe(position)).refused
    outside = tuple(1.01 * np.array(position))
    back = tuple(np.array(outside) + np.sign(np.array(position) - np.array(asked)) * 0.4)
    assert not check(command(back), observe(outside)).refused


def test_no_setpoint_passes_that_obeyed_for_ever_ends_nearer_than_the_clearance():
    rng = np.random.default_rng(11)
    passed = 0
    for _ in range(4000):
        here = np.array([0.0, 0.0, 50.0])
        points = here + rng.uniform(-18, 18, (rng.integers(1, 6), 3))
        distance = np.linalg.norm(points - here, axis=1).min() - RADIUS
        before = Setpoint((0.0, 0.0, 50.0), tuple(rng.uniform(-2, 2, 3)), 0.0)
        asked = command(here + rng.uniform(-2, 2, 3), rng.uniform(-3, 3, 3))
        sent = check(asked, surroundings=around(*points), previous=before).command.setpoint
        rest = np.array(sent.position_w) + REST_S * np.array(sent.velocity_w)
        then = np.linalg.norm(points - rest, axis=1).min() - RADIUS
        assert then >= min(8.0, distance) - 1e-3
        assert np.linalg.norm(np.array(sent.position_w) - here) <= 1.0 + 1e-9
        passed += sent.velocity_w != (0.0, 0.0, 0.0)
    assert passed > 300


def test_the_same_question_has_the_same_answer():
    asked = command((0.7, 0.2, 50.1), (0.4, 0.0, 0.1))
    assert check(asked, surroundings=wall_at(9.0)) == check(asked, surroundings=wall_at(9.0))


def test_the_model_stands_where_the_position_has_drifted_to():
    asked = command((0.2, 0.0, 50.0))
    before = check(asked, space=airspace(model=Wall()))
    assert not before.refused
    assert before.clearance_m == pytest.approx(10.0 - RADIUS)
    drifted = check(asked, space=airspace(model=Wall(), drift_w=np.array([-2.0, 0.0, 0.0])))
    assert drifted.clearance_m == pytest.approx(8.0 - RADIUS)
    assert drifted.refused
