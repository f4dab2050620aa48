"""The driver against the simulated sensor, over real sockets on loopback, faults included."""

import asyncio
import socket
import threading
from contextlib import asynccontextmanager, suppress

import numpy as np
import pytest

from drivers.clock import SharedClock, SharedClockWriter
from drivers.livox.discovery import discover
from drivers.livox.driver import Mid360Driver
from drivers.livox.statistics import Dropped, Link
from drivers.simulated import mid360_pattern
from drivers.simulated.mid360 import Mid360Twin

RANGE_M = 20.0
FACTOR = 3.0


class World:
    """A twin inside a sphere, its driver, and what the driver delivered."""

    def __init__(self, settings, clock, twin, lag_s):
        self.lag_s = lag_s
        self.settings = settings
        self.clock = clock
        self.twin = twin
        self.driver = Mid360Driver(settings, clock, lambda readings: self.imu.extend(readings))
        self.scans = []
        self.ages_s = []
        self.imu = []
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._render)

    def take(self, scan):
        self.scans.append(scan)
        self.ages_s.append(self.clock.now_s() - scan.stamp_s)

    def _render(self):
        count, period_ns = 5000, 25_000_000
        t_ns = round(self.clock.now_s() * 1e9)
        while not self._stop.wait(0.002):
            while t_ns * 1e-9 < self.clock.now_s() - self.lag_s:
                directions, _ = mid360_pattern.rays(t_ns * 1e-9, count)
                self.twin.send_points(
                    t_ns,
                    directions * np.float32(RANGE_M),
                    np.full(count, 80, np.uint8),
                    np.zeros(count, np.uint8),
                    np.arange(count) % 5 == 0,
                )
                t_ns += period_ns

    async def until(self, condition, wall_s=20.0):
        """Wait until something holds; fails where it does not in time."""
        async with asyncio.timeout(wall_s):
            while not condition():  # noqa: ASYNC110 - what is waited for lives in other threads
                await asyncio.sleep(0.01)

    async def scans_after(self, count):
        start = len(self.scans)
        await self.until(lambda: len(self.scans) >= start + count)
        return self.scans[start:]

    async def scans_within(self, mission_s):
        start = len(self.scans)
        await asyncio.sleep(mission_s / FACTOR)
        return self.scans[start:]


@asynccontextmanager
async def flying(settings, tmp_path, lag_s=0.0):
    SharedClockWriter(tmp_path / "clock", FACTOR, start_s=500.0)
    clock = SharedClock(tmp_path / "clock")
    with Mid360Twin(settings, clock, spin_up_s=0.2) as twin:
        world = World(settings, clock, twin, lag_s)
        world._thread.start()
        task = asyncio.create_task(world.driver.run(world.take))
        try:
            yield world
        finally:
            task.cancel()
            with suppress(asyncio.CancelledError):
                await task
            world._stop.set()
            world._thread.join()


async def test_scans_come_whole_at_ten_hertz_with_their_points_where_they_are(loopback, tmp_path):
    async with flying(loopback, tmp_path) as world:
        await world.scans_after(3)
        scans = await world.scans_after(10)
        span_s = scans[-1].stamp_s - scans[0].stamp_s
        assert span_s == pytest.approx(0.9, abs=0.05)
        for scan in scans:
            ranges_m = np.linalg.norm(scan.points_l, axis=1)
            np.testing.assert_allclose(ranges_m, RANGE_M, atol=2e-3)
            assert len(scan.points_l) == pytest.approx(4000, rel=0.02)
            assert scan.lost_packets == 0
        assert np.median(world.ages_s) < 0.5
        statistics = world.driver.statistics
        assert statistics.link is Link.STREAMING
        assert statistics.configured == 1
        assert statistics.temperature_c == 45.0
        assert not statistics.dropped


