"""The turbine is told of every two seconds, while a rotor is known that was measured."""

from dataclasses import replace

import numpy as np

from config.photos import Positioning
from config.presets import load_turbine
from mission.flight.command import SensingMode, SensingTask
from mission.flight.observation import BladeEstimate
from mission.processes.turbine_sight import TurbineSight
from perception.frame_drift import whole_covariance

HUB = (0.0, 0.0, 80.0)
TURBINE = load_turbine("v90-2.0")
TASK = SensingTask(
    SensingMode.BLADE, 1, hub_w=HUB, normal_w=(0.0, 1.0, 0.0), measured_s=10.0,
    blades=(BladeEstimate("A", (0.0, 0.0, 1.0), 0.0),),
)  # fmt: skip
STILL = np.zeros(3)


def skin(drift):
    """Returns of the front of a tower and a blade, both moved by a drift."""
    rng = np.random.default_rng(4)
    metres = rng.uniform(4.0, 30.0, 1500)
    span, shape = metres / TURBINE.blade_length_m, TURBINE.blade
    chord, thick, ahead = (
        np.interp(span, shape.span, column)
        for column in (shape.chord_m, shape.thickness, shape.pitch_axis)
    )
    aside = (ahead - rng.uniform(0.0, 1.0, 1500)) * chord
    near = -0.5 * thick * chord
    blade = np.stack([aside, near, 80.0 + TURBINE.hub_radius_m + metres], axis=1)
    height, turn = rng.uniform(20.0, 60.0, 600), rng.uniform(-1.2, 1.2, 600)
    base, top = TURBINE.tower_base_diameter_m / 2, TURBINE.tower_top_diameter_m / 2
    radius = base + (top - base) * height / TURBINE.tower_height_m
    across, deep = radius * np.sin(turn), TURBINE.overhang_m - radius * np.cos(turn)
    return np.concatenate([blade, np.stack([across, deep, height], axis=1)]) + drift


def looked(drift, *, task=TASK, turbine=TURBINE, seconds=3.0):
    sight, found = TurbineSight(Positioning(method="gnss")), []
    place = np.array([0.0, -25.0, 75.0])
    for tick in range(round(10 * seconds)):
        stamp_s = 20.0 + 0.1 * tick
        one = sight.take(task, turbine, skin(drift)[tick % 10 :: 10], stamp_s, place + drift, STILL)
        if one is not None:
            found.append(one)
    return found


def test_it_is_told_every_two_seconds():
    assert [round(seen.stamp_s, 1) for seen in looked(np.zeros(3), seconds=5.0)] == [
        20.0,
        22.0,
        24.0,
    ]


def test_it_tells_how_far_the_turbine_appears_moved():
    drift = np.array([0.6, -0.8, 0.0])
    seen = looked(drift)[-1]
    assert np.linalg.norm(np.array(seen.offset_w)[:2] - drift[:2]) < 0.35
    # What a heading would turn, 25 m away, is told together with it.
    covariance = whole_covariance(seen.covariance)
    there = np.array([1.0, 0.0, 0.0, -25.0])
    assert there @ covariance @ there < 0.6**2
    assert covariance[1, 1] < 0.8**2


def test_nothing_is_told_without_a_measured_rotor_or_dimensions():
    assert looked(np.zeros(3), task=replace(TASK, measured_s=None), seconds=1.5) == []
    assert looked(np.zeros(3), turbine=None, seconds=1.5) == []
