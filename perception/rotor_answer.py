"""From a settled fit to the rotor that is given out, or a refusal."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from perception import rotor_fit_kernel as kernel
from perception.rotor import (
    Blade,
    Refusal,
    RefusalCode,
    Rotor,
    angle_of,
    blade_angles_deg,
    direction_at,
)
from perception.rotor_edges import BladeData
from perception.tower_reference import TowerReference
from perception.values import Float

MAX_SPREAD_DEG = 9.0
MAX_PITCH_SIGMA_DEG = 9.0
MIN_TILT_DEG, MAX_TILT_DEG = -5.0, 13.0
PITCH_RANGE_DEG = (-14.0, 112.0)
MIN_RIVALRY = 0.08
"""A quite other pitch that costs hardly more a row: neither is given out."""
MAX_MISFIT = 1.4
"""A blade that fits worse than this has some other pitch."""
MAX_ODD_MISFIT = 1.0
"""The same where the blades' pitches differ by a quarter turn: leading and trailing edge are then
not told apart by the other blades."""
QUARTER_DEG = 45.0
"""Pitches further apart than this are taken as a quarter turn apart."""
LOST_MISFIT = 3.0
"""A blade that fits worse than this was not found: neither are the others where they were put."""
PITCH_SIGMA_FACTOR = 1.6
SIGMA_PITCH_DEG = (0.0, 15.0, 30.0, 50.0, 70.0, 85.0)
SIGMA_FACTOR = (1.65, 1.6, 1.7, 1.7, 1.75, 1.9)
"""Error over formal error of the fit by pitch, on scenes with the blades of V27, NREL-2.3-116,
IEA-3.4-130 and drawn ones (`benchmarks`, seeds 52000-52639, every other with any pitch, and theirs
of 97000-103239). Operating blades are given more than those errors need: what one type differs by
is the same on all three blades there, and four types tell little of the others."""
KNOWN_SHARE = 0.7
"""Where the shape is the type's own, less of the error is the shape's."""
TOWER_SIGMA_FACTOR = 0.95
GRAVITY_SIGMA_RAD = math.radians(0.65)
"""Of straight down by gravity against the tower: its lean, and the attitude's error."""
FLOOR_DEG = 0.05


@dataclass(frozen=True, slots=True, eq=False)
class FitState:
    """A settled fit: world ENU, metres, radians; params as `rotor_fit_kernel` orders them."""

    hub_w: Float
    normal_w: Float
    angle_rad: float
    cone_rad: float
    params: Float
    covariance: Float
    misfits: Float
    """(3,) 70th percentile of each blade's residuals, in sigmas: 0.6 where the shape is right."""
    rivalry: float
    """How much dearer a row the best fit at quite another pitch is."""
    data: BladeData
    residuals: Float
    known: bool
    """Whether the sections are those of the turbine's own type."""


def rotor_of(
    state: FitState, tower: TowerReference | None, down: Float, radius: float, stamp_s: float
) -> Rotor | Refusal:
    """Return the rotor of a settled fit, or why it is not one; blades named by the design."""
    residual = state.residuals[np.isfinite(state.residuals)]
    close = float((np.abs(residual) < 0.35).mean()) if len(residual) else 0.0
    if close < 0.6:
        return Refusal(
            RefusalCode.NOT_A_ROTOR, f"only {close:.0%} of the points lie on the fitted blades"
        )
    worst = float(state.misfits.max())
    if worst > LOST_MISFIT:
        return Refusal(
            RefusalCode.NOT_CONVERGED, f"a blade lies {worst:.1f} sigmas off its sections"
        )
    tilt = math.degrees(math.asin(float(state.normal_w @ down)))
    if not MIN_TILT_DEG < tilt < MAX_TILT_DEG:
        return Refusal(RefusalCode.NOT_A_ROTOR, f"a shaft does not tilt by {tilt:.0f} deg")
    reference_down = down if tower is None else tower.down_w
    stop, index, variance = _first_blade(state, down, reference_down)
    median_pitch = math.degrees(float(np.median(state.params[kernel.PITCH : kernel.SPACING])))
    factor = float(np.interp(median_pitch, SIGMA_PITCH_DEG, SIGMA_FACTOR))
    own = factor * (KNOWN_SHARE if state.known else 1.0) * math.sqrt(variance)
    reference_sigma = GRAVITY_SIGMA_RAD if tower is None else TOWER_SIGMA_FACTOR * tower.sigma_rad
    sigma = math.degrees(math.hypot(own, reference_sigma))
    return Rotor(
        stamp_s,
        state.hub_w,
        state.normal_w,
        stop,
        max(sigma, FLOOR_DEG),
        "gravity" if tower is None else "tower",
        _named_blades(state, stop, index, down, radius),
        "rotor_fit",
        math.degrees(state.cone_rad),
        len(state.data.rows.r_m),
    )


