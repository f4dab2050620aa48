import dataclasses
import types

import numpy as np
import pytest

from benchmarks.virtual_turbine import Truth, true_model
from config.presets import load_turbine
from mission.flight.command import SensingMode, SensingTask
from mission.flight.observation import (
    BladeTrack,
    FlightMode,
    Observation,
    RotorEstimate,
    Vehicle,
)
from mission.flight.rotor_watch import RotorWatch

TURBINE = load_turbine("windpact-1.5", 1.0)
MODEL = true_model(Truth(), TURBINE)
FRAME = MODEL.frames[0]
ROOT = MODEL.roots[0]
TIP = ROOT + MODEL.lengths[0] * MODEL.axes[0]
PASS_S = 30.0


def turned(point, about, angle_rad, through):
    """Rotate points (3,) about an axis through a place."""
    offset = point - through
    axis = about / np.linalg.norm(about)
    cos, sin = np.cos(angle_rad), np.sin(angle_rad)
    return through + (
        cos * offset + sin * np.cross(axis, offset) + (1 - cos) * (offset @ axis) * axis
    )


def vehicle(now, fix):
    return Vehicle(
        stamp_s=now, position_w=(0.0, 0.0, 50.0), velocity_w=(0.0, 0.0, 0.0),
        quaternion_wb=(1.0, 0.0, 0.0, 0.0), yaw_rad=0.0, mode=FlightMode.OFFBOARD,
        mode_stamp_s=now, armed=True, in_air=True, landed=False, heartbeat_stamp_s=now,
        gps_fix=fix,
    )  # fmt: skip


def fly(
    watch,
    true_axis_at,
    *,
    task_id=1,
    side="PS",
    from_s=100.0,
    fix=6,
    drift_m=0.0,
    seed=1,
    on_leg=True,
    view_w=-MODEL.normal_w,
):
    """Fly along blade A; ``true_axis_at(t_s)`` returns root and tip as they really are.

    Returns when movement was told, seconds into the pass; None: never.
    """
    rng = np.random.default_rng(seed)
    rotor = RotorEstimate(
        50.0, 1, hub_w=tuple(MODEL.hub_w), normal_w=tuple(MODEL.normal_w), stop_angle_deg=20.0
    )
    task = SensingTask(
        SensingMode.BLADE, task_id, normal_w=tuple(MODEL.normal_w), blade=FRAME.name, side=side,
        blade_root_w=tuple(ROOT), blade_tip_w=tuple(TIP),
    )  # fmt: skip
    axis = (TIP - ROOT) / np.linalg.norm(TIP - ROOT)
    for k in range(int(PASS_S * 10)):
        t_s = 0.1 * k
        root, tip = true_axis_at(t_s)
        share = 0.1 + 0.75 * t_s / PASS_S
        foot = root + share * (tip - root)
        foot = foot + drift_m * t_s / PASS_S * np.array([0.6, -0.8, 0.0]) + rng.normal(0, 0.06, 3)
        on_model = ROOT + ((foot - ROOT) @ axis) * axis
        now = from_s + t_s
        track = BladeTrack(
            now, FRAME.name, tuple(foot), tuple(axis), 12.0, 500.0, tuple(foot - on_model), 0.05
        )
        flight = types.SimpleNamespace(
            rotor=rotor, task=task, now_s=now, on_leg=on_leg, here_w=foot + 12.0 * view_w,
            observation=Observation(now, k, vehicle(now, fix), blade=track),
        )  # fmt: skip
        if watch.moved(flight):
            return t_s
    return None


def still(_t_s):
    return ROOT, TIP


def by_in_plane(degrees_at):
    def at(t_s):
        angle = np.radians(degrees_at(t_s))
        # About the shaft, pointing upwind: counter-clockwise seen from the front.
        return tuple(turned(p, -MODEL.normal_w, angle, MODEL.hub_w) for p in (ROOT, TIP))

    return at


