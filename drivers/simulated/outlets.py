"""Where the renderer's data goes: over the wire, as from real devices, or straight onto the bus."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

import numpy as np

from config.settings import Settings
from config.simulation import Word
from drivers.bus import Bus, BusUnreachable, Key
from drivers.clock import Clock
from drivers.codecs import COMPRESSED_IMAGE, POINT_CLOUD, encode_frame, encode_scan
from drivers.simulated.mid360 import Mid360Twin
from drivers.simulated.rtsp_server import RtspServer
from drivers.simulated.scanner import RawScan
from drivers.simulated.sinks import FrameSink, ScanSink
from perception.values import Bytes, Frame, Scan

_RETRY_S = 0.3


class WireScans:
    """Scans as a MID-360's own UDP packets."""

    def __init__(self, settings: Settings, clock: Clock) -> None:
        self._twin = Mid360Twin(settings.lidar, clock, seed=settings.simulation.seed)
        self._twin.start()

    @property
    def wanted(self) -> bool:
        """Whether the sensor measures at all."""
        return self._twin.sampling

    def send(self, scan: RawScan) -> None:
        """Hand the rays to the sensor, which packs and paces them."""
        self._twin.send_points(
            round(scan.t0_s * 1e9), scan.points_l, scan.reflectivity, scan.tag, scan.returned
        )

    def unsent_since_s(self) -> float | None:
        """Return the mission time of the oldest packet that has not left yet."""
        return self._twin.unsent_since_s()

    def set_fault(self, word: Word) -> None:
        """Play a failure word from now on."""
        self._twin.set_fault(word)

    def close(self) -> None:
        """Switch the sensor off."""
        self._twin.close()


class LateBus:
    """A session that is opened beside the work, when the router answers; until then all is lost."""

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._bus: Bus | None = None
        self._stop = threading.Event()
        threading.Thread(target=self._connect, name="bus-connect", daemon=True).start()

    def publish(self, key: Key, payload: bytes, encoding: str, attachment: bytes) -> None:
        """Publish sensor data, where the bus is there."""
        if self._bus is not None:
            self._bus.publish(
                key, payload, encoding=encoding, attachment=attachment, droppable=True
            )

    def close(self) -> None:
        """Leave the bus."""
        self._stop.set()
        if self._bus is not None:
            self._bus.close()

    def _connect(self) -> None:
        while not self._stop.is_set():
            try:
                self._bus = Bus.open_client(self._settings.bus, self._settings.vehicle)
            except BusUnreachable:
                self._stop.wait(_RETRY_S)
            else:
                return


class BusScans:
    """Scans published on Zenoh, without a wire; the failure words act on whole scans."""

    wanted = True

    def __init__(self, bus: LateBus, seed: int) -> None:
        self._bus = bus
        self._word: Word = "ok"
        self._sequence = 0
        self._last: Scan | None = None
        self._waiting: list[Scan] = []
        self._rng = np.random.default_rng([seed, 0xB5])

    def send(self, scan: RawScan) -> None:
        """Publish the returns of one period."""
        self._sequence += 1
        seen, end_s = scan.returned, scan.t0_s + float(scan.offsets_s[-1])
        made = Scan(
            stamp_s=end_s,
            sequence=self._sequence,
            points_l=scan.points_l[seen],
            age_s=(scan.offsets_s[-1] - scan.offsets_s[seen]).astype(np.float32),
            reflectivity=scan.reflectivity[seen],
            tag=scan.tag[seen],
        )
        for outgoing in self._spoilt(made):
            payload, attachment = encode_scan(outgoing)
            self._bus.publish(Key.SCAN, payload, POINT_CLOUD, attachment)

    def unsent_since_s(self) -> float | None:
        """Nothing waits here: whole scans are published at once."""
        return None

    def set_fault(self, word: Word) -> None:
        """Play a failure word from now on."""
        self._word = word

    def close(self) -> None:
        """Nothing is held: the bus belongs to whoever opened it."""

    def _spoilt(self, scan: Scan) -> list[Scan]:
        word = self._word
        if word == "stuck" and self._last is not None:
            return [self._last]
        self._last = scan
        if word == "off" or (word == "slow" and scan.sequence % 3):
            return []
        if word == "intermittent" and scan.stamp_s % 2.0 >= 1.2:
            return []
        if word == "delayed":
            self._waiting.append(scan)
            return [self._waiting.pop(0)] if len(self._waiting) > 8 else []
        if word in ("garbage", "wrong"):
            noise = self._rng.uniform(-60, 60, scan.points_l.shape).astype(np.float32)
            noise[::7] = np.nan
            return [
                Scan(scan.stamp_s, scan.sequence, noise, scan.age_s, scan.reflectivity, scan.tag)
            ]
        return [scan]


class WireFrames:
    """Frames as an RTSP stream."""

    def __init__(self, settings: Settings) -> None:
        camera = settings.simulation.camera
        port = _port_of(settings.camera.stream_url)
        self._server = RtspServer(
            port, camera.stream_width_px, camera.stream_height_px, camera.stream_fps
        )
        self._server.start()

    def send(self, t_s: float, grey: Bytes) -> None:
        """Offer a picture to the players."""
        self._server.push(np.repeat(grey[:, :, None], 3, axis=2), t_s)

    def close(self) -> None:
        """Stop the server."""
        self._server.close()


class BusFrames:
    """Frames published on Zenoh."""

    def __init__(self, bus: LateBus) -> None:
        self._bus = bus
        self._sequence = 0

    def send(self, t_s: float, grey: Bytes) -> None:
        """Publish a picture."""
        self._sequence += 1
        payload, attachment = encode_frame(Frame(t_s, self._sequence, grey))
        self._bus.publish(Key.FRAME, payload, COMPRESSED_IMAGE, attachment)

    def close(self) -> None:
        """Nothing is held: the bus belongs to whoever opened it."""


@contextmanager
def open_outlets(settings: Settings, clock: Clock) -> Iterator[tuple[ScanSink, FrameSink]]:
    """Open what `simulation.sensors` asks for; closed on leaving."""
    with ExitStack() as stack:
        scans: ScanSink
        frames: FrameSink
        if settings.simulation.sensors == "bus":
            bus = LateBus(settings)
            stack.callback(bus.close)
            scans, frames = BusScans(bus, settings.simulation.seed), BusFrames(bus)
        else:
            scans = WireScans(settings, clock)
            stack.callback(scans.close)
            frames = WireFrames(settings)
        stack.callback(frames.close)
        yield scans, frames


def _port_of(url: str) -> int:
    host = url.split("://", 1)[-1].split("/", 1)[0]
    return int(host.rsplit(":", 1)[1]) if ":" in host else 554
