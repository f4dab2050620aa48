"""The rotor in a recorded cloud, from Python."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from config.settings import Settings
    from config.turbine import Turbine
    from perception.cloud_estimate import CloudAnswer
    from perception.values import Float


def estimate(
    cloud: str | Path,
    *,
    viewpoint: Sequence[float] | None = None,
    poses: str | Path | None = None,
    time_offset_s: float | None = None,
    turbine: Turbine | None = None,
    rotor_diameter_m: float | None = None,
    prior_hub: Sequence[float] | None = None,
    prior_normal: Sequence[float] | None = None,
    settings: Settings | None = None,
) -> CloudAnswer:
    """Return the rotor that a cloud's file shows, or a refusal: `CloudAnswer.rotor` is either.

    World metres, z up. ``viewpoint``: where the sensor stood, unless the file or ``poses`` say it;
    ``prior_hub``: some 5 m wrong at most; ``prior_normal``: from rotor to nacelle. Raises
    `ValueError` with one sentence for what cannot be used (`drivers.bad_file.BadFile`,
    `perception.recorded_cloud.UnusableCloud`).
    """
    import numpy as np

    from config.settings import Settings
    from mission.records.recorded_cloud import load_cloud
    from perception.cloud_estimate import Question, estimate_cloud

    def vector(values: Sequence[float] | None) -> Float | None:
        return None if values is None else np.asarray(values, np.float64).reshape(3)

    settings = settings or Settings()
    placed = load_cloud(
        Path(cloud),
        settings.lidar,
        viewpoint_w=vector(viewpoint),
        poses_path=None if poses is None else Path(poses),
        time_offset_s=time_offset_s,
    )
    radius = None if rotor_diameter_m is None else rotor_diameter_m / 2
    question = Question(turbine, radius, vector(prior_hub), vector(prior_normal))
    return estimate_cloud(placed.cloud, question, settings)
