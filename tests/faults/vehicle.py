"""Cases 16 to 33: vehicle, link, pilot, air."""

from __future__ import annotations

import copy
import dataclasses
import datetime as dt
import math
import time
from unittest import mock

import numpy as np

from benchmarks.virtual_flight import TERMINAL
from config.energy import must_return_at
from config.presets import load_turbine
from config.settings import Settings
from drivers.autopilot_state import VehicleMode, VehicleReading
from mission.flight.command import Action, Phase
from mission.flight.observation import FlightMode
from mission.processes.preflight import preflight_items, wanted_parameters
from mission.remote.messages import SensingHealth
from tests.faults.fault import Fault, Seen
from tests.faults.guarding import random_setpoints
from tests.faults.rehearsal import (
    FLYING,
    flight_in,
    mission,
    seen,
    told,
)
from tests.faults.stalling import blocked_for_5_s, pilot_holds_meanwhile

#: So far from the vehicle something is put into its way: it has not been closer on anything.
AHEAD_M = 10.5


def link_silent():
    """Freeze everything that the vehicle reports at what it was."""
    kept = []

    def change(flight, observation, t_s):
        kept.append(observation.vehicle)
        return dataclasses.replace(observation, vehicle=kept[0])

    return change


def link_silent_1s():
    result = seen(link_silent(), "position_stale", for_s=1.2)
    assert "link_ageing" in result.events
    return dataclasses.replace(result, figure="warned, held by the age of the position")


def link_silent_for_good():
    return seen(link_silent(), "link_lost", figure=lambda flight, _: flight.machine.report().words)


def pilot_in_each_phase():
    worst, after_report, phases = 0.0, 0.0, 0
    for phase in FLYING:
        flight = flight_in(phase)
        flown = flight.run(limit_s=0.05)
        flight.pilot_takes()
        begin, reported, silent = flight.now_s, None, None
        for _ in range(round(30 / 0.05)):
            command = flight.one_tick(flown).command
            if reported is None and flight._mode_reported[0] is FlightMode.PILOT:
                reported = flight.now_s
            quiet = command.setpoint is None and command.action is None
            quiet = quiet and command.gimbal is None and command.photo is None
            if silent is None and reported is not None and quiet:
                silent = flight.now_s
            assert silent is None or quiet, "something was sent after the pilot took over"
        worst = max(worst, silent - begin)
        after_report = max(after_report, silent - reported)
        phases += 1
        assert str(flight.machine.state) == "released"
    words = f"{phases} phases; {after_report:.2f} s after the first message that reports it"
    assert after_report <= 0.1
    return Seen(phases, frozenset({"pilot_took_over"}), worst, "released", figure=words)


def offboard_refused():
    flight, asked = mission(), []
    flown = flight.run(until=Phase.TAKEOFF)

    def hook(flight, observation):
        if asked:
            return dataclasses.replace(observation, offboard_refused="offboard: denied")
        return observation

    flight.hook = hook
    while str(flight.machine.state) == "running":
        command = flight.one_tick(flown).command
        if command.action is not None and command.action.value == "offboard":
            asked.append(flight.now_s)
    assert len(asked) <= 3
    events = frozenset(e.name for e in flown.events)
    words = f"asked {len(asked)} times, then landed"
    return Seen(len(asked), events, end=str(flight.machine.state), figure=words)


def arming_not_carried_out():
    """The autopilot acknowledges and stays disarmed."""

    def hook(flight, observation):
        vehicle = dataclasses.replace(observation.vehicle, armed=False, in_air=False, landed=True)
        return dataclasses.replace(observation, vehicle=vehicle)

    flight, asked = mission(hook=hook), []
    flown = flight.run(limit_s=0.0)
    while flight.machine.state not in TERMINAL:
        command = flight.one_tick(flown).command
        if command.action is Action.ARM:
            asked.append(flight.now_s)
        assert command.action is not Action.TAKEOFF
    assert 1 < len(asked) <= 3
    events = frozenset(e.name for e in flown.events)
    words = f"asked {len(asked)} times: {flight.machine.report().words}"
    return Seen(len(asked), events, end=str(flight.machine.state), figure=words)


def _ready():
    return VehicleReading(
        stamp_s=1.0, position_w=(0.0, 0.0, 0.0), velocity_w=(0.0, 0.0, 0.0),
        quaternion_wb=(1.0, 0.0, 0.0, 0.0), yaw_rad=0.0, mode=VehicleMode.HOLD, mode_stamp_s=1.0,
        armed=False, in_air=False, landed=True, heartbeat_stamp_s=1.0, battery=0.95,
        battery_stamp_s=1.0, home_w=(0.0, 0.0, 0.0), healthy=True, gps_fix=3, gps_eph_m=0.9,
        satellites=14, rc_link=True,
    )  # fmt: skip


