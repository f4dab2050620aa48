"""The world's end of the link to its renderer: starts the process, sends without ever waiting."""

from __future__ import annotations

import asyncio
import contextlib
import secrets
import subprocess
import sys
import threading
from collections.abc import Callable
from multiprocessing.connection import Connection, Listener
from pathlib import Path
from queue import SimpleQueue

from drivers.simulated.link import (
    CameraSetting,
    FaultChange,
    Finish,
    Judgement,
    RenderProgress,
    StillDone,
    StillRequest,
    TruthState,
)

ToRenderer = TruthState | CameraSetting | StillRequest | FaultChange | Finish
FromRenderer = RenderProgress | StillDone | Judgement
_POLL_S = 0.02
_LEAVE_S = 3.0


class RendererLostError(RuntimeError):
    """The renderer ended, or did not come up."""


class RendererLink:
    """Renderer process and the threads that talk to it."""

    def __init__(self, run_dir: Path, on_message: Callable[[FromRenderer], None]) -> None:
        """Open the socket; ``on_message`` is called on the event loop."""
        self._run_dir = run_dir
        self._on_message = on_message
        self._loop = asyncio.get_running_loop()
        self._queue: SimpleQueue[ToRenderer | None] = SimpleQueue()
        self._connection: Connection | None = None
        self._process: subprocess.Popen[bytes] | None = None
        self.lost = asyncio.Event()
        """Set when the renderer has gone."""
        key = secrets.token_bytes(32)
        key_file = run_dir / "authkey"
        key_file.touch(mode=0o600)
        key_file.write_bytes(key)
        self._listener = Listener(str(run_dir / "renderer.sock"), "AF_UNIX", authkey=key)

    async def start(self, timeout_s: float) -> None:
        """Start the process and wait until it has connected, warmed up."""
        log = (self._run_dir / "renderer.log").open("wb")
        self._process = await asyncio.to_thread(
            subprocess.Popen,
            [sys.executable, "-m", "drivers.simulated.renderer", str(self._run_dir)],
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=log,
        )
        log.close()
        connected = asyncio.Event()
        threading.Thread(target=self._accept, args=(connected,), daemon=True).start()
        async with contextlib.AsyncExitStack() as stack:
            stack.callback(self._listener.close)
            deadline_s = self._loop.time() + timeout_s
            while not connected.is_set():
                if self._process.poll() is not None or self._loop.time() > deadline_s:
                    raise RendererLostError(f"the renderer did not start: {self._last_words()}")
                await asyncio.sleep(_POLL_S)

    def send(self, message: ToRenderer) -> None:
        """Queue a message; a thread of its own writes it."""
        self._queue.put(message)

    def close(self) -> None:
        """End the link and the process."""
        self._queue.put(None)
        if self._connection is not None:
            with contextlib.suppress(OSError):
                self._connection.close()
        process = self._process
        if process is None:
            return
        try:
            process.wait(_LEAVE_S if self._connection is not None else 0.0)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()

    def _accept(self, connected: asyncio.Event) -> None:
        try:
            connection = self._listener.accept()
        except (OSError, EOFError):
            # Closed while waiting: `start` has already said why.
            return
        self._connection = connection
        threading.Thread(target=self._write, args=(connection,), daemon=True).start()
        self._loop.call_soon_threadsafe(connected.set)
        self._read(connection)

    def _read(self, connection: Connection) -> None:
        try:
            while True:
                self._loop.call_soon_threadsafe(self._on_message, connection.recv())
        except (EOFError, OSError, TypeError, RuntimeError):
            # The other end has gone, or ours was closed under the read.
            with contextlib.suppress(RuntimeError):
                self._loop.call_soon_threadsafe(self.lost.set)

    def _write(self, connection: Connection) -> None:
        try:
            while (message := self._queue.get()) is not None:
                connection.send(message)
        except (OSError, ValueError):
            # The reader notices the loss and tells.
            return

    def _last_words(self) -> str:
        lines = (self._run_dir / "renderer.log").read_text("utf-8", "replace").splitlines()
        return lines[-1] if lines else "it said nothing"
