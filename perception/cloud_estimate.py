"""The rotor in a recorded cloud, without a mission: the pure core of `bladescout estimate`.

What the ascent would have told is found in the cloud itself: the tower, the side on which its
rotor hangs and the hub (`cloud_towers`); where no tower is seen, the fit looks for three arms
alone. The estimator is the mission's own (`estimator`). A recording of many seconds is judged
look by look, and the looks must agree. Without a known side there is no angle: from behind it is
120 degrees less the angle (design, Definitions).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from config.settings import Settings
from config.turbine import Turbine
from perception.cloud_frames import other_frame, with_tower_below
from perception.cloud_looks import looks
from perception.cloud_towers import surveyed_turbines
from perception.estimator import RotorFit, rotor_estimator
from perception.geometry import stop_angle_difference_deg
from perception.hub_prior import SurveyResult
from perception.recorded_cloud import RecordedCloud, checked
from perception.rotor import Refusal, RefusalCode, Rotor
from perception.stop_angle import DOWN_W
from perception.tower_reference import tower_reference
from perception.values import Float

DEFAULT_RADIUS_M = 60.0
"""Of what is kept round a hub where the rotor's size is not known: larger ones lose their tips."""
BEHIND_SIGMA_DEG = 2.5
"""Of an angle measured from behind, where nacelle and tower hide the roots: rms 2.3 over five
turbines drawn by the simulator."""
RADIUS_OF_HEIGHT = 0.5
"""Of a rotor to its hub's height over the ground: 0.4-0.65 for the types of config/turbines."""
LONG_M = 25.0
"""Of an upright thing that is a tower beyond doubt: a look from before the hub shows less of it."""
PASSES = 6
"""Of the paper's loop over one cloud."""
WORST_SPREAD_DEG = 2.0


@dataclass(frozen=True, slots=True, eq=False)
class Question:
    """What is known of the turbine beforehand; nothing need be."""

    turbine: Turbine | None = None
    rotor_radius_m: float | None = None
    """Where the type is not known but its size is."""
    hub_w: Float | None = None
    """(3,) up to some 5 m wrong."""
    normal_w: Float | None = None
    """(3,) downwind, from rotor to nacelle; within 40 deg."""


@dataclass(frozen=True, slots=True, eq=False)
class CloudAnswer:
    """The rotor or the refusal, and how it came about."""

    rotor: Rotor | Refusal
    found_by: str
    """`given`, `tower` or `rotor`: where the prior hub came from."""
    points: int
    dropped: int
    looks: int = 1
    """Estimates that were compared."""
    spread_deg: float | None = None
    """Between the looks' stop angles, where there was more than one."""
    from_behind: bool = False
    """Whether the rotor was seen from the nacelle's side: the fit is coarser there."""


@dataclass(frozen=True, slots=True, eq=False)
class _Prior:
    hub_w: Float | None
    normal_w: Float | None
    found_by: str
    side_is_sure: bool = True
    """False where what was taken for a tower is so short that it may be a blade."""
    height_m: float | None = None
    """Of the hub over the tower's foot, where a whole tower was seen."""


def estimate_cloud(
    cloud: RecordedCloud, question: Question, settings: Settings | None = None
) -> CloudAnswer:
    """Return the rotor that a recorded cloud shows, or why none is given.

    Raises `recorded_cloud.UnusableCloud` for a cloud that cannot be one of a rotor in metres.
    """
    settings = settings or Settings()
    near = checked(cloud)
    shift = near.shift_w
    hub_w = None if question.hub_w is None else np.asarray(question.hub_w, np.float64) - shift
    asked = replace(question, hub_w=hub_w, normal_w=_unit(question.normal_w))
    eye_w = _eye(near.cloud)
    refused: list[tuple[CloudAnswer, Refusal]] = []
    upright = False
    for prior in _priors(near.cloud, asked):
        upright |= prior.height_m is not None
        for sized in _sizes(asked, prior):
            tried = _by_prior(near.cloud, prior, sized, settings)
            if not isinstance(tried.rotor, Refusal):
                return _given_out(replace(tried, dropped=near.dropped), tried.rotor, eye_w, shift)
            refused.append((tried, tried.rotor))
    # The first prior is the best founded one: its refusal is what a person is told.
    answer, refusal = refused[0]
    # A plumb tower was seen: the cloud stands upright.
    frame = "" if upright else _other_frame(near.cloud, refusal, asked, settings)
    text = f"{refusal.text}; {frame or _missing(answer, refusal, asked)}"
    return replace(answer, rotor=replace(refusal, text=text), dropped=near.dropped)


def _given_out(answer: CloudAnswer, rotor: Rotor, eye_w: Float, shift_w: Float) -> CloudAnswer:
    """Return an answer in the cloud's own frame, its sigma honest from behind as well."""
    behind = float((rotor.hub_w - eye_w) @ rotor.normal_w) < 0
    sigma = max(rotor.sigma_deg, BEHIND_SIGMA_DEG) if behind else rotor.sigma_deg
    moved = replace(rotor, hub_w=rotor.hub_w + shift_w, sigma_deg=sigma)
    return replace(answer, rotor=moved, from_behind=behind)


def _sizes(question: Question, prior: _Prior) -> Iterator[Question]:
    """Yield the question; where the rotor's size is not known, then with one that suits the hub."""
    yield question
    if question.turbine is None and question.rotor_radius_m is None and prior.height_m is not None:
        yield replace(question, rotor_radius_m=RADIUS_OF_HEIGHT * prior.height_m)


