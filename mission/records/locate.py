"""What a pixel of a stored photo shows: blade, side, metre, place on the chord, size of a pixel."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from pathlib import Path

import cv2
import numpy as np

from mission.records.photo_record import NotARecord, PhotoRecord, View, read_record
from perception.blade_in_picture import BladeStations, Seen, outline_px, see
from perception.lens import Lens
from perception.values import Float

#: Nearer to an edge than this share of the chord is at the edge.
_EDGE_SHARE = 0.1
_END_M = 0.5


class OutsidePicture(ValueError):
    """The pixel does not lie in the picture."""


@dataclass(frozen=True, slots=True)
class Place:
    """What one pixel shows."""

    x_px: float
    y_px: float
    shows: str
    """`blade`, or `background` where the pixel misses the blade."""
    metre: float | None = None
    metre_sigma_m: float | None = None
    chord_share: float | None = None
    """0 at the leading edge, 1 at the trailing edge."""
    from_leading_m: float | None = None
    """Along the chord."""
    chord_sigma_m: float | None = None
    face: str | None = None
    """`PS` or `SS`: the side of the blade's skin."""
    near: str | None = None
    """`leading edge`, `trailing edge`, `root` or `tip`, where it is near one."""
    mm_per_px: float | None = None
    """At right angles to the line of sight."""
    incidence_deg: float | None = None
    """Of the line of sight on the skin: 0 is straight on."""
    beside_px: float | None = None
    """From the blade's outline, where the pixel misses it."""
    uncertain: bool = False
    """Nearer to the outline than the blade's place is known: it may as well be the other."""


@dataclass(frozen=True, slots=True)
class Located:
    """The answer for one pixel, or for a line between two."""

    photo: str
    turbine: str
    blade: str
    serial: str
    side: str
    place: Place
    to: Place | None = None
    length_mm: float | None = None
    """Between the two places."""
    flat: bool = False
    """One end misses the blade: the length is measured in a plane across the line of sight."""

    def as_json(self) -> dict[str, object]:
        """Return the answer as plain values."""
        return asdict(self)


def locate(photo: Path, pixel: tuple[float, float], to: tuple[float, float] | None) -> Located:
    """Return what a pixel of a photo shows, and how far it is to another.

    Raises `NotARecord` for a file that is no photo of a mission, `OutsidePicture`.
    """
    record = _checked(photo)
    view = record.view
    blade = None if view is None else view.blade()
    if view is None or blade is None:
        raise NotARecord(
            f"the sidecar of {photo} does not say where the blade is: "
            "no blade had been measured, or an older version wrote it"
        )
    pixels = np.array([pixel] if to is None else [pixel, to])
    for x, y in pixels:
        if not (0 <= x <= record.width_px and 0 <= y <= record.height_px):
            raise OutsidePicture(
                f"pixel {x:g} {y:g} lies outside the picture of "
                f"{record.width_px} x {record.height_px} pixels"
            )
    lens = view.lens(record.width_px, record.height_px)
    seen = see(blade, pixels, view.camera(), lens)
    outline = outline_px(blade, view.camera(), lens)
    places = [_place(k, pixels[k], seen, blade, outline, record, view) for k in range(len(pixels))]
    length, flat = (None, False) if to is None else _length_mm(pixels, seen, blade, view, lens)
    return Located(
        photo=str(photo),
        turbine=record.turbine,
        blade=record.blade,
        serial=record.serial,
        side=record.side,
        place=places[0],
        to=None if to is None else places[1],
        length_mm=length,
        flat=flat,
    )


def _checked(photo: Path) -> PhotoRecord:
    if not photo.is_file():
        raise NotARecord(f"there is no photo {photo}")
    if photo.suffix.lower() not in {".jpg", ".jpeg"}:
        raise NotARecord(f"{photo} is not a photo: its name does not end in .jpg")
    return read_record(photo)


def _place(
    index: int,
    pixel: Float,
    seen: Seen,
    blade: BladeStations,
    outline: Float,
    record: PhotoRecord,
    view: View,
) -> Place:
    # Positive inside the outline.
    inside_px = float(
        cv2.pointPolygonTest(
            outline.astype(np.float32), (float(pixel[0]), float(pixel[1])), measureDist=True
        )
    )
    distance = np.linalg.norm(blade.centre_w.mean(axis=0) - np.array(view.position_w))
    across_m = view.across_sigma_m or 0.0
    across_px = across_m * record.focal_px / float(distance)
    x, y = float(pixel[0]), float(pixel[1])
    if not seen.hit[index]:
        return Place(
            x, y, "background",
            beside_px=round(max(0.0, -inside_px), 1),
            uncertain=-inside_px < across_px,
        )  # fmt: skip
    metre, share = float(seen.metre_m[index]), float(seen.chord_share[index])
    chord_m = float(np.interp(metre, blade.metre_m, blade.chord_m))
    return Place(
        x,
        y,
        "blade",
        metre=round(metre, 3),
        metre_sigma_m=record.metre_sigma_m,
        chord_share=round(share, 3),
        from_leading_m=round(share * chord_m, 3),
        chord_sigma_m=round(across_m, 3),
        face="PS" if seen.pressure[index] else "SS",
        near=_near(metre, share, view.blade_length_m),
        mm_per_px=round(float(seen.depth_m[index]) * 1000 / record.focal_px, 3),
        incidence_deg=round(math.degrees(math.acos(min(1.0, float(seen.cosine[index])))), 1),
        uncertain=abs(inside_px) < across_px,
    )


def _near(metre: float, share: float, length_m: float | None) -> str | None:
    if metre < _END_M:
        return "root"
    if length_m is not None and length_m - metre < _END_M:
        return "tip"
    if share < _EDGE_SHARE:
        return "leading edge"
    return "trailing edge" if share > 1 - _EDGE_SHARE else None


def _length_mm(
    pixels: Float, seen: Seen, blade: BladeStations, view: View, lens: Lens
) -> tuple[float, bool]:
    """Return the distance between two places; and whether it was measured in a flat plane."""
    if seen.hit.all():
        return round(float(np.linalg.norm(seen.point_w[0] - seen.point_w[1])) * 1000, 1), False
    camera = view.camera()
    depths = seen.depth_m[seen.hit]
    if len(depths):
        depth = float(depths[0])
    else:
        forward = camera.rotation_wc[:, 2]
        depth = float(((blade.centre_w - camera.position_w) @ forward).mean())
    rays = lens.rays(pixels)
    points = rays / rays[:, 2:] * depth
    return round(float(np.linalg.norm(points[0] - points[1])) * 1000, 1), True
