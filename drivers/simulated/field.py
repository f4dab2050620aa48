"""The field process: the synthetic world and its mock autopilot, with the renderer beside it.

``python -m drivers.simulated.field RUN_DIR``. RUN_DIR holds ``settings.json``; the field writes
``told.json`` (all that the mission may know beforehand), ``clock``, and after the mission
``truth.json``. Standard output: a line of JSON ``{"ready": true}`` once sensors and MAVLink are up,
``{"finished": true}`` at the end, ``{"error": text}`` when the world cannot go on. Standard input,
a line of JSON each: ``{"finish": MISSION_DIR}``, ``{"fault": {"device": ..., "word": ...}}``,
``{"swap": true}`` (a charged battery), ``{"pilot": true}`` (return by the autopilot) or
``{"trace": FILE}``; its end ends the field.
"""

from __future__ import annotations

import asyncio
import contextlib
import gc
import json
import logging
import os
import signal
import sys
import time
from collections.abc import Coroutine
from pathlib import Path

import psutil
from pydantic import ValidationError

from config.settings import Settings
from config.simulation import Fault
from drivers.clock import SharedClockWriter, sleep_until
from drivers.simulated.field_orders import Order
from drivers.simulated.followed_world import FollowedWorld
from drivers.simulated.governor import Governor, Load
from drivers.simulated.link import Finish, Judgement, StillDone
from drivers.simulated.renderer_link import FromRenderer, RendererLink, RendererLostError
from drivers.simulated.scene import draw_scene
from drivers.simulated.told import write_told
from drivers.simulated.truth_report import Nearness, truth_of
from drivers.simulated.truth_trace import trace
from drivers.simulated.world import World

log = logging.getLogger(__name__)

_GOVERN_S = 0.05
_BUSY_EVERY_S = 0.5
#: The world is the autopilot too: it comes before what is heavy, where the system grants it.
_NICENESS = -5
_RENDERER_START_S = 180.0
_JUDGE_S = 300.0


