"""Missions one after the other in one process: what may grow is counted."""

from __future__ import annotations

import gc
import threading
import time

import psutil

from benchmarks.virtual_flight import TERMINAL
from benchmarks.virtual_turbine import Truth
from tests.faults.fault import Seen
from tests.faults.rehearsal import mission

BYTES_PER_HOUR = 1_000_000


def soak_in_memory(count, on_done=None):
    """Fly whole missions on the virtual clock; assert that memory, descriptors and threads stay.

    Counted from after a first mission, which fills caches that are meant to stay.
    """
    process = psutil.Process()
    mission(Truth(stop_angle_deg=15.0)).run()
    gc.collect()
    files, threads, flown_s = process.num_fds(), threading.active_count(), 0.0
    resident = process.memory_info().rss
    begun_s = time.process_time()
    for number in range(count):
        flight = mission(Truth(stop_angle_deg=float(number * 7 % 120)))
        flown_s += flight.run().duration_s
        assert flight.machine.state in TERMINAL
        del flight
        if on_done is not None:
            on_done(number)
    gc.collect()
    took_s = time.process_time() - begun_s
    grown = process.memory_info().rss - resident
    hours = flown_s / 3600
    assert process.num_fds() <= files
    assert threading.active_count() <= threads
    # The allocator rounds: below an hour only gross growth can be told.
    assert grown <= max(BYTES_PER_HOUR * hours, 30e6), f"{grown / 1e6:.1f} MB in {hours:.1f} h"
    words = (
        f"{count} missions, {hours:.2f} h flown in {took_s:.0f} s of processor time: "
        f"{grown / 1e6:+.1f} MB, descriptors and threads as before"
    )
    return Seen(count, end="flat", figure=words)
