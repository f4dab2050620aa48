import asyncio
import contextlib
from collections.abc import AsyncIterator, Awaitable, Callable, Sequence
from typing import Any

import pytest

from drivers.autopilot import AutopilotLink
from drivers.autopilot_errors import Refused, Unanswered
from drivers.autopilot_rates import REST_HZ, MessageRates

Start = Callable[..., Awaitable[Any]]
POSITION_HZ = 50.0
_POSITION, _ATTITUDE, _MODE, _HEARTBEAT, _HOME = 32, 30, 436, 0, 242
_REQUEST_MESSAGE = 512


async def until(condition: Callable[[], bool], timeout_s: float = 10.0) -> None:
    async with asyncio.timeout(timeout_s):
        while not condition():  # noqa: ASYNC110 (the world has no event to wait on)
            await asyncio.sleep(0.01)


class Vehicle:
    """Answers requests for streams as it is told to."""

    def __init__(self) -> None:
        self.hz: dict[int, float] = {}
        self.asked = 0
        self.heard = True
        self.answer: Exception | None = None
        self.unknown: set[int] = set()
        self.requested: list[int] = []
        self.at_rest: Callable[[], None] = lambda: None

    async def command(
        self, what: str, command: int, parameters: Sequence[float], tries: int
    ) -> None:
        await asyncio.sleep(0)
        assert tries == 1
        if command == _REQUEST_MESSAGE:
            self.requested.append(int(parameters[0]))
            return
        self.asked += 1
        if self.answer is not None:
            raise self.answer
        message, interval_us = parameters
        if message in self.unknown:
            raise Refused(what)
        self.hz[int(message)] = 1e6 / interval_us if interval_us else 0.0
        if self.hz[int(message)] == REST_HZ:
            self.at_rest()


@contextlib.asynccontextmanager
async def keeping(vehicle: Vehicle) -> AsyncIterator[MessageRates]:
    rates = MessageRates(vehicle, lambda: vehicle.heard, POSITION_HZ)  # type: ignore[arg-type]  # asked as a Wire is
    task = asyncio.create_task(rates.keep())
    try:
        yield rates
    finally:
        task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await task


async def test_it_counts_as_awake_only_when_all_was_asked_for_after_the_rest() -> None:
    vehicle = Vehicle()
    async with keeping(vehicle) as rates:
        assert not rates.awake
        await until(lambda: rates.awake)
        assert vehicle.hz[_POSITION] == POSITION_HZ
        rates.rest(True)
        assert not rates.awake
        await until(lambda: vehicle.hz[_POSITION] == REST_HZ)
        rates.rest(False)
        assert not rates.awake
        await until(lambda: rates.awake)
        assert vehicle.hz[_POSITION] == POSITION_HZ


async def test_a_change_while_it_asks_is_not_lost() -> None:
    vehicle = Vehicle()
    async with keeping(vehicle) as rates:
        vehicle.at_rest = lambda: rates.rest(False)
        rates.rest(True)
        await until(lambda: rates.awake)
        assert vehicle.hz[_POSITION] == POSITION_HZ


async def test_what_is_not_ours_is_slowed_at_rest_and_then_given_back() -> None:
    vehicle = Vehicle()
    async with keeping(vehicle) as rates:
        await until(lambda: rates.awake)
        assert _ATTITUDE not in vehicle.hz
        rates.rest(True)
        await until(lambda: vehicle.hz.get(_ATTITUDE) == REST_HZ)
        rates.rest(False)
        await until(lambda: rates.awake)
        assert vehicle.hz[_ATTITUDE] == 0.0  # its own


async def test_a_vehicle_that_was_silent_is_asked_anew() -> None:
    vehicle = Vehicle()
    async with keeping(vehicle) as rates:
        await until(lambda: rates.awake)
        vehicle.heard = False
        await until(lambda: not rates.awake)
        vehicle.hz.clear()
        vehicle.heard = True
        await until(lambda: rates.awake)
        assert vehicle.hz[_POSITION] == POSITION_HZ


async def test_a_vehicle_that_never_answers_is_taken_as_it_is() -> None:
    vehicle = Vehicle()
    vehicle.answer = Unanswered("message 32")
    async with keeping(vehicle) as rates:
        await until(lambda: rates.awake)
        asked = vehicle.asked
        await asyncio.sleep(0.6)
        assert vehicle.asked == asked


async def test_without_a_message_of_the_mode_the_heartbeat_tells_it() -> None:
    vehicle = Vehicle()
    vehicle.unknown = {_MODE}
    async with keeping(vehicle) as rates:
        await until(lambda: rates.awake)
        assert vehicle.hz[_HEARTBEAT] == 10.0


async def test_a_real_link_tells_seldom_at_rest_and_often_after_it(fly_vehicle: Start) -> None:
    vehicle = await fly_vehicle()
    async with AutopilotLink(vehicle.settings.autopilot, vehicle.clock) as link:

        def hz() -> float:
            reading = link.vehicle()
            return 0.0 if reading is None else reading.position_hz or 0.0

        await until(lambda: link.awake and hz() == pytest.approx(POSITION_HZ, rel=0.1))
        link.rest(True)
        await until(lambda: hz() == pytest.approx(REST_HZ, rel=0.1))
        assert not link.awake
        link.rest(False)
        await until(lambda: link.awake and hz() == pytest.approx(POSITION_HZ, rel=0.1))


async def test_a_vehicle_that_does_not_stream_its_home_is_asked_for_it() -> None:
    vehicle = Vehicle()
    vehicle.unknown = {_HOME}
    async with keeping(vehicle) as rates:
        await until(lambda: rates.awake)
    assert vehicle.requested == [_HOME]
