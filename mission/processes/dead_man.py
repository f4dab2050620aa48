"""The dead-man: when a setpoint may leave, and what a silence of our own means.

An autopilot that hears no setpoint for COM_OF_LOSS_T holds by itself. Whoever then goes on sending
takes the vehicle back without having asked anyone; so after a gap in our own stream nothing leaves
until the mode was read anew, late enough that the autopilot has made up its mind. The gap is
measured by our own clock: only such a gap, and no other change of mode, may be followed by a new
request for offboard. Mission seconds.
"""

from __future__ import annotations

from mission.flight.observation import Silence

#: A tick that took longer from looking to sending is dropped: its setpoint is of another time.
MAX_AGE_S = 0.1
#: Silent for so long, the autopilot may have left offboard.
STALL_S = 0.4
#: On a slow link a shorter gap may have become a longer one; it is remembered for a while.
SHORT_S, REMEMBERED_S = 0.2, 2.0
#: After so long it surely has (COM_OF_LOSS_T is at most 0.5 s by preflight), and has said so.
DECIDED_S = 0.7


class DeadMan:
    """Keeps when the last setpoint left."""

    def __init__(self) -> None:
        self._sent_s: float | None = None
        self._silence: Silence | None = None
        self._recent: Silence | None = None
        self.dropped = 0
        """Setpoints that came too late to be sent."""

    def look(self, now_s: float, *, engaged: bool) -> Silence | None:
        """Begin a tick: return the gap that no setpoint has closed yet, or one of a moment ago.

        ``engaged``: the vehicle is ours by offboard control. Where it is not, silence is no gap.
        """
        if not engaged:
            self._sent_s = self._silence = self._recent = None
            return None
        sent_s = self._sent_s
        if self._silence is None and sent_s is not None and now_s - sent_s > STALL_S:
            self._silence = Silence(sent_s, max(now_s, sent_s + DECIDED_S))
        if self._recent is not None and now_s - self._recent.read_after_s > REMEMBERED_S:
            self._recent = None
        return self._silence or self._recent

    def may_send(self, looked_s: float, now_s: float, mode_stamp_s: float | None) -> bool:
        """Return whether a setpoint decided from what was seen at ``looked_s`` may leave now."""
        if now_s - looked_s > MAX_AGE_S:
            self.dropped += 1
            return False
        if mode_stamp_s is None:
            return False
        return self._silence is None or mode_stamp_s >= self._silence.read_after_s

    def sent(self, now_s: float) -> float | None:
        """Note that a setpoint left; return the time since the one before, None for the first."""
        gap_s = None if self._sent_s is None else now_s - self._sent_s
        if self._sent_s is not None and gap_s is not None and gap_s > SHORT_S:
            self._recent = Silence(self._sent_s, now_s, closed=True)
        self._sent_s, self._silence = now_s, None
        return gap_s
