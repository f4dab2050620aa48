"""What the report draws: the rotor, the blades as maps, exposure curves, the course of the flight.

Everything here is arithmetic on a `MissionFile`, in the coordinates of the picture it stands in;
the template only places it. Percent are of a pass's length or of the mission's duration.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from mission.records.mission_file import MissionFile, PassPart, PhotoPart
from mission.remote.messages import EventMessage

_GRID_STEPS_M = (5, 10, 20, 25, 50)
_MOST_GRID_LINES = 8
_CURVE_WIDTH, _CURVE_HEIGHT = 280.0, 96.0
_LABEL_FROM_SHARE = 6.0
#: Below it the angle's figure does not fit between the tower and the blade.
_NARROW_DEG = 50.0


@dataclass(frozen=True, slots=True)
class Arm:
    """One blade of the rotor's picture: seen from upwind, hub at (0, 0), y down, length 100."""

    name: str
    turn_deg: float
    """Rotation of a blade drawn straight down, as SVG turns: clockwise positive."""
    label_x: float
    label_y: float


@dataclass(frozen=True, slots=True)
class RotorPicture:
    """The rotor as the viewer in front of it sees it."""

    arms: tuple[Arm, ...]
    arc: str
    """SVG path of the stop angle, from straight down to the first blade."""
    arc_label: tuple[float, float]
    arc_anchor: str


def rotor_picture(mission: MissionFile) -> RotorPicture | None:
    """Return the rotor's picture, or None where it was not measured."""
    rotor = mission.rotor
    if rotor is None:
        return None
    arms = []
    for blade in rotor.blades:
        # From straight down, counter-clockwise seen from the front: towards the viewer's right.
        x, y = _towards(blade.angle_deg)
        arms.append(Arm(blade.name, -blade.angle_deg, 113 * x, 113 * y + 4))
    x, y = _towards(rotor.stop_angle_deg)
    label_x, label_y = _towards(rotor.stop_angle_deg / 2)
    arc = f"M 0 46 A 46 46 0 0 0 {46 * x:.2f} {46 * y:.2f}"
    if rotor.stop_angle_deg < _NARROW_DEG:
        return RotorPicture(tuple(arms), arc, (-13, 50), "end")
    return RotorPicture(tuple(arms), arc, (66 * label_x, 66 * label_y + 4), "middle")


def _towards(angle_deg: float) -> tuple[float, float]:
    angle = math.radians(angle_deg)
    return math.sin(angle), math.cos(angle)


@dataclass(frozen=True, slots=True)
class Mark:
    """A place or a stretch, in percent of the whole."""

    at: float
    width: float
    words: str
    kind: str = ""


@dataclass(frozen=True, slots=True)
class Strip:
    """One pass on the blade map, root at the left."""

    flown: PassPart
    seen: tuple[Mark, ...]
    unseen: tuple[Mark, ...]
    photos: tuple[Mark, ...]
    grid: tuple[Mark, ...]
    true_coverage: float | None
    """Share of the side's true skin seen, by the simulated world."""


def strips(mission: MissionFile) -> list[Strip]:
    """Return the blade map's rows, in the order of blades and sides."""
    truth = {} if mission.truth is None else mission.truth.coverage
    return [
        _strip(
            one,
            [p for p in mission.photo_list if (p.blade, p.side) == (one.blade, one.side)],
            truth.get(one.blade, {}).get(one.side),
        )
        for one in mission.passes
    ]


def _strip(one: PassPart, photos: Sequence[PhotoPart], true_coverage: float | None) -> Strip:
    percent = 100 / max(one.length_m, 1e-6)
    spans = [
        Mark(low * percent, (high - low) * percent, f"photographed {low:.1f} to {high:.1f} m")
        for low, high in one.photographed_m
    ]
    gaps = [
        Mark(gap.from_m * percent, (gap.to_m - gap.from_m) * percent, gap.reason)
        for gap in one.unseen
    ]
    # Kept photos last, so that they lie over rejected ones.
    dots = [
        Mark(
            min(max(photo.metre * percent, 0.0), 100.0),
            0.0,
            f"{photo.metre:.1f} m" + (f": {photo.reason}" if photo.reason else ""),
            "kept" if photo.kept else "rejected",
        )
        for photo in sorted(photos, key=lambda photo: photo.kept)
    ]
    fine = next((s for s in _GRID_STEPS_M if one.length_m / s <= _MOST_GRID_LINES), 50)
    lines = range(0, int(one.length_m) + 1, fine)
    grid = tuple(Mark(metre * percent, 0.0, str(metre)) for metre in lines)
    return Strip(one, tuple(spans), tuple(gaps), tuple(dots), grid, true_coverage)


