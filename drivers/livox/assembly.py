"""From packets to scans: one scan every `scan_period_s` of sensor time.

Packets are received straight into slots of one large array and stay there, undecoded, until the
scan is complete. Loss is counted by the running number; duplicates, stragglers and packets whose
time makes no sense are dropped and counted.
"""

from __future__ import annotations

from collections import Counter

import numpy as np
from numpy.typing import NDArray

from drivers.livox.epoch import NewEpoch
from drivers.livox.packets import HEADER_BYTES, POINT_BYTES, Header, decode_points, read_header
from drivers.livox.sensor_clock import SensorClock
from drivers.livox.statistics import Dropped
from perception.values import Float32, Scan

#: A datagram that fills its slot is longer than any packet.
SLOT_BYTES = 1500
_PACKETS_PER_S = 2084
#: A packet from farther ahead of our own time than this cannot be right.
_AHEAD_S = 0.5
#: One farther ahead of the packet before is believed when its number says the same, or once another
#: goes on from there: a damaged time would cut off the scan, and all that is right would come from
#: the past for a while.
_LEAP_NS = 5_000_000
_WRAP = 1 << 16
#: So many wrong check sums on end, a quarter of a second of them, and no right one.
_FOREIGN_SUMS = 512
#: A scan that covers less of its period is thrown away: free space that nobody looked at must not
#: pass for free.
_MIN_COVER = 0.4


