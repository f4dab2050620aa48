"""Which of a side's skin the kept photos show, how finely, and why the rest is in none of them.

A side is laid out as a grid: bins along the blade, rows across the chord (leading edge on top; on
the edges' own sides across the section, suction side on top). The definitions are those of
coverage: skin facing the side's view within 45 deg, in a kept photo, met at 60 deg or less, fine
enough. The blade is where each photo's own record has it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from mission.records.photo_record import PhotoRecord
from perception.blade_in_picture import BladeStations
from perception.blade_section import VERTICES, section_outlines
from perception.values import Float

BINS, ROWS = 100, 9
FACING_COS, INCIDENCE_COS = 0.7071, 0.5

Bools = NDArray[np.bool_]


class Why(IntEnum):
    """Why a cell is in no kept photo; the higher, the nearer a photo came to showing it."""

    NOT_IN_VIEW = 0
    COARSE = 1
    FLAT = 2


@dataclass(frozen=True, slots=True, eq=False)
class SkinMap:
    """One side's grid, (ROWS, BINS)."""

    length_m: float
    on_side: Bools
    """Which cells are skin of this side."""
    gsd_mm: Float
    """Of the finest kept photo, at the camera's full size; NaN: in none."""
    why: NDArray[np.int8]
    """`Why`, of cells that are in none."""

    @property
    def seen(self) -> Bools:
        """Which cells a kept photo shows."""
        seen: Bools = self.on_side & np.isfinite(self.gsd_mm)
        return seen


def skin_map(
    records: Sequence[PhotoRecord], side: str, length_m: float, max_gsd_mm: float
) -> SkinMap | None:
    """Return the map of a side by the records of its blade; None where they say too little.

    ``records``: all photos of the blade, of whichever side; those not kept count for its form.
    """
    known = [(one, blade) for one in records if one.view and (blade := one.view.blade())]
    view = _view_of(side, [blade for _, blade in known], length_m)
    if view is None:
        return None
    shape = (ROWS, BINS)
    on_side, gsd = np.zeros(shape, bool), np.full(shape, np.inf)
    why = np.full(shape, int(Why.NOT_IN_VIEW), np.int8)
    for record, blade in known:
        cells = _cells(blade, side, view, length_m)
        if cells is None:
            continue
        columns, rows, points_w, normals_w = cells
        on_side[rows, columns] = True
        if not record.kept:
            continue
        mm, reason = _shown(record, points_w, normals_w, max_gsd_mm)
        np.minimum.at(gsd, (rows, columns), mm)
        np.maximum.at(why, (rows, columns), reason)
    if not on_side.any():
        return None
    return SkinMap(length_m, on_side, np.where(np.isfinite(gsd), gsd, np.nan), why)


def _view_of(side: str, blades: Sequence[BladeStations], length_m: float) -> Float | None:
    """Return the direction (3,) from which a side is looked at: by the chord at half span."""
    nearest, view = np.inf, None
    for blade in blades:
        index = int(np.abs(blade.metre_m - 0.5 * length_m).argmin())
        off = abs(float(blade.metre_m[index]) - 0.5 * length_m)
        if off < nearest:
            outward = blade.pressure_w if side in ("PS", "SS") else blade.leading_w
            nearest, view = off, outward[index] if side in ("PS", "LE") else -outward[index]
    return view


