"""The book of photos and passes: what was asked, what exists, what is missing."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum

import numpy as np

from config.settings import Settings
from mission.flight.leg import Leg, SidePass
from mission.flight.report import PassReport, Spread, covered_stretches
from mission.flight.rotor_model import RotorModel
from mission.flight.skin import Look, Mask, Skin


class PhotoStatus(Enum):
    """How a photo stands."""

    ASKED = "asked"
    TAKEN = "taken"
    FAILED = "failed"
    REJECTED = "rejected"
    BLURRED = "blurred"
    """It exists, but the vehicle moved too fast while it was taken: it counts for nothing."""


#: What a photo is for good, whatever is heard of it later.
LASTING = frozenset({PhotoStatus.REJECTED, PhotoStatus.BLURRED})
#: Photos are taken again until this share of the skin that a leg's photos can show is shown.
COVERED_SHARE = 0.99
BESIDE_TOWER_M = 0.7
#: Of one metre: what these did not show is out of sight from there.
ENOUGH_PHOTOS = 2


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
    exposed: bool = True
    """False: it is out of the range of exposure, and kept as the best there is."""
    look: Look | None = None
    """Where it was really taken from, once the shutter was open."""
    shows: Mapping[str, Mask] = field(default_factory=dict)
    """By side of the blade: which facets of its skin it shows."""


@dataclass(slots=True)
class SideBook:
    """What happened to one side of one blade."""

    planned: SidePass
    photos: list[Photo] = field(default_factory=list)
    distance: Spread = field(default_factory=Spread)
    clearance_min_m: float = math.inf
    skipped: bool = False

    def report(self, coverage: float | None) -> PassReport:
        """Return the side's line of the mission report; ``coverage``: share of its skin."""
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
            rejected=sum(p.status in LASTING for p in self.photos),
            unseen=side.unseen,
            skipped=self.skipped,
            stretches=self.stretches(),
            coverage=coverage,
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
        self._skins: Mapping[str, Mapping[str, Skin]] = {}
        self._model: RotorModel | None = None

    def measured(
        self, skins: Mapping[str, Mapping[str, Skin]], model: RotorModel | None = None
    ) -> None:
        """Take the skins of the measured rotor, by blade and side, and what may hide them."""
        self._skins, self._model = skins, model

    def looked(self, photo: Photo, look: Look, settings: Settings) -> None:
        """Write down from where a photo was taken: it tells which skin it shows."""
        photo.look = look
        skins = self._skins.get(photo.leg.blade, {})
        photo.shows = {
            side: skin.seen_in(look, settings, self._model) for side, skin in skins.items()
        }

    def covered(self, blade: str, side: str, *, well: bool = False) -> Mask | None:
        """Return which facets of a side the kept photos of its blade show; None: not known.

        ``well``: only those in the range of exposure count.
        """
        skin = self._skins.get(blade, {}).get(side)
        if skin is None:
            return None
        seen: Mask = np.zeros(len(skin.areas_m2), bool)
        for photo in self._photos.values():
            mask = photo.shows.get(side)
            kept = photo.status is PhotoStatus.TAKEN and photo.leg.blade == blade
            if kept and (photo.exposed or not well) and mask is not None and len(mask) == len(seen):
                seen |= mask
        return seen

    def skin_share(self, blade: str, side: str) -> float | None:
        """Return the share of a side's skin that photos show in range; None: not known."""
        seen, skin = self.covered(blade, side, well=True), self._skins.get(blade, {}).get(side)
        return None if seen is None or skin is None else skin.share(seen)

    def reports(self, *, skins: bool = True) -> tuple[PassReport, ...]:
        """Return the lines of the mission report; ``skins``: with the share of skin shown."""
        return tuple(
            book.report(self.skin_share(blade, side) if skins else None)
            for (blade, side), book in self.sides.items()
        )

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

    def number_from(self, photo_id: int) -> None:
        """Number new photos from here on: the numbers before are an earlier flight's."""
        self._next_id = max(self._next_id, photo_id)

    def adopt(
        self, photo_id: int, leg: Leg, target_m: float, metre: float, status: PhotoStatus
    ) -> Photo:
        """Enter a photo of an earlier flight; after a new measurement, anew."""
        book, before = self.side(leg), self._photos.get(photo_id)
        if before is not None:
            book.photos.remove(before)
        photo = Photo(photo_id, leg, target_m, metre, -math.inf, status)
        self._photos[photo_id] = photo
        book.photos.append(photo)
        return photo

    def settle(self, photo_id: int, status: PhotoStatus) -> Photo | None:
        """Write down what became of a photo; a rejected or blurred one stays so."""
        photo = self._photos.get(photo_id)
        if photo is None or photo.status in LASTING or photo.status is status:
            return None
        photo.status = status
        return photo

    def judged(self, photo_id: int, *, exposed: bool) -> None:
        """Write down how a kept photo is exposed."""
        photo = self._photos.get(photo_id)
        if photo is not None:
            photo.exposed = exposed

    def taken(self) -> int:
        """Return how many photos exist and are kept."""
        return sum(p.status is PhotoStatus.TAKEN for p in self._photos.values())

    def coverage(self, *, skipped: bool = True) -> float:
        """Return the share of the planned metres that is photographed.

        A side whose skin is shown is done, whichever of its photos show it. ``skipped``: sides
        that the operator left out count as planned too.
        """
        books = [book for book in self.sides.values() if skipped or not book.skipped]
        planned = sum(book.planned.planned_m for book in books)
        done = sum(self._done_m(book) for book in books)
        if planned <= 0:
            return 0.0 if books or not self.sides else 1.0
        return min(1.0, done / planned)

    def _done_m(self, book: SideBook) -> float:
        side, photographed_m = book.planned, book.photographed_m()
        skin = self._skins.get(side.blade, {}).get(side.side)
        if skin is None or photographed_m >= side.planned_m:
            return photographed_m
        shown = self.covered(side.blade, side.side)
        share = 0.0 if shown is None else skin.share(shown)
        return max(photographed_m, min(share / COVERED_SHARE, 1.0) * side.planned_m)

    def missing(self, leg: Leg) -> tuple[float, ...]:
        """Return the photo metres of a leg, in its order, that no kept photo is near."""
        kept = [
            photo.target_m
            for photo in self.side(leg).photos
            if photo.leg is leg and photo.status in {PhotoStatus.TAKEN, PhotoStatus.ASKED}
        ]
        return tuple(m for m in leg.photos if all(abs(m - k) > 0.05 for k in kept))

    def thin(self, leg: Leg, settings: Settings) -> tuple[float, ...]:
        """Return the photo metres of a leg, in its order, at which skin is still to be shown.

        By the skin itself: a photo that was aimed a little aside, or taken a little late, leaves
        a strip that only another photo shows. The fewest metres, taken by what each would add,
        that bring the leg to its share; what two photos of a metre did not show, a third will not
        either. Without a skin: the metres that no kept photo is near.
        """
        skin, seen = self._skins.get(leg.blade, {}).get(leg.side), self.covered(leg.blade, leg.side)
        if skin is None or seen is None:
            return self.missing(leg)
        shows = {}
        for metre in leg.photos:
            if self._kept_at(leg, metre) >= ENOUGH_PHOTOS:
                continue
            sight = leg.target(metre) - leg.position(metre)
            look = Look(leg.position(metre), sight / float(np.linalg.norm(sight)))
            # What peeps out beside the tower is not worth flying for once more.
            shows[metre] = skin.seen_in(look, settings, self._model, BESIDE_TOWER_M)
        unseen = np.logical_or.reduce([*shows.values(), seen]) & ~seen
        most_m2 = (1.0 - COVERED_SHARE) * float(skin.areas_m2[unseen | seen].sum())
        wanted: set[float] = set()
        while float(skin.areas_m2[unseen].sum()) > most_m2:
            best = max(shows, key=lambda m: float(skin.areas_m2[shows[m] & unseen].sum()))
            wanted.add(best)
            unseen = unseen & ~shows[best]
        return tuple(metre for metre in leg.photos if metre in wanted)

    def _kept_at(self, leg: Leg, metre: float) -> int:
        """Return how many kept photos were meant for a metre of this leg's line."""
        return sum(
            photo.status is PhotoStatus.TAKEN
            and photo.leg.view_w is leg.view_w
            and abs(photo.target_m - metre) < 0.05
            for photo in self.side(leg).photos
        )
