"""The rotor in a recorded cloud, from Python."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from numpy.typing import ArrayLike

if TYPE_CHECKING:
    from config.settings import Settings
    from config.turbine import Turbine
    from perception.cloud_estimate import CloudAnswer
    from perception.recorded_cloud import RecordedCloud
    from perception.values import Float


def estimate(
    cloud: str | Path | ArrayLike,
    *,
    viewpoint: ArrayLike | None = None,
    time_s: ArrayLike | None = None,
    poses: str | Path | None = None,
    time_offset_s: float | None = None,
    turbine: Turbine | str | None = None,
    rotor_diameter_m: float | None = None,
    prior_hub: Sequence[float] | None = None,
    prior_normal: Sequence[float] | None = None,
    settings: Settings | None = None,
) -> CloudAnswer:
    """Return the rotor that a cloud shows, or a refusal: `CloudAnswer.rotor` is either.

    Args:
        cloud: A file (NPZ, PCD, PLY, LVX2, PCAP, PCAPNG), or an array (N, 3). Metres, z up.
        viewpoint: (3,) where the sensor stood, or (N, 3) for each point; where neither the file nor
            ``poses`` say it.
        time_s: (N,) when each point of an array was measured; without it: as one look.
        poses: A file of poses, for a recording in the sensor's own frame.
        time_offset_s: Added to the recording's times to get the poses'.
        turbine: The type, or its name in config/turbines, where it is known.
        rotor_diameter_m: Where the type is not known, but the size is.
        prior_hub: (3,) about where the hub is, within 5 m.
        prior_normal: (3,) from rotor to nacelle, within 40 degrees.
        settings: The method (`estimation.method`) and how the LiDAR is mounted.

    Raises:
        ValueError: What was given cannot be used; the text is one sentence with the remedy
            (`drivers.bad_file.BadFile`, `perception.recorded_cloud.UnusableCloud`,
            `config.errors.ConfigError`).
    """
    import numpy as np

    from config.presets import load_turbine
    from config.settings import Settings
    from mission.records.recorded_cloud import load_cloud
    from perception.cloud_estimate import Question, estimate_cloud

    def vector(values: Sequence[float] | None) -> Float | None:
        return None if values is None else np.asarray(values, np.float64).reshape(3)

    settings = settings or Settings()
    if isinstance(cloud, str | Path):
        if time_s is not None:
            raise ValueError("time_s is of an array: a file says the times of its points itself")
        eye = None if viewpoint is None else np.asarray(viewpoint, np.float64)
        recorded = load_cloud(
            Path(cloud),
            settings.lidar,
            viewpoint_w=eye,
            poses_path=None if poses is None else Path(poses),
            time_offset_s=time_offset_s,
        ).cloud
    else:
        if poses is not None or time_offset_s is not None:
            raise ValueError("poses are for files: give an array in the world, with its viewpoint")
        recorded = _from_array(cloud, viewpoint, time_s)
    radius = None if rotor_diameter_m is None else rotor_diameter_m / 2
    known = load_turbine(turbine) if isinstance(turbine, str) else turbine
    question = Question(known, radius, vector(prior_hub), vector(prior_normal))
    return estimate_cloud(recorded, question, settings)


def _from_array(
    cloud: ArrayLike, viewpoint: ArrayLike | None, time_s: ArrayLike | None
) -> RecordedCloud:
    """Return an array as a recorded cloud. Raises `ValueError` where shapes do not fit."""
    import numpy as np

    from drivers.clouds.cloud_file import float_step_m
    from perception.recorded_cloud import RecordedCloud

    points = np.asarray(cloud)
    if points.ndim != 2 or points.shape[1] != 3:
        raise ValueError(f"cloud has shape {points.shape}: (N, 3) is wanted, x y z in metres")
    if viewpoint is None:
        raise ValueError("viewpoint is missing: where did the sensor stand, in the cloud's frame?")
    eye = np.asarray(viewpoint, np.float64)
    if eye.shape not in ((3,), points.shape):
        raise ValueError(f"viewpoint has shape {eye.shape}: (3,) or {points.shape} is wanted")
    times = None if time_s is None else np.asarray(time_s, np.float64)
    if times is not None and times.shape != points.shape[:1]:
        raise ValueError(f"time_s has shape {times.shape}: {points.shape[:1]} is wanted")
    return RecordedCloud(points.astype(np.float64), eye, times, float_step_m(points))
