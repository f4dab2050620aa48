import dataclasses

import pytest

from config.presets import load_turbine
from config.settings import Settings
from drivers.autopilot_state import VehicleMode, VehicleReading
from mission.processes.preflight import preflight_items

BARE = VehicleReading(
    stamp_s=1.0,
    position_w=(0.0, 0.0, 0.0),
    velocity_w=(0.0, 0.0, 0.0),
    quaternion_wb=(1.0, 0.0, 0.0, 0.0),
    yaw_rad=0.0,
    mode=VehicleMode.HOLD,
    mode_stamp_s=1.0,
    armed=False,
    in_air=False,
    landed=True,
    heartbeat_stamp_s=1.0,
    healthy=True,
    rc_link=False,
)
"""Nothing but what a plain simulator sends."""
SENSORS = {"lidar", "camera", "perception", "recorder", "disk"}


def failed(tmp_path, vehicle, *, strict, parameters=()):
    settings = Settings.model_validate({"autopilot": {"strict": strict}})
    items = preflight_items(
        settings, load_turbine("v27"), vehicle, dict(parameters), None, set(), tmp_path
    )
    return {item.name for item in items if not item.passed} - SENSORS


def test_a_drone_must_tell_of_everything_that_its_safety_needs(tmp_path):
    assert failed(tmp_path, BARE, strict=True) == {
        "battery",
        "gps",
        "home",
        "rc",
        "COM_OBL_RC_ACT",
        "COM_OF_LOSS_T",
        "RTL_RETURN_ALT",
    }


def test_a_simulator_need_not_tell_of_what_it_does_not_simulate(tmp_path):
    assert failed(tmp_path, BARE, strict=False) == set()


@pytest.mark.parametrize(
    ("wrong", "named"),
    [({"battery": 0.2}, "battery"), ({"gps_fix": 1}, "gps"), ({"healthy": False}, "vehicle")],
)
def test_what_a_simulator_does_tell_must_be_right(tmp_path, wrong, named):
    vehicle = dataclasses.replace(BARE, **wrong)
    assert failed(tmp_path, vehicle, strict=False) == {named}


def test_a_parameter_of_a_simulator_that_is_wrong_is_refused(tmp_path):
    told = [("COM_OBL_RC_ACT", 0.0)]
    assert failed(tmp_path, BARE, strict=False, parameters=told) == {"COM_OBL_RC_ACT"}