@dataclass(frozen=True, slots=True)
class Curve:
    """Mean grey (0-255) of a pass's kept photos along the blade, as SVG."""

    blade: str
    side: str
    length_m: float
    points: str
    """A polyline, root at the left, white on top."""
    dots: tuple[tuple[float, float, bool, str], ...]
    """x, y, in range, words."""


def exposure_curves(mission: MissionFile) -> list[Curve]:
    """Return a curve for each pass with at least one judged photo."""
    low, high = mission.exposure.range
    curves = []
    for one in mission.passes:
        dots = []
        for photo in sorted(mission.photo_list, key=lambda photo: photo.metre):
            grey = photo.mean_grey
            mine = (photo.blade, photo.side) == (one.blade, one.side)
            if not mine or not photo.kept or grey is None:
                continue
            share = min(max(photo.metre / max(one.length_m, 1e-6), 0.0), 1.0)
            within = low <= grey <= high if photo.in_range is None else photo.in_range
            words = f"{photo.metre:.1f} m: grey {grey:.0f}"
            dots.append((_CURVE_WIDTH * share, grey_height(grey), within, words))
        if dots:
            points = " ".join(f"{x:.1f},{y:.1f}" for x, y, _, _ in dots)
            curves.append(Curve(one.blade, one.side, one.length_m, points, tuple(dots)))
    return curves


def grey_height(grey: float) -> float:
    """Return where a grey (0-255) stands in a curve's picture, from its top."""
    return _CURVE_HEIGHT * (1 - grey / 255)


@dataclass(frozen=True, slots=True)
class Course:
    """The flight as a bar of phases with what happened above it."""

    phases: tuple[Mark, ...]
    events: tuple[Mark, ...]
    minutes: tuple[Mark, ...]


def course(mission: MissionFile, events: Iterable[EventMessage]) -> Course:
    """Return the flight's bar, from the request to the end."""
    flown = [phase for phase in mission.phases if phase.phase != "idle"]
    begin = mission.begin_s
    length = max((phase.to_s for phase in flown), default=begin) - begin
    percent = 100 / max(length, 1e-6)
    phases = tuple(
        Mark(
            (phase.from_s - begin) * percent,
            (phase.to_s - phase.from_s) * percent,
            phase.phase.replace("_", " "),
            phase.phase,
        )
        for phase in flown
    )
    marks = tuple(
        Mark((e.mission_s - begin) * percent, 0.0, f"{clock(e.mission_s - begin)} {e.text}", kind)
        for e in events
        if (kind := e.severity) not in ("none", "info") and not e.cleared
    )
    step = 1 if length < 900 else 5
    minutes = tuple(
        Mark(60 * minute * percent, 0.0, str(minute))
        for minute in range(0, int(length / 60) + 1, step)
    )
    return Course(phases, marks, minutes)


def labelled(mark: Mark) -> bool:
    """Tell whether a bar's part is wide enough for its name."""
    return mark.width >= max(_LABEL_FROM_SHARE, 0.95 * len(mark.words))


@dataclass(frozen=True, slots=True)
class Happening:
    """All events with the same words."""

    severity: str
    text: str
    count: int
    first_s: float
    last_s: float


def happenings(events: Iterable[EventMessage]) -> list[Happening]:
    """Return warnings and worse, those of the same words together, in order of the first."""
    found: dict[tuple[str, str], list[float]] = {}
    for event in events:
        if event.severity not in ("none", "info") and not event.cleared:
            found.setdefault((event.severity, event.text), []).append(event.mission_s)
    return [
        Happening(severity, text, len(times), min(times), max(times))
        for (severity, text), times in found.items()
    ]


def clock(seconds: float) -> str:
    """Return minutes and seconds as people write them: 7:05."""
    whole = round(abs(seconds))
    return f"{'-' if seconds < -0.5 else ''}{whole // 60}:{whole % 60:02d}"
