"""What can happen in flight, how bad it is, and which reaction wins.

Policy is this table; a new fault is a new row. Reactions are ordered by severity and the worst of
all that are active wins. A row may latch: once seen, its reaction is carried out to the end even
when the cause goes away.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import IntEnum, StrEnum


class Reaction(IntEnum):
    """What the flight does about an event, mildest first."""

    NONE = 0
    WARN = 1
    HOLD = 2
    """Stop where we are; go on when the cause is gone."""
    STAND_OFF = 3
    """Leave the rotor along the known-free way, then measure it again."""
    RETURN = 4
    """Leave the rotor, fly home, land."""
    LAND = 5
    """Land here: the autopilot's own landing."""
    RELEASE = 6
    """The pilot, or the autopilot's own failsafe, has it: send nothing."""


class Event(StrEnum):
    """Everything that the flight reacts to."""

    SCAN_AGEING = "scan_ageing"
    SCAN_SLOW = "scan_slow"
    SCAN_LATE = "scan_late"
    SCAN_TOO_SLOW = "scan_too_slow"
    SCAN_REPEATED = "scan_repeated"
    SCAN_LOST = "scan_lost"
    SENSING_DEAD = "sensing_dead"
    SENSING_LOST = "sensing_lost"
    LINK_AGEING = "link_ageing"
    LINK_SILENT = "link_silent"
    LINK_LOST = "link_lost"
    POSITION_STALE = "position_stale"
    POSITION_JUMP = "position_jump"
    HEADING_WRONG = "heading_wrong"
    FRAME_RESET = "frame_reset"
    OWN_SILENCE = "own_silence"
    WIND_STRONG = "wind_strong"
    BATTERY_UNKNOWN = "battery_unknown"
    BATTERY_RESERVE = "battery_reserve"
    CAMERA_OFFLINE = "camera_offline"
    CAMERA_LOST = "camera_lost"
    GIMBAL_SILENT = "gimbal_silent"
    EXPOSURE_STALE = "exposure_stale"
    GUARD_REFUSED = "guard_refused"
    GUARD_BLOCKED = "guard_blocked"
    ROTOR_TURNING = "rotor_turning"
    ROTOR_MOVED = "rotor_moved"
    OFFBOARD_REFUSED = "offboard_refused"
    PILOT_TOOK_OVER = "pilot_took_over"


@dataclass(frozen=True, slots=True)
class Policy:
    """The row of an event."""

    reaction: Reaction
    words: str
    """Shown to the operator."""


_R = Reaction

POLICY: dict[Event, Policy] = {
    Event.SCAN_AGEING: Policy(_R.WARN, "LiDAR scans come late"),
    Event.SCAN_SLOW: Policy(_R.WARN, "LiDAR scans come slowly: flying slower"),
    Event.SCAN_LATE: Policy(_R.HOLD, "LiDAR scans are too old: holding until they are fresh"),
    Event.SCAN_TOO_SLOW: Policy(_R.HOLD, "fewer than 4 LiDAR scans a second: holding"),
    Event.SCAN_REPEATED: Policy(_R.HOLD, "the LiDAR repeats the same scan: holding"),
    Event.SCAN_LOST: Policy(_R.RETURN, "LiDAR lost: leaving the rotor and returning"),
    Event.SENSING_DEAD: Policy(_R.HOLD, "the sensing process is gone: holding until it is back"),
    Event.SENSING_LOST: Policy(_R.RETURN, "sensing does not come back: returning"),
    Event.LINK_AGEING: Policy(_R.WARN, "the autopilot has not been heard for a second"),
    Event.LINK_SILENT: Policy(_R.HOLD, "the autopilot is silent: holding"),
    Event.LINK_LOST: Policy(_R.RELEASE, "the autopilot is lost: its own failsafe has it"),
    Event.POSITION_STALE: Policy(_R.HOLD, "the autopilot's position is too old: holding"),
    Event.POSITION_JUMP: Policy(_R.HOLD, "the autopilot's position jumped: holding"),
    Event.HEADING_WRONG: Policy(
        _R.HOLD, "the heading does not turn as the gyro does: holding until it is right again"
    ),
    Event.FRAME_RESET: Policy(
        _R.RELEASE, "the autopilot moved its local frame: handing over in its own hold"
    ),
    Event.OWN_SILENCE: Policy(
        _R.HOLD, "our own control stood still: the autopilot holds, asking for it again"
    ),
    Event.WIND_STRONG: Policy(_R.RETURN, "wind above the limit: leaving the rotor"),
    Event.BATTERY_UNKNOWN: Policy(_R.RETURN, "no battery telemetry: counted as low"),
    Event.BATTERY_RESERVE: Policy(_R.RETURN, "battery at the reserve for the way home"),
    Event.CAMERA_OFFLINE: Policy(_R.HOLD, "the camera is gone: holding until it is back"),
    Event.CAMERA_LOST: Policy(_R.RETURN, "the camera does not come back: returning"),
    Event.GIMBAL_SILENT: Policy(_R.WARN, "the gimbal does not report where it looks"),
    Event.EXPOSURE_STALE: Policy(_R.WARN, "no usable live picture: exposure stays as it is"),
    Event.GUARD_REFUSED: Policy(_R.WARN, "the guard refused a setpoint"),
    Event.GUARD_BLOCKED: Policy(_R.RETURN, "something stands in the way: returning"),
    Event.ROTOR_TURNING: Policy(_R.RETURN, "the rotor turns: staying away from it"),
    Event.ROTOR_MOVED: Policy(
        _R.STAND_OFF, "the rotor is not where it was measured: measuring again"
    ),
    Event.OFFBOARD_REFUSED: Policy(_R.LAND, "the autopilot refuses offboard control"),
    Event.PILOT_TOOK_OVER: Policy(
        _R.RELEASE, "the pilot, or the autopilot's own failsafe, has the vehicle"
    ),
}


@dataclass(frozen=True, slots=True)
class EventRecord:
    """One line of the mission's event log."""

    t_s: float
    """Mission time."""
    name: str
    """An `Event`, or a step of the mission (`phase`, `request`, `estimate`, `pass`, `photo`)."""
    severity: Reaction
    text: str


def arbitrate(active: Iterable[Event]) -> Reaction:
    """Return the worst reaction that any active event asks for."""
    return max((POLICY[event].reaction for event in active), default=Reaction.NONE)


def worst(active: Iterable[Event]) -> Event | None:
    """Return the event whose reaction wins; of equals the first in the table."""
    order = list(POLICY)
    found = sorted(active, key=lambda event: (-POLICY[event].reaction, order.index(event)))
    return found[0] if found else None
