"""The blade's own pixels in a live frame, metered where the LiDAR and the picture have it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from config.settings import Settings
from config.turbine import Turbine
from mission.flight.command import SensingTask
from mission.flight.sides import BladeFrame, blade_frame
from perception.blade_strip import (
    AIMED_SIGMA_M,
    SEEN_SIGMA_M,
    StripFollower,
    aside_of,
    find_strip,
)
from perception.geometry import pinhole_matrix
from perception.metering import Metered, blade_outline, meter_disc, meter_outline
from perception.projection import project
from perception.values import CameraPose, Float, Frame

#: Share of the blade's thickness that surely is blade where the picture does not show its edges.
SURE_WIDTH = 0.6
#: Share of the width between the edges that the picture shows.
SHOWN_WIDTH = 0.7
#: How far from the middle of the picture the blade counts, in radii of the paper's disc: where it
#: is only supposed to be, and where the picture shows it.
SUPPOSED_RADII, SHOWN_RADII = 4.0, 2.5
#: Aimed farther beside the modelled axis than this, the camera looks at something else.
MOST_DRIFT_M = 4.0
#: The metre is known to this share of the blade.
ABOUT = 0.06
_SPAN: Float = np.linspace(0.0, 1.0, 60, dtype=np.float64)


@dataclass(frozen=True, slots=True, eq=False)
class MeteredBlade:
    """What was metered, and where (pixels)."""

    metered: Metered | None
    centre_px: Float | None
    radius_px: float
    outline_px: Float | None
    range_m: float
    """From the camera to the part of the blade that it looks at."""


class BladeMetering:
    """Meters the blade of a task, frame by frame."""

    def __init__(self, settings: Settings, turbines: Mapping[str, Turbine]) -> None:
        """``turbines``: dimensions by the name of the site."""
        self._settings = settings
        self._follower = StripFollower()
        self._turbines = turbines
        self._sections = {name: _Sections.of(turbine) for name, turbine in turbines.items()}
        self._task_id = -1
        self._frame: BladeFrame | None = None

    def meter(
        self, frame: Frame, camera: CameraPose, task: SensingTask, foot_w: Float | None
    ) -> MeteredBlade | None:
        """Return the metering of a frame; None where no blade is looked for.

        ``foot_w``: (3,) where the LiDAR sees the blade's axis now, None: nowhere.
        """
        if task.blade_root_w is None or task.blade_tip_w is None:
            return None
        if task.task_id != self._task_id:
            self._task_id = task.task_id
            self._follower.reset()
            self._frame = _frame_of(task, self._turbines.get(task.turbine))
        height, width = frame.grey.shape
        settings = self._settings.camera
        matrix = pinhole_matrix(
            settings.focal_length_mm / settings.sensor_width_mm * width, width, height
        )
        root_w, tip_w = np.asarray(task.blade_root_w), np.asarray(task.blade_tip_w)
        if foot_w is not None:
            shift_w = _beside(foot_w, root_w, tip_w)
        else:
            # Where the LiDAR does not see it, the camera is still aimed where the flight has it.
            shift_w = _aimed_beside(camera, root_w, tip_w)
        root_w, tip_w = root_w + shift_w, tip_w + shift_w
        radius_px = self._settings.exposure.disc_radius * width
        near_w = looked_at(camera, root_w, tip_w)
        sections = self._sections.get(task.turbine)
        if sections is not None:
            found = self._on_blade(
                frame, camera, matrix, (root_w, tip_w, near_w), sections,
                shift_w, seen=foot_w is not None,
            )  # fmt: skip
            if found is not None:
                return found
        near_px = project(near_w, camera, matrix)
        metered = meter_disc(frame.grey, near_px, radius_px)
        range_m = math.dist(near_w, camera.position_w)
        return MeteredBlade(metered, near_px, radius_px, None, range_m)

    def _on_blade(
        self,
        frame: Frame,
        camera: CameraPose,
        matrix: Float,
        axis: tuple[Float, Float, Float],
        sections: _Sections,
        shift_w: Float,
        *,
        seen: bool,
    ) -> MeteredBlade | None:
        """Meter a strip along the blade.

        ``axis``: root, tip and the point looked at, (3,) each; ``shift_w``: (3,) of the axis from
        where the model has it; ``seen``: the LiDAR has the blade.
        """
        radius_px = self._settings.exposure.disc_radius * frame.grey.shape[1]
        root_w, tip_w, near_w = axis
        chord, thick = sections.chord_m, sections.thickness_m
        length_m = math.dist(tip_w, root_w)
        here = math.dist(near_w, root_w) / max(length_m, 1e-6)
        about = np.abs(_SPAN - here) < ABOUT
        axis_w = (tip_w - root_w) / max(length_m, 1e-6)
        aside_w = aside_of(axis_w, near_w - camera.position_w)
        if aside_w is None:
            return None
        strip = find_strip(
            frame.grey,
            near_w,
            axis_w,
            camera,
            matrix,
            chord_m=float(chord[about].max()),
            thickness_m=float(thick[about].min()),
            sigma_m=SEEN_SIGMA_M if seen else AIMED_SIGMA_M,
            width_m=None if self._frame is None else sections.width_m(here, self._frame, aside_w),
        )
        place = self._follower.update(strip, frame.stamp_s, float(shift_w @ aside_w))
        half_m, reach_px = 0.5 * SURE_WIDTH * thick, SUPPOSED_RADII * radius_px
        if place is not None:
            middle_m, width_m = place
            moved_w = middle_m * aside_w
            root_w, tip_w, near_w = root_w + moved_w, tip_w + moved_w, near_w + moved_w
            half_m = 0.5 * SHOWN_WIDTH * width_m * chord / float(np.interp(here, _SPAN, chord))
            reach_px = SHOWN_RADII * radius_px
        near_px = project(near_w, camera, matrix)
        outline = blade_outline(root_w, tip_w, half_m, camera, matrix)
        metered = meter_outline(frame.grey, outline, near_px, reach_px)
        range_m = math.dist(near_w, camera.position_w)
        found = MeteredBlade(metered, near_px, reach_px, outline, range_m)
        return None if metered is None else found


@dataclass(frozen=True, slots=True, eq=False)
class _Sections:
    """Those of a blade at every station from root to tip."""

    chord_m: Float
    thickness_m: Float
    twist_rad: Float

    @classmethod
    def of(cls, turbine: Turbine) -> _Sections:
        """Return the sections of a turbine's blades."""
        blade = turbine.blade
        chord = np.interp(_SPAN, blade.span, blade.chord_m)
        thickness = chord * np.interp(_SPAN, blade.span, blade.thickness)
        return cls(chord, thickness, np.radians(np.interp(_SPAN, blade.span, blade.twist_deg)))

    def width_m(self, here: float, frame: BladeFrame, aside_w: Float) -> float | None:
        """Return what shows of the width at a share of the span; None: the pitch is not known.

        ``aside_w``: (3,) unit, across blade and sight. A section is taken for an ellipse.
        """
        if frame.pitch_rad is None:
            return None
        chord, thickness, twist = (
            float(np.interp(here, _SPAN, column))
            for column in (self.chord_m, self.thickness_m, self.twist_rad)
        )
        along, across = (
            float(direction @ aside_w)
            for direction in (
                frame.leading(frame.pitch_rad + twist), frame.pressure(frame.pitch_rad + twist)
            )
        )  # fmt: skip
        return math.hypot(chord * along, thickness * across)


