"""Gimbals as others build them: behind the autopilot, and reporting in their own frames."""

import asyncio
import contextlib
import json
import math

import pytest

from config.sensors import Gimbal
from drivers.autopilot_errors import Refused
from drivers.autopilot_wire import Received
from drivers.clock import MonotonicClock
from drivers.payload_gimbal import GimbalLink
from perception.geometry import quaternion_from_euler

AUTOPILOT, GIMBAL = 1, 154
YAW_LOCK, IN_VEHICLE_FRAME, IN_EARTH_FRAME = 16, 32, 64


class Wire:
    """Keeps what is sent, and lets a test say what is heard."""

    system_id = 1

    def __init__(self, refused=()):
        self.listeners = {}
        self.refused = refused
        self.commands = []
        self.sent = []

    def listen(self, name, listener, component_id=None):
        self.listeners[name] = (listener, component_id)

    def hear(self, name, component, **fields):
        listener, wanted = self.listeners[name]
        if wanted in (None, component):
            listener(Received(name, component, fields, 10**9))

    async def command(self, _what, command, parameters, component_id=1, **_):
        self.commands.append((command, parameters[0], component_id))
        if command in self.refused:
            raise Refused("no")

    def send(self, name, fields, component_id=1):
        self.sent.append((name, json.loads(fields), component_id))


def gimbal(wire, vehicle_yaw_rad=0.0):
    return GimbalLink(wire, Gimbal(), MonotonicClock(), lambda: vehicle_yaw_rad)


def attitude(wire, component, heading_deg, pitch_deg, flags, **more):
    q = list(quaternion_from_euler(0.0, math.radians(pitch_deg), math.radians(heading_deg)))
    wire.hear(
        "GIMBAL_DEVICE_ATTITUDE_STATUS", component, q=q, flags=flags, time_boot_ms=1000, **more
    )


@pytest.mark.parametrize(
    ("flags", "heading_deg"),
    [
        (IN_EARTH_FRAME, 120.0),
        (IN_EARTH_FRAME | YAW_LOCK, 120.0),
        (YAW_LOCK, 120.0),  # before the frames had flags of their own
        (IN_VEHICLE_FRAME, 30.0),
        (IN_VEHICLE_FRAME | YAW_LOCK, 30.0),
        (0, 30.0),
    ],
)
async def test_the_yaw_is_absolute_in_whichever_frame_it_is_told(flags, heading_deg):
    wire = Wire()
    link = gimbal(wire, vehicle_yaw_rad=math.pi / 2 - math.radians(90.0))  # the nose east
    attitude(wire, GIMBAL, heading_deg, -35.0, flags)
    reading = link.reading()
    assert reading.yaw_rad == pytest.approx(math.radians(90.0 - 120.0))
    assert reading.pitch_rad == pytest.approx(math.radians(-35.0))


async def test_a_gimbal_without_mavlink_is_told_of_by_the_autopilot():
    wire = Wire()
    link = gimbal(wire)
    attitude(wire, AUTOPILOT, 10.0, 0.0, IN_EARTH_FRAME, gimbal_device_id=1)
    assert link.reading() is None  # nobody has said yet that there is one
    wire.hear("GIMBAL_MANAGER_INFORMATION", AUTOPILOT, gimbal_device_id=1)
    attitude(wire, AUTOPILOT, 10.0, 0.0, IN_EARTH_FRAME, gimbal_device_id=2)
    assert link.reading() is None  # another one
    attitude(wire, AUTOPILOT, 10.0, 0.0, IN_EARTH_FRAME, gimbal_device_id=1)
    assert link.reading().yaw_rad == pytest.approx(math.radians(80.0))
    assert link.aim(0.0, 0.0)
    name, fields, component = wire.sent[-1]
    assert (name, component) == ("GIMBAL_MANAGER_SET_PITCHYAW", AUTOPILOT)
    assert fields["gimbal_device_id"] == 1


@pytest.mark.parametrize("last", [AUTOPILOT, GIMBAL])
async def test_the_configured_gimbal_is_aimed_whichever_answers_last(last):
    wire = Wire()
    link = gimbal(wire)
    for component in (GIMBAL, AUTOPILOT) if last == AUTOPILOT else (AUTOPILOT, GIMBAL):
        device = GIMBAL if component == GIMBAL else 1
        wire.hear("GIMBAL_MANAGER_INFORMATION", component, gimbal_device_id=device)
    link.aim(0.0, 0.0)
    assert wire.sent[-1][2] == GIMBAL
    assert wire.sent[-1][1]["gimbal_device_id"] == GIMBAL


async def test_a_gimbal_that_gives_nobody_control_is_still_asked_where_it_looks():
    wire = Wire(refused=(1001,))
    link = gimbal(wire)
    wire.hear("GIMBAL_MANAGER_INFORMATION", GIMBAL, gimbal_device_id=GIMBAL)
    running = asyncio.create_task(link.run())
    await asyncio.sleep(0.05)
    running.cancel()
    with contextlib.suppress(asyncio.CancelledError):
        await running
    assert (511, 285.0, GIMBAL) in wire.commands
