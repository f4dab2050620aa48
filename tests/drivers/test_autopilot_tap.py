import asyncio
import time
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import common as mavlink

from drivers.autopilot import AutopilotLink
from drivers.autopilot_tap import TAP_FILE, TapListener, frames

Start = Callable[..., Awaitable[Any]]


def names(data: list[bytes]) -> dict[str, set[int]]:
    """Return the message names and by which components they were sent."""
    parser = mavlink.MAVLink(None)
    found: dict[str, set[int]] = {}
    for datagram in data:
        for frame in frames(datagram):
            for message in parser.parse_buffer(frame) or []:
                found.setdefault(message.get_type(), set()).add(message.get_srcComponent())
    return found


async def test_the_link_is_heard_in_both_directions_and_the_vehicle_hears_no_listener(
    fly_vehicle: Start, tmp_path: Path
) -> None:
    vehicle = await fly_vehicle(shared_link=True)
    heard: list[bytes] = []
    tap = tmp_path / TAP_FILE
    listener = TapListener(tap, vehicle.settings.autopilot.system_id, heard.append)
    # It is there before the link is, and again after the link was lost.
    listener.want(True)
    listening = asyncio.create_task(listener.run())
    try:
        for _ in range(2):
            heard.clear()
            async with AutopilotLink(vehicle.settings.autopilot, vehicle.clock, tap) as link:
                async with asyncio.timeout(10.0):
                    while "SET_POSITION_TARGET_LOCAL_NED" not in names(heard):
                        link.send_setpoint((0.0, 0.0, 1.0), (0.0, 0.0, 0.0), 0.0)
                        await asyncio.sleep(0.05)
                    await asyncio.sleep(0.3)
                said = names(heard)
                assert 1 in said["HEARTBEAT"]
                assert {"ATTITUDE", "LOCAL_POSITION_NED"} <= set(said)
                assert said["SET_POSITION_TARGET_LOCAL_NED"] == {191}
                assert 155 not in said["HEARTBEAT"]
    finally:
        listening.cancel()
        await asyncio.gather(listening, return_exceptions=True)


async def test_who_does_not_want_the_link_recorded_has_no_tap(
    fly_vehicle: Start, tmp_path: Path
) -> None:
    vehicle = await fly_vehicle(shared_link=True)
    quiet = vehicle.settings.autopilot.model_copy(update={"record_link": False})
    async with AutopilotLink(quiet, vehicle.clock, tmp_path / TAP_FILE):
        pass
    assert not (tmp_path / TAP_FILE).exists()


async def test_a_tap_that_cannot_be_told_costs_the_record_and_not_the_link(
    fly_vehicle: Start, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    vehicle = await fly_vehicle(shared_link=True)
    nowhere = tmp_path / "no such folder" / TAP_FILE
    async with AutopilotLink(vehicle.settings.autopilot, vehicle.clock, nowhere) as link:
        async with asyncio.timeout(10.0):
            while not link.connected:  # noqa: ASYNC110 (the world has no event to wait on)
                await asyncio.sleep(0.01)
    assert "will not be recorded" in caplog.text


async def test_a_setpoint_leaves_as_soon_while_the_link_is_heard(
    fly_vehicle: Start, tmp_path: Path
) -> None:
    vehicle = await fly_vehicle(shared_link=True)
    tap = tmp_path / TAP_FILE
    heard: list[bytes] = []
    took_s: list[float] = []
    async with AutopilotLink(vehicle.settings.autopilot, vehicle.clock, tap) as link:
        listener = TapListener(tap, 1, heard.append)
        listening = asyncio.create_task(listener.run())
        try:
            await asyncio.sleep(0.2)
            assert not heard
            listener.want(True)
            await asyncio.sleep(0.2)
            for _ in range(40):
                begun_s = time.perf_counter()
                link.send_setpoint((0.0, 0.0, 1.0), (0.0, 0.0, 0.0), 0.0)
                took_s.append(time.perf_counter() - begun_s)
                await asyncio.sleep(0.01)
            listener.want(False)
            await asyncio.sleep(0.05)
            before = len(heard)
            await asyncio.sleep(0.2)
            assert len(heard) == before
        finally:
            listening.cancel()
            await asyncio.gather(listening, return_exceptions=True)
    assert "SET_POSITION_TARGET_LOCAL_NED" in names(heard)
    assert sorted(took_s)[20] < 0.003


def test_a_datagram_is_cut_into_its_frames_and_what_is_none_is_left_out() -> None:
    one = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    beat = bytes(one.heartbeat_encode(2, 12, 81, 0, 4).pack(one))
    one.signing.sign_outgoing, one.signing.secret_key = True, b"0" * 32
    signed = bytes(one.heartbeat_encode(2, 12, 81, 0, 4).pack(one))
    old = bytes(one.heartbeat_encode(2, 12, 81, 0, 4).pack(one, force_mavlink1=True))
    assert len(signed) == len(beat) + 13
    assert frames(beat + b"\x00\x01" + signed + old + beat[:9]) == [beat, signed, old]
    assert frames(b"") == frames(b"\xfd") == frames(b"\xfd\xff\x00") == []
