"""What the autopilot will do by itself: shown before the start, as seen from behind the rotor."""

from __future__ import annotations

import time
from collections.abc import Mapping

from drivers.autopilot_state import VehicleReading
from mission.flight.observation import PreflightItem

#: 2026-01-01 UTC: a clock before it was never set.
_CLOCK_SET_S = 1_767_225_600.0
_RETURN = "climbs to RTL_RETURN_ALT where it is, then flies home straight"
_LAND = "descends where it is: beside the rotor along tower or blade"
_HOLD = "stays where it is"
_ACTIONS: Mapping[str, tuple[str, Mapping[int, str]]] = {
    "COM_LOW_BAT_ACT": (
        "at a critical battery",
        {0: "warns only", 2: _LAND, 3: f"{_RETURN}, or lands when it cannot"},
    ),
    "NAV_DLL_ACT": (
        "without the ground station",
        {0: "does nothing", 1: _HOLD, 2: _RETURN, 3: _LAND, 5: "terminates", 6: "disarms"},
    ),
    "NAV_RCL_ACT": (
        "without the remote control",
        {1: _HOLD, 2: _RETURN, 3: _LAND, 5: "terminates", 6: "disarms"},
    ),
    "GF_ACTION": (
        "outside its geofence",
        {0: "does nothing", 1: "warns only", 2: _HOLD, 3: _RETURN, 4: "terminates", 5: _LAND},
    ),
}
#: In the air these end the flight at once.
_FATAL = ("terminates", "disarms")


def failsafe_items(parameters: Mapping[str, float]) -> list[PreflightItem]:
    """Return what each failsafe does, a line each; one that would drop the vehicle is refused."""
    items = []
    for name, (when, actions) in _ACTIONS.items():
        value = parameters.get(name)
        if value is None:
            items.append(PreflightItem(name, True, f"{name} is not reported by this autopilot"))
            continue
        does = actions.get(round(value), "does what this version of its manual says")
        text = f"{name} is {value:g}: {when} it {does}"
        fatal = does in _FATAL
        items.append(PreflightItem(name, not fatal, text, f"param set {name} 2" if fatal else ""))
    return items


def radio_item(vehicle: VehicleReading | None, *, strict: bool) -> PreflightItem:
    """Return whether the pilot's remote control is heard; unless strict, it need not be."""
    heard = None if vehicle is None else vehicle.rc_link
    if heard is None:
        return PreflightItem("rc", True, "the vehicle does not tell of a remote control")
    text = "the remote control is heard" if heard else "the remote control is not heard"
    passed = heard or not strict
    return PreflightItem("rc", passed, text, "" if passed else "switch the remote control on")


def clock_item() -> PreflightItem:
    """Return whether UTC was ever set: photos and files are named by it."""
    is_set = time.time() > _CLOCK_SET_S
    text = "UTC is set" if is_set else "UTC was never set"
    return PreflightItem("clock", is_set, text, "" if is_set else "timedatectl set-ntp true")
