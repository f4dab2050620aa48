"""Start, watch and end the processes of the daemon. None outlives its parent."""

from __future__ import annotations

import asyncio
import logging
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

log = logging.getLogger(__name__)

#: Three deaths within this time mean that restarting does not help.
DEATH_WINDOW_S = 60.0
MAX_DEATHS = 3


@dataclass(slots=True)
class Child:
    """One process, restarted when it dies."""

    name: str
    module: str
    run_dir: Path
    process: asyncio.subprocess.Process | None = None
    deaths: list[float] = field(default_factory=list)
    ending: bool = False

    async def start(self) -> asyncio.subprocess.Process:
        """Start the process; its standard input is a pipe whose end tells it to leave."""
        self.process = await asyncio.create_subprocess_exec(
            sys.executable, "-m", self.module, str(self.run_dir), stdin=asyncio.subprocess.PIPE
        )
        return self.process

    async def keep_alive(self, on_death: Callable[[str, int], None]) -> None:
        """Restart the process whenever it dies, until `end` was called."""
        loop = asyncio.get_running_loop()
        while True:
            process = self.process or await self.start()
            code = await process.wait()
            if self._told_to_end():
                return
            now = loop.time()
            self.deaths = [t for t in self.deaths if now - t < DEATH_WINDOW_S] + [now]
            log.error("%s ended by itself (code %s): restarting it", self.name, code)
            on_death(self.name, len(self.deaths))
            self.process = None
            await asyncio.sleep(0.2 if len(self.deaths) < MAX_DEATHS else 5.0)
            if self._told_to_end():
                return

    def _told_to_end(self) -> bool:
        return self.ending

    async def end(self, patience_s: float = 4.0) -> None:
        """Ask the process to leave; kill it when it does not.

        Its input is closed, and SIGTERM sent for one that has just been started: it imports for
        seconds on a slow or busy computer, reads nothing yet, and has begun nothing.
        """
        self.ending = True
        if self.process is None or self.process.returncode is not None:
            return
        if self.process.stdin is not None:
            self.process.stdin.close()
        self.process.terminate()
        try:
            await asyncio.wait_for(self.process.wait(), patience_s)
        except TimeoutError:
            log.warning("%s does not leave: killing it", self.name)
            self.process.kill()
            await self.process.wait()


async def parent_gone() -> None:
    """Return when the parent closed our standard input, or died."""
    loop = asyncio.get_running_loop()
    reader = asyncio.StreamReader()
    transport, _ = await loop.connect_read_pipe(
        lambda: asyncio.StreamReaderProtocol(reader), sys.stdin
    )
    try:
        await reader.read()
    finally:
        transport.close()
