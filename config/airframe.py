"""The aircraft: how big it is, how it may move, how much energy it has."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from config.model import ConfigModel, Fraction, NotNegative, Positive


class Airframe(ConfigModel):
    """Size of the vehicle and the bounds of its motion."""

    radius_m: Annotated[float, Field(gt=0, le=5)] = 0.9
    """From the centre to the outermost point (a propeller's tip)."""
    max_speed_mps: Annotated[float, Field(gt=0, le=15)] = 6.0
    """Away from the turbine, outside the closed sphere."""
    max_climb_mps: Annotated[float, Field(gt=0, le=8)] = 3.0
    max_descent_mps: Annotated[float, Field(gt=0, le=8)] = 3.0
    max_acceleration_mps2: Annotated[float, Field(gt=0, le=5)] = 1.0
    max_jerk_mps3: Annotated[float, Field(gt=0, le=20)] = 2.0
    max_yaw_rate_dps: Annotated[float, Field(gt=0, le=180)] = 45.0


class Battery(ConfigModel):
    """Power model: hover, plus a share that grows with airspeed; and the reserve."""

    capacity_wh: Positive = 500.0
    """Of the full battery."""
    hover_w: Positive = 800.0
    """Power in a hover."""
    drag_w_per_mps3: NotNegative = 0.35
    """Parasitic power per cube of airspeed."""
    climb_w_per_mps: NotNegative = 90.0
    """Additional power per m/s of climb."""
    reserve: Fraction = 0.20
    """Share of the capacity that is left on landing."""
    autopilot_return_at: Fraction = 0.15
    """Where the autopilot's own low-battery return starts; ours starts 0.05 earlier."""
    telemetry_timeout_s: Positive = 5.0
    """A battery that is not told of for so long counts as low."""
