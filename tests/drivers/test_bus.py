import asyncio
import threading

import pytest

from config.links import Bus as BusSettings
from drivers.bus import Bus, BusUnreachable, Key
from drivers.free_port import free_port


@pytest.fixture
def end_point():
    return BusSettings(listen=f"tcp/127.0.0.1:{free_port()}")


async def until(condition, timeout_s=5.0):
    async with asyncio.timeout(timeout_s):
        while not condition():  # noqa: ASYNC110 - a list that fills tells nobody
            await asyncio.sleep(0.01)


async def test_what_one_client_publishes_another_receives_in_order(end_point):
    got = []
    with (
        Bus.open_router(end_point, "d"),
        Bus.open_client(end_point, "d") as sender,
        Bus.open_client(end_point, "d") as receiver,
    ):
        receiver.subscribe(Key.EVENT, got.append)
        await asyncio.sleep(0.3)
        for number in range(50):
            sender.publish(Key.EVENT, b"%d" % number, attachment=b"a")
        await until(lambda: len(got) == 50)
    assert [int(sample.payload) for sample in got] == list(range(50))
    assert {sample.attachment for sample in got} == {b"a"}
    assert {sample.key for sample in got} == {"mission/event"}


async def test_callbacks_run_on_the_event_loop(end_point):
    threads = []
    with Bus.open_router(end_point, "d") as router:
        router.subscribe(Key.STATE, lambda _: threads.append(threading.current_thread()))
        router.publish(Key.STATE, b"{}")
        await until(lambda: bool(threads))
    assert threads == [threading.main_thread()]


async def test_a_slow_reader_of_the_newest_sees_the_last_one(end_point):
    seen = []
    with Bus.open_router(end_point, "d") as router:
        router.subscribe_newest(Key.SCAN, lambda sample: seen.append(int(sample.payload)))
        router.publish(Key.SCAN, b"0")
        await until(lambda: bool(seen))
        for number in range(1, 200):
            router.publish(Key.SCAN, b"%d" % number)
        # The loop is busy meanwhile: all but the newest are passed over.
        threading.Event().wait(0.5)
        await until(lambda: seen[-1] == 199)
    assert len(seen) < 100


async def test_one_vehicle_does_not_hear_another(end_point):
    heard = []
    with (
        Bus.open_router(end_point, "one") as one,
        Bus.open_client(end_point, "two") as two,
    ):
        one.subscribe("**", heard.append)
        await asyncio.sleep(0.2)
        two.publish(Key.EVENT, b"two")
        one.publish(Key.EVENT, b"one")
        await until(lambda: bool(heard))
        await asyncio.sleep(0.2)
    assert [sample.payload for sample in heard] == [b"one"]


async def test_a_request_is_answered_and_an_unknown_one_gets_nothing(end_point):
    with Bus.open_router(end_point, "d") as router, Bus.open_client(end_point, "d") as client:
        router.answer_requests(
            ("echo",), lambda ask: ask.payload[::-1], per_s=20, too_many=b"too many"
        )
        await asyncio.sleep(0.2)
        assert await asyncio.to_thread(client.request, "rpc/echo", b"abc") == b"cba"
        assert await asyncio.to_thread(client.request, "rpc/nobody", b"abc") is None


def test_no_router_is_said_with_its_end_point(end_point):
    with pytest.raises(BusUnreachable, match=end_point.listen):
        Bus.open_client(end_point, "d")


async def test_a_taken_port_is_said_with_its_end_point(end_point):
    with (
        Bus.open_router(end_point, "d"),
        pytest.raises(BusUnreachable, match=end_point.listen),
    ):
        Bus.open_router(end_point, "d")


async def test_sensor_data_gives_way_and_events_do_not(end_point, monkeypatch):
    monkeypatch.setattr("drivers.bus.MAX_WAITING", 10)
    got = []
    with Bus.open_router(end_point, "d") as router:
        router.subscribe(Key.EVENT, got.append)
        with router._wake:  # the putting thread waits meanwhile
            for number in range(30):
                router.publish(Key.SCAN, b"x" * 10, droppable=True)
                if number < 10:
                    router.publish(Key.EVENT, b"%d" % number)
        await until(lambda: len(got) == 10)
        assert router.dropped == 30
