"""Whether the vehicle tells its place as often as a flight needs: at rest it tells it seldom."""

from __future__ import annotations

from drivers.autopilot_state import VehicleReading
from mission.flight.observation import PreflightItem

#: Above what is asked for at rest; between two positions any slower the flight would hold.
MIN_POSITION_HZ = 4.0


def telemetry_item(vehicle: VehicleReading | None, *, awake: bool) -> PreflightItem:
    """Return whether positions come often enough.

    ``awake``: the vehicle was asked for everything that a flight needs, and has answered.
    """
    hz = None if vehicle is None else vehicle.position_hz
    if not awake or hz is None:
        return PreflightItem("telemetry", False, "the vehicle is being asked for all of it", "wait")
    passed = hz >= MIN_POSITION_HZ
    mend = "" if passed else "raise the rate of LOCAL_POSITION_NED on the companion's MAVLink port"
    return PreflightItem("telemetry", passed, f"its position comes {hz:.0f} times a second", mend)