def preflight(folder, **changes):
    """Return the names of the items that fail, given one thing that is wrong."""
    turbine = load_turbine("v27")
    right = {
        "vehicle": _ready(),
        "parameters": wanted_parameters(turbine) | {"GF_ACTION": 2.0, "COM_LOW_BAT_ACT": 3.0},
        "sensing": SensingHealth(
            mission_s=1.0, lidar_online=True, camera_online=True, scans=9, frames=9, dropped=0
        ),
        "workers_ready": {"tracking", "estimation", "recorder"},
    }
    given = right | changes
    return preflight_items(
        Settings(), turbine, given["vehicle"], given["parameters"], given["sensing"],
        given["workers_ready"], folder,
    )  # fmt: skip


def preflight_lists_what_is_wrong():
    from pathlib import Path

    folder, vehicle = Path(__file__).parent, _ready()
    good = wanted_parameters(load_turbine("v27"))
    assert [i.name for i in preflight(folder) if not i.passed] == []
    broken = {
        "vehicle": {"vehicle": dataclasses.replace(vehicle, healthy=False)},
        "battery": {"vehicle": dataclasses.replace(vehicle, battery=0.2)},
        "gps": {"vehicle": dataclasses.replace(vehicle, gps_fix=2)},
        "home": {"vehicle": dataclasses.replace(vehicle, home_w=None)},
        "COM_OBL_RC_ACT": {"parameters": good | {"COM_OBL_RC_ACT": 0.0}},
        "COM_OF_LOSS_T": {"parameters": good | {"COM_OF_LOSS_T": 1.0}},
        "rc": {"vehicle": dataclasses.replace(vehicle, rc_link=False)},
        "NAV_RCL_ACT": {"parameters": good | {"NAV_RCL_ACT": 6.0}},
        "GF_ACTION": {"parameters": good | {"GF_ACTION": 4.0}},
        "RTL_RETURN_ALT": {"parameters": good | {"RTL_RETURN_ALT": 30.0}},
        "lidar": {"sensing": None},
        "camera": {"sensing": None},
        "perception": {"workers_ready": set()},
    }
    for name, change in broken.items():
        failed = {i.name: i for i in preflight(folder, **change) if not i.passed}
        assert name in failed
        assert failed[name].mend, f"{name} names no remedy"
    words = f"{len(broken)} faults, each listed with what mends it"
    return Seen(len(broken), frozenset({"preflight"}), end="refused", figure=words)


def without_the_operators_word():
    flight = mission()
    flight.requests = [dataclasses.replace(flight.requests[0], rotor_locked=False)]
    flight.run()
    assert not flight.armed
    return Seen(1, frozenset({"preflight"}), end=str(flight.machine.state),
                figure=flight.machine.report().words)  # fmt: skip


def gps_jumps():
    """The reported position runs off by 8 m within a second; its velocity says nothing of it."""

    def change(flight, observation, t_s):
        off = 8.0 * min(t_s, 1.0)
        x, y, z = observation.vehicle.position_w
        vehicle = dataclasses.replace(observation.vehicle, position_w=(x + off, y, z))
        return dataclasses.replace(observation, vehicle=vehicle)

    return seen(change, "position_jump", limit_s=20.0)


def height_runs_off():
    """The barometer's height runs off by 20 m in five seconds."""

    def change(flight, observation, t_s):
        x, y, z = observation.vehicle.position_w
        vehicle = dataclasses.replace(
            observation.vehicle, position_w=(x, y, z + 4.0 * min(t_s, 5.0))
        )
        return dataclasses.replace(observation, vehicle=vehicle)

    return seen(change, "position_jump", limit_s=20.0)


def heading_runs_off():
    """The heading turns by 15 deg at 10 deg/s, and back after 20 s; the gyro tells of no turn."""

    def change(flight, observation, t_s):
        vehicle = observation.vehicle
        off = min(10.0 * t_s, 15.0, max(0.0, 10.0 * (20.0 - t_s)))
        return dataclasses.replace(
            observation,
            vehicle=dataclasses.replace(
                vehicle,
                yaw_rad=vehicle.yaw_rad + math.radians(off),
                gyro_yaw_rad=vehicle.yaw_rad + 1.0,
            ),
        )

    return seen(change, "heading_wrong")


