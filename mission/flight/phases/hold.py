"""Hold: stay here, for an operator or until a cause is gone; and what the pilot has taken."""

from __future__ import annotations

from mission.flight.command import MissionState, Phase
from mission.flight.flight import Flight, Intent, PhaseStep

STABLE_S = 1.0


class Hold:
    """Stay at the place where it began; goes on with ``then`` when it may."""

    phase = Phase.HOLD

    def __init__(self, then: PhaseStep, words: str, *, paused: bool = False) -> None:
        self._then = then
        self._words = words
        self._paused = paused
        self._quiet_s = 0.0
        self._begun = False

    @property
    def then(self) -> PhaseStep:
        """What goes on afterwards."""
        return self._then

    @property
    def paused(self) -> bool:
        """Whether an operator asked for it: only an operator ends it."""
        return self._paused

    def pause(self, words: str = "paused by the operator") -> None:
        """From now on only an operator ends this hold."""
        self._paused, self._words = True, words

    def release(self, flight: Flight) -> None:
        """The operator lets it go on, once nothing else asks for a hold."""
        self._paused = False
        flight.state = MissionState.RUNNING

    def disturbed(self) -> None:
        """A cause is (again) active at this tick."""
        self._quiet_s = 0.0

    def resume(self, _flight: Flight) -> None:
        """A hold within a hold holds on."""

    def step(self, flight: Flight) -> Intent:
        """Stay; count how long nothing has disturbed."""
        if not self._begun:
            self._begun = True
            flight.follower.stop()
        setpoint = flight.hold() if flight.engaged else None
        self._quiet_s += flight.dt_s
        if self._paused or self._quiet_s < STABLE_S:
            return Intent(self._words, setpoint=setpoint)
        self._then.resume(flight)
        return Intent("going on", setpoint=setpoint, then=self._then)


class Released:
    """The pilot, or the autopilot's failsafe, has the vehicle: nothing is sent."""

    phase = Phase.RELEASED

    def __init__(self, then: PhaseStep | None, words: str) -> None:
        self._then = then
        self._words = words

    @property
    def then(self) -> PhaseStep | None:
        """What may be taken up again on a new request; None: nothing."""
        return self._then

    def resume(self, _flight: Flight) -> None:
        """Only a request ends this phase."""

    def step(self, _flight: Flight) -> Intent:
        """Send nothing."""
        return Intent(self._words)


class Idle:
    """No mission."""

    phase = Phase.IDLE

    def resume(self, _flight: Flight) -> None:
        """Nothing to find again."""

    def step(self, _flight: Flight) -> Intent:
        """Send nothing."""
        return Intent("waiting for a mission")
