"""The production path, whole, on one machine: field + daemon + a remote client.

The mission learns of the world only what the field tells beforehand (`told.json`) and what its
sensors see; the truth comes out of the field process when the mission is over.
"""

from __future__ import annotations

import json
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from config.settings import Settings
from config.simulation import Device, Simulation, Word
from config.turbine import Site
from drivers.bus import BusUnreachable
from drivers.free_port import free_port
from mission.flight.command import TERMINAL, MissionState
from mission.processes.runtime import CLOCK_FILE, SETTINGS_FILE
from mission.remote.client import Client, NoReply
from mission.remote.messages import EventMessage, RecordedMessage, Reply, StateMessage

READY_TIMEOUT_S = 90.0
START_TIMEOUT_S = 30.0
RECORD_TIMEOUT_S = 60.0
#: An inspection that needs more is not flown to its end.
MOST_FLIGHTS = 12
_COMES_YET = ("not_ready", "no_vehicle")


class SimulationFailed(RuntimeError):
    """A part of the simulation did not come up, or ended by itself."""


@dataclass(slots=True)
class Watcher:
    """What the remote client has seen; filled from the bus's thread."""

    on_change: Callable[[StateMessage], None]
    on_event: Callable[[EventMessage], None]
    state: StateMessage | None = None
    recorded: RecordedMessage | None = None
    events: list[EventMessage] = field(default_factory=list)

    def take_state(self, state: StateMessage) -> None:
        """Keep and show the newest state."""
        self.state = state
        self.on_change(state)

    def take_event(self, event: EventMessage) -> None:
        """Keep and show an event."""
        self.events.append(event)
        self.on_event(event)

    def take_recorded(self, message: RecordedMessage) -> None:
        """Keep the word that the mission folder is complete."""
        self.recorded = message


def on_loopback(settings: Settings) -> Settings:
    """Return the settings with every end point on free ports of this machine."""
    udp = socket.SOCK_DGRAM
    lidar = {
        "lidar_ip": "127.0.0.1",
        "host_ip": "127.0.0.1",
        "lidar_command_port": free_port(udp),
        "host_command_port": free_port(udp),
        "host_push_port": free_port(udp),
        "host_point_port": free_port(udp),
        "host_imu_port": free_port(udp),
        "source": "livox" if settings.simulation.sensors == "wire" else "bus",
    }
    http_port = free_port()
    # A simulated vehicle may be set up as a real one must have been by its owner.
    # (Another simulator is relayed by the field, so this end is a port of ours in any case.)
    autopilot: dict[str, object] = {
        "url": f"udpin://127.0.0.1:{free_port(udp)}",
        "payload_url": f"udpin://127.0.0.1:{free_port(udp)}",
        "set_parameters": True,
    }
    if settings.simulation.autopilot_url:
        # Nobody holds a remote control there, and what it does not simulate it does not send.
        autopilot["strict"] = False
    camera = {
        "stream_url": f"rtsp://127.0.0.1:{free_port()}/live",
        "source": "rtsp" if settings.simulation.sensors == "wire" else "bus",
    }
    simulated_camera = settings.simulation.camera.model_copy(update={"http_port": http_port})
    return settings.model_copy(
        update={
            "bus": settings.bus.model_copy(update={"listen": f"tcp/127.0.0.1:{free_port()}"}),
            "autopilot": settings.autopilot.model_copy(update=autopilot),
            "lidar": settings.lidar.model_copy(update=lidar),
            "camera": settings.camera.model_copy(update=camera),
            "positioning": settings.positioning.model_copy(
                update={"method": settings.simulation.position_profile}
            ),
            "simulation": settings.simulation.model_copy(update={"camera": simulated_camera}),
            "service": settings.service.model_copy(update={"metrics_port": 0}),
        }
    )