def _cells(
    blade: BladeStations, side: str, view_w: Float, length_m: float
) -> tuple[NDArray[np.intp], NDArray[np.intp], Float, Float] | None:
    """Return columns and rows (N,), points and outward normals (N, 3) of the cells in a part."""
    middles = (np.arange(BINS) + 0.5) * length_m / BINS
    inside = (middles >= blade.metre_m[0]) & (middles <= blade.metre_m[-1])
    columns = np.flatnonzero(inside)
    if len(columns) < 2:
        return None
    part = _at(blade, middles[columns])
    shell = part.shell()
    after = (np.arange(VERTICES) + 1) % VERTICES
    points = (shell + shell[:, after]) / 2
    across = shell[:, after] - shell
    along = np.gradient(points, axis=0)
    normals = np.cross(along, across)
    normals /= np.maximum(np.linalg.norm(normals, axis=2), 1e-12)[:, :, None]
    outward = np.einsum("svk,svk->sv", normals, points - part.centre_w[:, None])
    normals *= np.sign(outward.sum())
    x, y = section_outlines(part.thickness)
    x, y = (x + x[:, after]) / 2, (y + y[:, after]) / 2
    height = _height(side, x, y, part.thickness)
    # Of a bin's facets that face the view, the nearest to each row's middle stands for it.
    facing = normals @ view_w >= FACING_COS
    rows = (np.arange(ROWS) + 0.5) / ROWS
    off = np.abs(height[:, None, :] - rows[None, :, None])
    off = np.where(facing[:, None, :], off, np.inf)
    best = off.argmin(axis=2)
    near = np.take_along_axis(off, best[:, :, None], axis=2)[:, :, 0] <= 1.0 / ROWS
    index, row = np.nonzero(near)
    facet = best[index, row]
    return columns[index], row, points[index, facet], normals[index, facet]


def _height(side: str, x: Float, y: Float, thickness: Float) -> Float:
    """Return where facets (S, V) lie across the picture of a side, 0 at the top to 1; far: not."""
    if side in ("PS", "SS"):
        mine = y < 0 if side == "PS" else y >= 0
        return np.asarray(np.where(mine, x, np.inf), np.float64)
    mine = x < 0.5 if side == "LE" else x >= 0.5
    share = 0.5 - y / np.maximum(thickness, 1e-6)[:, None]
    return np.asarray(np.where(mine, np.clip(share, 0.0, 1.0), np.inf), np.float64)


def _at(blade: BladeStations, metres: Float) -> BladeStations:
    """Return the blade's sections at other metres."""

    def column(values: Float) -> Float:
        return np.asarray(np.interp(metres, blade.metre_m, values), np.float64)

    def vectors(values: Float) -> Float:
        return np.column_stack([column(values[:, axis]) for axis in range(3)])

    return BladeStations(
        metres,
        vectors(blade.centre_w),
        vectors(blade.leading_w),
        vectors(blade.pressure_w),
        column(blade.chord_m),
        column(blade.thickness),
        column(blade.pitch_axis),
    )


def _shown(
    record: PhotoRecord, points_w: Float, normals_w: Float, max_gsd_mm: float
) -> tuple[Float, NDArray[np.int8]]:
    """Return millimetres a pixel (N,), infinite where a photo does not show a cell, and why."""
    assert record.view is not None  # noqa: S101 - those without one were left out
    camera = record.view.camera()
    lens = record.view.lens(record.width_px, record.height_px)
    rays = points_w - camera.position_w
    pixels, ahead = lens.pixels(rays @ camera.rotation_wc)
    inside = (
        ahead
        & (pixels >= 0).all(axis=1)
        & (pixels[:, 0] <= record.width_px)
        & (pixels[:, 1] <= record.height_px)
    )
    distance = np.linalg.norm(rays, axis=1)
    flat = -np.einsum("nk,nk->n", rays, normals_w) < INCIDENCE_COS * distance
    full = 1.0
    if record.gsd_mm and record.gsd_full_mm:
        full = record.gsd_full_mm / record.gsd_mm
    mm = (rays @ camera.rotation_wc[:, 2]) * 1000 / lens.focal_px * full
    coarse = mm > max_gsd_mm
    why = np.full(len(mm), int(Why.NOT_IN_VIEW), np.int8)
    why[inside & coarse] = int(Why.COARSE)
    why[inside & flat] = int(Why.FLAT)
    return np.where(inside & ~flat & ~coarse, mm, np.inf), why
