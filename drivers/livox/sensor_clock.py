"""Mission time of what the sensor stamps in nanoseconds since it was switched on.

Without PTP the only link between the two clocks is the arrival of packets, and each one arrives
late by the network and by our own scheduling, never early. So the least difference ever seen is
the best: a minimum-offset filter. It may rise again only as fast as two clocks can drift apart,
so that a delay that appears later shows as age instead of being taken for the clock. A delay that
is there from the first packet on cannot be noticed.
"""

from __future__ import annotations

#: How fast the offset may rise: two cheap crystals, seconds per second.
MAX_DRIFT = 1e-4


class SensorClock:
    """Maps sensor time to mission time."""

    def __init__(self) -> None:
        self._offset_s: float | None = None
        self._seen_s = 0.0

    @property
    def offset_s(self) -> float | None:
        """Mission time minus sensor time; None before the first observation."""
        return self._offset_s

    def reset(self) -> None:
        """Forget everything: the sensor has started anew."""
        self._offset_s = None

    def observe(self, sensor_ns: int, arrival_s: float) -> None:
        """Take in that something stamped ``sensor_ns`` was here at a mission time."""
        offset_s = arrival_s - sensor_ns * 1e-9
        if self._offset_s is None:
            self._offset_s, self._seen_s = offset_s, arrival_s
            return
        risen_s = self._offset_s + MAX_DRIFT * max(arrival_s - self._seen_s, 0.0)
        self._offset_s, self._seen_s = min(offset_s, risen_s), arrival_s

    def mission_s(self, sensor_ns: int) -> float:
        """Return the mission time of a sensor stamp; call after the first `observe`."""
        return sensor_ns * 1e-9 + (self._offset_s or 0.0)
