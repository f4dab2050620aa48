"""Ten thousand requests a second at a daemon that flies: do its setpoints still leave on time?"""

from __future__ import annotations

import json
import multiprocessing
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing.sharedctypes import Synchronized
from multiprocessing.synchronize import Event

import numpy as np
import zenoh

from config.links import Bus as BusSettings
from drivers.bus import Bus, Key, Sample
from mission.processes.simulation import SimulationFailed

FLOOD_PER_S = 10_000.0
_BURST_S = 0.005


@dataclass(frozen=True, slots=True)
class Gaps:
    """Mission milliseconds between setpoints that left."""

    p50: float
    p99: float
    most: float
    setpoints: int


def gaps(bus: Bus, wait: Callable[[], None]) -> Gaps:
    """Return the gaps between the setpoints that leave while something is waited for."""
    sent_s: list[float] = []

    def take(sample: Sample) -> None:
        tick = json.loads(sample.payload)
        if tick["sent"]:
            sent_s.append(tick["observation"]["now_s"])

    end = bus.follow(Key.COMMAND, take)
    try:
        wait()
    finally:
        end()
    between = np.diff(sorted(sent_s)) * 1e3
    if not len(between):
        raise SimulationFailed("no setpoints left")
    p50, p99 = np.percentile(between, (50, 99))
    return Gaps(float(p50), float(p99), float(between.max()), len(sent_s))


@contextmanager
def flood(settings: BusSettings, vehicle: str, per_s: float) -> Iterator[Callable[[], int]]:
    """Ask so many times a second, from a process of its own; yields the count of questions."""
    spawn = multiprocessing.get_context("spawn")
    over, count = spawn.Event(), spawn.Value("q", 0)
    process = spawn.Process(target=_ask, args=(settings, vehicle, per_s, over, count), daemon=True)
    process.start()
    try:
        while not count.value and process.is_alive():
            time.sleep(0.05)
        yield lambda: int(count.value)
    finally:
        over.set()
        process.join(20)


def _ask(
    settings: BusSettings, vehicle: str, per_s: float, over: Event, count: Synchronized[int]
) -> None:
    request = json.dumps({"id": "x"})

    def take(_: zenoh.Reply) -> None:
        """Whatever is answered."""

    with Bus.open_client(settings, vehicle) as bus:
        key, begun_s = f"bladescout/{vehicle}/rpc/status", time.monotonic()
        while not over.is_set():
            due = (time.monotonic() - begun_s) * per_s
            while count.value < due and not over.is_set():
                bus.session.get(key, take, payload=request, attachment=b"flood", timeout=2.0)
                count.value += 1
            time.sleep(_BURST_S)
