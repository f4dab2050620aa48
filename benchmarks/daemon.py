"""What the daemon costs with every sensor at full rate, idle and in flight, and how soon it is up.

The simulated devices run beside it: MAVLink, the MID-360's packets at 200 k points a second, and a
live stream of 1080p30 that was encoded beforehand. Only the daemon's own processes are counted, in
CPU seconds by mission second: a computer that has no time for real time can measure it slowly.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path

import psutil

from benchmarks.daemon_flood import FLOOD_PER_S, Gaps, flood, gaps
from benchmarks.daemon_light import LightHeard, LightLag, light_heard
from benchmarks.daemon_usage import Shares, Usage, memory_mb
from benchmarks.replayed_stream import ReplayedStream
from config.settings import Settings
from config.simulation import Simulation
from config.sources import load_settings, scenario_path
from drivers.autopilot_tap import TAP_FILE
from drivers.bus import Bus, Key
from drivers.clock import Clock, SharedClock
from mission.flight.command import TERMINAL, Phase
from mission.processes.runtime import CLOCK_FILE
from mission.processes.simulation import Daemon, Field, SimulationFailed, on_loopback
from mission.remote.client import Client, NoReply
from mission.remote.messages import ReadyMessage, SensingHealth, StateMessage

_READY = frozenset({"tracking", "estimation", "recorder"})
_SETTLE_S = 5.0
_START_S = 600.0
_FLIGHT_S = 900.0


@dataclass(frozen=True, slots=True)
class Stage:
    """What one stage cost."""

    name: str
    shares: Shares
    memory_mb: dict[str, float]
    scans_hz: float
    """LiDAR scans that were looked at."""
    frames_hz: float
    """Live pictures that were looked at."""
    goal_percent: float | None
    goal_mb: float | None = None


@dataclass(frozen=True, slots=True)
class Measured:
    """Everything found."""

    ready_s: float
    """Wall seconds from the command to a daemon that takes a mission."""
    ready_cpu_s: float
    """CPU seconds of all processes until then."""
    stages: tuple[Stage, ...]
    flood: Flood | None = None
    light: LightLag | None = None
    """Along a blade, where it was asked for."""


@dataclass(frozen=True, slots=True)
class Flood:
    """Setpoints in quiet and in a flood of requests."""

    asked_per_s: float
    """Requests a mission second."""
    quiet: Gaps
    flooded: Gaps


@dataclass(frozen=True, slots=True)
class Rig:
    """A daemon with simulated devices, and a client."""

    daemon: Daemon
    client: Client
    bus: Bus
    settings: Settings
    clock: Clock
    begun_s: float
    run_dir: Path

    def usage(self) -> Usage:
        """Return what was used until now."""
        return Usage.now(self.root, self.clock.now_s())

    def wait(self, mission_s: float) -> None:
        """Wait for some mission time."""
        until_s = self.clock.now_s() + mission_s
        while self.clock.now_s() < until_s:
            self.daemon.check()
            time.sleep(0.02)

    @property
    def root(self) -> psutil.Process:
        """The supervisor."""
        return psutil.Process(self.daemon.pid)


@contextmanager
def rig(seed: int, speed: float, *, changing_light: bool = False) -> Iterator[Rig]:
    """Bring up field, stream and daemon."""
    overrides = [f"simulation.seed={seed}", f"simulation.speed={speed}", "simulation.sensors=wire"]
    settings = on_loopback(load_settings([scenario_path("demo")], overrides=overrides))
    # On a loaded machine a process may still write while it leaves.
    leaving = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
    with leaving as folder, ExitStack() as stack:
        world_dir, serve_dir = Path(folder) / "field", Path(folder) / "serve"
        world_dir.mkdir()
        serve_dir.mkdir()
        world = Field(settings, world_dir)
        try:
            site = world.wait_ready()
            clock = SharedClock(world_dir / CLOCK_FILE)
            stream = stack.enter_context(ReplayedStream(seed, clock, changing_light=changing_light))
            told = settings.model_copy(
                update={
                    "sites": (site,),
                    "simulation": Simulation(),
                    "missions_dir": str(Path(folder) / "missions"),
                    "camera": settings.camera.model_copy(update={"stream_url": stream.url}),
                }
            )
            begun_s = time.monotonic()
            daemon = Daemon(told, serve_dir, world_dir / CLOCK_FILE)
            try:
                with daemon.client(told) as client, Bus.open_client(told.bus, told.vehicle) as bus:
                    yield Rig(daemon, client, bus, told, clock, begun_s, serve_dir)
            finally:
                daemon.close()
        finally:
            world.close()


def measure(
    seed: int,
    seconds: float,
    speed: float,
    *,
    fly: bool,
    track: bool,
    light: bool = False,
    tell: Callable[[str], None] = lambda _: None,
) -> Measured:
    """Measure a daemon that is idle and, where asked for, one that flies as far as along a blade.

    ``seconds``: mission time of each stage; ``speed``: mission seconds a second; ``light``: only
    along a blade, where it changes and the exposure commands that follow are timed; ``tell`` hears
    what is being done.
    """
    stages: list[Stage] = []
    flooded = lag = None
    tell("coming up")
    with rig(seed, speed, changing_light=light) as up:
        ready_s = _until_ready(up)
        ready_cpu_s = sum(up.usage().cpu_s.values())
        up.wait(_SETTLE_S)
        if not light:
            tell("idle")
            stages.append(_stage(up, "idle", seconds, 5.0))
        if fly or light:
            newest = _start(up)
            tell("on the way up")
            if not light and reached(up, newest, Phase.ASCEND):
                stages.append(_stage(up, "ascent", seconds, 120.0, 1200.0))
                flooded = _flood(up, seconds, speed)
            tell("on the way to a blade: one to three minutes")
            if (track or light) and reached(up, newest, Phase.TRACK):
                tell("along a blade")
                with _light(up) if light else nullcontext() as heard:
                    stages.append(_stage(up, "along a blade", seconds, 120.0, 1200.0))
                lag = None if heard is None else LightLag.of(heard.lags_ms())
    return Measured(ready_s, ready_cpu_s, tuple(stages), flooded, lag)


def _until_ready(up: Rig) -> float:
    """Return how long the daemon took until it would take a mission."""
    heard: set[str] = set()

    def take(raw: bytes) -> None:
        heard.add(ReadyMessage.model_validate_json(raw).name)

    end = up.bus.follow(Key.READY, lambda sample: take(sample.payload))
    try:
        while time.monotonic() < up.begun_s + _START_S:
            up.daemon.check()
            if heard >= _READY and _linked(up.client):
                return time.monotonic() - up.begun_s
            time.sleep(0.02)
    finally:
        end()
    raise SimulationFailed(f"the daemon was not ready; heard of {sorted(heard)}")


def _linked(client: Client) -> bool:
    try:
        state = client.status().state
    except NoReply:
        return False
    return state is not None and state.link_ok


def _stage(up: Rig, name: str, seconds: float, goal: float, goal_mb: float | None = None) -> Stage:
    heard: list[SensingHealth] = []
    end = up.bus.follow(
        Key.SENSING,
        lambda sample: heard.append(SensingHealth.model_validate_json(sample.payload)),
    )
    before = up.usage()
    up.wait(seconds)
    shares = up.usage().since(before)
    end()
    span_s = heard[-1].mission_s - heard[0].mission_s
    scans_hz = (heard[-1].scans - heard[0].scans) / span_s
    frames_hz = (heard[-1].frames - heard[0].frames) / span_s
    return Stage(name, shares, memory_mb(up.root), scans_hz, frames_hz, goal, goal_mb)


def _start(up: Rig) -> list[StateMessage]:
    """Start a mission; return a list that holds its newest state."""
    newest: list[StateMessage] = []
    up.client.watch(lambda state: newest.__setitem__(slice(None), [state]))
    (site,) = up.settings.sites
    reply = up.client.start(site.name, operator="bench", rotor_locked=True)
    if not reply.ok:
        raise SimulationFailed(reply.text)
    return newest


def _flood(up: Rig, seconds: float, speed: float) -> Flood:
    """Compare the setpoints of some time with those of as long a flood."""
    quiet = gaps(up.bus, lambda: up.wait(seconds))
    with flood(up.settings.bus, up.settings.vehicle, FLOOD_PER_S * speed) as asked:
        before, begun_s = asked(), up.clock.now_s()
        flooded = gaps(up.bus, lambda: up.wait(seconds))
        per_s = (asked() - before) / (up.clock.now_s() - begun_s)
    return Flood(per_s, quiet, flooded)


def _light(up: Rig) -> AbstractContextManager[LightHeard]:
    """Hear what becomes of pictures until left."""
    tap = up.run_dir / TAP_FILE
    return light_heard(up.bus, tap, up.settings.autopilot.system_id, up.clock)


def reached(up: Rig, newest: list[StateMessage], phase: Phase) -> bool:
    """Wait for a phase; False where the mission ended before, turned back or did not come to it."""
    deadline_s = up.clock.now_s() + _FLIGHT_S
    while up.clock.now_s() < deadline_s:
        up.daemon.check()
        progress = newest[-1].progress if newest else None
        if progress is not None and progress.phase is phase:
            return True
        if progress is not None and (progress.state in TERMINAL or progress.phase is Phase.RETURN):
            return False
        time.sleep(0.1)
    return False
