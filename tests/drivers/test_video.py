import asyncio
import time
from collections.abc import Iterator

import numpy as np
import pytest

from drivers.clock import MonotonicClock
from drivers.simulated.rtsp_server import RtspServer
from drivers.video import VideoStream
from perception.values import Frame

WIDTH, HEIGHT = 320, 240


@pytest.fixture
def server() -> Iterator[RtspServer]:
    server = RtspServer(0, WIDTH, HEIGHT, 20)
    server.start()
    yield server
    server.close()


def coded(number: int) -> np.ndarray:
    """A horizontal ramp whose left quarter carries a number as its grey level."""
    picture = np.tile(np.linspace(20, 235, WIDTH).astype(np.uint8), (HEIGHT, 1))
    picture[:, : WIDTH // 4] = 8 * number
    return picture


def number_in(frame: Frame) -> int:
    return round(float(np.median(frame.grey[:, 10 : WIDTH // 4 - 10])) / 8)


async def push(server: RtspServer, sent: dict[int, float], count: int, first: int = 0) -> None:
    for number in range(first, first + count):
        sent[number] = time.monotonic()
        server.push(coded(number % 31), sent[number])
        await asyncio.sleep(0.05)


async def test_pictures_arrive_whole_fresh_and_stamped_with_their_own_time(
    server: RtspServer,
) -> None:
    stream = VideoStream(server.url, MonotonicClock(), latency_s=0.004)
    got: list[tuple[float, Frame]] = []
    sent: dict[int, float] = {}
    running = asyncio.create_task(stream.run(lambda f: got.append((time.monotonic(), f))))
    await push(server, sent, 31)
    running.cancel()
    await asyncio.gather(push(server, {}, 3), running, return_exceptions=True)

    assert len(got) > 15
    newest = got[-1][1]
    assert newest.grey.shape == (HEIGHT, WIDTH)
    assert newest.grey.dtype == np.uint8
    expected = coded(0)[:, WIDTH // 4 + 16 :].astype(int)
    assert np.abs(newest.grey[:, WIDTH // 4 + 16 :].astype(int) - expected).mean() < 2.0
    latencies = [at - sent[number_in(frame)] for at, frame in got]
    # The parser holds each picture back until the next one begins: 50 ms here.
    assert np.median(latencies) < 0.1
    errors = [frame.stamp_s - sent[number_in(frame)] for _, frame in got[5:]]
    assert abs(np.median(errors)) < 0.02
    assert [frame.sequence for _, frame in got] == list(range(1, len(got) + 1))


async def test_a_slow_reader_gets_the_newest_picture(server: RtspServer) -> None:
    stream = VideoStream(server.url, MonotonicClock())
    got: list[int] = []

    def read(frame: Frame) -> None:
        got.append(number_in(frame))
        time.sleep(0.2)  # holds up the event loop, not the stream

    running = asyncio.create_task(stream.run(read))
    await asyncio.to_thread(lambda: asyncio.run(push(server, {}, 31)))
    running.cancel()
    await asyncio.gather(push(server, {}, 2), running, return_exceptions=True)
    assert len(got) < 15
    assert np.diff(got).max() >= 3


async def test_a_stream_that_falls_silent_is_opened_anew(server: RtspServer) -> None:
    stream = VideoStream(server.url, MonotonicClock(), timeout_s=0.4)
    got: list[Frame] = []
    running = asyncio.create_task(stream.run(got.append))
    await push(server, {}, 12)
    before = len(got)
    assert before > 0
    await asyncio.sleep(0.7)
    assert stream.last_error
    await push(server, {}, 24)
    assert stream.connects >= 2
    assert len(got) > before
    running.cancel()
    await asyncio.gather(running, return_exceptions=True)


async def test_no_server_is_tried_again_without_an_error() -> None:
    stream = VideoStream("rtsp://127.0.0.1:9/live", MonotonicClock(), timeout_s=0.3)
    running = asyncio.create_task(stream.run(lambda _: None))
    await asyncio.sleep(0.6)
    assert not running.done()
    assert stream.connects == 0
    assert stream.last_error
    running.cancel()
    await asyncio.gather(running, return_exceptions=True)


async def test_at_rest_key_pictures_come_and_afterwards_all_of_them(server: RtspServer) -> None:
    stream = VideoStream(server.url, MonotonicClock())
    stream.rest(True)
    got: list[int] = []
    running = asyncio.create_task(stream.run(lambda frame: got.append(frame.sequence)))
    await push(server, {}, 90)
    at_rest = len(got)
    heard_ns = stream.heard_ns
    stream.rest(False)
    await push(server, {}, 60)
    running.cancel()
    await asyncio.gather(push(server, {}, 3), running, return_exceptions=True)
    assert 1 <= at_rest <= 5  # every fortieth picture is a key picture
    assert stream.connects == 1
    assert len(got) - at_rest > 12
    assert stream.heard_ns > heard_ns > 0


async def test_no_more_pictures_are_delivered_and_none_wider_than_wanted(
    server: RtspServer,
) -> None:
    stream = VideoStream(server.url, MonotonicClock(), rate_hz=5.0, width_px=160)
    got: list[Frame] = []
    running = asyncio.create_task(stream.run(got.append))
    await push(server, {}, 60)
    running.cancel()
    await asyncio.gather(push(server, {}, 3), running, return_exceptions=True)
    stamps_s = [frame.stamp_s for frame in got]
    assert len(got) >= 4
    # Pushed every 0.05 s; the first stamps wait until the least transport delay is known.
    assert np.diff(stamps_s)[3:].min() > 0.12
    assert got[-1].grey.shape == (120, 160)
    expected = coded(0)[:, WIDTH // 4 + 16 :].mean()
    assert abs(got[-1].grey[:, WIDTH // 8 + 8 :].mean() - expected) < 3.0


async def test_a_camera_that_sends_by_udp_alone_is_read_by_udp(
    server: RtspServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    agreed = RtspServer._set_up

    def udp_alone(self: RtspServer, client: object, text: str) -> str | None:
        return None if "TCP" in text else agreed(self, client, text)

    monkeypatch.setattr(RtspServer, "_set_up", udp_alone)
    stream = VideoStream(server.url, MonotonicClock())
    got: list[Frame] = []
    running = asyncio.create_task(stream.run(got.append))
    await push(server, {}, 40)
    running.cancel()
    await asyncio.gather(push(server, {}, 3), running, return_exceptions=True)
    assert len(got) > 5
    assert got[-1].grey.shape == (HEIGHT, WIDTH)
