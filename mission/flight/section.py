"""The chord along a blade, as a viewer sees it: its middle and its extent."""

from __future__ import annotations

import numpy as np

from config.turbine import Turbine
from mission.flight.sides import BladeFrame
from perception.values import Float


class Section:
    """The chord along a blade, as a viewer sees it."""

    def __init__(self, frame: BladeFrame, turbine: Turbine, grid_m: Float) -> None:
        """``grid_m``: (M,) metres."""
        shape, share = turbine.blade, grid_m / frame.length_m
        pitch = frame.pitch_rad or 0.0
        chord, twist, thickness, prebend, axis = (
            np.interp(share, shape.span, column)
            for column in (
                shape.chord_m, shape.twist_deg, shape.thickness, shape.prebend_m, shape.pitch_axis
            )
        )  # fmt: skip
        self.turbine = turbine
        angles = pitch + np.radians(twist)
        lead = np.cos(angles)[:, None] * frame.rotation_w + np.sin(angles)[:, None] * frame.upwind_w
        self.grid_m = grid_m
        self._frame = frame
        self._bend_w = prebend[:, None] * frame.pressure(pitch)
        self._middle_w = ((axis - 0.5) * chord)[:, None] * lead
        self._half_chord_w = 0.5 * chord[:, None] * lead
        self._half_thick_m = 0.5 * chord * thickness

    def across(self, view_w: Float) -> Float:
        """Return the unit direction (3,) across the blade, square to the view."""
        across: Float = np.asarray(np.cross(self._frame.axis_w, view_w), np.float64)
        return across / float(np.linalg.norm(across))

    def centre(self, view_w: Float) -> Float:
        """Return (M, 3) from the undeflected axis to the middle of what is seen."""
        across = self.across(view_w)
        return np.asarray(self._bend_w + (self._middle_w @ across)[:, None] * across, np.float64)

    def apparent(self, view_w: Float, distance_m: Float) -> Float:
        """Return (M, 3) from the middle of what is seen to its middle in a picture.

        ``distance_m``: (M,) of the viewer. The end of the chord that is nearer looks larger.
        """
        across = self.across(view_w)
        aside, nearer = self._half_chord_w @ across, self._half_chord_w @ view_w
        return np.asarray((aside * nearer / distance_m)[:, None] * across, np.float64)

    def half_width(self, view_w: Float) -> Float:
        """Return (M,) half of the blade's extent across the view."""
        across = self.across(view_w)
        along = np.abs(self._half_chord_w @ across)
        # An ellipse of chord and thickness, turned: never less than its thickness.
        chord = np.linalg.norm(self._half_chord_w, axis=1)
        sine = np.sqrt(np.maximum(1 - (along / np.maximum(chord, 1e-6)) ** 2, 0.0))
        return np.asarray(np.hypot(along, sine * self._half_thick_m), np.float64)
