import numpy as np

from drivers.livox.sensor_clock import SensorClock


def arrivals(delays_s, start_s=100.0, period_s=0.1):
    for k, delay_s in enumerate(delays_s):
        yield round(k * period_s * 1e9), start_s + k * period_s + delay_s


def test_the_least_delayed_packet_sets_the_clock():
    clock = SensorClock()
    delays_s = np.random.default_rng(0).exponential(0.01, 500) + 0.001
    for sensor_ns, arrival_s in arrivals(delays_s):
        clock.observe(sensor_ns, arrival_s)
    assert abs(clock.mission_s(0) - 100.0) < 0.004


def test_a_delay_that_appears_later_shows_as_age():
    clock = SensorClock()
    delays_s = [0.001] * 100 + [0.8] * 100
    for sensor_ns, arrival_s in arrivals(delays_s):
        clock.observe(sensor_ns, arrival_s)
    age_s = arrival_s - clock.mission_s(sensor_ns)
    assert 0.79 < age_s < 0.81


def test_two_clocks_that_drift_apart_are_followed():
    clock = SensorClock()
    for k in range(20_000):
        clock.observe(round(k * 0.1 * 1e9), 100.0 + k * 0.1 * (1 + 50e-6))
    assert abs(clock.mission_s(round(1999.9e9)) - (100.0 + 1999.9 * (1 + 50e-6))) < 0.001


def test_after_a_reset_the_sensor_may_count_from_zero():
    clock = SensorClock()
    clock.observe(10**12, 50.0)
    clock.reset()
    clock.observe(0, 60.0)
    assert clock.mission_s(0) == 60.0
