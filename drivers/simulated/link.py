"""What the world process and the renderer tell each other. Private to the field: truth is in it.

Both ends speak pickled dataclasses over a ``multiprocessing.connection`` Unix socket in the run's
private directory. World frame: ENU, metres, origin where the tower's axis meets the ground.
"""

from __future__ import annotations

from dataclasses import dataclass

Vec3 = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]


@dataclass(frozen=True, slots=True)
class TruthState:
    """World -> renderer, 50 times a mission second."""

    t_s: float
    position_w: Vec3
    velocity_w: Vec3
    quaternion_wb: Quaternion
    """w x y z: rotates body FLU into the world."""
    angular_rate_b: Vec3
    """rad/s, FLU"""
    camera_quaternion_wc: Quaternion
    """w x y z: rotates optical vectors into the world (the gimbal's true aim)."""
    camera_rate_rps: float
    """How fast the optical axis turns, for motion blur."""


@dataclass(frozen=True, slots=True)
class CameraSetting:
    """World -> renderer: what the camera was told, in force from ``t_s``."""

    t_s: float
    mode: str
    """`manual`: EV is absolute; `compensation`: EV biases the camera's own automatic."""
    ev: float
    locked: bool = False
    """Automatic exposure lock."""
    longest_s: float = 1 / 2000
    """Exposure time that is exceeded only when the amplifier is at its end."""


@dataclass(frozen=True, slots=True)
class StillRequest:
    """World -> renderer: the shutter opened at ``t_s``."""

    t_s: float
    index: int


@dataclass(frozen=True, slots=True)
class FaultChange:
    """World -> renderer: a device changes its failure word."""

    device: str
    word: str


@dataclass(frozen=True, slots=True)
class Finish:
    """World -> renderer: the mission is over; judge it."""

    mission_dir: str


@dataclass(frozen=True, slots=True)
class StillDone:
    """Renderer -> world: a still exists (or could not be made)."""

    index: int
    t_s: float
    url: str
    ok: bool
    ev: float
    shutter_s: float
    iso: float


@dataclass(frozen=True, slots=True)
class RenderProgress:
    """Renderer -> world, after each scan: how far the devices are, so that the world can wait."""

    t_s: float
    clearance_m: float
    """True distance from the body's centre to the mesh; stays inside the field."""


@dataclass(frozen=True, slots=True)
class Judgement:
    """Renderer -> world, once, after `Finish`: the truth of the mission as JSON."""

    json_text: str