class Field:
    """The field process: world, mock autopilot, renderer."""

    def __init__(self, settings: Settings, run_dir: Path) -> None:
        self._run_dir = run_dir
        self._up = False
        (run_dir / SETTINGS_FILE).write_text(settings.model_dump_json())
        with (run_dir / "field.log").open("wb") as log_file:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "drivers.simulated.field", str(run_dir)],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=log_file,
                text=True,
            )

    def wait_ready(self) -> Site:
        """Return the turbine as the mission is told of it, once the field is up."""
        self._expect("ready")
        self._up = True
        told = json.loads((self._run_dir / "told.json").read_text())
        return Site.model_validate(told["site"])

    def fault(self, device: Device, word: Word) -> None:
        """Change a device's failure word now."""
        self._say({"fault": {"device": device, "word": word}})

    def swap_battery(self) -> None:
        """Fit a charged battery to the landed vehicle."""
        self._say({"swap": True})

    def pilot_returns(self) -> None:
        """Have the pilot send the vehicle home."""
        self._say({"pilot": True})

    def trace(self, file: Path) -> None:
        """Have written down what the autopilot really does, from now on."""
        self._say({"trace": str(file)})

    def finish(self, mission_dir: Path) -> dict[str, object]:
        """End the world and return its truth."""
        self._say({"finish": str(mission_dir)})
        self._expect("finished")
        truth: dict[str, object] = json.loads((self._run_dir / "truth.json").read_text())
        return truth

    def runs(self) -> bool:
        """Return whether the process is there."""
        return self._process.poll() is None

    def close(self) -> None:
        """End the field process, whatever state it is in."""
        if self._process.stdin is not None:
            self._process.stdin.close()
        if not self._up:
            # It still draws its world, and would not hear for seconds that we are gone.
            self._process.terminate()
        try:
            self._process.wait(timeout=10)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        if self._process.stdout is not None:
            self._process.stdout.close()

    def _say(self, message: dict[str, object]) -> None:
        assert self._process.stdin is not None  # noqa: S101 - opened as a pipe
        self._process.stdin.write(json.dumps(message) + "\n")
        self._process.stdin.flush()

    def _expect(self, word: str) -> None:
        assert self._process.stdout is not None  # noqa: S101 - opened as a pipe
        for line in self._process.stdout:
            said = json.loads(line)
            if said.get(word):
                return
            if "error" in said:
                raise SimulationFailed(f"the simulated field cannot go on: {said['error']}")
        last = (self._run_dir / "field.log").read_text(errors="replace").strip().splitlines()
        reason = last[-1] if last else "without a word"
        raise SimulationFailed(f"the field process ended before it was {word}: {reason}")


class Daemon:
    """`bladescout serve`, as a process of its own."""

    def __init__(self, settings: Settings, run_dir: Path, clock: Path) -> None:
        self._run_dir = run_dir
        (run_dir / "log").mkdir(parents=True)
        (run_dir / SETTINGS_FILE).write_text(settings.model_dump_json())
        (run_dir / CLOCK_FILE).symlink_to(clock)
        with (run_dir / "serve.log").open("wb") as log_file:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "mission.cli.main", "serve", "--runtime", str(run_dir)],
                # Held open by us alone: the daemon leaves when we are gone, however we went.
                stdin=subprocess.PIPE,
                stderr=log_file,
                stdout=log_file,
            )

    @property
    def pid(self) -> int:
        """The supervisor's."""
        return self._process.pid

    def client(self, settings: Settings) -> Client:
        """Connect to the daemon once it listens."""
        deadline = time.monotonic() + START_TIMEOUT_S
        while True:
            self.check()
            try:
                return Client(settings.vehicle, settings.bus)
            except BusUnreachable:
                if time.monotonic() > deadline:
                    raise
                time.sleep(0.2)

    def check(self) -> None:
        """Raise `SimulationFailed` when the daemon has ended."""
        if self._process.poll() is not None:
            last = (self._run_dir / "serve.log").read_text(errors="replace").strip().splitlines()
            reason = last[-1] if last else "without a word"
            raise SimulationFailed(f"the daemon ended by itself: {reason}")

    def close(self) -> None:
        """Ask the daemon to end; it holds the vehicle and closes its files."""
        self._process.terminate()
        try:
            self._process.wait(timeout=15)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        if self._process.stdin is not None:
            self._process.stdin.close()


@dataclass(frozen=True, slots=True)
class Outcome:
    """How a simulated mission ended."""

    state: MissionState
    words: str
    mission_dir: Path
    truth: dict[str, object]
    log_dir: Path


@contextmanager
def _run_dir(keep: Path | None) -> Iterator[Path]:
    path = keep or Path(tempfile.mkdtemp(prefix="bladescout-"))
    path.mkdir(parents=True, exist_ok=True)
    try:
        yield path
    finally:
        if keep is None:
            shutil.rmtree(path, ignore_errors=True)


