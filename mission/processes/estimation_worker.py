"""The slow half of perception: tower and prior hub in the ascent, the rotor from before the hub.

A fit takes many milliseconds; here it keeps nothing waiting but the next fit.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field, replace

import numpy as np
from pydantic import TypeAdapter

from config.presets import turbines_of
from config.turbine import Turbine
from drivers.bus import Bus, Key
from mission.flight.command import SensingMode, SensingTask
from mission.flight.observation import BladeEstimate, HubPrior, RotorEstimate
from mission.processes.runtime import Runtime, run_process
from mission.processes.sensor_inbox import SensorInbox
from perception.deskew import points_in_world
from perception.estimator import RotorEstimator, rotor_estimator
from perception.geometry import vec3
from perception.hub_prior import SurveyResult, TowerSurvey
from perception.rotor import Refusal, Rotor
from perception.rotor_motion import RotorMotionWatch
from perception.side_votes import SideVotes
from perception.steady_poses import NOISY_M, SteadyPoses
from perception.values import Float, Pose, Scan
from perception.warm_up import warm_up_estimation

SURVEY_PERIOD_S = 1.0
PRIOR_PERIOD_S = 0.5
#: The rotor's side, once seen, is kept for so long, while the tower stays where it was but for what
#: the position wanders: on its way round a large rotor the flight does not see it for minutes.
SIDE_KEPT_S = 180.0
SIDE_MOVED_M, MOST_WANDER = 3.0, 4.0
#: The vehicle stands still when it has moved by less over the poses kept (6 s).
STEADY_M = 2.0
QUICK_DPS = 2.0
#: A slow turn counts when it is seen for so long without a break: a wander of the position by half
#: a metre, seen from 50 m, looks like one for two seconds. Nothing is approached meanwhile.
SLOW_SEEN_S = 4.0
#: A rate that is found is no proof of a still rotor, however doubtful it is.
STILL_DPS = 0.8
#: A hub or an axis found so much elsewhere begins the watch of the rotor's motion anew.
ANEW_M, ANEW_RAD = 3.0, math.radians(4.0)

_HUB_PRIOR = TypeAdapter(HubPrior)
_ROTOR = TypeAdapter(RotorEstimate)


@dataclass(slots=True)
class _Gathered:
    """What has come in for one sensing task."""

    task_id: int
    begun_s: float
    turbine: str = ""
    survey: TowerSurvey | None = None
    sides: SideVotes = field(default_factory=lambda: SideVotes(SIDE_KEPT_S))
    """Looks in which the rotor's side was seen."""
    clouds: deque[tuple[float, Float, Float]] = field(default_factory=deque)
    motion: RotorMotionWatch | None = None
    watched: SurveyResult | None = None
    """What `motion` was begun with."""
    estimator: RotorEstimator | None = None
    last_result_s: float = float("-inf")
    prior: SurveyResult | None = None
    last_prior_s: float = float("-inf")
    turning_s: float = float("inf")
    """Since when a slow turn is seen without a break."""


