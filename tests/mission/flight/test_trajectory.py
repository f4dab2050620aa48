import numpy as np
import pytest

from config.airframe import Airframe
from mission.flight.trajectory import Follower, Path

DT = 0.05


def fly(points, speed, airframe=None, slow=lambda t: 1.0, limit_s=120.0):
    airframe = airframe or Airframe()
    follower = Follower(airframe, 1.0)
    follower.start(Path(np.array(points, float), speed, airframe))
    position, velocity, sent = np.array(points[0], float), np.zeros(3), []
    t = 0.0
    while t < limit_s:
        setpoint = follower.follow(tuple(position), 0.0, DT, slow=slow(t))
        sent.append((np.array(setpoint.position_w), np.array(setpoint.velocity_w), position))
        wanted = 0.95 * (sent[-1][0] - position) + 0.67 * sent[-1][1]
        velocity = velocity + DT / 0.3 * (wanted - velocity)
        position = position + DT * velocity
        t += DT
        if follower.arrived(tuple(position)) and np.linalg.norm(velocity) < 0.05:
            break
    return sent, position, t


def test_no_path_is_flown_faster_than_the_airframe_may():
    slow = Airframe(max_speed_mps=1.5)
    sent, _, _ = fly([(0, 0, 50), (20, 0, 50)], 2.5, slow)
    assert max(np.linalg.norm(velocity) for _, velocity, _ in sent) == pytest.approx(1.5, abs=0.02)


def test_a_straight_line_is_flown_within_every_bound():
    sent, position, t = fly([(0, 0, 50), (40, 0, 50)], 2.0)
    velocities = np.array([v for _, v, _ in sent])
    speeds = np.linalg.norm(velocities, axis=1)
    change = np.diff(speeds) / DT
    assert speeds.max() == pytest.approx(2.0, abs=0.02)
    moving = speeds[1:] > 0.1
    assert np.abs(change[moving]).max() <= 1.05
    starting = np.diff(change)[:30] / DT
    assert np.abs(starting).max() <= 2.5
    assert position == pytest.approx([40, 0, 50], abs=0.6)
    assert t < 28


def test_a_setpoint_is_never_more_than_a_metre_ahead():
    sent, _, _ = fly([(0, 0, 20), (60, 0, 20), (60, 60, 60)], 6.0)
    assert max(np.linalg.norm(p - here) for p, _, here in sent) <= 1.0


def test_a_corner_is_rounded_and_hardly_cut():
    sent, _, _ = fly([(0, 0, 50), (20, 0, 50), (20, 20, 50)], 2.0)
    flown = np.array([p for p, _, _ in sent])
    corner = np.linalg.norm(flown - (20, 0, 50), axis=1).min()
    assert corner < 0.6
    velocities = np.array([v for _, v, _ in sent])
    assert np.linalg.norm(np.diff(velocities, axis=0), axis=1).max() / DT < 2.0


def test_slowing_to_nothing_stops_and_going_on_arrives():
    sent, position, _ = fly(
        [(0, 0, 50), (20, 0, 50)], 2.0, slow=lambda t: 0.0 if 4 < t < 9 else 1.0
    )
    speeds = [np.linalg.norm(v) for _, v, _ in sent]
    assert min(speeds[140:175]) == 0.0
    assert position == pytest.approx([20, 0, 50], abs=0.6)


def test_climb_and_descent_keep_their_own_bounds():
    sent, _, _ = fly([(0, 0, 5), (0, 0, 45)], 6.0, Airframe(max_climb_mps=2.5))
    assert max(v[2] for _, v, _ in sent) <= 2.5 + 1e-6


def test_a_hold_stays_where_the_vehicle_was():
    follower = Follower(Airframe(), 1.0)
    first = follower.hold((1.0, 2.0, 3.0), 0.0, DT)
    second = follower.hold((1.3, 2.0, 3.0), 0.0, DT)
    assert first.position_w == second.position_w == (1.0, 2.0, 3.0)
    assert second.velocity_w == (0.0, 0.0, 0.0)


def test_a_path_of_one_point_does_not_move():
    sent, position, _ = fly([(5, 5, 5), (5, 5, 5)], 2.0, limit_s=1.0)
    assert position == pytest.approx([5, 5, 5])
    assert all(np.isfinite(p).all() and np.isfinite(v).all() for p, v, _ in sent)


def pushed(by_mps2=0.8, noise_m=0.0, *, held=True, slack=False):
    """Fly along a line under a gust from the side; return the largest distance from it.

    ``noise_m``: how far the position told is beside the true one, to and fro each second.
    """
    follower, airframe = Follower(Airframe(), 1.0), Airframe()
    follower.start(Path(np.array([(0.0, 0, 50), (40.0, 0, 50)]), 2.0, airframe))
    position, velocity, off = np.array([0.0, 0, 50]), np.zeros(3), []
    for tick in range(round(12.0 / DT)):
        told = position + np.array([0.0, noise_m if tick % 20 < 10 else -noise_m, 0.0])
        setpoint = follower.follow(
            tuple(told), 0.0, DT, velocity_w=tuple(velocity) if held else None, slack=slack
        )
        wanted = 0.95 * (np.array(setpoint.position_w) - told) + setpoint.velocity_w
        gust = np.array([0.0, by_mps2 if 4 < tick * DT < 8 else 0.0, 0.0])
        velocity = velocity + DT * (1.8 * (wanted - velocity) + gust)
        position = position + DT * velocity
        off.append(abs(position[1]))
    return max(off)


def test_where_the_lidar_sees_the_line_a_gust_moves_the_vehicle_half_as_far_from_it():
    assert pushed() < 0.55 * pushed(held=False)


def test_by_the_position_alone_a_strong_gust_is_met_and_the_positions_noise_is_not_followed():
    loose = pushed(3.0, held=False)
    assert loose > 2.0
    assert pushed(3.0, slack=True) < 0.7 * loose
    assert pushed(0.0, noise_m=0.4, slack=True) == pushed(0.0, noise_m=0.4, held=False)
