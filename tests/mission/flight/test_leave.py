"""The way out of the rotor lies where the position has drifted to."""

from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.virtual_turbine import Truth, true_model
from config.presets import load_turbine
from config.settings import Settings
from mission.flight.phases.leave import StandOff, way_out
from mission.flight.plan import plan

TURBINE = load_turbine("windpact-1.5")


class Leaving(SimpleNamespace):
    """A flight that leaves the rotor; keeps what it is told to follow."""

    def go(self, points_w, _speed_mps, shift_w):
        self.way_w = np.asarray(points_w) + shift_w

    def follow(self, yaw_rad, slow, shift_w, *, firm):
        assert (slow, firm) == (1.0, False)
        self.shift_w = shift_w
        return ("setpoint", yaw_rad)

    def yaw_to(self, place_w):
        offset = place_w - self.here_w
        return float(np.arctan2(offset[1], offset[0]))


@pytest.fixture(scope="module")
def planned():
    model = true_model(Truth(stop_angle_deg=17.0, pitch_deg=85.0), TURBINE)
    start = model.hub_w - 20 * model.normal_w
    return model, plan(model, TURBINE, Settings(), [("A", "SS")], start, 0.0)


def leaving(planned, drift_w):
    model, found = planned
    inside = found.legs[-1].position(found.legs[-1].photos[-1])
    return Leaving(
        here_w=inside + drift_w, drift_w=np.array(drift_w), hub_w=model.hub_w,
        sphere_radius_m=model.rotor_radius_m + 15.0, normal_w=model.normal_w, plan=found,
        home_w=(-60.0, 0.0, 0.0), outcome=None, now_s=100.0,
        observation=SimpleNamespace(guard_refused=None, clearance=None),
    )  # fmt: skip


def test_it_is_the_plans_way_moved_by_the_drift(planned):
    still, drifted = leaving(planned, (0.0, 0.0, 0.0)), leaving(planned, (3.0, -2.0, 1.0))
    for flight in (still, drifted):
        StandOff(None).step(flight)
    assert drifted.way_w == pytest.approx(still.way_w + drifted.drift_w)
    assert drifted.shift_w == pytest.approx([3.0, -2.0, 1.0])
    assert way_out(drifted, homeward=False) == pytest.approx(way_out(still, homeward=False))


def test_outside_counts_from_where_the_rotor_has_drifted_to(planned):
    drifted = leaving(planned, (5.0, 0.0, 0.0))
    beyond = np.array([1.0, 0.0, 0.0]) * (drifted.sphere_radius_m + 1.0)
    drifted.here_w = drifted.hub_w + beyond
    drifted.hold = lambda: "hold"
    assert StandOff("next").step(drifted).words == "leaving the rotor"
    drifted.here_w = drifted.hub_w + beyond + drifted.drift_w
    intent = StandOff("next").step(drifted)
    assert (intent.words, intent.then) == ("clear of the rotor", "next")
