"""Carrying a device's own time over to mission time."""

from __future__ import annotations

from collections import deque


class MinimumOffset:
    """Maps device time to mission time by the least transport delay seen in a window.

    A message arrives at its device time + offset + delay, delay >= 0. The least difference
    (arrival - device time) of the window is the offset with the smallest delay in it; a message
    that waited on its way is thereby stamped with when it was made, not with when it came. The
    window lets the offset follow a drift between the clocks.
    """

    def __init__(self, window_s: float = 10.0, jump_s: float = 5.0) -> None:
        self._window_s = window_s
        self._jump_s = jump_s
        self._minima: deque[tuple[float, float]] = deque()  # (arrival, difference), both rising
        self._last_device_s = float("-inf")

    def clear(self) -> None:
        """Forget everything: the device has started anew."""
        self._minima.clear()
        self._last_device_s = float("-inf")

    def map(self, device_s: float, arrival_s: float) -> float:
        """Return the mission time of ``device_s``, having arrived at ``arrival_s``; never later."""
        difference = arrival_s - device_s
        # A device that restarts counts from zero again: its old offset is worth nothing.
        if device_s < self._last_device_s - self._jump_s:
            self.clear()
        self._last_device_s = device_s
        minima = self._minima
        while minima and minima[-1][1] >= difference:
            minima.pop()
        minima.append((arrival_s, difference))
        while minima[0][0] < arrival_s - self._window_s:
            minima.popleft()
        return device_s + minima[0][1]
