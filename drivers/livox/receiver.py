"""One thread that talks to the sensor and turns what arrives into scans.

Packets come 2 083 times a second (more in a fast simulation). The thread wakes, empties the
sockets, and naps for a few milliseconds: waking for each packet would cost more than its decoding.
At rest nothing wakes it between two scans: the kernel throws away what nobody would look at.
"""

from __future__ import annotations

import select
import socket
import time
from collections import Counter
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, replace

from config.sensors import Lidar
from drivers.clock import Clock
from drivers.livox.assembly import ScanAssembler
from drivers.livox.discovery import discover
from drivers.livox.frames import MAX_FRAME_BYTES, decode_frame
from drivers.livox.packets import ImuSample, decode_imu
from drivers.livox.sensor_clock import SensorClock
from drivers.livox.session import Session
from drivers.livox.sockets import ask_receive_buffer, bound
from drivers.livox.statistics import Dropped, Link, Statistics
from drivers.socket_gate import Gate
from perception.values import Scan

_NAP_S = 0.004
#: Of a buffer too small to sleep on: it holds a hundred packets.
_SHORT_NAP_S = 0.001
_SMALL_BUFFER_BYTES = 1 << 20
#: While resting one scan in so many seconds is looked at, and the packets between pass unread.
REST_PERIOD_S = 1.0
_REST_NAP_S = 0.03
#: The gate opens so long before the scan that is looked at, so that the clocks are one by then.
_LEAD_S = 0.05
_IDLE_MS = 20
_SHUT_MS = 50
_REOPEN_S = 1.0


@dataclass(frozen=True, slots=True)
class ImuReading:
    """One sample of the sensor's own IMU, sensor FLU."""

    stamp_s: float
    """Mission time."""
    gyro_rps: tuple[float, float, float]
    acc_g: tuple[float, float, float]


