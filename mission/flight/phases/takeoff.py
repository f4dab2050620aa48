"""Take-off by the autopilot, then the change to offboard control after a second of setpoints."""

from __future__ import annotations

from mission.flight.command import Action, Phase, SensingMode, Setpoint
from mission.flight.events import Event
from mission.flight.flight import Flight, Intent, PhaseStep
from mission.flight.observation import FlightMode
from mission.flight.phases.ascend import Ascend

RETRY_S = 4.0
TRIES = 3
STREAM_S = 1.0
OFFBOARD_S = 5.0
#: A vehicle that has hovered so long, so high, has taken off, however low that is.
HOVERS_S, LOWEST_M, STILL_MPS = 4.0, 2.0, 0.2


class Takeoff:
    """Arm, climb to the take-off height, hand over to `Engage`."""

    phase = Phase.TAKEOFF

    def __init__(self, asked: Action | None = None) -> None:
        """``asked``: for what has been asked once already."""
        self._asked_s: float | None = None
        self._asked = asked
        self._tries = 0 if asked is None else 1
        self._still_s: float | None = None

    def resume(self, _flight: Flight) -> None:
        """The autopilot flies this phase: nothing to find again."""

    def step(self, flight: Flight) -> Intent:
        """Ask for one thing at a time until it is seen done."""
        vehicle = flight.vehicle
        height = flight.settings.ascent.takeoff_height_m
        home = flight.home_w or vehicle.position_w
        risen = vehicle.position_w[2] - home[2]
        if vehicle.armed and vehicle.in_air and risen > 0.9 * height - 0.3:
            return Intent("airborne", then=Engage(Ascend()))
        if vehicle.armed and vehicle.in_air and risen > LOWEST_M and self._hovers(flight):
            flight.note("takeoff", f"the autopilot ended its climb at {risen:.1f} m")
            return Intent("airborne", then=Engage(Ascend()))
        wanted = Action.TAKEOFF if vehicle.armed else Action.ARM
        words = f"taking off: {risen:.1f} of {height:.0f} m" if vehicle.armed else "arming"
        if vehicle.in_air and wanted is self._asked:
            return Intent(words)
        if wanted is not self._asked:
            self._asked, self._tries, self._asked_s = wanted, 0, None
        waited = self._asked_s is None or flight.now_s - self._asked_s > RETRY_S
        if flight.observation.offboard_refused is not None or (waited and self._tries >= TRIES):
            flight.raised.add(Event.OFFBOARD_REFUSED)
            return Intent(flight.observation.offboard_refused or "take-off was not carried out")
        if not waited:
            return Intent(words)
        self._asked_s = flight.now_s
        self._tries += 1
        return Intent(words, action=wanted, takeoff_height_m=height)

    def _hovers(self, flight: Flight) -> bool:
        """Return whether the climb ended a while ago: some take off to a height of their own."""
        if flight.vehicle.velocity_w[2] > STILL_MPS:
            self._still_s = None
            return False
        if self._still_s is None:
            self._still_s = flight.now_s
        return flight.now_s - self._still_s > HOVERS_S


class Engage:
    """Stream a hold for a second, ask for OFFBOARD, wait until the autopilot reports it."""

    def __init__(
        self,
        then: PhaseStep,
        from_mode: FlightMode | None = None,
        *,
        after_silence: bool = False,
        taken_over: bool = False,
    ) -> None:
        self._then = then
        self.taken_over = taken_over
        """The vehicle was hovering, wherever that is, when the mission began."""
        self.after_silence = after_silence
        """Control is taken up again after a gap of our own."""
        self._from_mode = from_mode
        self._begun_s: float | None = None
        self._asked_s: float | None = None
        self._tries = 0
        self._hold: Setpoint | None = None

    @property
    def then(self) -> PhaseStep:
        """What is flown once the autopilot has taken up offboard control."""
        return self._then

    @property
    def from_mode(self) -> FlightMode | None:
        """The mode in which an operator took the mission up again."""
        return self._from_mode

    @property
    def phase(self) -> Phase:
        """A part of the take-off, or of what is taken up again."""
        return Phase.TAKEOFF if isinstance(self._then, Ascend) else self._then.phase

    def resume(self, _flight: Flight) -> None:
        """Begin the change of mode anew."""
        self._begun_s = self._asked_s = None
        self._tries = 0

    def step(self, flight: Flight) -> Intent:
        """Stream, ask, wait."""
        now, vehicle = flight.now_s, flight.vehicle
        if isinstance(self._then, Ascend):
            # What is seen of the tower from here spares a second look at it.
            flight.sense(SensingMode.TOWER)
        if self._begun_s is None:
            self._begun_s = now
            flight.follower.stop()
            flight.follower.face(vehicle.yaw_rad)
        hold = flight.hold()
        if self._asked_s is not None and (
            vehicle.mode is FlightMode.OFFBOARD and vehicle.mode_stamp_s >= self._asked_s
        ):
            flight.engaged, flight.engaged_s = True, now
            self._then.resume(flight)
            return Intent("offboard", setpoint=hold, then=self._then)
        if flight.observation.offboard_refused is not None and self._asked_s is not None:
            flight.raised.add(Event.OFFBOARD_REFUSED)
            return Intent(flight.observation.offboard_refused, setpoint=hold)
        since = self._begun_s + STREAM_S if self._asked_s is None else self._asked_s + OFFBOARD_S
        if now < since:
            return Intent("changing to offboard control", setpoint=hold)
        if self._tries >= TRIES:
            flight.raised.add(Event.OFFBOARD_REFUSED)
            return Intent("offboard was not taken up", setpoint=hold)
        self._asked_s, self._tries = now, self._tries + 1
        return Intent("changing to offboard control", setpoint=hold, action=Action.OFFBOARD)
