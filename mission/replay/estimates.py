"""Estimates recorded and recomputed, matched by the stamp of what they were made from."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

from pydantic import TypeAdapter

from drivers.bus import Key
from mission.flight.observation import (
    BladeTrack,
    ClearanceState,
    ExposureState,
    HubPrior,
    RotorEstimate,
    Vec3,
)
from mission.replay.difference import first_difference
from perception.geometry import stop_angle_difference_deg

Estimate: TypeAlias = ClearanceState | BladeTrack | ExposureState | HubPrior | RotorEstimate

ESTIMATES: dict[str, TypeAdapter[Estimate]] = {
    Key.CLEARANCE: TypeAdapter(ClearanceState),
    Key.BLADE: TypeAdapter(BladeTrack),
    Key.EXPOSURE: TypeAdapter(ExposureState),
    Key.HUB_PRIOR: TypeAdapter(HubPrior),
    Key.ROTOR: TypeAdapter(RotorEstimate),
}
_UNITS: dict[str, str] = {
    Key.CLEARANCE: "m of nearest distance",
    Key.BLADE: "m of the foot",
    Key.EXPOSURE: "grey",
    Key.HUB_PRIOR: "m of the hub",
    Key.ROTOR: "deg of stop angle",
}


@dataclass(slots=True)
class Compared:
    """One kind of estimate: recorded against recomputed, matched by the stamp of its scan."""

    recorded: int = 0
    recomputed: int = 0
    equal: int = 0
    largest: float = 0.0
    """Largest difference of the figure that matters, in `unit`."""
    total: float = 0.0
    matched: int = 0
    unit: str = ""
    first: str = ""
    """The first difference, in words; empty: none."""

    @property
    def mean(self) -> float:
        """Mean difference of the figure that matters, over those that are not equal."""
        unequal = self.matched - self.equal
        return self.total / unequal if unequal else 0.0

    @property
    def share_equal(self) -> float:
        """Share of the recorded estimates that came out to the last bit."""
        return self.equal / self.recorded if self.recorded else 1.0


def compare(key: str, recorded: Sequence[bytes], anew: Sequence[bytes]) -> Compared:
    """Compare the estimates of one key, as they went over the bus."""
    adapter = ESTIMATES[key]
    theirs = _by_stamp([adapter.validate_json(payload) for payload in anew])
    result = Compared(len(recorded), len(theirs), unit=_UNITS[key])
    for place, value in _by_stamp([adapter.validate_json(p) for p in recorded]).items():
        other = theirs.get(place)
        if other is None:
            result.first = result.first or f"none at {place[0]:.2f} s"
            continue
        result.matched += 1
        if isinstance(value, ClearanceState | RotorEstimate) and isinstance(other, type(value)):
            # Counted from when the sensor, or the worker, was started.
            other = replace(other, sequence=value.sequence)
        found = first_difference(value, other)
        if found is None:
            result.equal += 1
            continue
        path, mine, yours = found
        result.first = result.first or f"{place[0]:.2f} s: {path} {mine!r}, now {yours!r}"
        apart = _apart(value, other)
        result.total += apart
        result.largest = max(result.largest, apart)
    return result


def _by_stamp(values: Sequence[Estimate]) -> dict[tuple[float, int], Estimate]:
    """Return the values by stamp and by how many of the same stamp came before."""
    counts: Counter[float] = Counter()
    found = {}
    for value in values:
        found[value.stamp_s, counts[value.stamp_s]] = value
        counts[value.stamp_s] += 1
    return found


def _apart(mine: Estimate, yours: Estimate) -> float:
    """Return how far two estimates of a kind are apart, in the figure that matters."""
    if isinstance(mine, RotorEstimate) and isinstance(yours, RotorEstimate):
        if mine.refusal or yours.refusal:
            return 0.0 if bool(mine.refusal) == bool(yours.refusal) else math.inf
        return abs(stop_angle_difference_deg(mine.stop_angle_deg, yours.stop_angle_deg))
    if isinstance(mine, HubPrior) and isinstance(yours, HubPrior):
        return _between(mine.hub_w, yours.hub_w)
    if isinstance(mine, BladeTrack) and isinstance(yours, BladeTrack):
        return _between(mine.foot_w, yours.foot_w)
    if isinstance(mine, ExposureState) and isinstance(yours, ExposureState):
        return abs(mine.mean_grey - yours.mean_grey)
    if isinstance(mine, ClearanceState) and isinstance(yours, ClearanceState):
        if mine.nearest_m is None or yours.nearest_m is None:
            return 0.0 if mine.nearest_m is yours.nearest_m else math.inf
        return abs(mine.nearest_m - yours.nearest_m)
    return math.inf


def _between(mine: Vec3 | None, yours: Vec3 | None) -> float:
    if mine is None or yours is None:
        return 0.0 if mine is yours else math.inf
    return math.dist(mine, yours)
