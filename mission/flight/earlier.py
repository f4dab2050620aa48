"""What earlier flights of the same inspection left behind: photos, and how the rotor then stood.

Plain values, given to the machine in one observation, so that they are recorded and replayed. The
autopilot's local frame may be another one by now: places are told in the frame of the blade.
"""

from __future__ import annotations

from dataclasses import dataclass

Vec3 = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class OnBlade:
    """From where a photo was taken, in the frame of a section of its blade.

    Components towards the leading edge, out of the pressure side, and along the pitch axis from
    root to tip; metres from where the pitch axis passes the section.
    """

    metre: float
    """Of the section, along the pitch axis from the root flange."""
    eye: Vec3
    """Optical centre."""
    sight: Vec3
    """Unit, along the optical axis."""


@dataclass(frozen=True, slots=True)
class EarlierPhoto:
    """One photo that is on the disk."""

    photo_id: int
    blade: str
    side: str
    metre: float
    """Where the optical axis meets the blade."""
    kept: bool
    place: OnBlade | None = None
    """None where the blade's pitch was not known: then only the metre counts."""
    exposed: bool = True
    """False: out of the range of exposure."""


@dataclass(frozen=True, slots=True)
class Standing:
    """How the rotor stood in the autopilot's local frame, and what tells that frame again."""

    hub_w: Vec3
    normal_w: Vec3
    blades: tuple[tuple[str, Vec3, float | None], ...]
    """Name, direction, pitch in degrees."""
    tower_w: Vec3
    """Foot of the tower."""
    latitude_deg: float
    longitude_deg: float
    position_w: Vec3
    """Where the vehicle was in the local frame when it was at this place of the globe."""


@dataclass(frozen=True, slots=True)
class Earlier:
    """All earlier flights of an inspection together."""

    flights: int
    next_photo_id: int
    """Numbers below are taken, whether or not their photos exist."""
    photos: tuple[EarlierPhoto, ...] = ()
    stop_angle_deg: float | None = None
    """Of the estimate that named the blades; None: the rotor was never measured."""
    sigma_deg: float = 0.0
    skipped: tuple[tuple[str, str], ...] = ()
    """(blade, side) that an operator has left out."""
    standing: Standing | None = None
    """The rotor as the newest flight measured it, for a vehicle that is still in the air."""
