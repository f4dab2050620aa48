"""Track: leg by leg along the blades, at constant distance, a photo a footprint.

Along a leg the vehicle follows the planned line, moved by what the LiDAR says of the real blade
(`Registration`); the gimbal looks at the blade's foot, moved by what photos show (`Centring`);
photos are taken by `Shooter`. Legs are joined by ways of the roadmap. Metres whose photo failed,
and skin that none shows, are flown again at once, while the blade is near; what is found missing
later is flown again at the end.
"""

from __future__ import annotations

import itertools
import math

import numpy as np

from config.photos import Positioning
from mission.flight.command import MissionState, Phase
from mission.flight.endurance import suffices
from mission.flight.events import Event
from mission.flight.flight import Flight, Intent
from mission.flight.footprint import tracking_speed_mps
from mission.flight.leg import Leg
from mission.flight.motion import Motion, shutter_s
from mission.flight.phases.centring import Centring
from mission.flight.phases.home import Home
from mission.flight.phases.leave import StandOff, leave
from mission.flight.phases.registration import LOST_S, Registration
from mission.flight.phases.shooter import Shooter
from perception.values import Float

#: Nearer than this to a leg's line the vehicle joins it directly.
JOIN_M = 3.0
MOVED_S = 2.0
#: Less far in this time is no progress: the leg is left, and comes again with the gaps.
STUCK_M = 1.5
STUCK_S = 20.0
#: Nor is a leg flown along for so long without a photo, however the vehicle moves meanwhile.
PHOTOLESS_S = 60.0
#: Along a blade that the LiDAR does not see.
BLIND_MPS = 1.0
#: Along a blade that it has lost; after so long the vehicle stands until it is seen again.
LOST_MPS, LOST_HOLD_S = 0.5, 10.0
#: Before the first photo the blade is looked for so long, and its offset left to settle so long:
#: less than after what it counts as lost, and is passed from farther away.
FIND_S, SETTLE_S = 1.5, 1.0
EDGES = frozenset({"LE", "TE"})