def simulate(
    settings: Settings,
    on_state: Callable[[StateMessage], None],
    on_event: Callable[[EventMessage], None],
    *,
    keep_run_dir: Path | None = None,
) -> Outcome:
    """Fly one simulated mission and return its outcome.

    Raises `SimulationFailed`, `drivers.bus.BusUnreachable` or `NoReply`.
    """
    settings = on_loopback(settings)
    watcher = Watcher(on_state, on_event)
    with _run_dir(keep_run_dir) as run_dir:
        world_dir, serve_dir = run_dir / "field", run_dir / "serve"
        world_dir.mkdir()
        serve_dir.mkdir()
        world = Field(settings, world_dir)
        try:
            site = world.wait_ready()
            # What the mission gets holds nothing of the scenario: not the seed, not the draws.
            told = settings.model_copy(update={"sites": (site,), "simulation": Simulation()})
            daemon = Daemon(told, serve_dir, world_dir / CLOCK_FILE)
            try:
                folder = _fly(
                    daemon, told, site, watcher, settings.simulation.max_duration_s, world
                )
            finally:
                daemon.close()
            truth = world.finish(folder)
        finally:
            world.close()
        log_dir = folder / "log"
        shutil.copytree(serve_dir / "log", log_dir, dirs_exist_ok=True)
        for name in (world_dir / "field.log", serve_dir / "serve.log"):
            shutil.copy(name, log_dir)
    assert watcher.state is not None  # noqa: S101 - _fly waited for its terminal state
    progress = watcher.state.progress
    return Outcome(progress.state, progress.words, folder, truth, log_dir)


def _fly(
    daemon: Daemon,
    settings: Settings,
    site: Site,
    watcher: Watcher,
    max_mission_s: float,
    world: Field,
) -> Path:
    """Fly the mission; where a battery does not suffice, swap it and fly on."""
    with daemon.client(settings) as client:
        client.watch(watcher.take_state, watcher.take_event, watcher.take_recorded)
        folder = _start(daemon, client, site)
        for flight in range(1, MOST_FLIGHTS + 1):
            photos = _photos(watcher)
            _to_its_end(daemon, client, watcher, folder, flight, max_mission_s)
            state = watcher.state
            swap = state is not None and state.progress.swap
            gained = _photos(watcher) > photos or flight == 1
            late = state is None or state.mission_s > max_mission_s
            if flight == MOST_FLIGHTS or not swap or not gained or late:
                break
            world.swap_battery()
            _resume(daemon, client, folder)
        return folder


def _photos(watcher: Watcher) -> int:
    return 0 if watcher.state is None else watcher.state.progress.photos


def _to_its_end(
    daemon: Daemon,
    client: Client,
    watcher: Watcher,
    folder: Path,
    flight: int,
    max_mission_s: float,
) -> None:
    """Wait for the end of a flight and for its folder; end it where it takes too long."""
    aborted = False
    while not _ended(watcher, folder, flight):
        daemon.check()
        time.sleep(0.1)
        state = watcher.state
        if state is not None and state.mission_s > max_mission_s and not aborted:
            client.abort()
            aborted = True
    deadline = time.monotonic() + RECORD_TIMEOUT_S
    while watcher.recorded is None and time.monotonic() < deadline:
        time.sleep(0.05)
    recorded, watcher.recorded = watcher.recorded, None
    if recorded is None:
        raise SimulationFailed("the recorder did not complete the mission folder")
    if not recorded.ok:
        raise SimulationFailed(f"{folder} is not complete: {recorded.text}")


def _resume(daemon: Daemon, client: Client, folder: Path) -> None:
    def ask() -> Reply:
        return client.resume(folder.name, operator="simulated operator", rotor_locked=True)

    _until_taken(daemon, ask, f"take up {folder.name} again", comes_yet=None)


def _start(daemon: Daemon, client: Client, site: Site) -> Path:
    def ask() -> Reply:
        return client.start(site.name, operator="simulated operator", rotor_locked=True)

    return Path(_until_taken(daemon, ask, "take the mission", comes_yet=_COMES_YET).mission_dir)


def _until_taken(
    daemon: Daemon, ask: Callable[[], Reply], what: str, *, comes_yet: Collection[str] | None
) -> Reply:
    """Ask until the daemon does it; ``comes_yet``: the refusals to wait through (None: all)."""
    deadline = time.monotonic() + START_TIMEOUT_S
    text = ""
    while time.monotonic() < deadline:
        daemon.check()
        try:
            reply = ask()
        except NoReply as error:
            text = str(error)
        else:
            if reply.ok:
                return reply
            text = reply.text
            if comes_yet is not None and reply.code not in comes_yet:
                break
        time.sleep(0.2)
    raise SimulationFailed(f"the daemon did not {what}: {text}")


def _ended(watcher: Watcher, folder: Path, flight: int) -> bool:
    state = watcher.state
    if state is None or (state.mission_dir, state.progress.flight) != (str(folder), flight):
        return False
    return state.progress.state in TERMINAL
