"""A MID-360 on the wire, without its optics: whoever casts the rays hands the points over.

It answers discovery and commands like a real unit, spins up, reports its state once a second, and
sends points and IMU samples in the real layout, paced by mission time. The eight failure words
are built in. Meant for the process that renders; needs no asyncio.

    twin = Mid360Twin(settings.lidar, clock)
    with twin:
        directions, offsets_s = mid360_pattern.rays(t0_s, 20_000)
        ...                                     # cast; mid360_noise.measure(...)
        twin.send_points(t0_ns, points_l, returns.reflectivity, returns.tag, returns.returned)
"""

from __future__ import annotations

import select
import socket
import threading
from contextlib import ExitStack
from typing import Self

import numpy as np
from numpy.typing import NDArray

from config.sensors import Lidar
from config.simulation import Word
from drivers.clock import Clock
from drivers.livox.frames import (
    DISCOVERY_PORT,
    MAX_FRAME_BYTES,
    Command,
    Key,
    WorkState,
    decode_frame,
    encode_frame,
)
from drivers.livox.packets import POINTS_PER_PACKET
from drivers.livox.sockets import bound
from drivers.simulated.mid360_faults import DELAY_S, StreamFault
from drivers.simulated.mid360_firmware import Firmware
from drivers.simulated.mid360_sender import PacedSender, Timed
from drivers.simulated.mid360_wire import POINT, Records, pack_imu, pack_packets, pack_points
from perception.values import Bytes, Float32

_STANDARD_COMMAND_PORT = 56100
_STANDARD_SOURCES = (56200, 56300, 56400)
_IMU_PERIOD_NS = 5_000_000
_UPTIME_NS = 1_000_000_000
"""How long a sensor's clock runs before it can be asked anything."""
_IMU_BACKLOG_NS = 500_000_000
_WITHOUT_IMU = frozenset({"off", "stuck", "garbage", "wrong"})
_PUSH_PERIOD_S = 1.0
_POLL_S = 0.02
_MAX_GAP_NS = 1_000_000