def _frame_of(task: SensingTask, turbine: Turbine | None) -> BladeFrame | None:
    """Return how the blade of a task is turned; None where that was not measured."""
    blade = next((one for one in task.blades if one.name == task.blade), None)
    if turbine is None or blade is None or task.hub_w is None or task.normal_w is None:
        return None
    hub, normal, axis = (np.asarray(v) for v in (task.hub_w, task.normal_w, blade.direction_w))
    return blade_frame(blade.name, hub, normal, axis, blade.pitch_deg, turbine)


def looked_at(camera: CameraPose, root_w: Float, tip_w: Float) -> Float:
    """Return the point (3,) of the blade's axis that comes nearest to the optical axis."""
    axis, sight = tip_w - root_w, camera.rotation_wc[:, 2]
    between = root_w - camera.position_w
    a, b, d, e = axis @ axis, axis @ sight, axis @ between, sight @ between
    parallel = a - b * b < 1e-6 * a
    share = 0.5 if parallel else float((b * e - d) / (a - b * b))
    nearest: Float = root_w + min(max(share, 0.0), 1.0) * axis
    return nearest


def _aimed_beside(camera: CameraPose, root_w: Float, tip_w: Float) -> Float:
    """Return how far (3,) beside the modelled axis the camera is aimed; 0 where not at the blade.

    The flight aims by what it has learned of the position's drift; the model knows none of it.
    """
    nearest_w = looked_at(camera, root_w, tip_w)
    sight = camera.rotation_wc[:, 2]
    away = nearest_w - camera.position_w
    beside: Float = (away @ sight) * sight - away
    axis = tip_w - root_w
    beside = beside - (beside @ axis) / (axis @ axis) * axis
    return beside if float(beside @ beside) < MOST_DRIFT_M**2 else np.zeros(3)


def _beside(foot_w: Float, root_w: Float, tip_w: Float) -> Float:
    """Return how far (3,) the blade was last seen beside the modelled axis."""
    axis, offset = tip_w - root_w, foot_w - root_w
    across: Float = offset - (offset @ axis) / (axis @ axis) * axis
    return across