def by_yaw(degrees_at):
    def at(t_s):
        angle = np.radians(degrees_at(t_s))
        up = np.array([0.0, 0.0, 1.0])
        return tuple(turned(p, up, angle, MODEL.tower_top_w) for p in (ROOT, TIP))

    return at


@pytest.mark.parametrize("seed", range(5))
def test_a_still_rotor_is_not_accused(seed):
    watch = RotorWatch()
    assert fly(watch, still, seed=seed) is None
    assert fly(watch, still, task_id=2, side="SS", from_s=150.0, seed=seed + 50) is None


@pytest.mark.parametrize("fix", [3, 6])
def test_a_position_that_drifts_is_not_taken_for_a_turn(fix):
    assert fly(RotorWatch(), still, fix=fix, drift_m=0.7 if fix == 6 else 2.5) is None


@pytest.mark.parametrize("degrees", [6.0, -6.0])
def test_a_rotor_that_has_turned_on_is_noticed(degrees):
    watch = RotorWatch()
    assert fly(watch, by_in_plane(lambda _: degrees)) is not None
    found = np.degrees(watch.turns[FRAME.name].in_plane_rad)
    assert found == pytest.approx(degrees, abs=0.5)


def test_a_creep_is_noticed_from_pass_to_pass_once_it_is_more_than_drift():
    watch = RotorWatch()
    noticed = None
    for number in range(12):
        began = 60.0 * number
        noticed = fly(
            watch, by_in_plane(lambda t, began=began: 0.01 * (began + t)), task_id=number,
            from_s=100.0 + began, seed=number,
        )  # fmt: skip
        if noticed is not None:
            break
    assert noticed is not None
    assert 3.0 < 0.01 * (began + noticed) < 6.0


def test_a_nacelle_that_has_yawed_since_the_first_pass_is_noticed_where_the_blade_shows_it():
    watch = RotorWatch()
    assert fly(watch, still) is None
    # This blade hangs nearly straight down: it takes a large yaw to turn it.
    assert fly(watch, still, task_id=2, side="SS", from_s=150.0) is None
    late = fly(watch, by_yaw(lambda _: 15.0), task_id=3, from_s=200.0)
    lean = np.degrees(np.arccos(abs(MODEL.axes[0] @ [0, 0, 1])))
    assert (late is not None) == (15.0 * np.sin(np.radians(lean)) > 4.0)


def test_a_side_looked_at_from_elsewhere_shows_other_skin_and_is_not_held_to_the_first_view():
    bent, watch = by_yaw(lambda _: 15.0), RotorWatch()
    assert fly(watch, still) is None
    aside_w = turned(-MODEL.normal_w, MODEL.axes[0], np.radians(45.0), np.zeros(3))
    assert fly(watch, bent, task_id=2, from_s=150.0, view_w=aside_w) is None
    # What that view has shown, it is held to.
    assert fly(watch, bent, task_id=3, from_s=200.0, view_w=aside_w) is None


def test_a_blade_seen_aslant_from_the_way_to_a_leg_says_nothing():
    watch = RotorWatch()
    assert fly(watch, by_in_plane(lambda _: 6.0), on_leg=False) is None
    assert watch.turns == {}


def test_a_new_measurement_begins_anew():
    watch = RotorWatch()
    assert fly(watch, by_in_plane(lambda _: 6.0)) is not None
    flight = types.SimpleNamespace(
        rotor=RotorEstimate(300.0, 2), now_s=300.0, observation=Observation(300.0, 1),
        task=SensingTask(SensingMode.BLADE, 9, blade="A"), on_leg=True,
    )  # fmt: skip
    assert not watch.moved(flight)
    assert watch.turns == {}


def test_what_is_not_a_number_is_left_out():
    watch = RotorWatch()

    def nowhere(t_s):
        return (ROOT, TIP) if t_s < 20.0 else (ROOT * np.nan, TIP)

    assert fly(watch, nowhere) is None
    assert all(np.isfinite(dataclasses.astuple(turn)).all() for turn in watch.turns.values())
