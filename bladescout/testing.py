"""A pytest fixture that flies simulated missions in tests of one's own.

In ``conftest.py``: ``pytest_plugins = ["bladescout.testing"]``; then::

    def test_our_ground_station_aborts_a_mission(simulated_drone):
        with simulated_drone("quick", seed=3) as drone:
            folder = drone.start()
            drone.wait_until(lambda state: state.progress.phase == "ascend", within_s=120)
            our_ground_station(drone.router, drone.vehicle).abort()
            mission = drone.finish()
        assert mission["state"] == "ended_safely"

``drone.client`` is a connected `bladescout.Client`, ``drone.events`` what has happened so far, and
``finish`` returns mission.json, with the truth of the simulated world in it.
"""

from __future__ import annotations

from pathlib import Path
from typing import Protocol

import pytest

from config.sources import load_settings, scenario_path
from mission.processes.simulated_drone import SimulatedDrone

__all__ = ["DroneFactory", "SimulatedDrone", "simulated_drone"]


class DroneFactory(Protocol):
    """Makes a simulated drone at the turbine of a scenario."""

    def __call__(self, scenario: str = "quick", *settings: str, seed: int = 1) -> SimulatedDrone:
        """Return it, to be entered.

        ``scenario``: a packaged one or a TOML file; ``settings``: as in ``--set``.
        """
        ...


@pytest.fixture
def simulated_drone(tmp_path: Path) -> DroneFactory:
    """Make simulated drones whose missions lie below the test's own folder."""

    def make(scenario: str = "quick", *settings: str, seed: int = 1) -> SimulatedDrone:
        path = Path(scenario) if scenario.endswith(".toml") else scenario_path(scenario)
        own = (f"simulation.seed={seed}", f"missions_dir={tmp_path / 'missions'}")
        return SimulatedDrone(load_settings([path], overrides=[*own, *settings]))

    return make
