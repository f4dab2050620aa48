"""The book of photos and passes: what was asked, what exists, what is missing."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import Enum

from mission.flight.passes import Leg, SidePass
from mission.flight.report import PassReport, Spread, covered_stretches


class PhotoStatus(Enum):
    """How a photo stands."""

    ASKED = "asked"
    TAKEN = "taken"
    FAILED = "failed"
    REJECTED = "rejected"


@dataclass(slots=True)
class Photo:
    """One photo of the mission."""

    photo_id: int
    leg: Leg
    target_m: float
    """Metre that the plan wanted."""
    metre: float
    """Metre that the optical axis met."""
    asked_s: float
    status: PhotoStatus = PhotoStatus.ASKED


@dataclass(slots=True)
class SideBook:
    """What happened to one side of one blade."""

    planned: SidePass
    photos: list[Photo] = field(default_factory=list)
    distance: Spread = field(default_factory=Spread)
    clearance_min_m: float = math.inf
    skipped: bool = False

    def report(self) -> PassReport:
        """Return the side's line of the mission report."""
        side, least = self.planned, self.clearance_min_m
        taken = [p for p in self.photos if p.status is PhotoStatus.TAKEN]
        return PassReport(
            blade=side.blade,
            side=side.side,
            length_m=side.length_m,
            planned_m=side.planned_m,
            photographed_m=self.photographed_m(),
            distance_mean_m=self.distance.mean,
            distance_rms_error_m=self.distance.rms_error,
            distance_min_m=self.distance.least if self.distance.count else None,
            clearance_min_m=least if math.isfinite(least) else None,
            photos=len(taken),
            rejected=sum(p.status is PhotoStatus.REJECTED for p in self.photos),
            unseen=side.unseen,
            skipped=self.skipped,
            stretches=self.stretches(),
        )

    def photographed_m(self) -> float:
        """Return the metres of blade that taken photos show."""
        return sum(high - low for low, high in self.stretches())

    def stretches(self) -> tuple[tuple[float, float], ...]:
        """Return the stretches (from, to) of the blade that taken photos show, metres."""
        shown = (
            (p.metre - p.leg.footprint_m / 2, p.metre + p.leg.footprint_m / 2)
            for p in self.photos
            if p.status is PhotoStatus.TAKEN
        )
        return covered_stretches(shown, self.planned.length_m, self.planned.unseen)


class Ledger:
    """All sides of the mission, and its photos by id."""

    def __init__(self) -> None:
        self.sides: dict[tuple[str, str], SideBook] = {}
        self._photos: dict[int, Photo] = {}
        self._next_id = 1

    def open_side(self, planned: SidePass) -> None:
        """Begin, or after a new measurement continue, the book of a side."""
        key = (planned.blade, planned.side)
        if key in self.sides:
            self.sides[key].planned = planned
        else:
            self.sides[key] = SideBook(planned)

    def side(self, leg: Leg) -> SideBook:
        """Return the book of a leg's side."""
        return self.sides[leg.blade, leg.side]

    def ask(self, leg: Leg, target_m: float, metre: float, now_s: float) -> Photo:
        """Write down a photo that is being asked for."""
        photo = Photo(self._next_id, leg, target_m, metre, now_s)
        self._next_id += 1
        self._photos[photo.photo_id] = photo
        self.side(leg).photos.append(photo)
        return photo

    def settle(self, photo_id: int, status: PhotoStatus) -> Photo | None:
        """Write down what became of a photo; a rejected one stays rejected."""
        photo = self._photos.get(photo_id)
        if photo is None or photo.status is PhotoStatus.REJECTED or photo.status is status:
            return None
        photo.status = status
        return photo

    def taken(self) -> int:
        """Return how many photos exist and are kept."""
        return sum(p.status is PhotoStatus.TAKEN for p in self._photos.values())

    def coverage(self, *, skipped: bool = True) -> float:
        """Return the share of the planned metres that is photographed.

        ``skipped``: sides that the operator left out count as planned too.
        """
        books = [book for book in self.sides.values() if skipped or not book.skipped]
        planned = sum(book.planned.planned_m for book in books)
        done = sum(book.photographed_m() for book in books)
        if planned <= 0:
            return 0.0 if books or not self.sides else 1.0
        return min(1.0, done / planned)

    def missing(self, leg: Leg) -> tuple[float, ...]:
        """Return the photo metres of a leg, in its order, that no kept photo is near."""
        kept = [
            photo.target_m
            for photo in self.side(leg).photos
            if photo.leg is leg and photo.status in {PhotoStatus.TAKEN, PhotoStatus.ASKED}
        ]
        return tuple(m for m in leg.photos if all(abs(m - k) > 0.05 for k in kept))
