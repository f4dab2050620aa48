import asyncio
import math
import socket
import threading
import time
from collections.abc import Awaitable, Callable
from typing import Any

import pytest
from pymavlink.dialects.v20 import common as mavlink

from config.links import Autopilot
from drivers.autopilot import AutopilotLink
from drivers.autopilot_errors import BadSetpoint, LinkFailed, NoVehicle, PortTaken, Refused
from drivers.autopilot_state import VehicleMode, VehicleReading
from drivers.clock import MonotonicClock, sleep, sleep_until
from drivers.frames import Vec3

Start = Callable[..., Awaitable[Any]]


def udp_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as trial:
        trial.bind(("127.0.0.1", 0))
        return int(trial.getsockname()[1])


def seen(link: AutopilotLink) -> VehicleReading:
    reading = link.vehicle()
    assert reading is not None
    return reading


async def until(condition: Callable[[], bool], timeout_s: float = 15.0) -> None:
    async with asyncio.timeout(timeout_s):
        while not condition():  # noqa: ASYNC110 (the world has no event to wait on)
            await asyncio.sleep(0.01)


async def ready(link: AutopilotLink) -> None:
    await until(
        lambda: (
            (reading := link.vehicle()) is not None
            and reading.healthy
            and reading.altitude_m is not None
        )
    )


async def test_a_vehicle_that_does_not_answer_is_named_with_url_and_time() -> None:
    url = f"udpin://127.0.0.1:{udp_port()}"
    settings = Autopilot(url=url, connect_timeout_s=0.2)
    with pytest.raises(NoVehicle, match=rf"system id 1 .*{url} within 0.2 s"):
        async with AutopilotLink(settings, MonotonicClock()):
            pass


async def test_a_taken_port_is_noticed_before_the_other_loses_its_link() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        port = other.getsockname()[1]
        settings = Autopilot(url=f"udpin://127.0.0.1:{port}")
        with pytest.raises(PortTaken, match=f"port {port} is taken"):
            async with AutopilotLink(settings, MonotonicClock()):
                pass


@pytest.mark.parametrize("url", ["serial:///dev/nothing-here:57600", "nonsense://x"])
async def test_a_url_that_cannot_be_opened_is_named(url: str) -> None:
    with pytest.raises(LinkFailed, match=r"nothing-here|nonsense"):
        async with AutopilotLink(Autopilot(url=url), MonotonicClock()):
            pass


async def test_a_foreign_system_id_is_not_taken_for_our_vehicle() -> None:
    port, stop = udp_port(), threading.Event()
    sender = mavlink.MAVLink(None, srcSystem=7, srcComponent=1)

    def send() -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
            while not stop.wait(0.05):
                beat = mavlink.MAVLink_heartbeat_message(2, 12, 81, 6 << 16, 4, 3)
                out.sendto(beat.pack(sender), ("127.0.0.1", port))

    thread = threading.Thread(target=send)
    thread.start()
    try:
        settings = Autopilot(url=f"udpin://127.0.0.1:{port}", connect_timeout_s=0.6)
        with pytest.raises(NoVehicle, match="heard system id 7"):
            async with AutopilotLink(settings, MonotonicClock()):
                pass
    finally:
        stop.set()
        thread.join()


async def test_it_arms_takes_off_flies_five_metres_holds_and_lands(fly_vehicle: Start) -> None:
    vehicle = await fly_vehicle()
    clock = vehicle.clock
    async with AutopilotLink(vehicle.settings.autopilot, clock) as link:
        await ready(link)
        await link.act("arm")
        await link.act("takeoff", height_m=4.0)
        await until(lambda: seen(link).position_w[2] > 3.5 and seen(link).mode is VehicleMode.HOLD)
        assert seen(link).in_air

        x, y, z = seen(link).position_w
        goal: Vec3 = (x + 5.0, y, z)
        flying = asyncio.create_task(_send_for(link, clock, goal, 14.0))
        await sleep(clock, 0.6)
        await link.act("offboard")
        await flying
        reading = seen(link)
        assert reading.mode is VehicleMode.OFFBOARD
        assert math.dist(reading.position_w, goal) < 0.5
        assert reading.yaw_rad == pytest.approx(0.3, abs=0.05)
        truth = vehicle.truth.aircraft.body.position_w
        assert truth[0] - 80.0 == pytest.approx(goal[0], abs=0.8)
        assert clock.now_s() - reading.stamp_s < 0.5

        await link.act("hold")
        await until(lambda: seen(link).mode is VehicleMode.HOLD)
        await link.act("land")
        await until(lambda: not seen(link).armed)
        assert seen(link).landed
        before_s = time.monotonic()
    assert time.monotonic() - before_s < 1.0


