import asyncio
import contextlib
import socket
import time

import pytest
from pymavlink.dialects.v20 import common as mavlink

from config.presets import load_turbine
from config.settings import Settings
from drivers.clock import SharedClockWriter
from drivers.free_port import free_port
from drivers.simulated.followed_clock import FollowedClock
from drivers.simulated.followed_world import FollowedWorld
from drivers.simulated.link import TruthState
from drivers.simulated.scene import Scene
from drivers.simulated.world import World


def scene_at(launch_w):
    return Scene(
        turbine=load_turbine("v90-2.0"),
        stop_angle_deg=10.0,
        nacelle_yaw_deg=180.0,
        tilt_deg=5.0,
        cone_deg=3.0,
        pitch_deg=(0.0, 0.0, 0.0),
        launch_w=launch_w,
        wind_mean_mps=4.0,
        wind_from_deg=180.0,
        prior_error_m=(0.0, 0.0, 0.0),
    )


def settings_for(url, **simulation):
    return Settings.model_validate(
        {
            "autopilot": {
                "url": url,
                "payload_url": f"udpin://127.0.0.1:{free_port(socket.SOCK_DGRAM)}",
                "connect_timeout_s": 3.0,
            },
            "simulation": simulation,
        }
    )


async def test_the_turbine_stands_relative_to_the_home_of_another_simulator(tmp_path):
    outside = f"udpin://127.0.0.1:{free_port(socket.SOCK_DGRAM)}"
    mission = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    mission.bind(("127.0.0.1", 0))
    mission.setblocking(False)
    inside = f"udpin://127.0.0.1:{mission.getsockname()[1]}"
    truth = []
    clock = SharedClockWriter(tmp_path / "clock", 0.0)
    followed = FollowedWorld(
        settings_for(inside, autopilot_url=outside),
        scene_at((0.0, -70.0, 1.5)),
        clock,
        truth.append,
    )
    # The mock plays the other simulator, three times as fast as real time.
    other_clock = SharedClockWriter(tmp_path / "other", 3.0, start_s=100.0)
    other = World(settings_for(outside), scene_at((80.0, 0.0, 0.0)), other_clock, lambda _: None)
    tasks = [asyncio.create_task(other.run())]
    try:
        await followed.start()
        tasks.append(asyncio.create_task(followed.run()))
        await asyncio.sleep(1.0)
        apart = []
        for _ in range(40):
            await asyncio.sleep(0.05)
            apart.append(other.now_s - clock.now_s())
        # Load moves both; on the whole the followed clock keeps to the other's.
        assert sorted(apart[20:])[10] == pytest.approx(sorted(apart[:20])[10], abs=0.3)
        newest = [message for message in truth if isinstance(message, TruthState)][-1]
        assert newest.position_w == pytest.approx((0.0, -70.0, 1.5), abs=0.5)
        assert followed.home.latitude_deg == pytest.approx(54.0138)
        assert mission.recv(2048)[0] == 0xFD
        facts = followed.facts()
        assert facts.battery_left is None
        assert not facts.took_off
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        followed.close()
        with contextlib.suppress(OSError):
            other.close()
        mission.close()


async def test_a_simulator_that_does_not_answer_is_one_clear_sentence(tmp_path):
    url = f"udpin://127.0.0.1:{free_port(socket.SOCK_DGRAM)}"
    settings = settings_for(f"udpin://127.0.0.1:{free_port(socket.SOCK_DGRAM)}", autopilot_url=url)
    quick = settings.model_copy(
        update={"autopilot": settings.autopilot.model_copy(update={"connect_timeout_s": 0.2})}
    )
    clock = SharedClockWriter(tmp_path / "clock", 0.0)
    followed = FollowedWorld(quick, scene_at((0.0, -70.0, 0.0)), clock, lambda _: None)
    try:
        with pytest.raises(TimeoutError, match=r"no heartbeat from udpin://127.0.0.1"):
            await followed.start()
    finally:
        followed.close()


async def test_a_relay_onto_itself_is_refused(tmp_path):
    url = f"udpin://127.0.0.1:{free_port(socket.SOCK_DGRAM)}"
    clock = SharedClockWriter(tmp_path / "clock", 0.0)
    with pytest.raises(ConnectionError, match="relays between the two"):
        FollowedWorld(
            settings_for(url, autopilot_url=url), scene_at((0, 0, 0)), clock, lambda _: None
        )


def test_the_clock_stands_while_the_other_simulator_is_silent(tmp_path):
    clock = SharedClockWriter(tmp_path / "clock", 0.0)
    follow = FollowedClock(clock)
    follow.take(50.0, monotonic_s=0.0)
    follow.watch()
    assert clock.factor() == 0.0


def test_world_time_counts_from_the_start_however_long_the_other_simulator_has_run(tmp_path):
    clock = SharedClockWriter(tmp_path / "clock", 0.0)
    follow = FollowedClock(clock)
    for step in range(30):
        follow.take(86_400.0 + 0.1 * step, monotonic_s=0.1 * step)
    assert 0.0 <= clock.now_s() < 10.0
    assert follow.world_s(86_402.0) == pytest.approx(2.0, abs=0.1)


