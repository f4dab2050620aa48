import dataclasses

import pytest

from drivers.autopilot_rates import REST_HZ
from drivers.autopilot_state import VehicleMode, VehicleReading
from mission.processes.preflight_telemetry import telemetry_item

READING = VehicleReading(
    stamp_s=1.0, position_w=(0.0, 0.0, 0.0), velocity_w=(0.0, 0.0, 0.0),
    quaternion_wb=(1.0, 0.0, 0.0, 0.0), yaw_rad=0.0, mode=VehicleMode.HOLD, mode_stamp_s=1.0,
    armed=False, in_air=False, landed=True, heartbeat_stamp_s=1.0,
)  # fmt: skip


@pytest.mark.parametrize(
    ("hz", "awake", "passed"),
    [(50.0, True, True), (50.0, False, False), (REST_HZ, True, False), (None, True, False)],
)
def test_nothing_takes_off_on_the_telemetry_of_a_rest(hz, awake, passed):
    reading = dataclasses.replace(READING, position_hz=hz)
    assert telemetry_item(reading, awake=awake).passed is passed


def test_without_a_vehicle_there_is_no_telemetry():
    assert not telemetry_item(None, awake=True).passed
