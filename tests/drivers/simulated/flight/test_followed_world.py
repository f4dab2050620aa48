import asyncio
import contextlib
import socket

import pytest

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
        await asyncio.sleep(1.5)
        behind = []
        for _ in range(20):
            await asyncio.sleep(0.05)
            behind.append(other.now_s - clock.now_s())
        # Load moves both; on the whole the followed clock keeps to the other's.
        assert abs(sorted(behind)[10]) < 0.25
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
    assert clock.now_s() == pytest.approx(50.0, abs=0.1)
    follow.watch()
    assert clock.factor() == 0.0