async def test_imu_readings_come_at_200_hertz_of_mission_time(loopback, tmp_path):
    async with flying(loopback, tmp_path) as world:
        world.twin.set_motion((0.1, 0.2, 0.3), (0.0, 0.0, 1.0))
        await world.until(lambda: len(world.imu) >= 100)
        stamps_s = [reading.stamp_s for reading in world.imu[-50:]]
        assert np.median(np.diff(stamps_s)) == pytest.approx(0.005, abs=1e-4)
        assert world.imu[-1].gyro_rps == pytest.approx((0.1, 0.2, 0.3))


async def test_packets_from_another_address_are_dropped_and_counted(loopback, tmp_path):
    async with flying(loopback, tmp_path) as world:
        await world.scans_after(2)
        with socket.socket(type=socket.SOCK_DGRAM) as intruder:
            intruder.bind(("127.0.0.77", 0))
            for port in (loopback.host_point_port, loopback.host_push_port, loopback.host_imu_port):
                for _ in range(10):
                    intruder.sendto(bytes(1380), ("127.0.0.1", port))
        await world.scans_after(2)
        assert world.driver.statistics.dropped == {Dropped.SOURCE: 30}


async def test_bad_bytes_from_the_right_address_do_not_stop_it(loopback, tmp_path):
    rng = np.random.default_rng(1)
    async with flying(loopback, tmp_path) as world:
        await world.scans_after(2)
        with socket.socket(type=socket.SOCK_DGRAM) as sock:
            sock.bind(("127.0.0.1", 0))

            def flooded():
                # A busy machine loses some of them in its buffers: then more are sent.
                for port in 10 * (
                    loopback.host_point_port,
                    loopback.host_push_port,
                    loopback.host_imu_port,
                    loopback.host_command_port,
                ):
                    sock.sendto(rng.bytes(int(rng.integers(0, 2000))), ("127.0.0.1", port))
                return world.driver.statistics.dropped.get(Dropped.MALFORMED, 0) >= 1000

            await world.until(flooded)
        await world.scans_after(3)


@pytest.mark.parametrize("word", ["off", "stuck", "garbage", "wrong"])
async def test_a_sensor_that_fails_delivers_nothing_false_and_then_recovers(
    loopback, tmp_path, word
):
    async with flying(loopback, tmp_path) as world:
        await world.scans_after(3)
        world.twin.set_fault(word)
        await world.scans_within(1.0)  # what was under way
        assert await world.scans_within(1.0) == []
        assert world.twin.disturbed > 100
        world.twin.set_fault("ok")
        scans = await world.scans_after(3)
        for scan in scans:
            np.testing.assert_allclose(np.linalg.norm(scan.points_l, axis=1), RANGE_M, atol=2e-3)
        assert world.ages_s[-1] < 0.7


async def test_a_slow_sensor_delivers_four_scans_a_second(loopback, tmp_path):
    async with flying(loopback, tmp_path) as world:
        await world.scans_after(3)
        world.twin.set_fault("slow")
        await world.scans_within(1.0)
        scans = await world.scans_within(4.0)
        assert 12 <= len(scans) <= 20
        assert world.twin.disturbed > 1000


async def test_scans_that_come_late_say_so_by_their_age(loopback, tmp_path):
    async with flying(loopback, tmp_path) as world:
        await world.scans_after(10)
        world.twin.set_fault("delayed")
        await world.scans_within(1.2)
        await world.scans_after(5)
        assert min(world.ages_s[-4:]) > 0.7
        assert world.twin.disturbed > 1000


async def test_points_that_were_late_from_the_start_are_told_by_the_imu(loopback, tmp_path):
    async with flying(loopback, tmp_path, lag_s=0.4) as world:
        await world.scans_after(10)
        # The map of clocks goes by the least lag seen: a few hundredths may be missed.
        assert min(world.ages_s[-5:]) > 0.36


async def test_an_intermittent_sensor_is_silent_and_back_again(loopback, tmp_path):
    async with flying(loopback, tmp_path) as world:
        await world.scans_after(3)
        world.twin.set_fault("intermittent")
        scans = await world.scans_within(6.0)
        gaps_s = np.diff([scan.stamp_s for scan in scans])
        assert (gaps_s > 0.6).sum() >= 2


