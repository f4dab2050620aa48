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
SIGMA_FACTOR = 1.8
"""Error over formal error of the fit, on the tuning scenes."""
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
    costs: Float
    """(3,) mean robust cost a row of each blade."""
    rivalry: float
    """How much dearer a row the best fit at quite another pitch is."""
    data: BladeData
    residuals: Float


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
    tilt = math.degrees(math.asin(float(state.normal_w @ down)))
    if not MIN_TILT_DEG < tilt < MAX_TILT_DEG:
        return Refusal(RefusalCode.NOT_A_ROTOR, f"a shaft does not tilt by {tilt:.0f} deg")
    reference_down = down if tower is None else tower.down_w
    first = angle_of(
        direction_at(state.angle_rad, state.normal_w, down), state.normal_w, reference_down
    )
    stop = math.degrees(first) % 120.0
    variance = float(state.covariance[kernel.ANGLE, kernel.ANGLE])
    reference_sigma = math.radians(0.5) if tower is None else tower.sigma_rad
    sigma = math.degrees(math.sqrt(variance * SIGMA_FACTOR**2 + reference_sigma**2))
    names = blade_angles_deg(stop)
    turn = round(((names[0] - math.degrees(first)) % 360.0) / 120.0) % 3
    blades = []
    for i, name in enumerate("ABC"):
        b = (turn + i) % 3
        pitch, pitch_sigma = _pitch(state, b)
        known = pitch is not None
        direction = direction_at(
            state.angle_rad + 2 * math.pi / 3 * b, state.normal_w, down, state.cone_rad
        )
        tip = state.data.reach_m[b]
        blades.append(
            Blade(
                name,
                direction,
                pitch,
                pitch_sigma if known else None,
                tip if tip > 0.93 * radius else None,
            )
        )
    return Rotor(
        stamp_s,
        state.hub_w,
        state.normal_w,
        stop,
        max(sigma, FLOOR_DEG),
        "gravity" if tower is None else "tower",
        (blades[0], blades[1], blades[2]),
        "rotor_fit",
        math.degrees(state.cone_rad),
        len(state.data.rows.r_m),
    )


def _pitch(state: FitState, b: int) -> tuple[float | None, float]:
    """Return a blade's pitch and its sigma, degrees; None rather than a doubtful one.

    Leading and trailing edge are told apart by the sense of rotation and the range that pitch can
    have. A blade may be alike the others or a quarter turn from them: between, the fit is stuck.
    """
    pitches = np.degrees(state.params[kernel.PITCH : kernel.SPACING])
    pitch = float(pitches[b])
    variance = float(state.covariance[kernel.PITCH + b, kernel.PITCH + b])
    sigma = SIGMA_FACTOR * math.degrees(math.sqrt(variance))
    apart = abs(pitch - float(np.median(pitches)))
    alike = apart < MAX_SPREAD_DEG or abs(apart - 90.0) < 2 * MAX_SPREAD_DEG
    inside = PITCH_RANGE_DEG[0] < pitch < PITCH_RANGE_DEG[1]
    return (pitch if inside and alike and sigma < MAX_PITCH_SIGMA_DEG else None), sigma