class ScanAssembler:
    """Collects point packets and hands over scans.

    Args:
        period_s: sensor time covered by a scan.
        range_m: (nearest, farthest) return kept.
        clock: gives the mission time of a sensor stamp.
        dropped: counts what is not used.
    """

    def __init__(
        self,
        period_s: float,
        range_m: tuple[float, float],
        clock: SensorClock,
        dropped: Counter[Dropped],
    ) -> None:
        self._period_ns = round(period_s * 1e9)
        self._range_m = range_m
        self._clock = clock
        self._dropped = dropped
        # Room for twice the nominal rate: a scan that fills it is cut early.
        self._capacity = max(64, round(period_s * 2 * _PACKETS_PER_S))
        store = bytearray((self._capacity + 1) * SLOT_BYTES)
        self._slots = np.frombuffer(store, np.uint8).reshape(-1, SLOT_BYTES)
        self._views = [
            memoryview(store)[at : at + SLOT_BYTES] for at in range(0, len(store), SLOT_BYTES)
        ]
        self._headers: list[Header] = []
        self._stamps: set[int] = set()
        self._start_ns: int | None = None
        self._limit_ns: float = np.inf
        self._epoch = NewEpoch()
        self._wrong_sums = 0
        self._leapt_ns: int | None = None
        self._last_number: int | None = None
        self._lost_before_scan = 0
        self.newest_ns = -1
        """Sensor time of the newest packet used; -1 before the first."""
        self.lost = 0
        self.packets = 0
        self.points = 0
        self.scans = 0

    @property
    def slot(self) -> memoryview:
        """Where the next datagram is to be received."""
        return self._views[len(self._headers)]

    def observe(self, sensor_ns: int, arrival_s: float) -> None:
        """Tell that something of this sensor time was here at a mission time.

        IMU samples count too: they share the clock of the points, and leave at once where points
        may wait to be complete.
        """
        if sensor_ns <= self._limit_ns:
            self._clock.observe(sensor_ns, arrival_s)
        self.expect(arrival_s)

    def expect(self, now_s: float) -> None:
        """Tell the mission time: from then on a stamp well ahead of it is refused."""
        offset_s = self._clock.offset_s
        self._limit_ns = np.inf if offset_s is None else (now_s + _AHEAD_S - offset_s) * 1e9

    def accept(self, size: int) -> Scan | None:
        """Take the datagram in `slot`; return the scan that it completes, if any."""
        header = self._header(size)
        if header is None:
            self._dropped[Dropped.MALFORMED] += 1
            return None
        stamp_ns = header.stamp_ns
        if stamp_ns in self._stamps:
            self._dropped[Dropped.REPEATED] += 1
            return None
        if self._start_ns is not None and not self._start_ns <= stamp_ns <= self._limit_ns:
            if not self._epoch.confirms(stamp_ns):
                past = stamp_ns < self._start_ns
                self._dropped[Dropped.PAST if past else Dropped.FUTURE] += 1
                return None
            self._restart()
        elif self._leaps(header):
            self._dropped[Dropped.FUTURE] += 1
            return None
        scan = self._finish_before(header)
        self._append(header)
        if self._is_complete(header):
            scan = self.finish()
        return scan

    def _header(self, size: int) -> Header | None:
        """Read the datagram in `slot`.

        Where not one check sum of many has been right, it is not the one that we know: UDP has its
        own, and packets are read without.
        """
        if self._wrong_sums >= _FOREIGN_SUMS:
            return read_header(self.slot, size, summed=False)
        header = read_header(self.slot, size)
        if header is not None:
            self._wrong_sums = 0
        elif read_header(self.slot, size, summed=False) is not None:
            self._wrong_sums += 1
        return header

    def _leaps(self, header: Header) -> bool:
        """Return whether a packet comes from well ahead of the last, and nothing bears it out.

        After a loss the running number has gone on as far as the time.
        """
        leapt_ns, newest_ns, stamp_ns = self._leapt_ns, self.newest_ns, header.stamp_ns
        self._leapt_ns = None
        if self._start_ns is None or stamp_ns <= newest_ns + _LEAP_NS:
            return False
        if leapt_ns is not None and leapt_ns < stamp_ns <= leapt_ns + _LEAP_NS:
            return False
        if self._last_number is not None:
            step_ns = header.interval_ns * header.points / max(header.points - 1, 1)
            by_number_ns = (header.number - self._last_number) % _WRAP * step_ns
            if abs(by_number_ns - (stamp_ns - newest_ns)) < _LEAP_NS:
                return False
        self._leapt_ns = stamp_ns
        return True

    def look(self, size: int) -> bool:
        """Take only the time of the datagram in `slot`; False where it makes no sense."""
        header = self._header(size)
        if header is None or not (self._start_ns or 0) <= header.stamp_ns <= self._limit_ns:
            return False
        self.newest_ns = max(self.newest_ns, header.stamp_ns)
        return True

    def forget(self) -> None:
        """Leave off collecting: packets that are not handed over from now on are not lost."""
        self._clear()
        self._last_number = None

    def finish(self) -> Scan | None:
        """Return what has been collected as a scan, complete or not; None when that is nothing."""
        headers, lost = self._headers, max(0, self.lost - self._lost_before_scan)
        if not headers or self._clock.offset_s is None:
            self._clear()
            return None
        newest_ns = max(header.stamp_ns + header.interval_ns for header in headers)
        self._clear()
        self._start_ns = newest_ns + 1
        if sum(header.interval_ns for header in headers) < _MIN_COVER * self._period_ns:
            self._dropped[Dropped.FRAGMENT] += len(headers)
            return None
        first = headers[0]
        end = HEADER_BYTES + first.points * POINT_BYTES[first.data_type]
        found = decode_points(self._slots[: len(headers), HEADER_BYTES:end], first.data_type)
        if found is None:
            return None
        near_m, far_m = self._range_m
        range_m = np.sqrt(np.einsum("ij,ij->i", found.points_l, found.points_l))
        kept = np.flatnonzero((range_m >= near_m) & (range_m <= far_m))
        self.scans += 1
        self.points += len(kept)
        return Scan(
            stamp_s=self._clock.mission_s(newest_ns),
            sequence=self.scans,
            points_l=found.points_l.take(kept, axis=0),
            age_s=_ages(headers, newest_ns, found.place.take(kept)),
            reflectivity=found.reflectivity.take(kept),
            tag=found.tag.take(kept),
            lost_packets=lost,
        )

    def _finish_before(self, header: Header) -> Scan | None:
        """Close the scan that a packet of the next one, or of another layout, cuts off."""
        headers = self._headers
        if not headers:
            return None
        if (
            header.stamp_ns < (self._start_ns or 0) + self._period_ns
            and len(headers) < self._capacity
            and header[:2] == headers[0][:2]
        ):
            return None
        arrived = self._slots[len(headers)].copy()
        scan = self.finish()
        self._slots[0] = arrived
        return scan

    def _append(self, header: Header) -> None:
        if not self._headers:
            self._start_ns = header.stamp_ns
        self._headers.append(header)
        self._stamps.add(header.stamp_ns)
        self._epoch.clear()
        self.newest_ns = max(self.newest_ns, header.stamp_ns)
        self.packets += 1
        if self._last_number is not None:
            missing = (header.number - self._last_number - 1) % _WRAP
            if missing >= _WRAP // 2:  # overtaken on the way, and counted as lost
                self.lost = max(0, self.lost - 1)
                return
            self.lost += missing
        self._last_number = header.number

    def _is_complete(self, header: Header) -> bool:
        # One packet early rather than late: sensors that send in bursts need not be waited for.
        end_ns = header.stamp_ns + 2 * header.interval_ns
        return end_ns >= (self._start_ns or 0) + self._period_ns

    def _restart(self) -> None:
        """Begin again: the sensor's clock has (after a reboot, or synchronised)."""
        self._clear()
        self._clock.reset()
        self._limit_ns = np.inf
        self._start_ns = self._last_number = None
        self.newest_ns = -1

    def _clear(self) -> None:
        self._headers = []
        self._stamps.clear()
        self._lost_before_scan = self.lost


def _ages(headers: list[Header], newest_ns: int, place: NDArray[np.intp]) -> Float32:
    """Return (N,) seconds before the newest point at which each point was measured."""
    points = headers[0].points
    first_s = np.array([(newest_ns - header.stamp_ns) * 1e-9 for header in headers], np.float32)
    step_s = np.float32(headers[0].interval_ns * 1e-9 / max(points - 1, 1))
    packet = place // points
    age_s: Float32 = first_s.take(packet) - (place - packet * points).astype(np.float32) * step_s
    return np.maximum(age_s, np.float32(0))