def _first_blade(state: FitState, down: Float, reference_down: Float) -> tuple[float, int, float]:
    """Return the stop angle (degrees), the fit's index of the first blade, the variance (rad^2).

    The fit's angle is the common one; each bearing stands a little off it.
    """
    turned = angle_of(
        direction_at(state.angle_rad, state.normal_w, down), state.normal_w, reference_down
    )
    own = [
        math.degrees(turned + state.params[kernel.SPACING + b]) % 360.0 + 120.0 * b
        for b in range(3)
    ]
    first = next((b for b in range(3) if own[b] % 360.0 < 120.0), 0)
    pair = [kernel.ANGLE, kernel.SPACING + first]
    return own[first] % 120.0, first, float(state.covariance[np.ix_(pair, pair)].sum())


def _named_blades(
    state: FitState, stop_angle_deg: float, first: int, down: Float, radius: float
) -> tuple[Blade, Blade, Blade]:
    """Return blades A, B, C; ``first``: the fit's index of the blade at the stop angle."""
    to_a = round((blade_angles_deg(stop_angle_deg)[0] - stop_angle_deg) / 120.0)
    blades = []
    for i, name in enumerate("ABC"):
        b = (first + to_a + i) % 3
        pitch, sigma = _pitch(state, b)
        angle = state.angle_rad + 2 * math.pi / 3 * b + float(state.params[kernel.SPACING + b])
        direction = direction_at(angle, state.normal_w, down, state.cone_rad)
        tip = state.data.reach_m[b]
        seen = tip if tip > 0.93 * radius else None
        blades.append(Blade(name, direction, pitch, None if pitch is None else sigma, seen))
    return blades[0], blades[1], blades[2]


def _pitch(state: FitState, b: int) -> tuple[float | None, float]:
    """Return a blade's pitch and its sigma, degrees; None rather than a doubtful one.

    Leading and trailing edge are told apart by the sense of rotation and the range that pitch can
    have. A blade may be alike the others or a quarter turn from them: between, the fit is stuck.
    """
    pitches = np.degrees(state.params[kernel.PITCH : kernel.SPACING])
    pitch = float(pitches[b])
    variance = float(state.covariance[kernel.PITCH + b, kernel.PITCH + b])
    sigma = PITCH_SIGMA_FACTOR * math.degrees(math.sqrt(variance))
    apart = abs(pitch - float(np.median(pitches)))
    alike = apart < MAX_SPREAD_DEG or abs(apart - 90.0) < 2 * MAX_SPREAD_DEG
    inside = PITCH_RANGE_DEG[0] < pitch < PITCH_RANGE_DEG[1]
    most = MAX_ODD_MISFIT if np.ptp(pitches) > QUARTER_DEG else MAX_MISFIT
    known = inside and alike and sigma < MAX_PITCH_SIGMA_DEG and state.misfits[b] < most
    known = known and state.rivalry > MIN_RIVALRY
    return (pitch if known else None), sigma
