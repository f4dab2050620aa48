"""A vehicle by other hands that sends next to nothing: heartbeat, angles and a local position."""

import asyncio
import contextlib
import gc
import math
import socket
import time

import pytest
from pymavlink.dialects.v20 import common as mavlink

from config.links import Autopilot
from drivers.autopilot import AutopilotLink
from drivers.autopilot_errors import Refused
from drivers.clock import MonotonicClock
from drivers.free_port import free_port

SYSTEM = 9


class PlainVehicle(asyncio.DatagramProtocol):
    """Acknowledges every command; every second acknowledgement is lost, unless told otherwise."""

    def __init__(self, port):
        self._port = port
        self._packer = mavlink.MAVLink(None, srcSystem=SYSTEM, srcComponent=1)
        self._parser = mavlink.MAVLink(None)
        self._parser.robust_parsing = True
        self._transport = None
        self._acknowledged = 0
        self.loses = True
        self.results = (0,)
        self.commands = []

    def connection_made(self, transport):
        self._transport = transport

    def datagram_received(self, data, _peer):
        for message in self._parser.parse_buffer(bytearray(data)) or ():
            if message.get_type() == "COMMAND_LONG" and message.target_system == SYSTEM:
                self._command(message)

    def error_received(self, exc):
        pass

    def _command(self, message):
        self.commands.append(message)
        self._acknowledged += 1
        if self._acknowledged % 2 or not self.loses:
            for result in self.results:
                self.send(mavlink.MAVLink_command_ack_message(message.command, result))

    def send(self, message):
        data = message.pack(self._packer)
        self._packer.seq = (self._packer.seq + 1) % 256
        self._transport.sendto(data, ("127.0.0.1", self._port))

    async def tell(self):
        while True:
            boot_ms = int(time.monotonic() * 1e3) & 0xFFFFFFF
            self.send(mavlink.MAVLink_heartbeat_message(2, 12, 0x81, 4 << 16 | 3 << 24, 4, 3))
            self.send(mavlink.MAVLink_attitude_message(boot_ms, 0.0, 0.0, 0.5, 0.0, 0.0, 0.0))
            self.send(
                mavlink.MAVLink_local_position_ned_message(boot_ms, 1.0, 2.0, -3.0, 0.0, 0.0, 0.0)
            )
            await asyncio.sleep(0.05)


@contextlib.asynccontextmanager
async def linked(**settings):
    port = free_port(socket.SOCK_DGRAM)
    loop = asyncio.get_running_loop()
    _, vehicle = await loop.create_datagram_endpoint(
        lambda: PlainVehicle(port), local_addr=("127.0.0.1", 0)
    )
    telling = asyncio.create_task(vehicle.tell())
    url = f"udpin://127.0.0.1:{port}"
    chosen = Autopilot(url=url, system_id=SYSTEM, record_link=False, **settings)
    try:
        async with AutopilotLink(chosen, MonotonicClock()) as link:
            async with asyncio.timeout(15.0):
                while link.vehicle() is None:  # noqa: ASYNC110 (the vehicle has no event)
                    await asyncio.sleep(0.05)
            yield link, vehicle
    finally:
        telling.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await telling
        vehicle._transport.close()


async def test_a_vehicle_that_tells_next_to_nothing_is_understood_and_taken_off():
    async with linked(strict=False) as (link, vehicle):
        reading = link.vehicle()
        assert reading.position_w == pytest.approx((2.0, 1.0, 3.0))
        assert reading.yaw_rad == pytest.approx(math.pi / 2 - 0.5)
        assert (reading.armed, reading.in_air, reading.healthy) == (True, True, True)
        assert reading.home_w is None
        await link.act("takeoff", 12.0)
        take_off = [message for message in vehicle.commands if message.command == 22]
        assert math.isnan(take_off[-1].param7)  # it takes its own height


async def test_a_drone_without_an_altitude_is_not_taken_off():
    async with linked() as (link, _):
        with pytest.raises(Refused, match="altitude"):
            await link.act("takeoff", 12.0)


async def test_an_end_that_follows_its_progress_at_once_is_heard():
    async with linked() as (link, vehicle):
        vehicle.results = (5, 5, 0)
        begun_s = time.monotonic()
        await link.wire.command("photo", 2000, (0.0,))
        await link.wire.command("photo", 2000, (0.0,))
        assert time.monotonic() - begun_s < 3.0  # one acknowledgement in two is lost, no more
        vehicle.results = (5, 4)
        with pytest.raises(Refused, match="failed"):
            await link.wire.command("photo", 2000, (0.0,))


async def test_equal_commands_at_once_are_each_acknowledged():
    async with linked() as (link, vehicle):
        vehicle.loses = False
        await asyncio.gather(*(link.wire.command("stream", 511, (float(k),)) for k in range(4)))
        asked = [message.param1 for message in vehicle.commands if message.command == 511]
        assert set(range(4)) <= set(asked)


async def test_a_parameter_that_nobody_answers_for_leaves_no_complaint_behind(caplog):
    async with linked() as (link, _):
        reading = asyncio.create_task(link.read_parameters(("COM_OF_LOSS_T",)))
        await asyncio.sleep(0.3)
        reading.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await reading
    gc.collect()
    await asyncio.sleep(0)
    assert "never retrieved" not in caplog.text


async def test_our_commands_come_from_a_component_of_the_vehicles_own_system():
    async with linked() as (link, vehicle):
        await link.wire.command("photo", 2000, (0.0,))
        sender = vehicle.commands[-1]
        assert (sender.get_srcSystem(), sender.get_srcComponent()) == (SYSTEM, 191)