class EstimationWorker:
    """Accumulates scans for the task in force and publishes what they say."""

    def __init__(self, runtime: Runtime, bus: Bus) -> None:
        self._settings = runtime.settings
        self._bus = bus
        self._inbox = SensorInbox(bus, runtime.clock)
        self._gathered = _Gathered(-1, 0.0)
        self._sequence = 0
        self._turbines = turbines_of(self._settings.sites)
        noisy = self._settings.positioning.noise_sigma_m > NOISY_M
        self._steady = SteadyPoses() if noisy else None

    async def run(self) -> None:
        """Work through the newest scan, again and again, until cancelled."""
        warm_up_estimation(self._settings)
        await self._inbox.work("estimation", self.take_scan)

    def take_scan(self, scan: Scan) -> None:
        """Add a scan to what was gathered for the task; publish what is due."""
        task = self._inbox.task
        if task.mode not in (SensingMode.TOWER, SensingMode.ROTOR):
            return
        if task.task_id != self._gathered.task_id:
            # The tower does not move: what was seen of it serves the next task too.
            same = self._gathered.turbine == task.turbine
            before, began_s = self._gathered, scan.stamp_s
            self._gathered = _Gathered(task.task_id, began_s, task.turbine)
            if same:
                self._gathered.survey, self._gathered.sides = before.survey, before.sides
        points_w, origins_w = points_in_world(
            scan, self._poses(), self._settings.lidar, trusted_only=True
        )
        if task.mode is SensingMode.TOWER:
            self._survey(task, points_w, scan.stamp_s)
        else:
            self._estimate(task, points_w, origins_w, scan.stamp_s)

    # --- the ascent -----------------------------------------------------------------------------

    def _survey(self, task: SensingTask, points_w: Float, stamp_s: float) -> None:
        gathered, turbine = self._gathered, self._turbines.get(task.turbine)
        if task.tower_w is None:
            return
        if gathered.survey is None:
            gathered.survey = TowerSurvey(expected_w=np.asarray(task.tower_w), turbine=turbine)
        gathered.survey.update(points_w, stamp_s)
        if gathered.motion is not None:
            gathered.motion.update(points_w, stamp_s)
        if stamp_s - gathered.last_result_s >= SURVEY_PERIOD_S:
            gathered.last_result_s = stamp_s
            self._look(gathered, task, turbine)
        if gathered.prior is not None and stamp_s - gathered.last_prior_s >= PRIOR_PERIOD_S:
            gathered.last_prior_s = stamp_s
            prior = _prior(gathered.prior, self._turning(gathered))
            self._bus.publish(Key.HUB_PRIOR, _HUB_PRIOR.dump_json(prior))

    def _look(self, gathered: _Gathered, task: SensingTask, turbine: Turbine | None) -> None:
        result = None if gathered.survey is None else gathered.survey.result()
        if result is None:
            return
        wander_m = MOST_WANDER * self._settings.positioning.wander_sigma_m
        most_m = max(SIDE_MOVED_M, wander_m)
        gathered.prior = result = _with_side(result, gathered.sides, task, most_m)
        if result.normal_w is not None and (gathered.motion is None or _moved(gathered, result)):
            radius_m = 50.0 if turbine is None else turbine.rotor_radius_m
            gathered.watched = result
            gathered.motion = RotorMotionWatch(
                result.hub_w, result.normal_w, radius_m, result.tower
            )

    def _turning(self, gathered: _Gathered) -> bool | None:
        """Return whether the rotor turns; from a moving vehicle only a quick one is told.

        Flying past a feathered blade shows other parts of it from moment to moment, which looks
        like a slow turn of up to a third of a degree a second.
        """
        motion = None if gathered.motion is None else gathered.motion.result()
        if motion is None:
            return None
        if motion.turning and abs(motion.rate_dps) > QUICK_DPS:
            return True
        if self._travelled_m() > STEADY_M:
            gathered.turning_s = float("inf")
            return None
        if not motion.turning:
            gathered.turning_s = float("inf")
            return False if abs(motion.rate_dps) < STILL_DPS else None
        gathered.turning_s = min(gathered.turning_s, gathered.last_prior_s)
        seen_s = gathered.last_prior_s - gathered.turning_s
        return True if seen_s >= SLOW_SEEN_S else None

    def _travelled_m(self) -> float:
        """Return how far the vehicle has come over the poses kept, along any axis."""
        places = np.array([pose.position_w for pose in self._poses()])
        return float(np.ptp(places, axis=0).max()) if len(places) else float("inf")

    def _poses(self) -> list[Pose]:
        """Return the newest poses; where the position told jitters, steadied."""
        if self._steady is None:
            return list(self._inbox.poses)
        self._steady.follow(self._inbox.poses)
        return list(self._steady.poses)

    # --- the rotor ------------------------------------------------------------------------------

    def _estimate(
        self, task: SensingTask, points_w: Float, origins_w: Float, stamp_s: float
    ) -> None:
        gathered, settings = self._gathered, self._settings
        gathered.clouds.append((stamp_s, points_w, origins_w))
        window_s = settings.estimation.accumulate_s
        while gathered.clouds and stamp_s - gathered.clouds[0][0] > window_s:
            gathered.clouds.popleft()
        begun_s = max(gathered.begun_s, gathered.last_result_s)
        if stamp_s - begun_s < window_s:
            return
        gathered.last_result_s = stamp_s
        if gathered.estimator is None:
            gathered.estimator = rotor_estimator(settings, self._turbines.get(task.turbine))
        answer = gathered.estimator.update(
            np.concatenate([points for _, points, _ in gathered.clouds]),
            np.concatenate([origins for _, _, origins in gathered.clouds]),
            stamp_s,
            prior_hub_w=None if task.hub_w is None else np.asarray(task.hub_w),
            prior_normal_w=None if task.normal_w is None else np.asarray(task.normal_w),
        )
        self._sequence += 1
        estimate = rotor_estimate(answer, stamp_s, self._sequence)
        self._bus.publish(Key.ROTOR, _ROTOR.dump_json(estimate))


