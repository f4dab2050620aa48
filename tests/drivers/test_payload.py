import asyncio
from collections.abc import Awaitable, Callable
from typing import Any

import pytest

from drivers.autopilot import AutopilotLink
from drivers.clock import sleep
from drivers.payload import Payload, PhotoTaken

Start = Callable[..., Awaitable[Any]]


async def until(condition: Callable[[], bool], timeout_s: float = 15.0) -> None:
    async with asyncio.timeout(timeout_s):
        while not condition():  # noqa: ASYNC110 (the world has no event to wait on)
            await asyncio.sleep(0.01)


class Photos:
    def __init__(self) -> None:
        self.taken: list[PhotoTaken] = []
        self.failed: list[tuple[int, str]] = []

    def take(self, photo: PhotoTaken) -> None:
        self.taken.append(photo)

    def fail(self, photo_id: int, reason: str) -> None:
        self.failed.append((photo_id, reason))


@pytest.mark.parametrize("shared_link", [False, True])
async def test_the_gimbal_turns_to_absolute_angles(fly_vehicle: Start, shared_link: bool) -> None:
    vehicle, photos = await fly_vehicle(shared_link=shared_link), Photos()
    async with (
        AutopilotLink(vehicle.settings.autopilot, vehicle.clock) as link,
        Payload(link, vehicle.settings, vehicle.clock, photos.take, photos.fail) as payload,
    ):
        await until(lambda: (g := payload.gimbal()) is not None and g.in_control)
        await until(lambda: link.vehicle() is not None)
        reading = link.vehicle()
        assert reading is not None
        yaw_rad = reading.yaw_rad + 0.5
        for _ in range(30):
            assert payload.aim(yaw_rad, -0.4)
            await sleep(vehicle.clock, 0.1)
        gimbal = payload.gimbal()
        assert gimbal is not None
        assert gimbal.yaw_rad == pytest.approx(yaw_rad, abs=0.03)
        assert gimbal.pitch_rad == pytest.approx(-0.4, abs=0.02)
        assert vehicle.clock.now_s() - gimbal.stamp_s < 0.5


async def test_at_rest_the_gimbal_tells_seldom_where_it_looks_and_then_often_again(
    fly_vehicle: Start,
) -> None:
    vehicle, photos = await fly_vehicle(), Photos()
    async with (
        AutopilotLink(vehicle.settings.autopilot, vehicle.clock) as link,
        Payload(link, vehicle.settings, vehicle.clock, photos.take, photos.fail) as payload,
    ):
        await until(lambda: (g := payload.gimbal()) is not None and g.in_control)

        async def stamps(mission_s: float) -> int:
            seen = set()
            end_s = vehicle.clock.now_s() + mission_s
            while vehicle.clock.now_s() < end_s:
                gimbal = payload.gimbal()
                assert gimbal is not None
                seen.add(gimbal.stamp_s)
                await asyncio.sleep(0.005)
            return len(seen)

        payload.rest(True)
        async with asyncio.timeout(20.0):
            while await stamps(2.0) > 6:
                pass
        payload.rest(False)
        async with asyncio.timeout(20.0):
            while await stamps(2.0) < 30:
                pass


async def test_photos_are_taken_one_after_the_other_and_two_may_wait(fly_vehicle: Start) -> None:
    vehicle, photos = await fly_vehicle(), Photos()
    async with (
        AutopilotLink(vehicle.settings.autopilot, vehicle.clock) as link,
        Payload(link, vehicle.settings, vehicle.clock, photos.take, photos.fail) as payload,
    ):
        await until(lambda: (c := payload.camera()) is not None and c.online)
        asked_s = vehicle.clock.now_s()
        assert payload.take_photo(11)
        await asyncio.sleep(0.02)
        assert payload.take_photo(12)
        assert payload.take_photo(13)
        assert not payload.take_photo(14)
        await until(lambda: len(photos.taken) == 3)
        assert [photo.photo_id for photo in photos.taken] == [11, 12, 13]
        assert [photo.index for photo in photos.taken] == [0, 1, 2]
        assert photos.taken[0].file_url.endswith("/0.jpg")
        assert asked_s <= photos.taken[0].stamp_s < asked_s + 0.5
        assert [photo_id for photo_id, _ in photos.failed] == [14]
        camera = payload.camera()
        assert camera is not None
        assert (camera.photos_taken, camera.last_photo_id, camera.failed_photo_id) == (3, 13, 14)


