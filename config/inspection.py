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
    """Of the climb along the tower."""


class Estimation(ConfigModel):
    """The stop angle: which method, and when it has converged."""

    method: Literal["rotor_fit", "fermat"] = "rotor_fit"
    """`rotor_fit`: the whole rotor in one robust fit; `fermat`: the paper's method."""
    stand_off_m: Annotated[float, Field(ge=12, le=40)] = 20.0
    """d_c: distance before the hub from which the rotor is measured."""
    accumulate_s: Annotated[float, Field(ge=0.1, le=10)] = 2.0
    """Scan time that one estimate uses."""
    agree_deg: Positive = 0.5
    """epsilon_a: successive estimates that differ by less have converged."""
    agree_count: Annotated[int, Field(ge=2, le=10)] = 3
    """So many successive estimates must agree."""
    max_iterations: Annotated[int, Field(ge=1, le=100)] = 20
    """After so many estimates without agreement it is given up."""
    timeout_s: Positive = 90.0
    """After so long before the hub, too."""


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
    """Where `distance_m` is not clear of the turbine, a pass is flown farther off, up to this."""
    max_speed_mps: Annotated[float, Field(gt=0, le=2)] = 2.0
    """Along a blade; slower where a photo would blur."""
    overlap: Annotated[float, Field(ge=0, le=0.8)] = 0.3
    """Of successive photos along the blade, share of a picture; photogrammetry needs 0.6."""
    max_view_turn_deg: Annotated[float, Field(ge=0, le=60)] = 45.0
    """How far a side's first view may be turned about the blade from the straight one, to be clear.

    Further views look at what that one does not show, from farther round.
    """
    max_gsd_mm: Positive = 1.5
    """A pixel of a photo at its full size shows at most so many mm of skin."""
    lost_foot_s: Positive = 2.0
    """After so long without the blade in the scans a pass slows down, then holds."""


class Exposure(ConfigModel):
    """Live exposure of the blade."""

    method: Literal["predictive", "step"] = "predictive"
    """`predictive` inverts the camera's response; `step`: the paper's Algorithm 2."""
    min_grey: Annotated[float, Field(ge=0, le=255)] = 110.0
    """mu_min: below it the shadow side of a white blade loses its defects in noise."""
    max_grey: Annotated[float, Field(ge=0, le=255)] = 160.0
    """mu_max: above it the sunlit leading edge begins to clip."""
    target_grey: Annotated[float, Field(ge=0, le=255)] = 135.0
    """Mean grey of the blade that is aimed at."""
    step_ev: Positive = 1 / 3
    """k_mu"""
    disc_radius: Fraction = 0.05
    """r_f as a share of the picture's width."""
    max_wait_s: NotNegative = 0.5
    """A still waits this long for the exposure to come into range."""


class Guard(ConfigModel):
    """What no command may break (all distances from the airframe's outermost point)."""

    min_clearance_m: Annotated[float, Field(ge=5)] = 8.0
    """No setpoint leads nearer to anything than this."""
    outward_below_m: Annotated[float, Field(ge=5)] = 10.0
    """Nearer to its blade than this, a pass moves out."""
    closed_sphere_margin_m: Annotated[float, Field(ge=8)] = 12.0
    """Rotor radius plus this is the sphere round the prior hub, closed until the rotor is known."""
    cylinder_radius_m: Positive = 250.0
    """Round the take-off point."""
    max_height_m: Positive = 300.0
    """Over the take-off point."""
    max_speed_near_mps: Annotated[float, Field(gt=0, le=2)] = 2.0
    """Near the turbine, along blades and on the ways between them."""
    max_lead_m: Annotated[float, Field(gt=0, le=3)] = 1.0
    """A setpoint is at most this far ahead of the vehicle."""
    scan_warn_s: Positive = 0.3
    """A scan older than this is warned of."""
    scan_hold_s: Positive = 0.5
    """Without a newer scan than this the vehicle holds."""
    max_wind_mps: Positive = 12.0
    """Mean wind, as the autopilot estimates it: above it the vehicle flies home."""
    max_gust_mps: Positive = 15.0
    """A single gust, likewise."""


class Inspection(ConfigModel):
    """What of the turbine is flown."""

    blades: tuple[BladeName, ...] = ("A", "B", "C")
    """A is the blade at -45 to 75 degrees from straight down; B, C follow counter-clockwise."""
    sides: tuple[Side, ...] = ("PS", "SS", "LE", "TE")
    """Pressure and suction side, leading and trailing edge."""