class Receiver:
    """Receives from one sensor until `stop`; `run` is the body of its thread.

    Args:
        settings: where the sensor is and what is wanted of it.
        clock: mission time.
        on_scan: called in the receiving thread.
        on_imu: called in the receiving thread with all readings of a wake-up.
    """

    def __init__(
        self,
        settings: Lidar,
        clock: Clock,
        on_scan: Callable[[Scan], None],
        on_imu: Callable[[tuple[ImuReading, ...]], None] | None,
    ) -> None:
        self._settings = settings
        self._clock = clock
        self._on_scan = on_scan
        self._on_imu = on_imu
        self._dropped: Counter[Dropped] = Counter()
        self._sensor_clock = SensorClock()
        self._assembler = ScanAssembler(
            settings.scan_period_s,
            (settings.blind_range_m, settings.max_range_m),
            self._sensor_clock,
            self._dropped,
        )
        self._session = Session(settings)
        self._lidar_ip = settings.lidar_ip
        self._command_port = settings.lidar_command_port
        self._imu_count = 0
        self._last_points_s = float("-inf")
        self._host = Statistics()
        self.resting = False
        """Set from any thread: a scan a second is enough, at next to no cost."""
        self._unread_until_s = float("-inf")
        self._stopping = False
        self._wake_read, self._wake_write = socket.socketpair()

    @property
    def statistics(self) -> Statistics:
        """A snapshot; may be read from any thread."""
        session, assembler = self._session, self._assembler
        return replace(
            self._host,
            link=session.link if self._host.link is Link.STREAMING else self._host.link,
            serial=session.device.serial,
            work_state=session.device.work_state,
            temperature_c=session.device.temperature_c,
            scans=assembler.scans,
            packets=assembler.packets,
            points=assembler.points,
            imu=self._imu_count,
            lost=assembler.lost,
            dropped=dict(self._dropped),
            configured=session.configured,
            warning=session.warning or self._host.warning,
        )

    def stop(self) -> None:
        """End `run`, from any thread."""
        self._stopping = True
        # Whoever waits for the other end sees it closed; sending could find it closed already.
        self._wake_write.close()

    def run(self) -> None:
        """Receive until stopped; a network that is not there is tried again."""
        try:
            while not self._stopping:
                try:
                    self._find()
                    with ExitStack() as stack:
                        self._serve(_Sockets(stack, self._settings))
                except OSError as error:
                    self._host = Statistics(link=Link.CLOSED, warning=f"LiDAR network: {error}")
                    self._pause(_REOPEN_S)
        finally:
            self._host = Statistics()
            self._wake_read.close()

    def _find(self) -> None:
        """Learn the sensor's address where it is not configured."""
        self._host = replace(self._host, link=Link.SEARCHING)
        while not self._lidar_ip and not self._stopping:
            found = discover(self._settings.host_ip, self._settings.serial)
            if found is None:
                self._pause(_REOPEN_S)
            else:
                self._lidar_ip, self._command_port = found.lidar_ip, found.command_port

    def _pause(self, wall_s: float) -> None:
        if not self._stopping:
            select.select([self._wake_read], [], [], wall_s)

    def _serve(self, sockets: _Sockets) -> None:
        granted, warning = ask_receive_buffer(sockets.points, self._settings.receive_buffer_bytes)
        self._host = Statistics(link=Link.STREAMING, receive_buffer_bytes=granted, warning=warning)
        poll = select.poll()
        for sock in (self._wake_read, sockets.points, sockets.imu, sockets.push, sockets.command):
            poll.register(sock, select.POLLIN)
        points_fd = sockets.points.fileno()
        nap_s = _NAP_S if granted >= _SMALL_BUFFER_BYTES else _SHORT_NAP_S
        gate = Gate(sockets.points, sockets.imu)
        while not self._stopping:
            ready = {fd for fd, _ in poll.poll(_SHUT_MS if gate.shut else _IDLE_MS)}
            if sockets.imu.fileno() in ready:
                self._drain_imu(sockets.imu)
            unread = self._unread()
            if points_fd in ready and unread:
                self._pass_over_points(sockets.points)
            elif points_fd in ready:
                self._drain_points(sockets.points)
            for sock in (sockets.push, sockets.command):
                if sock.fileno() in ready:
                    self._drain_frames(sock)
            if self._unread(_LEAD_S):
                self._shut(gate, sockets.points)
            elif gate.shut:
                gate.open()
                self._session.listen_again(self._clock.now_s())
            if not gate.shut:
                self._keep_up(sockets.command)
                if ready:
                    time.sleep(_REST_NAP_S if unread else nap_s)

    def _unread(self, lead_s: float = 0.0) -> bool:
        """Return whether nothing that comes within the lead is going to be looked at."""
        return self.resting and self._clock.now_s() + lead_s < self._unread_until_s

    def _shut(self, gate: Gate, points: socket.socket) -> None:
        """Let the kernel throw away what comes; what had come before is passed over."""
        if not gate.shut and gate.close():
            self._pass_over_points(points)

    def _keep_up(self, command: socket.socket) -> None:
        """Send what is due, and close a scan that nothing follows."""
        now_s = self._clock.now_s()
        for datagram in self._session.poll(now_s):
            try:
                command.sendto(datagram, (self._lidar_ip, self._command_port))
            except OSError as error:  # cable out: it is asked again at the next retry
                self._host = replace(self._host, warning=f"LiDAR unreachable: {error}")
        if now_s - self._last_points_s > self._settings.scan_period_s:
            self._deliver(self._assembler.finish())

    def _drain_points(self, sock: socket.socket) -> None:
        assembler, lidar_ip, before = self._assembler, self._lidar_ip, self._assembler.packets
        assembler.expect(self._clock.now_s())
        # A flood must not keep the thread from its other work.
        for _ in range(4096):
            try:
                size, source = sock.recvfrom_into(assembler.slot)
            except BlockingIOError:
                break
            if source[0] != lidar_ip:
                self._dropped[Dropped.SOURCE] += 1
                continue
            if self._sensor_clock.offset_s is None and assembler.packets > before:
                self._observe()
            if self._deliver(assembler.accept(size)) and self.resting:
                break  # what else waits is not looked at
        if assembler.packets > before:
            self._observe()

    def _pass_over_points(self, sock: socket.socket) -> None:
        """Empty the socket; of the newest packet the time is taken, so that the clocks stay one."""
        assembler, size, sender = self._assembler, 0, ""
        assembler.forget()
        assembler.expect(self._clock.now_s())
        for _ in range(4096):
            try:
                size, (sender, _) = sock.recvfrom_into(assembler.slot)
            except BlockingIOError:
                break
        if sender == self._lidar_ip and assembler.look(size):
            self._observe()

    def _observe(self) -> None:
        """Map the newest stamp to now: of a batch it is the one that waited least."""
        now_s = self._clock.mission_time_of(time.monotonic_ns())
        self._assembler.observe(self._assembler.newest_ns, now_s)
        self._last_points_s = now_s
        self._session.on_points(now_s)

    def _deliver(self, scan: Scan | None) -> bool:
        if scan is None:
            return False
        self._on_scan(scan)
        self._unread_until_s = self._clock.now_s() + REST_PERIOD_S - self._settings.scan_period_s
        return True

    def _drain_imu(self, sock: socket.socket) -> None:
        samples: list[ImuSample] = []
        datagrams = self._datagrams(sock)
        # At rest the newest is enough: it keeps the clocks one.
        for datagram in datagrams[-1:] if self.resting else datagrams:
            sample = decode_imu(datagram)
            if sample is None:
                self._dropped[Dropped.MALFORMED] += 1
            else:
                samples.append(sample)
        if not samples:
            return
        self._imu_count += len(samples)
        self._assembler.observe(
            samples[-1].stamp_ns, self._clock.mission_time_of(time.monotonic_ns())
        )
        if self._on_imu is not None and self._sensor_clock.offset_s is not None:
            mission_s = self._sensor_clock.mission_s
            self._on_imu(
                tuple(ImuReading(mission_s(s.stamp_ns), s.gyro_rps, s.acc_g) for s in samples)
            )

    def _drain_frames(self, sock: socket.socket) -> None:
        for datagram in self._datagrams(sock):
            frame = decode_frame(datagram)
            if frame is None:
                self._dropped[Dropped.MALFORMED] += 1
            else:
                self._session.on_frame(frame, self._clock.now_s())

    def _datagrams(self, sock: socket.socket) -> list[bytes]:
        """Return what the sensor sent to a socket; what others sent is counted."""
        datagrams: list[bytes] = []
        for _ in range(1024):
            try:
                datagram, source = sock.recvfrom(MAX_FRAME_BYTES)
            except BlockingIOError:
                break
            if source[0] == self._lidar_ip:
                datagrams.append(datagram)
            else:
                self._dropped[Dropped.SOURCE] += 1
        return datagrams


class _Sockets:
    """The host's end points, open for as long as the stack."""

    def __init__(self, stack: ExitStack, settings: Lidar) -> None:
        def opened(port: int) -> socket.socket:
            return stack.enter_context(bound(settings.host_ip, port))

        self.points = opened(settings.host_point_port)
        self.imu = opened(settings.host_imu_port)
        self.push = opened(settings.host_push_port)
        self.command = opened(settings.host_command_port)
