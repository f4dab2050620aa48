"""The baselines as rows of the angle bench: each answers a scene, as one function."""

from __future__ import annotations

import time
from typing import NamedTuple

from benchmarks.angle_pictures import PictureOptions, take_picture
from benchmarks.angle_scenes import AngleScene
from benchmarks.angle_sites import BACKDROPS
from perception.baselines.line_fit import Variant, fit_rotor_by_lines
from perception.baselines.stokkeland import estimate_stop_angle
from perception.baselines.vision_angle import VisionRefusal
from perception.rotor import Refusal


class Outcome(NamedTuple):
    """What a method said about a scene."""

    angle_deg: float | None
    refusal: str
    """Empty where there is an angle."""
    seconds: float
    """Of the estimate alone; drawing the picture is not counted."""


def evaluate_line_fit(scene: AngleScene, variant: Variant = Variant.TWO_LINES) -> Outcome:
    """Answer by plane and lines, on the scene's own cloud."""
    start = time.perf_counter()
    answer = fit_rotor_by_lines(
        scene.points_w, scene.origins_w, scene.prior_hub_w, variant=variant, down_w=scene.down_w
    )
    took = time.perf_counter() - start
    if isinstance(answer, Refusal):
        return Outcome(None, answer.text, took)
    return Outcome(answer.stop_angle_deg, "", took)


def evaluate_vision(
    scene: AngleScene, seed: int | None = None, options: PictureOptions | None = None
) -> Outcome:
    """Answer by Hough lines and a vote, on a picture taken from where the scene was scanned.

    Without a ``seed`` the picture's surroundings follow from the scene itself; without
    ``options`` they are those of its site.
    """
    drawn = int(scene.stop_angle_deg * 1e7) if seed is None else seed
    picture = take_picture(scene, drawn, options or PictureOptions(backdrop=BACKDROPS[scene.site]))
    start = time.perf_counter()
    answer = estimate_stop_angle(picture.grey, picture.roll_rad, picture.matrix)
    took = time.perf_counter() - start
    if isinstance(answer, VisionRefusal):
        return Outcome(None, answer.text, took)
    return Outcome(answer.stop_angle_deg, "", took)
