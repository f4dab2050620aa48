import math

import numpy as np
import pytest

from drivers.simulated.position_control import Estimate, PositionController, Target
from drivers.simulated.px4_parameters import Parameters
from drivers.simulated.vehicle import Multirotor, attitude_quaternion
from perception.geometry import rotation_from_quaternion

NAN3 = (math.nan, math.nan, math.nan)


def hovering(wind_w=(0.0, 0.0, 0.0), ground_z=0.0):
    body = Multirotor((0.0, 0.0, ground_z), 0.0)
    body.z = 50.0
    controller = PositionController(Parameters())
    for _ in range(1000):
        fly(body, controller, Target((0.0, 0.0, 50.0), NAN3, yaw_rad=0.0), wind_w)
    return body, controller


def fly(body, controller, target, wind_w=(0.0, 0.0, 0.0)):
    estimate = Estimate(body.position_w, body.velocity_w, body.yaw_rad)
    body.step(controller.step(target, estimate, 0.01), wind_w, 0.01)


@pytest.mark.parametrize(("step_m", "speed"), [(8.0, (4.0, 5.6)), (40.0, (9.0, 11.8))])
def test_a_step_of_the_position_is_answered_as_px4_was_measured(step_m, speed):
    # PX4 v1.17: 4.3 m/s over 8 m, 9.5 m/s over 40 m, overshoot 0.7-0.9 m.
    body, controller = hovering()
    fastest = over = 0.0
    for _ in range(2500):
        fly(body, controller, Target((step_m, 0.0, 50.0), NAN3, yaw_rad=0.0))
        fastest, over = max(fastest, body.vx), max(over, body.x - step_m)
    assert speed[0] < fastest < speed[1]
    assert 0.5 < over < (1.0 if step_m == 8.0 else 1.8)
    assert body.x == pytest.approx(step_m, abs=0.1)


def test_a_bare_position_one_metre_ahead_is_flown_slowly():
    body, controller = hovering()
    for _ in range(1500):
        fly(body, controller, Target((body.x + 1.0, 0.0, 50.0), NAN3, yaw_rad=0.0))
    assert 0.6 < body.vx < 1.1


def test_velocity_fed_forward_tracks_a_moving_point_with_little_lag():
    body, controller = hovering()
    for i in range(1500):
        point = 1.5 * i * 0.01
        fly(body, controller, Target((point, 0.0, 50.0), (1.5, 0.0, 0.0), yaw_rad=0.0))
    assert abs(point - body.x) < 0.7
    assert body.vx == pytest.approx(1.5, abs=0.1)


def test_it_holds_against_wind_by_leaning_into_it():
    body, _ = hovering(wind_w=(8.0, 0.0, 0.0))
    assert abs(body.x) < 0.3
    up = rotation_from_quaternion(body.quaternion_wb()) @ (0, 0, 1)
    assert 5 < math.degrees(math.acos(up[2])) < 20
    assert up[0] < 0


def test_the_tilt_limit_holds():
    body, controller = hovering()
    steepest = 0.0
    for _ in range(500):
        fly(body, controller, Target((200.0, 0.0, 50.0), NAN3, yaw_rad=0.0))
        up = rotation_from_quaternion(body.quaternion_wb()) @ (0, 0, 1)
        steepest = max(steepest, math.degrees(math.acos(up[2])))
    assert 35 < steepest < 50


def test_the_yaw_rate_is_limited():
    body, controller = hovering()
    before = body.yaw_rad
    for _ in range(100):
        fly(body, controller, Target((0.0, 0.0, 50.0), NAN3, yaw_rad=math.pi - 0.01))
    assert math.degrees(body.yaw_rad - before) < 46


def test_it_rests_on_the_ground_until_thrust_lifts_it():
    body = Multirotor((3.0, 4.0, 1.0), 0.5)
    controller = PositionController(Parameters())
    for _ in range(100):
        fly(body, controller, Target(idle=True), wind_w=(6.0, 0.0, 0.0))
    assert body.position_w == (3.0, 4.0, 1.0)
    assert body.on_ground


def test_the_attitude_turns_up_onto_the_thrust_axis_after_the_yaw():
    rotation = rotation_from_quaternion(attitude_quaternion(0.2, -0.1, 0.7))
    expected = np.array([0.2, -0.1, 1.0]) / np.linalg.norm([0.2, -0.1, 1.0])
    np.testing.assert_allclose(rotation[:, 2], expected, atol=1e-12)
    level = rotation_from_quaternion(attitude_quaternion(0.0, 0.0, 0.7))
    np.testing.assert_allclose(level[:, 0], [math.cos(0.7), math.sin(0.7), 0], atol=1e-12)
