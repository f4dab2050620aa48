"""Between missions, with the vehicle disarmed, sensing goes slowly: flight says so."""

from __future__ import annotations

from collections.abc import Callable

from drivers.bus import Bus, Key, Sample
from drivers.clock import Clock
from mission.flight.observation import RequestKind
from mission.remote.messages import Intent, StateMessage

#: States that were under way when a mission was asked for still say rest.
_STALE_S = 1.0


class Rest:
    """Whether everything rests; those concerned are told of each change."""

    def __init__(self, bus: Bus, clock: Clock) -> None:
        self._clock = clock
        self._told: list[Callable[[bool], None]] = []
        self.resting = False
        """Not before flight has said so: who knows nothing works in full."""
        self.woke_s = float("-inf")
        """Mission time at which the last rest ended."""
        bus.subscribe(Key.STATE, self._take_state)
        bus.subscribe(Key.INTENT, self._take_intent)

    def tell(self, concerned: Callable[[bool], None]) -> None:
        """Call back with every change from now on."""
        self._told.append(concerned)
        concerned(self.resting)

    def _take_state(self, sample: Sample) -> None:
        state = StateMessage.model_validate_json(sample.payload)
        if not state.resting or self._clock.now_s() - self.woke_s > _STALE_S:
            self._set(state.resting)

    def _take_intent(self, sample: Sample) -> None:
        if Intent.model_validate_json(sample.payload).kind is RequestKind.START:
            self._set(False)
            self.woke_s = self._clock.now_s()

    def _set(self, resting: bool) -> None:
        if resting == self.resting:
            return
        self.resting = resting
        if not resting:
            self.woke_s = self._clock.now_s()
        for concerned in self._told:
            concerned(resting)
