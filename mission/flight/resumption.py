"""A later flight of an unfinished inspection: the same blades by the same names, what exists kept.

The rotor is measured anew, for it must stand as it did: a blade is known by its place alone. What
earlier photos show is then laid on the newly measured blades, so that only what is missing is
flown.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from config.turbine import Turbine
from mission.flight.earlier import Earlier, EarlierPhoto, OnBlade
from mission.flight.flight import Flight
from mission.flight.ledger import PhotoStatus
from mission.flight.leg import Leg
from mission.flight.observation import RotorEstimate
from mission.flight.plan import Plan
from mission.flight.sides import BladeFrame
from mission.flight.skin import Look
from perception.geometry import stop_angle_difference_deg
from perception.rotor import blade_angles_deg
from perception.values import Float

#: A rotor that stands within this of where it stood has not been moved: what two measurements of
#: the same rotor differ by, and the play of a locked shaft.
SAME_DEG = 2.0
MOST_SAME_DEG = 5.0
#: An earlier photo nearer than this share of the spacing stands for a planned one. Strips that it
#: leaves are found by the skin, as in any flight.
STANDS_FOR = 0.35
#: Earlier photos laid on the blades in one tick.
SLICE = 4


def turned_words(earlier: Earlier, rotor: RotorEstimate) -> str:
    """Return why the blades cannot be told by their names any more; empty: they can."""
    if earlier.stop_angle_deg is None:
        return ""
    turned = stop_angle_difference_deg(rotor.stop_angle_deg, earlier.stop_angle_deg)
    unsure = 3.0 * float(np.hypot(rotor.sigma_deg, earlier.sigma_deg))
    if abs(turned) <= min(SAME_DEG + unsure, MOST_SAME_DEG):
        return ""
    return (
        f"the rotor has turned by {turned:+.1f} deg (or by a third of a turn more) since it was "
        "inspected: which blade is which cannot be told; start a new mission"
    )


def renamed(estimate: RotorEstimate, stop_angle_deg: float | None) -> RotorEstimate:
    """Return an estimate whose blades bear the names that they had (design: the nearest).

    ``stop_angle_deg``: by which they were named, None: never.
    """
    if stop_angle_deg is None:
        return estimate
    then = dict(zip("ABC", blade_angles_deg(stop_angle_deg), strict=True))
    now = dict(zip("ABC", blade_angles_deg(estimate.stop_angle_deg), strict=True))

    def name(new: str) -> str:
        return min(then, key=lambda old: abs((now[new] - then[old] + 180.0) % 360.0 - 180.0))

    blades = tuple(replace(blade, name=name(blade.name)) for blade in estimate.blades)
    return replace(estimate, blades=tuple(sorted(blades, key=lambda blade: blade.name)))


def section_of(frame: BladeFrame, turbine: Turbine, metre: float) -> tuple[Float, Float]:
    """Return where the pitch axis passes a section (3,), and its directions as columns (3, 3).

    Towards the leading edge, out of the pressure side, along the axis. The pitch must be known.
    """
    pitch = frame.pitch_rad or 0.0
    shape, share = turbine.blade, metre / frame.length_m
    angle = pitch + float(np.radians(np.interp(share, shape.span, shape.twist_deg)))
    bend = float(np.interp(share, shape.span, shape.prebend_m))
    centre = frame.root_w + metre * frame.axis_w + bend * frame.pressure(pitch)
    directions = np.stack([frame.leading(angle), frame.pressure(angle), frame.axis_w], axis=1)
    return centre, directions


def look_from(place: OnBlade, frame: BladeFrame, turbine: Turbine) -> Look:
    """Return from where a photo was taken, beside the blade as it is measured now."""
    centre, directions = section_of(frame, turbine, place.metre)
    return Look(centre + directions @ np.array(place.eye), directions @ np.array(place.sight))


def adopt_steps(flight: Flight, found: Plan, earlier: Earlier) -> Iterator[Plan | None]:
    """Enter earlier photos into the books, a few a tick: yields None and, last, the plan."""
    frames = {frame.name: frame for frame in found.model.frames}
    for number, photo in enumerate(earlier.photos):
        _adopt(flight, found, frames[photo.blade], photo)
        if number % SLICE == SLICE - 1:
            yield None
    for key in earlier.skipped:
        if key in flight.ledger.sides:
            flight.ledger.sides[key].skipped = True
            flight.note("pass", f"{' '.join(key)} was left out by the operator, and stays so")
    left = sum(len(flight.ledger.missing(leg)) for leg in found.legs)
    flight.note("resumed", f"{len(earlier.photos)} earlier photos, {left} photos to take")
    yield found


def _adopt(flight: Flight, found: Plan, frame: BladeFrame, photo: EarlierPhoto) -> None:
    legs = [leg for leg in found.legs if (leg.blade, leg.side) == (photo.blade, photo.side)]
    if not legs:
        return
    look = None
    if photo.place is not None and frame.pitch_rad is not None:
        look = look_from(photo.place, frame, flight.turbine)
    leg = min(legs, key=lambda one: _apart(one, photo, look))
    nearest = min(leg.photos, key=lambda metre: abs(metre - photo.metre))
    near = abs(nearest - photo.metre) <= STANDS_FOR * leg.spacing_m
    status = PhotoStatus.TAKEN if photo.kept else PhotoStatus.REJECTED
    target = nearest if near else photo.metre
    entered = flight.ledger.adopt(photo.photo_id, leg, target, photo.metre, status)
    entered.exposed = photo.exposed
    if look is not None:
        flight.ledger.looked(entered, look, flight.settings)


def _apart(leg: Leg, photo: EarlierPhoto, look: Look | None) -> float:
    """Return how far a photo is from what a leg would take at its metre."""
    metre = min(max(photo.metre, float(leg.grid_m[0])), float(leg.grid_m[-1]))
    off = abs(metre - photo.metre)
    if look is None:
        return off
    # Rows of one side are flown on one line, and differ in where they aim.
    reach = float(np.linalg.norm(leg.target(metre) - look.eye_w))
    aimed = look.eye_w + reach * look.sight_w
    aside = float(np.linalg.norm(leg.target(metre) - aimed))
    return off + aside + float(np.linalg.norm(leg.position(metre) - look.eye_w))