def _moved(gathered: _Gathered, result: SurveyResult) -> bool:
    """Return whether hub or axis are known better than when the rotor began to be watched."""
    was = gathered.watched
    if was is None or was.normal_w is None or result.normal_w is None:
        return False
    turned = float(was.normal_w @ result.normal_w) < math.cos(ANEW_RAD)
    return turned or float(np.linalg.norm(was.hub_w - result.hub_w)) > ANEW_M


def _with_side(
    result: SurveyResult, sides: SideVotes, task: SensingTask, most_m: float
) -> SurveyResult:
    """Return the result with the side that the looks of late name.

    A rotor does not lose its side between two looks; a view of few points does. A flight that
    measures again says which side it has known. ``most_m``: a tower that is found farther from
    where it was, at the hub's height, is not the same.
    """
    if result.normal_w is not None:
        sides.add(result)
    known = sides.believed(result.stamp_s)
    if known is result:
        return result
    if known is not None:
        height_m = float(known.hub_w[2])
        apart_w = result.tower.at_height(height_m) - known.tower.at_height(height_m)
        near = float(np.linalg.norm(apart_w[:2])) <= most_m
        return replace(known, stamp_s=result.stamp_s) if near else _sideless(result)
    if result.normal_w is not None or task.normal_w is None or task.hub_w is None:
        return _sideless(result)
    return replace(result, normal_w=np.asarray(task.normal_w), hub_w=np.asarray(task.hub_w))


def _sideless(result: SurveyResult) -> SurveyResult:
    """Return a result without the side that it names: others contradict it."""
    if result.normal_w is None:
        return result
    centre_w = result.tower.at_height(float(result.hub_w[2]))
    apart_m = float(np.linalg.norm(result.hub_w - centre_w))
    sigma_m = math.hypot(result.sigma_m, apart_m)
    return replace(result, normal_w=None, hub_w=centre_w, sigma_m=sigma_m, yaw_sigma_deg=180.0)


def _prior(result: SurveyResult, turning: bool | None) -> HubPrior:
    return HubPrior(
        stamp_s=result.stamp_s,
        tower_w=vec3(result.tower.foot_w),
        tower_axis_w=vec3(result.tower.axis_w),
        tower_top_m=result.tower.top_m,
        hub_w=vec3(result.hub_w),
        normal_w=None if result.normal_w is None else vec3(result.normal_w),
        sigma_m=result.sigma_m,
        turning=turning,
    )


def rotor_estimate(answer: Rotor | Refusal, stamp_s: float, sequence: int) -> RotorEstimate:
    """Return an estimator's answer as flight reads it."""
    if isinstance(answer, Refusal):
        return RotorEstimate(stamp_s, sequence, refusal=answer.code, refusal_text=answer.text)
    blades = tuple(
        BladeEstimate(blade.name, vec3(blade.direction_w), blade.pitch_deg, blade.length_m)
        for blade in answer.blades
    )
    return RotorEstimate(
        stamp_s=stamp_s,
        sequence=sequence,
        hub_w=vec3(answer.hub_w),
        normal_w=vec3(answer.normal_w),
        stop_angle_deg=answer.stop_angle_deg,
        sigma_deg=answer.sigma_deg,
        reference=answer.reference,
        blades=blades,
        cone_deg=answer.cone_deg,
        method=answer.method,
    )


async def estimate(runtime: Runtime) -> None:
    """Run the worker until cancelled."""
    with runtime.open_bus() as bus:
        await EstimationWorker(runtime, bus).run()


if __name__ == "__main__":
    run_process("estimation", estimate)
