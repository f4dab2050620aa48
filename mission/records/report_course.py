"""The flight as a bar of phases and, on the same axis of time, its plots."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from mission.records.course import Course
from mission.records.mission_file import MissionFile
from mission.remote.messages import EventMessage

WIDTH, HEIGHT = 1000.0, 120.0
_LABEL_FROM_SHARE = 6.0
_STEPS = (1, 2, 5, 10, 20, 50, 100, 200)
_MOST_LINES = 5


@dataclass(frozen=True, slots=True)
class Mark:
    """A place or a stretch, in percent of the whole."""

    at: float
    width: float
    words: str
    kind: str = ""


@dataclass(frozen=True, slots=True)
class Bar:
    """The flight as a bar of phases with what happened above it."""

    phases: tuple[Mark, ...]
    events: tuple[Mark, ...]
    minutes: tuple[Mark, ...]


@dataclass(frozen=True, slots=True)
class Plot:
    """One picture over time: lines, and the values beside its left edge."""

    name: str
    unit: str
    lines: tuple[tuple[str, str, str], ...]
    """Of each: kind, what it is, SVG path."""
    grid: tuple[tuple[float, str], ...]
    """y and value."""
    limit: float | None
    """y of the line that shall not be crossed, or of what was wanted."""
    limit_words: str


def bar(mission: MissionFile, events: Iterable[EventMessage]) -> Bar:
    """Return the flight's bar, from the request to the end."""
    flown = [phase for phase in mission.phases if phase.phase != "idle"]
    begin, length = _span(mission)
    percent = 100 / length
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
    step = next((s for s in (1, 2, 5, 10, 20) if length / 60 / s <= 12), 30)
    minutes = tuple(
        Mark(60 * minute * percent, 0.0, str(minute))
        for minute in range(0, int(length / 60) + 1, step)
    )
    return Bar(phases, marks, minutes)


def _span(mission: MissionFile) -> tuple[float, float]:
    flown = [phase for phase in mission.phases if phase.phase != "idle"]
    begin = mission.begin_s
    return begin, max(max((phase.to_s for phase in flown), default=begin) - begin, 1e-6)


def plots(mission: MissionFile) -> list[Plot]:
    """Return distance and clearance, height, and battery over the flight; empty: not recorded."""
    course = mission.course
    if course is None or not course.mission_s:
        return []
    told = mission.inspection
    return [
        _plot(
            mission,
            course,
            "Distance and clearance",
            "m",
            (
                ("distance", "to the blade's axis", course.distance_m),
                ("clearance", "clearance by LiDAR", course.clearance_m),
            ),
            most=30.0,
            limit=told.min_clearance_m,
            limit_words="least clearance",
        ),
        _plot(mission, course, "Height", "m", (("height", "above take-off", course.height_m),)),
        _plot(
            mission,
            course,
            "Battery",
            "%",
            (("battery", "charge", tuple(_percent(v) for v in course.battery)),),
            most=100.0,
        ),
    ]


def _percent(share: float | None) -> float | None:
    return None if share is None else 100 * share


def _plot(
    mission: MissionFile,
    course: Course,
    name: str,
    unit: str,
    lines: Sequence[tuple[str, str, Sequence[float | None]]],
    *,
    most: float | None = None,
    limit: float | None = None,
    limit_words: str = "",
) -> Plot:
    begin, length = _span(mission)
    values = [value for _, _, column in lines for value in column if value is not None]
    reach = max(values, default=1.0)
    # Where there is nothing near, a clearance of tens of metres says nothing.
    top = max(reach if most is None else min(most, reach) if unit == "m" else most, 1.0)
    step = next((s for s in _STEPS if top / s <= _MOST_LINES), 500)
    drawn = [
        (
            kind,
            words,
            _path(
                [WIDTH * (at - begin) / length for at in course.mission_s],
                [None if v is None or v > top else HEIGHT * (1 - v / top) for v in column],
            ),
        )
        for kind, words, column in lines
    ]
    grid = [(HEIGHT * (1 - value / top), str(value)) for value in range(0, int(top) + 1, step)]
    line = None if limit is None or limit > top else HEIGHT * (1 - limit / top)
    return Plot(
        name,
        unit,
        tuple(drawn),
        tuple(grid),
        line,
        f"{limit_words} {limit:g} m" if limit is not None else "",
    )


def _path(across: Sequence[float], heights: Sequence[float | None]) -> str:
    """Return an SVG path, broken where there is no value."""
    parts, down = [], False
    for x, y in zip(across, heights, strict=True):
        if y is None or not 0 <= x <= WIDTH:
            down = False
            continue
        parts.append(f"{'L' if down else 'M'}{x:.1f} {y:.1f}")
        down = True
    return "".join(parts)


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
