"""kill -9 of each process in turn, in each phase, in real processes."""

from __future__ import annotations

import contextlib
import tempfile
import time
from pathlib import Path

import numpy as np
import psutil

from tests.faults.fault import Fault, Seen
from tests.faults.rig import Rig

PHASES = ("takeoff", "ascend", "approach", "estimate", "track", "return")
SPEED = 2.0
#: After a kill the vehicle has come to rest, wall seconds.
REST_S = 6.0
#: A hovering vehicle wanders by so much.
WANDER_M = 1.0
HELD = ("HOLD", "LAND")
BACK_S = 15.0


@contextlib.contextmanager
def rig():
    with (
        tempfile.TemporaryDirectory(prefix="bladescout-fault-") as name,
        Rig(Path(name), speed=SPEED) as rig,
    ):
        yield rig.start()


def come_to(rig, phase):
    """Wait for a phase; the way home is taken by an abort."""
    if phase == "return":
        rig.phase("track")
        rig.client.abort()
    rig.phase(phase)
    time.sleep(1.0)


def left_alone(rig):
    """Assert that the vehicle comes to rest by the autopilot alone, and stays; return the words."""
    begun_s = rig.now_s()
    # A take-off that the autopilot was sent on is flown to its end by the autopilot.
    rig.until(lambda: rig.newest()["mode"] in HELD and _stands(rig.recent()), 40.0, every_s=0.2)
    time.sleep(REST_S)
    lines = [line for line in rig.trace() if line["mission_s"] >= begun_s]
    assert lines[-1]["mode"] in HELD, "something moved by itself"
    after = [line for line in lines if line["mission_s"] > begun_s + SPEED * REST_S / 2]
    places = np.array([line["position_w"] for line in after])
    wandered = float(np.linalg.norm(places - places[0], axis=1).max())
    words = f"wandered by {wandered:.1f} m, {after[0]['position_w']} to {after[-1]['position_w']}"
    assert wandered <= WANDER_M, f"{words}; {sorted({line['mode'] for line in after})}"
    last_s = max((s["setpoint_s"] for s in lines if s["setpoint_s"] is not None), default=begun_s)
    late = [line["mode"] for line in lines if line["mission_s"] > last_s + 1.5]
    assert "OFFBOARD" not in late, "offboard was not left"
    return max(0.0, last_s - begun_s)


def _stands(lines):
    """Return whether, where something flies, it has stood for the last second."""
    last = lines[-1]
    latest = [line for line in lines if line["mission_s"] > last["mission_s"] - 1.0]
    fastest = max(float(np.linalg.norm(line["velocity_w"])) for line in latest)
    flown = last["position_w"][2] > 3.0 or not last["armed"]
    return flown and fastest < 0.5


def family_of(rig):
    daemon = psutil.Process(rig.daemon._process.pid)
    return [daemon, *daemon.children(recursive=True)]


def kill_in_each_phase(module):
    """Kill a process without which no mission goes on, once in each phase; a mission each."""
    silent_s, clearance_m = 0.0, np.inf
    for phase in PHASES:
        with rig() as one:
            come_to(one, phase)
            family = family_of(one)
            victim = family[0] if module is None else one.process(module)
            victim.kill()
            silent_s = max(silent_s, left_alone(one))
            if module is None:
                left = psutil.wait_procs(family, timeout=10)[1]
                assert left == [], f"orphans after a kill in {phase}: {left}"
            else:
                one.until(lambda one=one: one.process(module) is not None, BACK_S)
                idle = one.watcher.state.progress.phase
                assert idle == "idle", f"{phase}: the flight process is back and {idle}"
            clearance_m = min(clearance_m, one.finish()["min_clearance_m"] or np.inf)
    words = (
        f"{len(PHASES)} phases: held each time, stayed within {WANDER_M:.0f} m, nothing orphaned; "
        f"the last setpoint {silent_s:.2f} s after"
    )
    return Seen(len(PHASES), clearance_m=clearance_m, end="held", figure=words)


def kill_on_the_way(module):
    """Kill a process that comes back, once in each phase; the mission goes on or home.

    In two missions: what dies three times in a minute is not flown on with.
    """
    killed, back_s, states, names, clearance_m = [], 0.0, set(), set(), np.inf
    for phases in (PHASES[::2], PHASES[1::2]):
        with rig() as one:
            for phase in phases:
                if _reached(one, phase):
                    victim = one.process(module)
                    victim.kill()
                    killed.append(phase)
                    begun = time.monotonic()
                    one.until(lambda one=one, gone=victim.pid: one.another(module, gone), BACK_S)
                    back_s = max(back_s, time.monotonic() - begun)
            states.add(str(one.over(900.0)))
            names |= one.names()
            family = family_of(one)
            clearance_m = min(clearance_m, one.finish()["min_clearance_m"] or np.inf)
        left = psutil.wait_procs(family, timeout=10)[1]
        assert left == [], f"orphans: {left}"
    assert {"takeoff", "ascend", "approach", "track"} <= set(killed)
    words = (
        f"killed in {', '.join(killed)}: back within {back_s:.1f} s each time, nothing orphaned; "
        f"{' and '.join(sorted(states)).replace('_', ' ')}"
    )
    worst = min(states, key=lambda state: state in _ON_THE_WAY.split())
    return Seen(len(killed), frozenset(names), None, worst, clearance_m=clearance_m, figure=words)


def _reached(one, phase):
    """Wait for a phase, or for the end of the mission; return whether the phase came."""
    later = PHASES[PHASES.index(phase) :]
    one.phase(*later, "landed", "released", within_s=600.0)
    return one.watcher.state.progress.phase == phase


_ON_THE_WAY = "completed ended_safely"

ROWS: tuple[Fault, ...] = (
    Fault(15, "kill -9 of the sensing process, in each phase",
          lambda: kill_on_the_way("mission.processes.sensing"),
          "scan_late sensing_dead sensing_died", None, _ON_THE_WAY, slow=True),
    Fault(15, "kill -9 of the tracking worker, in each phase",
          lambda: kill_on_the_way("mission.processes.tracking_worker"), "scan_late", None,
          _ON_THE_WAY, slow=True),
    Fault(15, "kill -9 of the estimation worker, in each phase",
          lambda: kill_on_the_way("mission.processes.estimation_worker"), "", None,
          _ON_THE_WAY, slow=True),
    Fault(19, "kill -9 of the recorder, in each phase",
          lambda: kill_on_the_way("mission.processes.recorder"), "recorder_died", None,
          _ON_THE_WAY, slow=True),
    Fault(19, "kill -9 of the flight process, in each phase",
          lambda: kill_in_each_phase("mission.processes.flight"), "", None, "held", slow=True),
    Fault(19, "kill -9 of the daemon's first process, in each phase",
          lambda: kill_in_each_phase(None), "", None, "held", slow=True),
)  # fmt: skip
