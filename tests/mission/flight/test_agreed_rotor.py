from dataclasses import replace

import numpy as np
import pytest

from mission.flight.agreed_rotor import SETTLED_COUNT, agreed_rotor, same_blade, settled
from mission.flight.observation import BladeEstimate, RotorEstimate
from perception.geometry import stop_angle_difference_deg
from perception.rotor import blade_angles_deg, direction_at

DOWN = np.array([0.0, 0.0, -1.0])


def look(stop_angle_deg, sequence, *, hub=(0.0, 0.0, 90.0), normal=(0.0, 1.0, 0.0)):
    blades = tuple(
        BladeEstimate(name, tuple(direction_at(np.radians(angle), np.array(normal), DOWN)), 80.0)
        for name, angle in zip("ABC", blade_angles_deg(stop_angle_deg), strict=True)
    )
    return RotorEstimate(
        stamp_s=float(sequence), sequence=sequence, hub_w=hub, normal_w=normal,
        stop_angle_deg=stop_angle_deg, sigma_deg=0.2, blades=blades,
    )  # fmt: skip


@pytest.mark.parametrize("middle", [20.0, 0.0, 75.0, 119.9])
def test_the_angle_is_the_mean_of_the_looks_that_agreed(middle):
    looks = [look((middle + off) % 120.0, k) for k, off in enumerate((-0.4, -0.1, 0.2))]
    agreed = agreed_rotor(looks)
    assert abs(stop_angle_difference_deg(agreed.stop_angle_deg, middle - 0.1)) < 1e-9
    assert 0.0 <= agreed.stop_angle_deg < 120.0
    assert (agreed.stamp_s, agreed.sequence) == (2.0, 2)
    wanted = look((middle - 0.1) % 120.0, 9)
    for blade in agreed.blades:
        true = same_blade(blade, wanted)
        np.testing.assert_allclose(blade.direction_w, true.direction_w, atol=1e-4)


def test_names_are_those_of_one_look_where_two_looks_name_otherwise():
    looks = [look(74.8, 0), look(75.2, 1), look(75.1, 2)]
    assert same_blade(looks[0].blades[0], looks[1]).name != "A"
    agreed = agreed_rotor(looks)
    assert [blade.name for blade in agreed.blades] == ["A", "B", "C"]
    apart = [np.dot(a.direction_w, b.direction_w) for a in agreed.blades for b in agreed.blades]
    np.testing.assert_allclose(sorted(apart)[:6], -0.5, atol=1e-3)


def test_hub_and_axis_are_means():
    looks = [
        look(10.0, 0, hub=(0.2, 0.0, 90.0), normal=(0.01, 1.0, 0.0)),
        look(10.0, 1, hub=(-0.2, 0.4, 90.2), normal=(-0.01, 1.0, 0.0)),
    ]
    agreed = agreed_rotor(looks)
    np.testing.assert_allclose(agreed.hub_w, (0.0, 0.2, 90.1))
    np.testing.assert_allclose(agreed.normal_w, (0.0, 1.0, 0.0), atol=1e-9)


def test_one_look_is_itself():
    one = look(33.0, 4)
    agreed = agreed_rotor([one])
    assert (agreed.stop_angle_deg, agreed.hub_w) == (one.stop_angle_deg, one.hub_w)
    for ours, its in zip(agreed.blades, one.blades, strict=True):
        np.testing.assert_allclose(ours.direction_w, its.direction_w)


def scattered(count, *, sigma=0.5, rate_dps=0.0, period_s=2.1, seed=1):
    noise = np.random.default_rng(seed)
    looks = []
    for k in range(count):
        angle = 60.0 + rate_dps * period_s * k + noise.normal(0, sigma)
        looks.append(replace(look(angle % 120.0, k), stamp_s=period_s * k))
    return looks


def test_estimates_that_scatter_are_settled_once_there_are_enough():
    assert not settled(scattered(SETTLED_COUNT - 1))
    assert settled(scattered(SETTLED_COUNT + 4))
    assert not settled(scattered(SETTLED_COUNT + 4, sigma=3.0))


@pytest.mark.parametrize("rate", [0.3, -0.4, 2.0])
@pytest.mark.parametrize("count", [8, 12, 20])
def test_those_of_a_rotor_that_turns_are_not(rate, count):
    assert not any(settled(scattered(count, rate_dps=rate, seed=k)) for k in range(20))
