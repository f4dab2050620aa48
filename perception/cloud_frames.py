"""Is a cloud in the world frame at all? What else it looks like, in words.

A rotor turned about its own shaft is a rotor still, with another angle: only its tower tells. And
a cloud that shows no rotor may show one as soon as it is turned by one of the usual mistakes.
"""

from __future__ import annotations

import numpy as np

from perception.estimator import RotorFit
from perception.geometry import lidar_in_body
from perception.rotor import Refusal, RefusalCode, Rotor, down_in_plane, right_in_plane
from perception.stop_angle import DOWN_W
from perception.tower_reference import tower_reference
from perception.values import Float

BESIDE_M = 4.0
"""Of a tower that is seen where none can be."""
ENOUGH = 40_000
_Y_UP: Float = np.array([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]])


def with_tower_below(answer: Rotor | Refusal, points_w: Float, radius_m: float) -> Rotor | Refusal:
    """Return the answer, a refusal where the tower stands beside or above the hub instead."""
    if isinstance(answer, Refusal) or answer.reference == "tower":
        return answer
    under = down_in_plane(answer.normal_w, DOWN_W)
    right = right_in_plane(answer.normal_w, DOWN_W)
    if tower_reference(points_w, answer.hub_w, answer.normal_w, under, radius_m) is not None:
        return answer
    for other in (-under, right, -right):
        tower = tower_reference(points_w, answer.hub_w, answer.normal_w, other, radius_m)
        if tower is not None and tower.length_m > BESIDE_M:
            return Refusal(
                RefusalCode.NOT_A_ROTOR, "the tower stands beside or above the hub: z is not up"
            )
    return answer


def other_frame(
    points_w: Float, eye_w: Float, estimator: RotorFit, nose_down_deg: float, code: RefusalCode
) -> str:
    """Return in words in which frame a refused cloud seems to be, empty where in none of them.

    ``points_w``: (N, 3); ``eye_w``: (3,) where the sensor stood; ``code``: of the refusal: a frame
    in which the side alone is missing is better than one in which nothing is found.
    """
    frames = {
        f"it seems to be in the sensor's own frame, {nose_down_deg:g} deg nose down: give the "
        "poses": lidar_in_body(nose_down_deg),
        "its y axis seems to point up: turn it so that z does": _Y_UP,
        "its y axis seems to point down, as in a camera's frame: turn it so that z points up": (
            _Y_UP.T
        ),
    }
    points = points_w[:: max(1, len(points_w) // ENOUGH)] - eye_w
    best, said = 0, ""
    for text, turn in frames.items():
        answer = estimator.update(
            points @ turn.T, np.zeros(3), 0.0, prior_hub_w=None, prior_normal_w=None
        )
        if isinstance(answer, Refusal):
            side_alone = answer.code is RefusalCode.SIDE_UNKNOWN
            worth = int(side_alone and code is not RefusalCode.SIDE_UNKNOWN)
        else:
            worth = 3 if answer.reference == "tower" else 2
        if worth > best:
            best, said = worth, text
    return said
