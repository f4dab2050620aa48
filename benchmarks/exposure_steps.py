"""Steps and ramps of the light: frames that show the blade out of range.

The light of a whole look changes by 2 to 4 EV from one frame to the next, or by 3 EV over 30
frames, from where the blade is exposed right. Before it, every method has the same 12 s
of light with two changes: 6 s of steady light in which no photo is near, as on the way to the first
pass, then changes by 3 and by 1.3 EV. Ours learns camera and latency from them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from benchmarks.exposure_camera import REFERENCE, BenchCamera, CameraKind, Curve
from benchmarks.exposure_methods import CHOICES, Maker
from benchmarks.exposure_play import MAX_GREY, MIN_GREY, Player, Region
from benchmarks.exposure_scene import Lighting, Looks, Shown, Surface
from perception.exposure_response import BRIGHT
from perception.values import Float, Float32

LATENCIES_S = (0.05, 0.1, 0.2, 0.4)
RATES_FPS = (10, 30)
STEPS_EV = (2.0, -2.0, 3.0, -3.0, 4.0, -4.0)
RAMPS_EV = (3.0, -3.0)
RAMP_FRAMES = 30
WIDTH_PX, HEIGHT_PX = 64, 48
#: Light before the event: a stretch in which no photo is near, then others.
_SPARE_S, _PHASE_S, _AFTER_S = 6.0, 2.0, 3.0
#: More of the blade white than this is a clipped event.
_CLIPPED = 0.03


@dataclass(frozen=True, slots=True)
class Event:
    """A change of the light before one camera."""

    change_ev: float
    frames: int
    """1: a step."""
    kind: CameraKind
    fps: int

    @property
    def name(self) -> str:
        """Say what it is."""
        shape = "step" if self.frames == 1 else "ramp"
        return f"{shape} {abs(self.change_ev):g} EV"


@dataclass(frozen=True, slots=True)
class Outcome:
    """What a method made of an event."""

    event: Event
    outside: int
    """Frames out of range from the event on, unless the camera was at its end."""
    answered: int
    """Frames from one that was answered to the first that the answer exposed: latency + 1."""
    again: int
    """The same of the second answer: a latency varies by a frame."""
    clipped: bool
    beyond: int
    """Frames out of range on the other side of the target: overshoot."""
    restless: int
    """Frames out of range in the last second: a limit cycle or an error that stays."""

    @property
    def within_goal(self) -> bool:
        """Whether a step cost no more than (latency + 1) frames, that of two when clipped."""
        return self.outside <= self.answered + (self.again if self.clipped else 0)


def events(seed: int) -> Iterator[Event]:
    """Yield every event; tone curves take turns."""
    curves = tuple(Curve)
    count = seed
    for manual in (True, False):
        for fps in RATES_FPS:
            for latency_s in LATENCIES_S:
                shapes = [(ev, 1) for ev in STEPS_EV] + [(ev, RAMP_FRAMES) for ev in RAMPS_EV]
                for change_ev, frames in shapes:
                    count += 1
                    kind = CameraKind(curves[count % 3], manual, latency_s)
                    yield Event(change_ev, frames, kind, fps)


def standing_look(looks: Looks, surface: Surface, seed: int) -> Shown:
    """Return a small look whose blade has radiance `REFERENCE`, so that targets lie on steps."""
    share = float(np.random.default_rng([seed, 0x57]).uniform(0.2, 0.7))
    light = looks.light(surface, Lighting.OVERCAST, share)
    shown = looks.show(surface, light, share, WIDTH_PX, HEIGHT_PX)
    blade = shown.radiance[shown.blade]
    scale = REFERENCE / float(np.exp(np.log(blade).mean()))
    return Shown(np.asarray(shown.radiance * np.float32(scale), np.float32), shown.blade)


def play(event: Event, make: Maker, shown: Shown, seed: int) -> Outcome:
    """Put an event to a method."""
    rng = np.random.default_rng([seed, 0x33])
    player = Player(make(event.kind.manual), BenchCamera(event.kind, seed))
    region = Region.of(shown.blade, float(rng.uniform(-1, 1)))
    light_ev, first = _light(event)
    for k, ev in enumerate(light_ev):
        # The scene is never quite still: a vehicle hovers.
        grain = rng.normal(0.0, 0.004)
        radiance: Float32 = shown.radiance * np.float32(2.0 ** (ev + grain))
        spare = k < round(_SPARE_S * event.fps)
        player.frame(radiance, region, k / event.fps, spare=spare)
    return _outcome(event, player, first)


def _light(event: Event) -> tuple[Float, int]:
    """Return the light (EV) of every frame, and the event's first frame."""
    before = -event.change_ev / 2
    stretches = ((0.0, _SPARE_S), (-1.7, _PHASE_S), (1.3, _PHASE_S), (0.0, _PHASE_S))
    lead = [np.full(round(size_s * event.fps), before + away) for away, size_s in stretches]
    ramp = np.linspace(before, -before, event.frames + 1)[1:]
    after = np.full(round(_AFTER_S * event.fps) - 1, -before)
    return np.concatenate([*lead, ramp, after]), sum(map(len, lead))


def _outcome(event: Event, player: Player, first: int) -> Outcome:
    record = player.record
    greys = np.array(record.greys)
    outside = record.outside()
    # Without an answer there is nothing to be late for but the latency itself.
    plain = max(1, math.ceil(event.kind.latency_s * event.fps - 1e-6))
    answered, again = (*record.delays(first), plain, plain)[:2]
    other = greys[first:] < MIN_GREY if event.change_ev > 0 else greys[first:] > MAX_GREY
    at_event = record.clipped[first] > _CLIPPED or greys[first] > BRIGHT
    return Outcome(
        event=event,
        outside=int(outside[first:].sum()),
        answered=answered,
        again=again,
        clipped=bool(at_event),
        beyond=int((other & outside[first:]).sum()),
        restless=int(outside[-event.fps :].sum()),
    )


def best_choice(name: str, shown: Shown, seed: int) -> str:
    """Return the settings of a method that keep the blade in range most, on other events."""
    choices = CHOICES[name]
    if len(choices) == 1:
        return next(iter(choices))
    shapes = ((2.5, 1, Curve.SHOULDER), (-2.5, 1, Curve.GAMMA), (2.5, RAMP_FRAMES, Curve.FILMIC))
    trials = [
        Event(change_ev, frames, CameraKind(curve, True, latency_s), fps)
        for change_ev, frames, curve in shapes
        for latency_s, fps in ((0.1, 10), (0.2, 30))
    ]
    cost = {
        label: sum(play(event, make, shown, seed + 7).outside for event in trials)
        for label, make in choices.items()
    }
    return min(cost, key=lambda label: cost[label])
