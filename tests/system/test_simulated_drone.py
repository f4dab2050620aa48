"""The fixture that others fly missions with: a mission that an outside client aborts."""

import pytest

from mission.remote.client import Client, bus_settings

pytest_plugins = ["bladescout.testing"]
pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]


def test_a_mission_is_started_watched_and_aborted_by_code_from_outside(simulated_drone):
    with simulated_drone("quick", "simulation.speed=2", seed=3) as drone:
        folder = drone.start()
        assert drone.wait_until(lambda state: state.progress.phase == "ascend", within_s=240)
        with Client(drone.vehicle, bus_settings(drone.router)) as outside:
            assert outside.abort().ok
        mission = drone.finish(within_s=300)
        names = [event.name for event in drone.events]
    assert mission["state"] == "ended_safely"
    assert mission["truth"]["vehicle"]["landed"]
    assert (folder / "report.html").is_file()
    assert "request" in names
