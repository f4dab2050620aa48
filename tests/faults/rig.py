"""A simulated mission in real processes, to which things are done from outside."""

from __future__ import annotations

import contextlib
import json
import os
import time
from pathlib import Path

import psutil

from config.simulation import Simulation
from config.sources import load_settings
from mission.flight.command import MissionState
from mission.processes.runtime import CLOCK_FILE
from mission.processes.simulation import TERMINAL, Daemon, Field, Watcher, on_loopback
from mission.remote.client import NoReply

#: A small turbine, one side of one blade; the launch point before the rotor.
SMALL = (
    "sites.0.scale=0.5",
    "inspection.blades=A",
    "inspection.sides=PS",
    "simulation.truth.launch_bearing_from_rotor_deg=20",
    "simulation.truth.launch_distance_m=30",
)

#: More than a second of a trace.
TAIL_BYTES = 32_000


class Rig:
    """Field, daemon and client of one mission."""

    def __init__(
        self, folder: Path, *overrides: str, speed: float | str = 1.0, seed: int = 1
    ) -> None:
        scenario = Path(__file__).parents[2] / "config" / "scenarios" / "demo.toml"
        own = (
            f"simulation.speed={speed}",
            f"simulation.seed={seed}",
            f"missions_dir={folder / 'missions'}",
        )
        self.settings = on_loopback(load_settings([scenario], [*SMALL, *own, *overrides], {}))
        self.folder = folder
        self.events = []
        self.watcher = Watcher(lambda _: None, self.events.append)
        self.world_dir, self.serve_dir = folder / "field", folder / "serve"
        self.trace_file = folder / "trace.jsonl"
        self.mission_dir = None
        self._stack = contextlib.ExitStack()

    def __enter__(self):
        for path in (self.world_dir, self.serve_dir):
            path.mkdir(parents=True)
        self.world = Field(self.settings, self.world_dir)
        self._stack.callback(self.world.close)
        site = self.world.wait_ready()
        told = self.settings.model_copy(update={"sites": (site,), "simulation": Simulation()})
        self.site, self.told = site, told
        self.world.trace(self.trace_file)
        self.daemon = Daemon(told, self.serve_dir, self.world_dir / CLOCK_FILE)
        self._stack.callback(self.daemon.close)
        self.client = self._stack.enter_context(self.daemon.client(told))
        watcher = self.watcher
        self.client.watch(watcher.take_state, watcher.take_event, watcher.take_recorded)
        return self

    def __exit__(self, *_):
        self._stack.close()

    def start(self):
        """Ask for the mission until the daemon takes it."""

        def taken():
            try:
                reply = self.client.start(
                    self.site.name, operator="simulated operator", rotor_locked=True
                )
            except NoReply:
                return False
            self.mission_dir = Path(reply.mission_dir) if reply.ok else None
            return reply.ok

        self.until(taken, 90.0, every_s=0.3)
        return self

    def until(self, true, within_s, *, every_s=0.05):
        """Wait for something, in wall time; fail where it does not come."""
        deadline = time.monotonic() + within_s
        while not true():
            state = self.watcher.state
            words = None if state is None else state.progress
            assert time.monotonic() < deadline, f"waited {within_s} s in vain; {words}"
            time.sleep(every_s)

    def phase(self, *names, within_s=400.0):
        """Wait until the mission is in one of the phases; fail where it is over before."""

        def there():
            state = self.watcher.state
            if state is None:
                return False
            over = state.progress.state in TERMINAL
            assert not over or "released" in names or "landed" in names, state.progress.words
            return state.progress.phase in names

        self.until(there, within_s)

    def over(self, within_s=400.0):
        """Wait for the end of the mission; return its state."""
        ends = {*TERMINAL, MissionState.IDLE}
        self.until(lambda: self.watcher.state.progress.state in ends, within_s)
        return self.watcher.state.progress.state

    def process(self, module):
        """Return the process of this mission that runs a module."""
        for process in psutil.process_iter():
            with contextlib.suppress(psutil.Error):
                line = process.cmdline()
                mine = str(self.serve_dir) in line or str(self.world_dir) in line
                if mine and module in line and process.status() != psutil.STATUS_ZOMBIE:
                    return process
        return None

    def another(self, module, gone):
        """Return whether a module runs again, in another process than the one that is gone."""
        process = self.process(module)
        return process is not None and process.pid != gone

    def trace(self):
        """Return what the autopilot did so far, oldest first."""
        lines = self.trace_file.read_text().splitlines()
        return [json.loads(line) for line in lines[:-1]]

    def recent(self):
        """Return the last second or more of the trace, without reading all before it."""
        with self.trace_file.open("rb") as file:
            file.seek(0, os.SEEK_END)
            file.seek(max(0, file.tell() - TAIL_BYTES))
            whole = file.read().splitlines()[1:-1]
        return [json.loads(line) for line in whole]

    def newest(self):
        """Return the newest line of the trace."""
        return self.recent()[-1]

    def now_s(self):
        """Return mission time as the world has it."""
        return self.newest()["mission_s"]

    def names(self):
        """Return the names of what was noticed so far."""
        return frozenset(event.name for event in self.events)

    def finish(self):
        """End the world; return its truth."""
        return self.world.finish(self.mission_dir or self.folder)
