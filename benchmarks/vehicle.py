"""The simulated vehicle beside what was measured on PX4: steps, lag, stopping, hovering.

What a mock flies like decides what a mission on it is worth. Each row is flown by the vehicle,
controller, estimator and wind of `bladescout simulate`, and stands beside the figure that PX4
v1.17 with its own simulator gave for the same manoeuvre. (How far it flies on when the link dies
is held to PX4's figures by the tests of the mock autopilot.)
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from random import Random
from typing import Literal

import numpy as np

from config.simulation import Wind
from drivers.simulated.position_control import Estimate, PositionController, Target
from drivers.simulated.position_error import EstimatorError
from drivers.simulated.px4_parameters import Parameters
from drivers.simulated.vehicle import Multirotor, Vec3
from drivers.simulated.wind import WindField

STEP_S = 0.01
HEIGHT_M = 50.0
HOVER_S = 300.0
STILL: Vec3 = (0.0, 0.0, 0.0)
HERE: Vec3 = (0.0, 0.0, HEIGHT_M)


@dataclass(frozen=True, slots=True)
class Row:
    """One manoeuvre."""

    name: str
    value: float
    unit: str
    px4: str
    """What was measured on PX4, as published by the measurement."""


class _Flown:
    """A vehicle in the air, in steps of 10 ms."""

    def __init__(self) -> None:
        self.body = Multirotor((0.0, 0.0, 0.0), 0.0)
        self.body.z = HEIGHT_M
        self._controller = PositionController(Parameters())
        for _ in range(1000):
            self.step(Target(HERE, yaw_rad=0.0))

    def step(
        self, target: Target, wind_w: Vec3 = STILL, error: EstimatorError | None = None
    ) -> None:
        body = self.body
        position, velocity = body.position_w, body.velocity_w
        if error is not None:
            error.step(STEP_S, position, velocity)
            position = _sum(position, error.position)
            velocity = _sum(velocity, error.velocity)
        estimate = Estimate(position, velocity, body.yaw_rad)
        body.step(self._controller.step(target, estimate, STEP_S), wind_w, STEP_S)


def measure(seed: int) -> Iterator[Row]:
    """Yield every row; ``seed`` draws the wind and the estimator's error of the hovers."""
    for step_m, px4_mps in ((8.0, "4.3"), (40.0, "9.5")):
        fastest, over = _step(step_m)
        yield Row(f"step of {step_m:.0f} m: fastest", fastest, "m/s", px4_mps)
        yield Row(f"step of {step_m:.0f} m: overshoot", over, "m", "0.7-0.9")
    yield Row("a bare position 1 m ahead: speed", _one_ahead(), "m/s", "0.75")
    profiles: tuple[tuple[Literal["rtk", "gnss"], str], ...] = (("gnss", "0.6"), ("rtk", "-"))
    for profile, px4_m in profiles:
        wander = _hover(profile, seed)
        yield Row(f"hover with {profile.upper()}: wander within a minute, half", wander, "m", px4_m)


def _step(step_m: float) -> tuple[float, float]:
    flown = _Flown()
    target = Target((step_m, 0.0, HEIGHT_M), yaw_rad=0.0)
    fastest = over = 0.0
    for _ in range(2500):
        flown.step(target)
        fastest, over = max(fastest, flown.body.vx), max(over, flown.body.x - step_m)
    return fastest, over


def _one_ahead() -> float:
    flown = _Flown()
    for _ in range(1500):
        flown.step(Target((flown.body.x + 1.0, 0.0, HEIGHT_M), yaw_rad=0.0))
    return flown.body.vx


def _hover(profile: Literal["rtk", "gnss"], seed: int) -> float:
    """Return half the median range of the true place over a minute of hovering in 5 m/s."""
    flown = _Flown()
    error = EstimatorError(profile, Random(seed))
    field = WindField(Wind(turbulence=0.1), 5.0, 270.0, HEIGHT_M, Random(seed + 1))
    target, places = Target(HERE, yaw_rad=0.0), []
    for index in range(round(HOVER_S / STEP_S)):
        wind_w = field.step(index * STEP_S, STEP_S, HEIGHT_M, flown.body.velocity_w)
        flown.step(target, wind_w, error)
        places.append((flown.body.x, flown.body.y))
    minutes = np.array(places).reshape(5, -1, 2)
    return float(np.median(np.ptp(minutes, axis=1)) / 2)


def _sum(one: Vec3, other: Vec3) -> Vec3:
    return (one[0] + other[0], one[1] + other[1], one[2] + other[2])