class Track:
    """Fly the plan's legs."""

    phase = Phase.TRACK

    def __init__(self, positioning: Positioning) -> None:
        """``positioning``: how well the vehicle knows where it is."""
        self._leg: Leg | None = None
        self._shooter: Shooter | None = None
        self._running = False
        self._moving = False
        self._registration = Registration()
        self._centring = Centring(positioning)
        self._gaps: list[Leg] | None = None
        self._at_once: Leg | None = None
        self._speed = 1.0
        self._got_to_w: Float | None = None
        self._got_s = 0.0
        self._running_s = 0.0
        """Since when the leg is flown along."""
        self._photo_s: float | None = None
        """When the last photo was asked for along the leg, or flying along it began."""
        self._begun = False
        self._motion: Motion | None = None

    @property
    def leg(self) -> Leg | None:
        """What is flown along, or flown to."""
        return self._leg

    def resume(self, _flight: Flight) -> None:
        """Find the way back to where the leg was left."""
        self._moving = self._running = False
        self._got_to_w = self._photo_s = None

    def skip(self, flight: Flight) -> None:
        """Leave the side that is being flown; the next one follows."""
        if self._leg is not None:
            book = flight.ledger.side(self._leg)
            book.skipped = True
            flight.note("pass", f"skipped {self._leg.blade} {self._leg.side}")
        self._finish_leg(flight)

    def step(self, flight: Flight) -> Intent:
        """Fly to the leg, along the leg, or on to the next."""
        flight.on_leg = self._running
        if self._leg is None:
            leg = self._next_leg(flight)
            if leg is None:
                return Intent("all sides flown", setpoint=flight.hold(), then=StandOff(Home()))
            if not self._affordable(flight, leg):
                return _split(flight)
            self._begin(flight, leg)
        if self._leg is None or self._shooter is None:
            return Intent("between two legs", setpoint=flight.hold())
        if self._motion is not None:
            self._motion.take(flight.observation)
        if self._shooter.done(flight.now_s):
            self._finish_leg(flight)
            return Intent("leg flown", setpoint=flight.hold())
        if self._stuck(flight):
            flight.note("pass", f"left {self._leg.blade} {self._leg.side}: no way ahead")
            self._finish_leg(flight)
            self._at_once = None
            return Intent("no way ahead", setpoint=flight.hold())
        # After a hold there may be no photo left to fly to, only the camera's word to wait for.
        if self._running or not self._shooter.left:
            return self._run(flight, self._leg, self._shooter)
        return self._transit(flight, self._leg, self._shooter)

    def _affordable(self, flight: Flight, leg: Leg) -> bool:
        """Return whether the battery suffices for a pass; what is begun with is always flown."""
        photos = leg.photos if leg.again else flight.ledger.missing(leg)
        first, self._begun = not self._begun, True
        return first or suffices(flight, leg, photos)

    def _stuck(self, flight: Flight) -> bool:
        """Return whether the vehicle has not got on for a while, whatever keeps it."""
        here = flight.here_w
        if self._got_to_w is None or float(np.linalg.norm(here - self._got_to_w)) > STUCK_M:
            self._got_to_w, self._got_s = here, flight.now_s
        if not self._running or self._photo_s is None:
            self._photo_s = flight.now_s
        photoless_s = flight.now_s - self._photo_s
        return flight.now_s - self._got_s > STUCK_S or photoless_s > PHOTOLESS_S

    # --- legs -----------------------------------------------------------------------------

    def _next_leg(self, flight: Flight) -> Leg | None:
        legs = () if flight.plan is None else flight.plan.legs
        if self._at_once is not None:
            leg, self._at_once = self._at_once, None
            return leg
        while flight.leg_index < len(legs):
            leg = legs[flight.leg_index]
            if not flight.ledger.side(leg).skipped and flight.ledger.missing(leg):
                return leg
            flight.leg_index += 1
        if self._gaps is None:
            self._gaps = [
                leg.with_photos(thin, again=True)
                for leg in legs
                if not flight.ledger.side(leg).skipped
                and (thin := flight.ledger.thin(leg, flight.settings))
            ]
            if self._gaps:
                flight.note("gaps", f"{sum(len(g.photos) for g in self._gaps)} photos again")
        return self._gaps.pop(0) if self._gaps else None

    def _begin(self, flight: Flight, leg: Leg) -> None:
        photos = leg.photos if leg.again else flight.ledger.missing(leg)
        self._motion = Motion(flight.settings)
        self._leg, self._shooter = leg, Shooter(leg, photos, self._motion)
        self._running = self._moving = False
        self._registration.begin(leg.blade)
        self._centring.begin(leg, flight.now_s)
        tip = leg.root_w + leg.length_m * leg.axis_w
        chord = max(flight.turbine.blade.chord_m)
        width = chord + 1.0
        flight.sense_blade(leg.blade, leg.side, leg.root_w, tip, width, blind=leg.blind)
        words = "again " if leg.again else ""
        flight.note("pass", f"{words}{leg.blade} {leg.side}, {len(photos)} photos")

    def _finish_leg(self, flight: Flight) -> None:
        if self._leg is not None and not self._leg.again:
            flight.leg_index += 1
            thin = flight.ledger.thin(self._leg, flight.settings)
            if thin and not flight.ledger.side(self._leg).skipped:
                # Back along the leg, from where the vehicle is.
                self._at_once = self._leg.with_photos(thin[::-1], again=True)
        self._leg = self._shooter = None
        self._moving = self._running = False
        self._got_to_w = self._photo_s = None

    # --- moving ---------------------------------------------------------------------------

    def _transit(self, flight: Flight, leg: Leg, shooter: Shooter) -> Intent:
        # The roadmap is the plan's: it is flown moved by what the position has drifted since.
        shift = flight.drift_w = self._registration.drifted(flight)
        start = leg.position(shooter.left[0])
        yaw, gimbal = (
            _yaw(flight, leg),
            flight.aim_at(leg.target(shooter.left[0]) + shift),
        )
        words = f"flying to blade {leg.blade} {leg.side}"
        if not self._moving:
            way = self._way(flight, start)
            if way is None:
                flight.note("pass", f"no clear way to {leg.blade} {leg.side}: left out")
                flight.ledger.side(leg).skipped = True
                self._finish_leg(flight)
                return Intent("no clear way", setpoint=flight.hold(yaw))
            self._moving = True
            flight.go(way, flight.settings.guard.max_speed_near_mps, shift)
        setpoint = flight.follow(yaw, 1.0, shift, firm=False)
        if flight.arrived(0.8, shift):
            self._running, self._moving, self._running_s = True, False, flight.now_s
        return Intent(words, setpoint=setpoint, gimbal=gimbal, ev=_ev(flight))

    def _way(self, flight: Flight, start: Float) -> Float | None:
        here = flight.here_w - flight.drift_w
        if flight.plan is None or float(np.linalg.norm(start - here)) < JOIN_M:
            return start[None]
        way = flight.plan.roadmap.way(here, start)
        return None if way is None else way[1:]

    def _run(self, flight: Flight, leg: Leg, shooter: Shooter) -> Intent:
        shift = self._registration.update(flight, leg)
        flight.drift_w = self._registration.drift_w
        here, firm = flight.here_w, self._registration.fresh(flight, leg)
        metre = leg.metre_of(here - shift)
        if not self._moving and shooter.left:
            self._moving = True
            shutter = shutter_s(flight.observation.camera, flight.settings)
            distance = leg.distance_at(shooter.left[0])
            self._speed = tracking_speed_mps(distance, leg.spacing_m, shutter, flight.settings)
            if leg.blind:
                self._speed = min(self._speed, BLIND_MPS)
            flight.go(_line(leg, metre, shooter.left), self._speed, shift)
        unseen = leg.blind or self._registration.lost_s(flight) > LOST_S
        centring, photos = self._centring, flight.observation.photos
        centring.step(photos, flight.now_s, unseen=unseen, firm=firm)
        seen = self._registration.aim_w + centring.value_w
        foot = leg.target(min(max(metre, 0.0), leg.length_m)) + seen
        aim = flight.aim_at(foot)
        distance = self._distance(flight, leg, metre, here, shift)
        photo, slow = None, 0.0
        if self._settled(flight, leg):
            photo, slow = shooter.step(flight, metre, distance, aim, foot, seen, self._speed)
        if photo is not None:
            self._photo_s = flight.now_s
            centring.asked(photo.photo_id, photo.metre, flight.now_s)
        slow *= self._unseen(flight, leg)
        setpoint = flight.follow(_yaw(flight, leg), slow, shift, firm=firm)
        if shooter.left and flight.follower.left_m < 0.05:
            flight.go(_line(leg, metre, shooter.left), self._speed, shift)
        if self._registration.moved_s > MOVED_S:
            flight.raised.add(Event.ROTOR_MOVED)
        book = flight.ledger.side(leg)
        book.distance.add(distance, leg.distance_at(metre))
        clearance = flight.observation.clearance
        if clearance is not None and clearance.nearest_m is not None:
            near = clearance.nearest_m - flight.settings.airframe.radius_m
            book.clearance_min_m = min(book.clearance_min_m, near)
        return Intent(
            f"blade {leg.blade} {leg.side} at {metre:.1f} m", setpoint=setpoint, gimbal=aim,
            ev=_ev(flight), photo=photo, metre=metre, distance_m=distance,
        )  # fmt: skip

    def _settled(self, flight: Flight, leg: Leg) -> bool:
        """Return whether the first photo need not wait for the LiDAR any more."""
        waited_s = flight.now_s - self._running_s
        return (
            leg.blind or waited_s > FIND_S or flight.now_s - self._registration.found_s > SETTLE_S
        )

    def _unseen(self, flight: Flight, leg: Leg) -> float:
        """Return by how much to slow a leg whose blade the LiDAR has lost; 0: hold.

        An edge may be too thin to be seen: there the fitted rotor is flown along to the end.
        """
        lost_s = self._registration.lost_s(flight)
        if leg.blind or lost_s <= flight.settings.tracking.lost_foot_s:
            return 1.0
        if lost_s > LOST_HOLD_S and leg.side not in EDGES:
            return 0.0
        return min(1.0, LOST_MPS / self._speed)

    def _distance(self, flight: Flight, leg: Leg, metre: float, here: Float, shift: Float) -> float:
        track = flight.observation.blade
        square = abs(float(leg.view_w @ leg.axis_w)) < 0.05
        if track is not None and square and self._registration.fresh(flight, leg):
            return track.distance_m
        foot = leg.foot(metre) + leg.centre(metre) + shift
        return float(np.linalg.norm(here - foot))