async def test_a_lost_report_of_a_photo_is_asked_for_again(
    fly_vehicle: Start, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("drivers.payload_camera._CAPTURED_TIMEOUT_S", 0.4)
    vehicle, photos = await fly_vehicle(), Photos()
    camera = vehicle.truth.payload.camera
    send, lost = camera._send, []

    def lose_first_report(message: object) -> None:
        if message.get_type() == "CAMERA_IMAGE_CAPTURED" and not lost:
            lost.append(message)
        else:
            send(message)

    monkeypatch.setattr(camera, "_send", lose_first_report)
    async with (
        AutopilotLink(vehicle.settings.autopilot, vehicle.clock) as link,
        Payload(link, vehicle.settings, vehicle.clock, photos.take, photos.fail) as payload,
    ):
        await until(lambda: payload.camera() is not None)
        payload.take_photo(3)
        await until(lambda: bool(photos.taken) or bool(photos.failed))
        assert len(lost) == 1
        assert [photo.photo_id for photo in photos.taken] == [3]


async def test_exposure_is_manual_snapped_and_reported_as_applied(fly_vehicle: Start) -> None:
    vehicle, photos = await fly_vehicle(), Photos()
    async with (
        AutopilotLink(vehicle.settings.autopilot, vehicle.clock) as link,
        Payload(link, vehicle.settings, vehicle.clock, photos.take, photos.fail) as payload,
    ):
        await until(lambda: payload.exposure_known)
        assert payload.manual_exposure
        asked_s = vehicle.clock.now_s()
        payload.want_ev(0.75)
        await until(lambda: (c := payload.camera()) is not None and c.ev not in (None, 0.0))
        camera = payload.camera()
        assert camera is not None
        assert camera.ev == pytest.approx(2 / 3, abs=1e-3)
        assert camera.ev_stamp_s > asked_s
        assert vehicle.settings_told[-1].ev == pytest.approx(2 / 3, abs=1e-3)


async def test_a_camera_that_only_compensates_says_so(fly_vehicle: Start) -> None:
    vehicle, photos = await fly_vehicle(exposure="compensation"), Photos()
    async with (
        AutopilotLink(vehicle.settings.autopilot, vehicle.clock) as link,
        Payload(link, vehicle.settings, vehicle.clock, photos.take, photos.fail) as payload,
    ):
        await until(lambda: payload.exposure_known)
        assert not payload.manual_exposure
        camera = payload.camera()
        assert camera is not None
        assert camera.ev is not None


async def test_a_camera_that_clamps_shows_its_limit(fly_vehicle: Start) -> None:
    vehicle, photos = await fly_vehicle(), Photos()
    async with (
        AutopilotLink(vehicle.settings.autopilot, vehicle.clock) as link,
        Payload(link, vehicle.settings, vehicle.clock, photos.take, photos.fail) as payload,
    ):
        await until(lambda: payload.exposure_known)
        vehicle.truth.fault("camera", "wrong")
        payload.want_ev(3.0)
        await until(lambda: (c := payload.camera()) is not None and c.max_ev < 3.0)
        camera = payload.camera()
        assert camera is not None
        assert (camera.ev, camera.max_ev) == (pytest.approx(1.0), pytest.approx(1.0))


async def test_a_camera_that_rejects_ev_is_asked_again_and_photos_go_on(
    fly_vehicle: Start, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("drivers.payload_exposure._RETRY_S", 0.1)
    vehicle, photos = await fly_vehicle(), Photos()
    async with (
        AutopilotLink(vehicle.settings.autopilot, vehicle.clock) as link,
        Payload(link, vehicle.settings, vehicle.clock, photos.take, photos.fail) as payload,
    ):
        await until(lambda: payload.exposure_known)
        vehicle.truth.fault("camera", "stuck")
        payload.want_ev(1.0)
        payload.take_photo(1)
        await until(lambda: len(photos.taken) == 1)
        await asyncio.sleep(0.5)
        camera = payload.camera()
        assert camera is not None
        assert camera.ev == 0.0
        assert sum("exposure" in record.message for record in caplog.records) == 1
        vehicle.truth.fault("camera", "ok")
        await until(lambda: (c := payload.camera()) is not None and c.ev == pytest.approx(1.0))
