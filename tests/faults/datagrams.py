"""Damaged LiDAR datagrams among valid ones, into the assembler as the receiver feeds it."""

from __future__ import annotations

import time
from collections import Counter

import numpy as np

from drivers.livox.assembly import ScanAssembler
from drivers.livox.frames import decode_frame
from drivers.livox.packets import decode_imu, read_header
from drivers.livox.sensor_clock import SensorClock
from drivers.simulated.mid360_wire import pack_packets, pack_points
from tests.faults.fault import Seen

STEP_NS = 96 * 5000


def _valid(count, first):
    points = count * 96
    records = pack_points(
        np.tile(np.float32([10.0, 0, 0]), (points, 1)),
        np.full(points, 50, np.uint8),
        np.zeros(points, np.uint8),
        np.arange(points) % 4 == 0,
    )
    packed = pack_packets(records, first * STEP_NS, 5000, first & 0xFFFF)
    return [row.tobytes() for row in packed]


def _spoil(packet, kind, rng):
    """Return a packet truncated, prolonged, of random bytes, with flipped bits, or mis-sized."""
    spoilt = bytearray(packet)
    if kind == 0:
        return bytes(spoilt[: rng.integers(0, len(spoilt))])
    if kind == 1:
        return bytes(spoilt) + rng.bytes(int(rng.integers(1, 100)))
    if kind == 2:
        return rng.bytes(int(rng.integers(0, 1500)))
    if kind == 3:
        for at in rng.integers(0, 36, 3):
            spoilt[at] ^= 1 << int(rng.integers(8))
        return bytes(spoilt)
    spoilt[5] = int(rng.integers(0, 256))
    spoilt[10] = int(rng.integers(0, 256))
    return bytes(spoilt)


def wild_datagrams(damaged, seed=6):
    """Feed so many damaged datagrams, one for each valid packet; count what became of both."""
    rng, dropped = np.random.default_rng(seed), Counter()
    assembler = ScanAssembler(0.1, (0.5, 70.0), SensorClock(), dropped)
    scans = fed = 0
    used = [0, 0]
    start_s = time.process_time()
    while fed < damaged:
        batch = min(2000, damaged - fed)
        for packet in _valid(batch, fed):
            spoilt = _spoil(packet, int(rng.integers(5)), rng)
            for which, datagram in enumerate((packet, spoilt)):
                read_header(datagram, len(datagram))
                decode_imu(datagram)
                decode_frame(datagram)
                size = min(len(datagram), len(assembler.slot))
                assembler.slot[:size] = datagram[:size]
                before = assembler.packets
                scan = assembler.accept(size)
                if assembler.packets > before:
                    used[which] += 1
                    newest_ns = assembler.newest_ns
                    assembler.observe(newest_ns, 1000.0 + newest_ns * 1e-9 + 0.001)
                scans += scan is not None
        fed += batch
    took_s = time.process_time() - start_s
    expected = damaged * STEP_NS * 1e-9 / 0.1
    # A few that flipped bits have made a credible one of are used; no valid one is lost for them.
    assert used[0] >= 0.998 * damaged, used
    assert used[1] <= 0.02 * damaged, used
    assert scans >= 0.998 * expected - 1, (scans, expected)
    words = (
        f"{damaged} damaged, {sum(dropped.values())} dropped and counted, {scans} scans of "
        f"{expected:.0f}, {used[0] / damaged:.2%} of the valid ones used and "
        f"{used[1] / damaged:.1%} of the damaged, {2 * damaged / took_s:.0f} datagrams/s of "
        "processor time"
    )
    return Seen(damaged, frozenset({"dropped"} if dropped else ()), end="received", figure=words)
