"""What every process of the daemon starts from: settings, clock, bus, log."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import signal
import sys
from collections.abc import Awaitable, Callable, Coroutine
from dataclasses import dataclass
from pathlib import Path

from config.settings import Settings
from drivers.bus import Bus
from drivers.clock import Clock, MonotonicClock, SharedClock
from mission.processes.children import parent_gone
from mission.processes.logs import configure_logging

log = logging.getLogger(__name__)

SETTINGS_FILE = "settings.json"
CLOCK_FILE = "clock"


@dataclass(frozen=True, slots=True)
class Runtime:
    """Settings, clock and run directory of one process."""

    settings: Settings
    clock: Clock
    run_dir: Path

    @classmethod
    def load(cls, run_dir: Path) -> Runtime:
        """Read what the supervisor wrote; the clock is the field's where there is one."""
        settings = Settings.model_validate_json((run_dir / SETTINGS_FILE).read_bytes())
        clock_file = run_dir / CLOCK_FILE
        clock: Clock = SharedClock(clock_file) if clock_file.exists() else MonotonicClock()
        return cls(settings, clock, run_dir)

    def open_bus(self) -> Bus:
        """Connect to the supervisor's router."""
        return Bus.open_client(self.settings.bus, self.settings.vehicle)


def run_process(
    name: str, main: Callable[[Runtime], Coroutine[None, None, None]], *, niceness: int = 0
) -> None:
    """Entry point of a child process: run ``main`` until it ends, the parent leaves or SIGTERM.

    ``niceness`` below 0 (what flies comes first) takes effect where the system grants it.
    """
    run_dir = Path(sys.argv[1])
    runtime = Runtime.load(run_dir)
    configure_logging(name, run_dir, runtime.settings.service.logs)
    with contextlib.suppress(PermissionError):
        os.setpriority(os.PRIO_PROCESS, 0, niceness)
    try:
        asyncio.run(_until_told(runtime, main))
    except KeyboardInterrupt:
        log.info("interrupted")


async def _until_told(
    runtime: Runtime, main: Callable[[Runtime], Coroutine[None, None, None]]
) -> None:
    loop = asyncio.get_running_loop()
    told = asyncio.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(number, told.set)
    waits: list[Awaitable[object]] = [parent_gone(), told.wait()]
    watchers = [asyncio.ensure_future(wait) for wait in waits]
    work = asyncio.create_task(main(runtime))
    await asyncio.wait([work, *watchers], return_when=asyncio.FIRST_COMPLETED)
    for task in (work, *watchers):
        if not task.done():
            task.cancel()
    results = await asyncio.gather(work, *watchers, return_exceptions=True)
    if isinstance(results[0], Exception):
        raise results[0]
