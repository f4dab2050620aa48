"""What is told of a photo is what was so when its shutter opened."""

import pytest

from config.settings import Settings
from drivers.bus import Key
from drivers.clock import MonotonicClock
from drivers.payload_camera import PhotoTaken
from mission.flight.command import PhotoCommand
from mission.flight.observation import CameraState, FlightMode, Observation, Vehicle
from mission.processes.flight_outputs import FlightOutputs
from mission.processes.flight_pace import Pace
from mission.processes.runtime import Runtime
from mission.remote.messages import PhotoTakenMessage
from tests.mission.processes.test_flight_resume import HandBus


def observed(now_s, ev, confirmed_s):
    place = (0.0, 0.0, 50.0)
    vehicle = Vehicle(
        stamp_s=now_s, position_w=place, velocity_w=(0.0, 0.0, 0.0),
        quaternion_wb=(1.0, 0.0, 0.0, 0.0), yaw_rad=0.0, mode=FlightMode.OFFBOARD,
        mode_stamp_s=now_s, armed=True, in_air=True, landed=False, heartbeat_stamp_s=now_s,
    )  # fmt: skip
    camera = CameraState(now_s, ev, confirmed_s, shutter_s=1 / 2000)
    return Observation(now_s, round(20 * now_s), vehicle, camera=camera)


@pytest.mark.parametrize(("opened_s", "ev"), [(10.2, 0.0), (10.4, -0.7)])
def test_a_photo_has_the_exposure_that_was_in_force_not_the_newest(tmp_path, opened_s, ev):
    bus = HandBus()
    outputs = FlightOutputs(bus, Runtime(Settings(), MonotonicClock(), tmp_path), Pace())
    told = [observed(10.0, 0.0, 9.0), observed(10.5, -0.7, 10.3), observed(11.0, 1.0, 10.9)]
    for one in told:
        outputs.vehicle(one)
    photo = PhotoTaken(7, "http://camera/7.jpg", opened_s, 7)
    outputs.photo(photo, PhotoCommand(7, "A", "PS", 12.0, 12.0), told[-1])
    (message,) = [payload for key, payload in bus.said if key == Key.PHOTO]
    assert PhotoTakenMessage.model_validate_json(message).ev == ev
