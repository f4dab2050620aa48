"""Long blades flown in several flights, in memory: how many it takes, and what is left undone.

``python -m tests.faults.splitting --turbine dtu-10mw``: machine, guard and planner against a
kinematic vehicle and ideal senses; its battery lasts 2000 s. After a flight that the battery ended
a charged one takes its place, and the next flight flies what is missing.
"""

from __future__ import annotations

import argparse
import dataclasses
import sys

from benchmarks import virtual_flight
from benchmarks.virtual_flight import VirtualFlight
from benchmarks.virtual_turbine import Truth
from config.presets import load_turbine
from config.settings import Settings
from config.turbine import Site
from mission.flight.command import MissionState
from tests.mission.flight.test_resumption import left_behind

MOST_FLIGHTS = 8
#: How far the senses see a tower, beyond the closed sphere of a large rotor.
SEEN_FROM_M = 160.0


def flight_of(name, earlier):
    """Return the next flight of an inspection of all twelve sides."""
    turbine = load_turbine(name)
    apart = turbine.rotor_radius_m + 30.0
    site = Site(name="t1", turbine=name, tower_north_m=apart + 3.0, tower_east_m=-2.0)
    number = 1 if earlier is None else earlier.flights + 1

    def hook(flight, observation):
        if flight.tick == 5:
            return dataclasses.replace(observation, earlier=earlier)
        return observation

    truth = Truth(tower_w=(0.0, apart, 0.0))
    flight = VirtualFlight(Settings(), site, turbine, truth, hook, seed=number)
    flight.start(flight=number)
    return flight


def main() -> int:
    """Fly until nothing is missing."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--turbine", default="dtu-10mw")
    options = parser.parse_args()
    virtual_flight.SEEN_FROM_M = SEEN_FROM_M
    earlier = None
    for number in range(1, MOST_FLIGHTS + 1):
        flight = flight_of(options.turbine, earlier)
        flown = flight.run(4000.0)
        report = flight.machine.report()
        sys.stdout.write(
            f"flight {number}: {report.state}, {report.words}; {flown.duration_s:.0f} s, "
            f"{len(flown.photos)} photos, {flight.machine.ledger.coverage():.1%} of the planned "
            f"metres, battery {flight._battery:.1%}, clearance {flown.min_clearance_m:.1f} m\n"
        )
        sys.stdout.flush()
        if not report.swap:
            break
        earlier = left_behind(flight, number)
    return 0 if report.state is MissionState.COMPLETED else 1


if __name__ == "__main__":
    sys.exit(main())
