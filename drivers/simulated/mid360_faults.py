"""The eight failure words, as a MID-360's stream of packets suffers them. Pure but for its random.

`slow` and `intermittent` thin the stream, `stuck` repeats it, `garbage` and `wrong` spoil it.
`off` and `delayed` are the sender's: nothing goes out, or all of it later.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from config.simulation import Word
from drivers.livox.packets import POINTS_PER_PACKET
from drivers.simulated.mid360_wire import PACKET, Records

DELAY_S = 0.8
_KEPT_FOR_STUCK = 208
_POINTS_AT = 5
_DATA_TYPE_AT = 10
#: (period, time in it that gets through), seconds. Slow: 208 packets, one scan, 4 times a second.
_SLOW_S = (0.25, 0.09984)
_INTERMITTENT_S = (2.0, 1.2)


@dataclass(frozen=True, slots=True)
class Outgoing:
    """One datagram on its way."""

    data: bytes | memoryview
    foreign: bool = False
    """Sent from another address than the sensor's."""


class StreamFault:
    """Applies the word in force to packets, batch by batch."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.word: Word = "ok"
        self.disturbed = 0
        """Packets withheld, repeated or spoilt."""
        self._rng = rng
        self._kept: Records = np.zeros(0, PACKET)
        self._next = 0

    def apply(self, packets: Records) -> Sequence[Outgoing | None]:
        """Return what goes out in the place of each packet; None: nothing."""
        if self.word in {"ok", "delayed"}:
            self._kept = _last(self._kept, packets)
            self.disturbed += len(packets) * (self.word == "delayed")
            return _as_they_are(packets)
        if self.word in {"slow", "intermittent"}:
            period_s, open_s = _SLOW_S if self.word == "slow" else _INTERMITTENT_S
            passing = packets["stamp_ns"] % round(period_s * 1e9) < round(open_s * 1e9)
            self.disturbed += int(np.count_nonzero(~passing))
            sent = _as_they_are(packets)
            return [one if ok else None for one, ok in zip(sent, passing, strict=True)]
        self.disturbed += len(packets)
        if self.word == "stuck" and len(self._kept):
            order = (self._next + np.arange(len(packets))) % len(self._kept)
            self._next = (self._next + len(packets)) % len(self._kept)
            return _as_they_are(self._kept[order])
        if self.word == "garbage":
            noise = self._rng.integers(0, 256, (len(packets), PACKET.itemsize), dtype=np.uint8)
            return [Outgoing(row.tobytes()) for row in noise]
        if self.word == "wrong":
            return [_wrong(one.data, kind) for kind, one in enumerate(_as_they_are(packets))]
        return [None] * len(packets)  # off, or stuck before anything was measured


def _last(kept: Records, packets: Records) -> Records:
    if len(packets) >= _KEPT_FOR_STUCK:
        return packets[-_KEPT_FOR_STUCK:]
    return np.concatenate([kept, packets])[-_KEPT_FOR_STUCK:]


def _as_they_are(packets: Records) -> list[Outgoing]:
    whole = memoryview(np.ascontiguousarray(packets).tobytes())
    size = PACKET.itemsize
    return [Outgoing(whole[at : at + size]) for at in range(0, len(whole), size)]


def _wrong(packet: bytes | memoryview, kind: int) -> Outgoing:
    """Return a packet that is almost right."""
    spoilt = bytearray(packet)
    if kind % 4 == 0:
        return Outgoing(packet, foreign=True)
    if kind % 4 == 1:
        return Outgoing(bytes(spoilt[: len(spoilt) // 2]))
    if kind % 4 == 2:
        spoilt[_DATA_TYPE_AT] = 7
    else:
        spoilt[_POINTS_AT] = POINTS_PER_PACKET - 1
    return Outgoing(bytes(spoilt))
