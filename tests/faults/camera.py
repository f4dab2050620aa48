"""Cases 34 to 39: camera, gimbal, exposure."""

from __future__ import annotations

import dataclasses
import itertools

from tests.faults.fault import Fault
from tests.faults.rehearsal import rehearse, seen, told


def ev_never_taken():
    """The camera stays at its EV whatever it is told; metering asks for two stops more."""
    asked = []

    def change(flight, observation, t_s):
        if flight._previous is not None and flight._previous.command.ev is not None:
            asked.append(flight.now_s)
        camera = dataclasses.replace(observation.camera, ev=0.0)
        exposure = dataclasses.replace(observation.exposure, ev_wanted=2.0, in_range=False)
        return dataclasses.replace(observation, camera=camera, exposure=exposure)

    result, _, flown = rehearse(change, "pass")
    spaced = min(b - a for a, b in itertools.pairwise(asked))
    assert spaced >= 1.9
    marked = sum("exposure" in photo.marks for photo in flown.photos)
    assert marked
    words = f"asked again every {spaced:.1f} s at the soonest; {marked} photos taken and marked"
    return dataclasses.replace(result, reacted_s=None, figure=words)


def gimbal_silent():
    def change(flight, observation, t_s):
        return dataclasses.replace(observation, gimbal=None)

    result, _, flown = rehearse(change, "gimbal_silent")
    marked = sum("aim" in photo.marks for photo in flown.photos)
    assert marked == len(flown.photos) > 0
    words = f"{marked} photos, each after 3 s and marked"
    return dataclasses.replace(result, reacted_s=None, figure=words)


def gimbal_ten_degrees_behind():
    behind = told("gimbal", yaw_rad=lambda flight, _: flight._gimbal[0] + 0.175)
    result, _, flown = rehearse(behind, "gimbal_silent pass")
    assert all("aim" in photo.marks for photo in flown.photos)
    words = f"{len(flown.photos)} photos, each after 3 s and marked"
    return dataclasses.replace(result, reacted_s=None, figure=words)


def camera_away_for_5_s():
    return seen(told("camera", online=False), "camera_offline", for_s=5.0)


def camera_away_for_good():
    return seen(told("camera", online=False), "camera_lost")


_PAYLOAD = "tests/drivers/test_payload.py::"
_FRAMES = "tests/perception/test_frame_check.py::"
_METERING = "tests/perception/test_metering.py::"
_EXPOSURE = "tests/perception/test_exposure.py::"

ROWS = (
    Fault(34, "the camera never takes the EV", ev_never_taken, "", None,
          "completed ended_safely"),
    Fault(34, "the camera rejects EV",
          _PAYLOAD + "test_a_camera_that_rejects_ev_is_asked_again_and_photos_go_on"),
    Fault(34, "the camera clamps EV", _PAYLOAD + "test_a_camera_that_clamps_shows_its_limit"),
    Fault(34, "no wind-up",
          _EXPOSURE + "test_a_camera_that_cannot_go_on_causes_no_wind_up"),
    Fault(35, "a photo that shows nothing",
          "tests/mission/records/test_photos.py"
          "::test_a_photo_that_shows_nothing_is_rejected_with_the_reason"),
    Fault(35, "a frozen stream",
          _FRAMES + "test_a_frozen_stream_is_not_used_and_one_that_moves_again_is"),
    Fault(35, "a black or white picture",
          _FRAMES + "test_a_blank_picture_is_not_used_until_it_stays"),
    Fault(35, "a frame 2 s late", _FRAMES + "test_a_frame_two_seconds_late_is_not_used"),
    Fault(35, "a picture of another size", _FRAMES + "test_another_size_is_no_crash"),
    Fault(36, "the target lies off the picture or behind the camera",
          _METERING + "test_a_point_outside_or_behind_is_not_metered"),
    Fault(36, "the disc is partly outside",
          _METERING + "test_the_disc_is_all_pixels_within_the_radius_and_the_picture"),
    Fault(37, "a step of light",
          _EXPOSURE + "test_after_a_step_of_light_the_blade_is_soon_in_range_and_stays"),
    Fault(38, "the gimbal does not answer", gimbal_silent, "gimbal_silent", None,
          "completed ended_safely"),
    Fault(38, "the gimbal is 10 deg behind", gimbal_ten_degrees_behind, "", None,
          "completed ended_safely"),
    Fault(39, "the camera is unplugged for 5 s", camera_away_for_5_s, "camera_offline", 0.5,
          "completed"),
    Fault(39, "the camera is unplugged for good", camera_away_for_good, "camera_lost", 10.1,
          "ended_safely"),
)  # fmt: skip