def frame_reset():
    def change(flight, observation, t_s):
        x, y, z = observation.vehicle.position_w
        vehicle = dataclasses.replace(
            observation.vehicle, position_w=(x + 3.0, y - 2.0, z), reset_count=1
        )
        return dataclasses.replace(observation, vehicle=vehicle)

    return seen(change, "frame_reset")


def battery_gone():
    stamp = []

    def change(flight, observation, t_s):
        stamp.append(observation.vehicle.battery_stamp_s)
        return told("vehicle", battery_stamp_s=stamp[0])(flight, observation, t_s)

    return seen(change, "battery_unknown")


def battery_low():
    return seen(told("vehicle", battery=0.2), "battery_reserve")


def _wind(speed):
    return told("vehicle", wind_w=(speed, 0.0, 0.0))


def gust():
    return seen(_wind(15.5), "wind_strong")


def strong_wind():
    return seen(_wind(12.5), "wind_strong")


def setpoints_against_the_true_mesh():
    return random_setpoints(10_000, seed=30)


def more_setpoints_against_the_true_mesh():
    return random_setpoints(100_000, seed=31)


def something_hangs_in_the_way():
    """A load of half a metre hangs in the air where the pass leads to, seen by the LiDAR alone."""
    flight = flight_in(Phase.TRACK)
    here, twin = flight.position.copy(), copy.deepcopy(flight)
    ahead = np.array(twin.run(limit_s=60.0).track)
    load = next(place for place in ahead if np.linalg.norm(place - here) > AHEAD_M)
    rng = np.random.default_rng(30)
    returns = load + rng.uniform(-0.25, 0.25, (40, 3))
    flight._points = np.concatenate([flight._points, returns])
    flown, apart = flight.run(limit_s=0.0), []
    while str(flight.machine.state) == "running":
        flight.one_tick(flown)
        apart.append(float(np.linalg.norm(returns - flight.position, axis=1).min()))
    least = min(apart) - flight.settings.airframe.radius_m
    assert least >= 8.0, f"{least:.2f} m from the load"
    return Seen(
        len(returns), frozenset(e.name for e in flown.events), end=str(flight.machine.state),
        clearance_m=min(least, flown.min_clearance_m),
        figure=f"never nearer to it than {least:.2f} m: {flight.machine.report().words}",
    )  # fmt: skip


def clock_steps():
    """UTC steps by an hour, to and fro, at every reading, while a mission is flown."""
    first = mission().run(60.0)
    steps = 0
    real = time.time

    def stepping():
        nonlocal steps
        steps += 1
        return real() + (3600.0 if steps % 2 else -3600.0)

    class Stepping(dt.datetime):
        @classmethod
        def now(cls, tz=None):
            return super().fromtimestamp(stepping(), tz)

    with mock.patch("time.time", stepping), mock.patch("datetime.datetime", Stepping):
        assert abs(time.time() - real()) > 3500
        second = mission().run(60.0)
    assert first.track == second.track
    assert [e.text for e in first.events] == [e.text for e in second.events]
    return Seen(steps, end="same", figure="60 s flown twice: the same setpoints, tick by tick")


def reserve_is_kept_before_the_autopilots_own_return():
    settings = Settings()
    far = (settings.guard.cylinder_radius_m, 0.0, 100.0)
    needed = must_return_at(
        settings.battery, settings.airframe, far, (0.0, 0.0, 0.0), 100.0, (8.0, 0.0, 0.0)
    )
    least = settings.battery.autopilot_return_at + 0.05
    near = must_return_at(
        settings.battery, settings.airframe, (1.0, 0.0, 10.0), (0.0, 0.0, 0.0), 10.0,
        (0.0, 0.0, 0.0),
    )  # fmt: skip
    assert needed >= near >= least - 1e-9
    words = f"turns home at {near:.0%} beside home, at {needed:.0%} from {far[0]:.0f} m away"
    return Seen(2, frozenset({"battery_reserve"}), end="ended_safely", figure=words)


_AUTOPILOT = "tests/drivers/test_autopilot.py::"
_GUARD = "tests/mission/flight/test_guard.py::"
_DEADMAN = "tests/mission/processes/test_dead_man.py::"