async def test_a_sensor_that_restarts_is_read_on(loopback, tmp_path):
    settings = loopback
    async with flying(settings, tmp_path) as world:
        await world.scans_after(3)
        world.twin._firmware.boots += 1  # what a reboot command does: its clock counts from zero
        await world.scans_within(1.5)
        scans = await world.scans_after(3)
        assert abs(world.clock.now_s() - scans[-1].stamp_s) < 0.7


async def test_another_serial_number_is_not_configured(loopback, tmp_path):
    settings = loopback.model_copy(update={"serial": "47MDOTHER"})
    async with flying(settings, tmp_path) as world:
        await world.until(lambda: "47MDOTHER is configured" in world.driver.statistics.warning)
        assert await world.scans_within(0.5) == []


async def test_a_port_that_is_taken_is_said_and_tried_again(loopback, tmp_path):
    with socket.socket(type=socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", loopback.host_point_port))
        async with flying(loopback, tmp_path) as world:
            await world.until(lambda: "LiDAR network" in world.driver.statistics.warning)
            other.close()
            await world.scans_after(1)
            assert "network" not in world.driver.statistics.warning


async def test_a_receive_buffer_not_granted_is_a_warning_with_its_remedy(loopback, tmp_path):
    settings = loopback.model_copy(update={"receive_buffer_bytes": 1 << 30})
    async with flying(settings, tmp_path) as world:
        await world.until(lambda: world.driver.statistics.link is not Link.CLOSED)
        await world.until(lambda: "sysctl -w net.core.rmem_max" in world.driver.statistics.warning)


def test_a_sensor_is_found_by_discovery(loopback, tmp_path):
    SharedClockWriter(tmp_path / "clock", FACTOR)
    clock = SharedClock(tmp_path / "clock")
    with socket.socket(type=socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    with Mid360Twin(loopback, clock, serial="47MDFOUND", discovery_port=port):
        target = ("127.0.0.1", port)
        found = discover("127.0.0.1", target=target)
        assert found is not None
        assert (found.serial, found.lidar_ip) == ("47MDFOUND", "127.0.0.1")
        assert found.command_port == loopback.lidar_command_port
        assert discover("127.0.0.1", "47MDOTHER", wait_s=0.1, target=target) is None


async def test_at_rest_a_scan_a_second_comes_and_none_of_the_packets_between_is_lost(
    loopback, tmp_path
):
    async with flying(loopback, tmp_path) as world:
        await world.scans_after(2)
        world.driver.rest(True)
        await world.scans_after(2)
        read, sent = world.driver.statistics.packets, world.twin.sent
        count = len(world.scans)
        scans = await world.scans_after(5)
        arrivals_s = np.add(world.ages_s, [scan.stamp_s for scan in world.scans])
        assert np.diff(arrivals_s[count:]).mean() > 0.8
        assert all(scan.lost_packets == 0 for scan in scans)
        # Most of the packets were not even looked at.
        assert world.driver.statistics.packets - read < 0.5 * (world.twin.sent - sent)
        assert world.driver.statistics.link is Link.STREAMING


async def test_after_a_rest_every_scan_comes_again(loopback, tmp_path):
    async with flying(loopback, tmp_path) as world:
        world.driver.rest(True)
        await world.scans_after(3)
        world.driver.rest(False)
        await world.scans_after(2)
        scans = await world.scans_after(10)
        assert scans[-1].stamp_s - scans[0].stamp_s == pytest.approx(0.9, abs=0.05)


async def test_a_sensor_that_reboots_during_a_rest_is_followed(loopback, tmp_path):
    async with flying(loopback, tmp_path) as world:
        world.driver.rest(True)
        await world.scans_after(2)
        world.twin._firmware.boots += 1  # as above
        await world.scans_after(3)
        assert abs(world.clock.now_s() - world.scans[-1].stamp_s) < 1.5
