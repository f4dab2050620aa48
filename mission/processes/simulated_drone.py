"""A drone at a turbine, simulated whole, for the tests of whoever builds upon bladescout."""

from __future__ import annotations

import shutil
import tempfile
import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Self

from config.settings import Settings
from config.simulation import Simulation
from mission.flight.command import TERMINAL
from mission.processes.runtime import CLOCK_FILE
from mission.processes.simulation import Daemon, Field, SimulationFailed, Watcher, on_loopback
from mission.records.summary import add_truth
from mission.remote.client import Client, NoReply
from mission.remote.messages import EventMessage, RecordedMessage, StateMessage

START_WITHIN_S = 180.0
RECORDED_WITHIN_S = 120.0
_POLL_S = 0.1
_COMES_YET = ("not_ready", "no_vehicle")


class SimulatedDrone:
    """Field and daemon in processes of their own; a context manager.

    Whatever speaks to a real daemon can speak to this one, at `router`, as `vehicle`, about the
    turbine `site`. Raises `mission.processes.simulation.SimulationFailed` where a part of it does
    not come up, or ends by itself.
    """

    def __init__(self, settings: Settings) -> None:
        self._settings = on_loopback(settings)
        self._stack = ExitStack()
        self._watcher = Watcher(lambda _: None, lambda _: None)
        self._field: Field | None = None
        self._daemon: Daemon | None = None
        self._client: Client | None = None
        self.router = self._settings.bus.listen
        """Where clients connect, as tcp/127.0.0.1:7447."""
        self.vehicle = self._settings.vehicle
        self.site = self._settings.sites[0].name

    def __enter__(self) -> Self:
        run_dir = Path(tempfile.mkdtemp(prefix="bladescout-"))
        self._stack.callback(shutil.rmtree, run_dir, ignore_errors=True)
        try:
            self._open(run_dir)
        except BaseException:
            self._stack.close()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    @property
    def client(self) -> Client:
        """A client that is connected."""
        if self._client is None:
            raise RuntimeError("the simulated drone was not entered (with ...)")
        return self._client

    @property
    def state(self) -> StateMessage | None:
        """The newest state."""
        return self._watcher.state

    @property
    def events(self) -> tuple[EventMessage, ...]:
        """What has happened so far."""
        return tuple(self._watcher.events)

    def start(self) -> Path:
        """Start a mission as an operator would; return its folder."""
        deadline = time.monotonic() + START_WITHIN_S
        words = ""
        while time.monotonic() < deadline:
            self._check()
            try:
                reply = self.client.start(self.site, operator="a test", rotor_locked=True)
            except NoReply as error:
                words = str(error)
            else:
                if reply.ok:
                    return Path(reply.mission_dir)
                words = reply.text
                if reply.code not in _COMES_YET:
                    break
            time.sleep(_POLL_S)
        raise SimulationFailed(f"the daemon did not take the mission: {words}")

    def wait_until(self, condition: Callable[[StateMessage], bool], within_s: float) -> bool:
        """Return whether a state came, within so many wall seconds, that meets a condition."""
        deadline = time.monotonic() + within_s
        while time.monotonic() < deadline:
            self._check()
            state = self._watcher.state
            if state is not None and condition(state):
                return True
            time.sleep(_POLL_S)
        return False

    def finish(self, within_s: float = 3600.0) -> Mapping[str, object]:
        """Wait for the end of the mission and end the world; return mission.json with the truth."""
        if not self.wait_until(lambda state: state.progress.state in TERMINAL, within_s):
            raise SimulationFailed(f"the mission had not ended after {within_s:g} s")
        recorded = self._await_recorded()
        if not recorded.ok:
            raise SimulationFailed(f"the mission folder is not complete: {recorded.text}")
        assert self._field is not None  # noqa: S101 - the client is connected: it was entered
        folder = Path(recorded.mission_dir)
        return add_truth(folder, self._field.finish(folder))

    def _await_recorded(self) -> RecordedMessage:
        deadline = time.monotonic() + RECORDED_WITHIN_S
        while time.monotonic() < deadline:
            self._check()
            if self._watcher.recorded is not None:
                return self._watcher.recorded
            time.sleep(_POLL_S)
        raise SimulationFailed("the recorder did not complete the mission folder")

    def _open(self, run_dir: Path) -> None:
        world_dir, serve_dir = run_dir / "field", run_dir / "serve"
        world_dir.mkdir()
        serve_dir.mkdir()
        self._field = Field(self._settings, world_dir)
        self._stack.callback(self._field.close)
        # What the mission gets holds nothing of the scenario: not the seed, not the draws.
        told = self._settings.model_copy(
            update={"sites": (self._field.wait_ready(),), "simulation": Simulation()}
        )
        self._daemon = Daemon(told, serve_dir, world_dir / CLOCK_FILE)
        self._stack.callback(self._daemon.close)
        self._client = self._stack.enter_context(self._daemon.client(told))
        watcher = self._watcher
        self._client.watch(watcher.take_state, watcher.take_event, watcher.take_recorded)

    def _check(self) -> None:
        if self._daemon is not None:
            self._daemon.check()