class Field:
    """One run of the synthetic world."""

    def __init__(self, run_dir: Path) -> None:
        self._run_dir = run_dir
        text = (run_dir / "settings.json").read_text("utf-8")
        self._settings = settings = Settings.model_validate_json(text)
        scene = draw_scene(settings)
        # The world stands until its sensors are up.
        self._clock = SharedClockWriter(run_dir / "clock", 0.0)
        self._governor = Governor(settings.simulation.speed)
        self._renderer = RendererLink(run_dir, self._from_renderer)
        followed = bool(settings.simulation.autopilot_url)
        kind = FollowedWorld if followed else World
        self._followed = followed
        self._world: World | FollowedWorld = kind(settings, scene, self._clock, self._renderer.send)
        self._scene = scene
        self._nearness = Nearness(settings.airframe.radius_m)
        self._progress_s = 0.0
        self._seeing = asyncio.Event()
        self._judgement: asyncio.Future[str] = asyncio.get_running_loop().create_future()
        self._started_ns = time.monotonic_ns()

    async def run(self) -> int:
        """Run until told to finish, or standard input ends; return the exit code."""
        tasks: list[asyncio.Task[None]] = []
        try:
            await self._renderer.start(_RENDERER_START_S)
            await self._world.start()
            tasks.append(asyncio.create_task(self._world.run()))
            if not self._followed:
                tasks.append(asyncio.create_task(self._govern()))
            await self._while_seen(self._seeing.wait())
            write_told(self._run_dir / "told.json", self._settings, self._scene, self._world.home)
            gc.freeze()
            self._started_ns = time.monotonic_ns()
            tasks += [
                asyncio.create_task(self._rehearse(fault))
                for fault in self._settings.simulation.faults
            ]
            _say({"ready": True})
            await self._while_seen(self._serve(tasks))
        except (RendererLostError, ConnectionError, TimeoutError) as lost:
            _say({"error": str(lost)})
            return 1
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
            self._world.close()
            self._renderer.close()
        return 0

    async def _while_seen(self, work: Coroutine[object, object, object]) -> None:
        """Do some work; raise when the renderer is lost before it is done."""
        lost = asyncio.create_task(self._renderer.lost.wait())
        doing = asyncio.create_task(work)
        await asyncio.wait((lost, doing), return_when=asyncio.FIRST_COMPLETED)
        lost.cancel()
        if not doing.done():
            doing.cancel()
            raise RendererLostError("the renderer was lost")
        await doing

    async def _serve(self, tasks: list[asyncio.Task[None]]) -> None:
        """Follow the orders on standard input until the last."""
        reader = asyncio.StreamReader()
        loop = asyncio.get_running_loop()
        await loop.connect_read_pipe(lambda: asyncio.StreamReaderProtocol(reader), sys.stdin)
        while line := await self._next_line(reader, tasks):
            try:
                order = Order.model_validate_json(line)
            except ValidationError as error:
                log.warning("not an order: %s", error)
                continue
            if order.fault is not None:
                self._world.fault(order.fault.device, order.fault.word)
            if order.swap and isinstance(self._world, World):
                self._world.swap_battery()
            if order.pilot and isinstance(self._world, World):
                self._world.pilot_returns()
            if order.trace is not None and isinstance(self._world, World):
                tasks.append(asyncio.create_task(trace(self._world, Path(order.trace))))
            if order.finish is not None:
                await self._finish(order.finish)
                _say({"finished": True})
                return

    async def _next_line(
        self, reader: asyncio.StreamReader, tasks: list[asyncio.Task[None]]
    ) -> bytes:
        """Return the next line; a task of the world that fails meanwhile ends the field."""
        reading = asyncio.create_task(reader.readline())
        watched = [task for task in tasks if not task.done()]
        while not reading.done():
            await asyncio.wait((reading, *watched), return_when=asyncio.FIRST_COMPLETED)
            for task in [task for task in watched if task.done()]:
                watched.remove(task)
                task.result()
        return reading.result()

    async def _finish(self, mission_dir: str) -> None:
        """Have the mission judged and write the truth."""
        wall_s = (time.monotonic_ns() - self._started_ns) * 1e-9
        self._renderer.send(Finish(mission_dir))
        judgement = await asyncio.wait_for(asyncio.shield(self._judgement), _JUDGE_S)
        truth = truth_of(judgement, self._world.facts(), self._nearness, wall_s)
        (self._run_dir / "truth.json").write_text(json.dumps(truth, indent=1), "utf-8")

    def _from_renderer(self, message: FromRenderer) -> None:
        if isinstance(message, Judgement):
            if not self._judgement.done():
                self._judgement.set_result(message.json_text)
        elif isinstance(message, StillDone):
            self._world.payload.camera.still_done(message)
        else:
            self._progress_s = message.t_s
            self._seeing.set()
            if self._world.airborne:
                self._nearness.note(message.t_s, message.clearance_m)

    async def _govern(self) -> None:
        """Set the clock's factor by the load, again and again."""
        last_s = time.monotonic()
        busy, busy_s = 0.0, last_s
        psutil.cpu_times_percent(None)
        while True:
            now_s = time.monotonic()
            if now_s - busy_s > _BUSY_EVERY_S:
                # What runs at low priority gives way by itself and is no load.
                times = psutil.cpu_times_percent(None)
                busy, busy_s = 1 - (times.idle + times.iowait + times.nice) / 100, now_s
            mission_s = self._clock.now_s()
            world_s = self._world.now_s
            # Before the first scan there is nothing to wait for.
            behind_s = world_s - self._progress_s if self._seeing.is_set() else 0.0
            load = Load(behind_s, mission_s - world_s, busy)
            factor = self._governor.step(load, now_s - last_s)
            if abs(factor - self._clock.factor()) > 0.01 * max(factor, 0.1):
                self._clock.set_factor(factor)
            last_s = now_s
            await asyncio.sleep(_GOVERN_S)

    async def _rehearse(self, fault: Fault) -> None:
        """Apply one scheduled fault, and take it back where its time is bounded."""
        await sleep_until(self._clock, fault.at_s)
        self._world.fault(fault.device, fault.word)
        if fault.for_s is not None:
            await sleep_until(self._clock, fault.at_s + fault.for_s)
            self._world.fault(fault.device, "ok")


def _say(words: dict[str, bool | str]) -> None:
    sys.stdout.write(json.dumps(words) + "\n")
    sys.stdout.flush()


async def _main(run_dir: Path) -> int:
    loop = asyncio.get_running_loop()
    # Ctrl-C reaches the whole group; the mission lands first, and ends the field by its input.
    loop.add_signal_handler(signal.SIGINT, lambda: None)
    task = asyncio.current_task()
    if task is not None:
        loop.add_signal_handler(signal.SIGTERM, task.cancel)
    try:
        return await Field(run_dir).run()
    except ConnectionError as error:
        _say({"error": str(error)})
        return 1
    except asyncio.CancelledError:
        return 0


if __name__ == "__main__":
    logging.basicConfig(level=logging.INFO, format="field: %(message)s", stream=sys.stderr)
    with contextlib.suppress(PermissionError):
        os.setpriority(os.PRIO_PROCESS, 0, _NICENESS)
    sys.exit(asyncio.run(_main(Path(sys.argv[1]))))