_LIMITS_27 = (
    "the heading is compared with the gyro of the autopilot, so one that was wrong from the start "
    "is not noticed; clearance is taken from the scans of the moment all the same"
)
_LIMITS_30 = (
    "once there is a model, the LiDAR's blind sectors are taken for free within the plan's "
    "corridors (one tick in twenty along two sides leads, steeply downwards, into a place never "
    "seen in it); before there is one, a way that a phase flies opens its own corridor (the "
    "closed sphere, the scans and what was never seen bind it all the same); what was seen longer "
    "than 120 s ago is left to the model"
)
_LIMITS_24 = (
    "a missing remote control cannot be waived in the request; whether a fence is loaded is not "
    "looked at, only what the autopilot does at it"
)
_LIMITS_22 = (
    "a takeover ends the flight: taken back in the air by `bladescout resume --airborne`, the "
    "next flight leaves the rotor and measures it anew before it flies what is missing"
)

ROWS = (
    Fault(16, "the autopilot is silent for 1 s", link_silent_1s, "position_stale", 0.6,
          "completed released"),
    Fault(16, "the autopilot is silent for good", link_silent_for_good, "link_lost", 11.1,
          "failed"),
    Fault(17, "no acknowledgement comes",
          _AUTOPILOT + "test_no_acknowledgement_ends_after_three_tries"),
    Fault(18, "control is blocked for 5 s while a blade is flown", blocked_for_5_s,
          "own_silence", 0.1, "completed"),
    Fault(18, "the pilot chooses Hold meanwhile", pilot_holds_meanwhile, "pilot_took_over", 0.1,
          "released"),
    Fault(18, "a tick that took more than 100 ms",
          _DEADMAN + "test_a_tick_that_took_too_long_is_dropped"),
    Fault(22, "the pilot takes over, in each phase", pilot_in_each_phase, "pilot_took_over", 1.1,
          "released", lacking=_LIMITS_22),
    Fault(22, "what the pilot took is taken back by a request alone",
          "tests/mission/flight/test_takeover.py"
          "::test_what_the_pilot_took_is_taken_back_only_by_a_request"),
    Fault(23, "offboard is refused", offboard_refused, "offboard_refused", None, "refused"),
    Fault(23, "arming is not carried out", arming_not_carried_out, "offboard_refused", None,
          "refused"),
    Fault(24, "each thing that preflight looks at is wrong in turn",
          preflight_lists_what_is_wrong, "preflight", None, "refused", lacking=_LIMITS_24),
    Fault(24, "the operator's word that the rotor is locked is missing",
          without_the_operators_word, "", None, "refused"),
    Fault(25, "the position runs off by 8 m in a second", gps_jumps, "position_jump", 1.0,
          "running released completed ended_safely"),
    Fault(26, "the estimator resets its local frame", frame_reset, "frame_reset", 0.1,
          "released"),
    Fault(27, "the height runs off by 20 m in 5 s", height_runs_off, "position_jump", 1.0,
          "running released completed ended_safely"),
    Fault(27, "the heading runs off by 15 deg, and comes back after 20 s", heading_runs_off,
          "heading_wrong", 1.0, "completed", lacking=_LIMITS_27),
    Fault(28, "the battery is at 20 %", battery_low, "battery_reserve", 0.1, "ended_safely"),
    Fault(28, "no battery telemetry for 5 s", battery_gone, "battery_unknown", 5.1,
          "ended_safely"),
    Fault(28, "the way home is computed in a head wind",
          reserve_is_kept_before_the_autopilots_own_return, "battery_reserve", None,
          "ended_safely"),
    Fault(29, "a gust above 15 m/s", gust, "wind_strong", 0.1, "ended_safely"),
    Fault(29, "5 s of wind above 12 m/s", strong_wind, "wind_strong", 5.1, "ended_safely"),
    Fault(30, "10 000 random setpoints near the true mesh", setpoints_against_the_true_mesh,
          "guard", None, "clear", lacking=_LIMITS_30),
    Fault(30, "100 000 random setpoints near the true mesh",
          more_setpoints_against_the_true_mesh, "guard", None, "clear", slow=True),
    Fault(30, "a load hangs where the pass leads to", something_hangs_in_the_way,
          "guard_refused guard_blocked", None, "completed ended_safely"),
    Fault(31, "a setpoint that is not a number",
          _GUARD + "test_a_setpoint_that_is_not_a_number_becomes_a_hold"),
    Fault(31, "outside the cylinder and above the height limit",
          _GUARD + "test_cylinder_and_height_are_not_left_but_may_be_come_back_into"),
    Fault(32, "a foreign system id",
          _AUTOPILOT + "test_a_foreign_system_id_is_not_taken_for_our_vehicle"),
    Fault(33, "UTC steps by an hour, to and fro", clock_steps, "", None, "same"),
)  # fmt: skip