def _split(flight: Flight) -> Intent:
    """End this flight between two passes: another one flies the rest."""
    flight.swap = True
    words = "the battery does not suffice for the next pass: resume with a fresh one"
    return leave(flight, Intent(words, flight.hold()), MissionState.ENDED_SAFELY, words)


def _line(leg: Leg, metre: float, left: tuple[float, ...]) -> Float:
    """Return the leg's line from the present metre over the photos that are left."""
    first = min(max(metre, 0.0), leg.length_m)
    places = [first, left[0], left[-1]] if len(left) > 1 else [first, left[0]]
    points = []
    for a, b in itertools.pairwise(places):
        count = max(2, math.ceil(abs(b - a)) + 1)
        points += [leg.position(float(m)) for m in np.linspace(a, b, count)]
    return np.stack(points)


def _yaw(flight: Flight, leg: Leg) -> float:
    """Face the blade; keep the heading where it is straight above or below."""
    x, y = -float(leg.view_w[0]), -float(leg.view_w[1])
    if math.hypot(x, y) < 0.25:
        return flight.vehicle.yaw_rad
    return math.atan2(y, x)


def _ev(flight: Flight) -> float | None:
    """Return the exposure that metering asks for, while its picture is fresh."""
    exposure = flight.observation.exposure
    if exposure is None or flight.now_s - exposure.stamp_s > 1.0:
        return None
    return exposure.ev_wanted