async def _send_for(link: AutopilotLink, clock: object, goal: Vec3, for_s: float) -> None:
    begin_s = clock.now_s()
    tick = 0
    while clock.now_s() < begin_s + for_s:
        link.send_setpoint(goal, (0.0, 0.0, 0.0), 0.3)
        tick += 1
        await sleep_until(clock, begin_s + 0.05 * tick)


async def test_a_refusal_carries_the_autopilots_own_words_once(fly_vehicle: Start) -> None:
    vehicle = await fly_vehicle()
    async with AutopilotLink(vehicle.settings.autopilot, vehicle.clock) as link:
        await ready(link)
        with pytest.raises(Refused) as refusal:
            await link.act("offboard")  # no setpoint was ever sent
        text = str(refusal.value)
        assert "after 3 tries" in text
        assert text.count("Offboard") == 1


async def test_no_acknowledgement_ends_after_three_tries(fly_vehicle: Start) -> None:
    vehicle = await fly_vehicle()
    async with AutopilotLink(vehicle.settings.autopilot, vehicle.clock) as link:
        await ready(link)
        vehicle.truth.fault("link", "off")
        begin_s = time.monotonic()
        with pytest.raises(Refused, match="no acknowledgement after 3 tries"):
            await link.act("arm")
        assert time.monotonic() - begin_s < 3.0


async def test_parameters_are_read_and_set_with_their_own_types(fly_vehicle: Start) -> None:
    vehicle = await fly_vehicle()
    async with AutopilotLink(vehicle.settings.autopilot, vehicle.clock) as link:
        names = ("COM_OBL_RC_ACT", "COM_OF_LOSS_T", "COM_FLTMODE1")
        values = await link.read_parameters(names)
        assert values == {"COM_OBL_RC_ACT": 5.0, "COM_OF_LOSS_T": 0.5, "COM_FLTMODE1": -1.0}
        await link.set_parameter("COM_OBL_RC_ACT", 4)
        assert (await link.read_parameters(("COM_OBL_RC_ACT",)))["COM_OBL_RC_ACT"] == 4.0


async def test_a_setpoint_that_is_not_finite_never_leaves(fly_vehicle: Start) -> None:
    vehicle = await fly_vehicle()
    async with AutopilotLink(vehicle.settings.autopilot, vehicle.clock) as link:
        for bad in (math.nan, math.inf):
            with pytest.raises(BadSetpoint):
                link.send_setpoint((0.0, bad, 5.0), (0.0, 0.0, 0.0), 0.0)
            with pytest.raises(BadSetpoint):
                link.send_setpoint((0.0, 0.0, 5.0), (0.0, 0.0, 0.0), bad)
        assert link.setpoints_sent == 0


async def test_the_pilots_mode_is_reported_faster_than_by_the_heartbeat(fly_vehicle: Start) -> None:
    vehicle = await fly_vehicle()
    async with AutopilotLink(vehicle.settings.autopilot, vehicle.clock) as link:
        await ready(link)
        await sleep(vehicle.clock, 2.0)
        ages_s = []
        for _ in range(20):
            ages_s.append(vehicle.clock.now_s() - seen(link).mode_stamp_s)
            await sleep(vehicle.clock, 0.13)
        # CURRENT_MODE was asked for at 10 Hz, and a heartbeat alone would come once a second.
        assert sorted(ages_s)[15] < 0.3