class Mid360Twin:
    """One simulated MID-360; start it with `start` or as a context manager.

    Args:
        settings: its own address is `lidar_ip` and `lidar_command_port`. At the standard port
            56100 it sends from the standard ports too, else from free ones.
        clock: mission time; packets leave when it reaches their time.
        serial: up to 15 ASCII characters.
        spin_up_s: mission time from idle to sampling (a real unit: 6-10 s).
        seed: of the garbage that a fault sends.
        discovery_port: where discoveries are heard; None: at 56000 where the command port is the
            standard one, else not at all, since several simulations may run on a host.
    """

    def __init__(
        self,
        settings: Lidar,
        clock: Clock,
        *,
        serial: str = "47MDSIM00000001",
        spin_up_s: float = 2.0,
        seed: int = 0,
        discovery_port: int | None = None,
    ) -> None:
        self._clock = clock
        self._settings = settings
        self._ip = settings.lidar_ip or "127.0.0.1"
        self._firmware = Firmware(settings, serial, spin_up_s)
        self._lock = threading.Lock()
        self._fault = StreamFault(np.random.default_rng(seed))
        self._sender = PacedSender(clock, self._send_imu)
        self._standard = settings.lidar_command_port == _STANDARD_COMMAND_PORT
        self._discovery_port = discovery_port or (DISCOVERY_PORT if self._standard else None)
        self._stack = ExitStack()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._serve, name="mid360-firmware", daemon=True)
        self._switched_on_ns = round(clock.now_s() * 1e9) - _UPTIME_NS
        self._boots = self._firmware.boots
        self._carry: Records = np.zeros(0, POINT)
        self._carry_ns = 0
        self._number = self._imu_number = self._imu_next_ns = 0
        self._motion = ((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def sampling(self) -> bool:
        """Whether points are wanted; while not, rays need not be cast."""
        return self._firmware.work_state(self._clock.now_s()) is WorkState.SAMPLING

    @property
    def disturbed(self) -> int:
        """Packets withheld, repeated, delayed or spoilt by a fault so far."""
        return self._fault.disturbed

    @property
    def sent(self) -> int:
        """Point packets sent so far."""
        return self._sender.sent

    def unsent_since_s(self) -> float | None:
        """Return the mission time of the oldest packet that has not left, None for none."""
        return self._sender.unsent_since_s()

    def start(self) -> None:
        """Open the ports and begin to answer; OSError where a port is taken."""
        push, points, imu = _STANDARD_SOURCES if self._standard else (0, 0, 0)
        with ExitStack() as stack:

            def opened(ip: str, port: int, *, shared: bool = False) -> socket.socket:
                return stack.enter_context(bound(ip, port, shared=shared))

            self._command = opened(self._ip, self._settings.lidar_command_port)
            self._push, self._points, self._imu = (opened(self._ip, p) for p in (push, points, imu))
            self._foreign = opened(_other_address(self._ip), 0)
            self._listening = [self._command]
            if self._discovery_port is not None:
                # Broadcasts are heard on all addresses, and answered from the sensor's own.
                self._listening.append(opened("", self._discovery_port, shared=True))
                self._found = opened(self._ip, self._discovery_port, shared=True)
                self._found.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
                self._listening.append(self._found)
            self._stack = stack.pop_all()
        self._thread.start()
        self._sender.start()

    def close(self) -> None:
        """Switch off and close the ports."""
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join()
        self._sender.close()
        self._stack.close()

    def set_fault(self, word: Word) -> None:
        """Fail in the way of a word from now on; `ok` ends it.

        `off` is a cable pulled: nothing goes out, nothing is heard, inside it goes on.
        """
        with self._lock:
            self._fault.word = word
            if word == "off":
                self._sender.clear()

    def set_motion(
        self, gyro_rps: tuple[float, float, float], acc_g: tuple[float, float, float]
    ) -> None:
        """Tell what the built-in IMU measures from now on, sensor FLU."""
        self._motion = (gyro_rps, acc_g)

    def send_points(
        self,
        t_first_ns: int,
        points_l: Float32,
        reflectivity: Bytes,
        tag: Bytes,
        returned: NDArray[np.bool_],
        *,
        interval_ns: int = 5000,
    ) -> None:
        """Send points in firing order, each packet when its last point's time has come.

        Args:
            t_first_ns: mission time of the first point, in nanoseconds. The stamps on the wire
                count from when the sensor was switched on.
            points_l: (N, 3) metres, sensor FLU; ignored where nothing returned.
            reflectivity: (N,) 8 bit.
            tag: (N,) Livox confidence bits.
            returned: (N,) False: sent as a no-return.
            interval_ns: mission time from one point to the next (a real unit: 5000).

        What does not fill a packet waits for the next call. While the sensor is not sampling, or
        nobody has told it where to send, nothing is sent.
        """
        with self._lock:
            self._start_anew_after_boot()
            to = self._firmware.destination(Key.POINT_DESTINATION)
            if to is None or not self.sampling:
                self._carry = self._carry[:0]
                return
            first_ns, records = self._join(
                t_first_ns, pack_points(points_l, reflectivity, tag, returned), interval_ns
            )
            packets = pack_packets(
                records, first_ns - self._switched_on_ns, interval_ns, self._number
            )
            self._number += len(packets)
            delay_s = DELAY_S if self._fault.word == "delayed" else 0.0
            outgoing = self._fault.apply(packets)
            step_ns = POINTS_PER_PACKET * interval_ns
            timed = [
                Timed(
                    (first_ns + (at + 1) * step_ns) * 1e-9 + delay_s,
                    one.data,
                    self._foreign if one.foreign else self._points,
                    (to.ip, to.port),
                )
                for at, one in enumerate(outgoing)
                if one is not None
            ]
        self._sender.put(timed)

    def _start_anew_after_boot(self) -> None:
        if self._boots == self._firmware.boots:
            return
        self._boots = self._firmware.boots
        self._switched_on_ns = round(self._clock.now_s() * 1e9) - _UPTIME_NS
        self._number = self._imu_number = self._imu_next_ns = 0
        self._carry = self._carry[:0]
        self._sender.clear()

    def _join(self, t_first_ns: int, records: Records, interval_ns: int) -> tuple[int, Records]:
        """Return the start and the points of whole packets; keep the rest."""
        expected_ns = self._carry_ns + len(self._carry) * interval_ns
        if len(self._carry) and abs(t_first_ns - expected_ns) <= _MAX_GAP_NS:
            records = np.concatenate([self._carry, records])
            t_first_ns = self._carry_ns
        whole = len(records) - len(records) % POINTS_PER_PACKET
        self._carry, self._carry_ns = records[whole:], t_first_ns + whole * interval_ns
        return t_first_ns, records[:whole]

    def _send_imu(self) -> None:
        """Send the samples whose time has come, with or without points.

        They never wait for a renderer: from them the host learns the sensor's clock.
        """
        with self._lock:
            self._start_anew_after_boot()
            word = self._fault.word
            to = self._firmware.destination(Key.IMU_DESTINATION)
            now_s = self._clock.now_s() - (DELAY_S if word == "delayed" else 0.0)
            now_ns = round(now_s * 1e9) - self._switched_on_ns
            first_ns = max(self._imu_next_ns, now_ns - _IMU_BACKLOG_NS)
            stamps = range(-(-first_ns // _IMU_PERIOD_NS) * _IMU_PERIOD_NS, now_ns, _IMU_PERIOD_NS)
            if to is None or not self.sampling or not stamps:
                return
            self._imu_next_ns = stamps[-1] + _IMU_PERIOD_NS
            if word in _WITHOUT_IMU:
                return
            packets = [
                pack_imu(stamp_ns, self._imu_number + at, *self._motion)
                for at, stamp_ns in enumerate(stamps)
            ]
            self._imu_number += len(packets)
        for packet in packets:
            _send(self._imu, packet, (to.ip, to.port))

    def _serve(self) -> None:
        """Answer and report until closed; the body of the firmware's thread."""
        pushed_s, sequence = float("-inf"), 0
        while not self._stop.is_set():
            for sock in select.select(self._listening, [], [], _POLL_S)[0]:
                self._answer(sock)
            now_s = self._clock.now_s()
            if now_s - pushed_s >= _PUSH_PERIOD_S:
                pushed_s, sequence = now_s, sequence + 1
                self._report(sequence, now_s)

    def _answer(self, sock: socket.socket) -> None:
        datagram, source = sock.recvfrom(MAX_FRAME_BYTES)
        frame = decode_frame(datagram)
        if frame is None or self._fault.word == "off":
            return
        with self._lock:
            reply = self._firmware.answer(frame, self._clock.now_s())
        if reply is None:
            return
        if frame.command != Command.DISCOVER:
            _send(sock, encode_frame(reply), source)
            return
        # A real unit answers everybody; loopback has no broadcast of its own.
        everybody = "255.255.255.255" if not source[0].startswith("127.") else source[0]
        _send(self._found, encode_frame(reply), (everybody, source[1]))

    def _report(self, sequence: int, now_s: float) -> None:
        with self._lock:
            to = self._firmware.destination(Key.STATE_DESTINATION)
            report = encode_frame(self._firmware.report(sequence, now_s))
        if to is not None and self._fault.word != "off":
            _send(self._push, report, (to.ip, to.port))


def _send(sock: socket.socket, data: bytes, to: tuple[str, int]) -> None:
    try:
        sock.sendto(data, to)
    except OSError:
        return  # nobody can be reached: as with a real cable, the sensor does not know


def _other_address(ip: str) -> str:
    """Return an address of this host that is not the sensor's."""
    return "127.0.0.254" if ip.startswith("127.") and ip != "127.0.0.254" else "127.0.0.1"
