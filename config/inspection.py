"""How the inspection is flown: estimate, track, expose, and what must never happen."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from config.model import ConfigModel, Fraction, NotNegative, Positive

Side = Literal["PS", "SS", "LE", "TE"]
BladeName = Literal["A", "B", "C"]


class Ascent(ConfigModel):
    """Climb along the tower, outside the closed sphere, until the prior hub is known."""

    takeoff_height_m: Annotated[float, Field(ge=10, le=50)] = 12.0
    """Over the ground, which counts as an obstacle like any other."""
    stand_off_m: Positive = 25.0
    """Horizontal distance wanted from the tower's axis in front of the rotor."""
    climb_speed_mps: Annotated[float, Field(gt=0, le=6)] = 3.0


class Estimation(ConfigModel):
    """The stop angle: which method, and when it has converged."""

    method: Literal["rotor_fit", "fermat"] = "rotor_fit"
    stand_off_m: Annotated[float, Field(ge=12, le=40)] = 20.0
    """d_c: distance before the hub from which the rotor is measured."""
    accumulate_s: Annotated[float, Field(ge=0.1, le=10)] = 2.0
    """Scan time that one estimate uses."""
    agree_deg: Positive = 0.5
    """epsilon_a: successive estimates that differ by less have converged."""
    agree_count: Annotated[int, Field(ge=2, le=10)] = 3
    max_iterations: Annotated[int, Field(ge=1, le=100)] = 20
    timeout_s: Positive = 90.0


class FermatMethod(ConfigModel):
    """Parameters of the paper's method (Shi et al. 2025, Sec. III-B), frozen on a tuning set."""

    voxel_m: Positive = 0.2
    plane_threshold_m: Positive = 0.6
    ring_radius_m: Positive = 8.0
    """r_s"""
    search_step_m: Positive = 0.2
    """Delta d"""
    ring_step_m: Positive = 0.1
    """Delta l"""
    search_count: Annotated[int, Field(ge=1)] = 200
    """N"""
    cluster_eps_m: Positive = 2.5
    cluster_min_samples: Annotated[int, Field(ge=1)] = 1
    window_deg: Annotated[float, Field(gt=0, le=360)] = 60.0
    """Horizontal field of view used."""


class Tracking(ConfigModel):
    """Flying along a blade."""

    distance_m: Annotated[float, Field(ge=10, le=20)] = 12.0
    """From the blade's axis."""
    max_distance_m: Annotated[float, Field(ge=10, le=30)] = 20.0
    max_speed_mps: Annotated[float, Field(gt=0, le=2)] = 2.0
    overlap: Annotated[float, Field(ge=0, le=0.8)] = 0.3
    max_view_turn_deg: Annotated[float, Field(ge=0, le=60)] = 45.0
    max_gsd_mm: Positive = 1.5
    lost_foot_s: Positive = 2.0


class Exposure(ConfigModel):
    """Live exposure of the blade."""

    method: Literal["predictive", "step"] = "predictive"
    min_grey: Annotated[float, Field(ge=0, le=255)] = 110.0
    """mu_min: below it the shadow side of a white blade loses its defects in noise."""
    max_grey: Annotated[float, Field(ge=0, le=255)] = 160.0
    """mu_max: above it the sunlit leading edge begins to clip."""
    target_grey: Annotated[float, Field(ge=0, le=255)] = 135.0
    step_ev: Positive = 1 / 3
    """k_mu"""
    disc_radius: Fraction = 0.05
    """r_f as a share of the picture's width."""
    max_wait_s: NotNegative = 0.5
    """A still waits this long for the exposure to come into range."""


class Guard(ConfigModel):
    """What no command may break (all distances from the airframe's outermost point)."""

    min_clearance_m: Annotated[float, Field(ge=5)] = 8.0
    outward_below_m: Annotated[float, Field(ge=5)] = 10.0
    closed_sphere_margin_m: Annotated[float, Field(ge=8)] = 12.0
    """Rotor radius plus this is the sphere round the prior hub, closed until the rotor is known."""
    cylinder_radius_m: Positive = 250.0
    """Round the take-off point."""
    max_height_m: Positive = 300.0
    max_speed_near_mps: Annotated[float, Field(gt=0, le=2)] = 2.0
    max_lead_m: Annotated[float, Field(gt=0, le=3)] = 1.0
    """A setpoint is at most this far ahead of the vehicle."""
    scan_warn_s: Positive = 0.3
    scan_hold_s: Positive = 0.5
    max_wind_mps: Positive = 12.0
    max_gust_mps: Positive = 15.0


class Inspection(ConfigModel):
    """What of the turbine is flown."""

    blades: tuple[BladeName, ...] = ("A", "B", "C")
    sides: tuple[Side, ...] = ("PS", "SS", "LE", "TE")