def test_a_reboot_of_the_other_simulator_does_not_turn_world_time_back(tmp_path):
    clock = SharedClockWriter(tmp_path / "clock", 0.0, start_s=40.0)
    follow = FollowedClock(clock)
    follow.take(500.0, monotonic_s=0.0)
    follow.take(3.0, monotonic_s=20.0)
    assert clock.now_s() >= 40.0
    assert follow.world_s(4.0) == pytest.approx(41.0, abs=0.2)


def test_world_time_leaps_with_the_other_simulator_where_nothing_was_heard_for_a_while(tmp_path):
    clock = SharedClockWriter(tmp_path / "clock", 0.0)
    follow = FollowedClock(clock)
    follow.take(500.0, monotonic_s=0.0)
    follow.take(503.0, monotonic_s=3.0)
    assert clock.now_s() == pytest.approx(3.0, abs=0.2)


async def speak(port, messages, period_s=0.05, system=1):
    """Send messages of an autopilot by other hands, again and again."""
    packer = mavlink.MAVLink(None, srcSystem=system, srcComponent=1)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        while True:
            boot_ms = int(time.monotonic() * 1e3) & 0xFFFFFFF
            for message in messages(boot_ms):
                sender.sendto(message.pack(packer), ("127.0.0.1", port))
            await asyncio.sleep(period_s)


def bare(boot_ms):
    return [
        mavlink.MAVLink_heartbeat_message(2, 12, 0x01, 4 << 16 | 3 << 24, 3, 3),
        mavlink.MAVLink_attitude_message(boot_ms, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        mavlink.MAVLink_local_position_ned_message(boot_ms, 40.0, -20.0, -3.0, 0.0, 0.0, 0.0),
    ]


def at_its_home(boot_ms):
    home = (474000000, 85000000, 500_000, 40.0, -20.0, -3.0, [1, 0, 0, 0], 0.0, 0.0, 0.0)
    return [*bare(boot_ms), mavlink.MAVLink_home_position_message(*home)]


async def followed(tmp_path, messages, **options):
    port, truth = free_port(socket.SOCK_DGRAM), []
    inside = f"udpin://127.0.0.1:{free_port(socket.SOCK_DGRAM)}"
    world = FollowedWorld(
        settings_for(inside, autopilot_url=f"udp://127.0.0.1:{port}"),
        scene_at((5.0, -70.0, 1.5)),
        SharedClockWriter(tmp_path / "clock", 0.0),
        truth.append,
    )
    speaking = asyncio.create_task(speak(port, messages, **options))
    running = None
    try:
        await world.start()
        running = asyncio.create_task(world.run())
        await asyncio.sleep(0.5)
    finally:
        for task in filter(None, (speaking, running)):
            task.cancel()
        await asyncio.gather(*filter(None, (speaking, running)), return_exceptions=True)
        world.close()
    return world, [message for message in truth if isinstance(message, TruthState)]


async def test_the_origin_of_the_vehicles_frame_need_not_be_its_home(tmp_path):
    world, truth = await followed(tmp_path, at_its_home)
    assert truth[-1].position_w == pytest.approx((5.0, -70.0, 1.5))
    assert world.home.altitude_m == pytest.approx(500.0)


async def test_a_vehicle_that_tells_no_home_is_taken_to_stand_there(tmp_path, monkeypatch):
    monkeypatch.setattr("drivers.simulated.followed_world._NO_HOME_S", 0.3)
    _, truth = await followed(tmp_path, bare)
    assert truth[-1].position_w == pytest.approx((5.0, -70.0, 1.5))


async def test_the_clock_follows_any_stream_of_a_vehicle_that_tells_its_place_seldom(tmp_path):
    def seldom(boot_ms):
        return [m for m in at_its_home(boot_ms) if boot_ms % 1000 < 60 or "ATT" in m.get_type()]

    world, _ = await followed(tmp_path, seldom)
    assert world.now_s > 0.0


async def test_a_vehicle_that_does_not_tell_whether_it_landed_flies_where_it_is_high(tmp_path):
    def high(boot_ms):
        beat, angles, _ = bare(boot_ms)
        beat.base_mode = 0x81
        place = mavlink.MAVLink_local_position_ned_message(boot_ms, 40.0, -20.0, -8.0, 0, 0, 0)
        return [beat, angles, place, at_its_home(boot_ms)[-1]]

    world, _ = await followed(tmp_path, high)
    assert world.airborne
    assert world.facts().took_off


async def test_a_vehicle_with_another_system_id_is_named(tmp_path):
    with pytest.raises(TimeoutError, match=r"heard system id 42: set autopilot\.system_id"):
        await followed(tmp_path, at_its_home, system=42)


async def test_a_port_that_another_program_has_is_one_clear_sentence(tmp_path):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        url = f"udpin://127.0.0.1:{other.getsockname()[1]}"
        inside = f"udpin://127.0.0.1:{free_port(socket.SOCK_DGRAM)}"
        clock = SharedClockWriter(tmp_path / "clock", 0.0)
        with pytest.raises(ConnectionError, match="in use"):
            FollowedWorld(
                settings_for(inside, autopilot_url=url), scene_at((0, 0, 0)), clock, print
            )