def _priors(cloud: RecordedCloud, question: Question) -> Iterator[_Prior]:
    """Yield what may be known of hub and side, the best founded first; each only when asked for."""
    if question.hub_w is not None and question.normal_w is not None:
        yield _Prior(question.hub_w, question.normal_w, "given")
        return
    eye = _eye(cloud)
    turbines = surveyed_turbines(cloud.points_w, question.turbine, eye)
    if question.hub_w is not None:
        at = question.hub_w[:2]
        near = [one for one in turbines if np.linalg.norm((one.hub_w - question.hub_w)[:2]) < 12.0]
        near.sort(key=lambda one: float(np.linalg.norm(one.hub_w[:2] - at)))
        for one in near[:1]:
            yield _Prior(question.hub_w, one.normal_w, "given", *_tower_of(one))
        yield _Prior(question.hub_w, None, "given")
        return
    for one in turbines:
        is_long, height_m = _tower_of(one)
        if question.normal_w is not None:
            yield _Prior(one.hub_w, question.normal_w, "tower", height_m=height_m)
        else:
            yield _Prior(one.hub_w, one.normal_w, "tower", is_long, height_m)
    yield _Prior(None, question.normal_w, "rotor")


def _tower_of(turbine: SurveyResult) -> tuple[bool, float | None]:
    """Return whether it is a tower beyond doubt, and then how high above its foot the hub is."""
    foot_m = float(turbine.tower.foot_w[2])
    is_long = turbine.tower.highest_m - foot_m > LONG_M
    return is_long, float(turbine.hub_w[2]) - foot_m if is_long else None


def _by_prior(
    cloud: RecordedCloud, prior: _Prior, question: Question, settings: Settings
) -> CloudAnswer:
    """Return the answer with one prior: the best of the looks, where they agree."""
    estimator = rotor_estimator(settings, question.turbine, question.rotor_radius_m)
    passes = PASSES if settings.estimation.method == "fermat" else 1
    rotors: list[Rotor] = []
    refusal: Refusal | None = None
    used = 0
    for look in looks(cloud, prior.hub_w, _radius_m(question), settings.estimation.accumulate_s):
        points, origins = look.points_w, np.asarray(look.origins_w)
        used = used or len(points)
        for _ in range(passes):
            answer = estimator.update(
                points, origins, 0.0, prior_hub_w=prior.hub_w, prior_normal_w=prior.normal_w
            )
            if isinstance(answer, Refusal):
                break
        answer = _of_known_side(answer, prior, points, question)
        answer = with_tower_below(answer, points, _radius_m(question))
        if isinstance(answer, Refusal):
            refusal = refusal or answer
        else:
            rotors.append(answer)
    if not rotors:
        none = Refusal(RefusalCode.NO_POINTS, "no look shows anything round the hub")
        return CloudAnswer(refusal or none, prior.found_by, used, 0)
    best = min(rotors, key=lambda rotor: rotor.sigma_deg)
    errors = [stop_angle_difference_deg(r.stop_angle_deg, best.stop_angle_deg) for r in rotors]
    spread = max(errors) - min(errors) if len(rotors) > 1 else None
    answer = best
    if spread is not None and spread > max(WORST_SPREAD_DEG, 6 * best.sigma_deg):
        answer = Refusal(
            RefusalCode.NOT_CONVERGED,
            f"{len(rotors)} looks differ by {spread:.1f} deg: does the rotor turn?",
        )
    return CloudAnswer(answer, prior.found_by, used, 0, len(rotors), spread)


def _of_known_side(
    answer: Rotor | Refusal, prior: _Prior, points_w: Float, question: Question
) -> Rotor | Refusal:
    """Return a refusal in the place of an angle whose side nobody knows.

    The paper's method does not ask for it. The fit takes it from the prior, which may be wrong;
    then it does not see the tower where that would be.
    """
    if isinstance(answer, Refusal) or answer.reference == "tower":
        return answer
    if prior.normal_w is not None and prior.side_is_sure:
        # Only the paper's method can contradict it: the fit was held to it.
        if float(answer.normal_w @ prior.normal_w) > 0:
            return answer
        return Refusal(RefusalCode.SIDE_UNKNOWN, "the rotor is seen from behind")
    radius = _radius_m(question)
    if tower_reference(points_w, answer.hub_w, answer.normal_w, DOWN_W, radius) is not None:
        return answer
    return Refusal(
        RefusalCode.SIDE_UNKNOWN, "no tower seen behind the rotor and no prior axis given"
    )


def _radius_m(question: Question) -> float:
    if question.turbine is not None:
        return question.turbine.rotor_radius_m
    return question.rotor_radius_m or DEFAULT_RADIUS_M


def _other_frame(
    cloud: RecordedCloud, refusal: Refusal, question: Question, settings: Settings
) -> str:
    fit = RotorFit(question.turbine, question.rotor_radius_m)
    nose_down_deg = settings.lidar.nose_down_deg
    return other_frame(cloud.points_w, _eye(cloud), fit, nose_down_deg, refusal.code)


def _missing(answer: CloudAnswer, refusal: Refusal, question: Question) -> str:
    """Return what the cloud does not show, or what a person could add."""
    missing = []
    if answer.found_by == "rotor":
        missing.append("no tower is seen that would tell hub and side")
    if question.hub_w is None:
        missing.append("a prior hub would help")
    if refusal.code is RefusalCode.SIDE_UNKNOWN and question.normal_w is None:
        missing.append("give the prior normal (from rotor to nacelle)")
    return ", ".join(missing) or "record again, nearer to the hub and in front of it"


def _eye(cloud: RecordedCloud) -> Float:
    origins = np.asarray(cloud.origins_w, np.float64)
    return origins if origins.ndim == 1 else np.asarray(np.median(origins, axis=0), np.float64)


def _unit(vector: Float | None) -> Float | None:
    if vector is None:
        return None
    values = np.asarray(vector, np.float64)
    return values / float(np.linalg.norm(values))
