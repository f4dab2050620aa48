"""How long each step of perception takes, on one drawn turbine: `bladescout bench latency`.

Process CPU time is what a step costs whatever else the machine does; wall time beside it is what
the step waits as well. Medians and 99th percentiles over the repeats, after one run that is not
counted (compiled kernels are loaded in it).
"""

from __future__ import annotations

import itertools
import math
import os
import platform
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.latency_scene import Second, second_before_hub
from config.settings import Settings
from config.turbine import Turbine
from drivers.simulated.scanner import Scanner
from perception.blade_line import fit_blade_line
from perception.clearance import OccupancyMemory
from perception.deskew import points_in_world
from perception.exposure import exposure_control
from perception.exposure_limits import EvSteps
from perception.geometry import camera_looking_along, pinhole_matrix
from perception.grid_map import GridMap
from perception.metering import blade_outline, histogram_of, meter_outline
from perception.projection import project
from perception.ring_search import search_points, search_rings
from perception.rotor_fit import fit_rotor
from perception.rotor_plane import fit_rotor_plane
from perception.stop_angle import NEAREST_M, REACH_M, FermatEstimator
from perception.values import CameraPose, Float

MANY = 200_000
PASSES = 6
"""Of one run of the paper's loop, after which its grid map begins anew."""
SCAN_S = 0.1
PICTURE_PX = (1080, 1920)
AROUND_M, AROUND_POINTS = 30.0, 1500


@dataclass(frozen=True, slots=True)
class Row:
    """What one step took, milliseconds; ``goal_ms`` is what it may take (CPU, median)."""

    name: str
    points: int
    cpu_p50_ms: float
    cpu_p99_ms: float
    wall_p50_ms: float
    wall_p99_ms: float
    goal_ms: float | None = None
    real_time_ms: float | None = None
    """Sensor time that the step makes, for what is stated as a multiple of real time."""

    @property
    def met(self) -> bool | None:
        """Whether the median stays within the goal, None without a goal."""
        return None if self.goal_ms is None else self.cpu_p50_ms <= self.goal_ms

    @property
    def times_real(self) -> float | None:
        """How many times faster than real time, where that is what counts."""
        return None if self.real_time_ms is None else self.real_time_ms / self.cpu_p50_ms


@dataclass(frozen=True, slots=True)
class Machine:
    """On what, and beside what, it was measured."""

    cpu: str
    cores: int
    usable_cores: int
    load_1_min: float
    load_5_min: float
    python: str


@dataclass(frozen=True, slots=True, eq=False)
class Step:
    """Something to be timed, by itself."""

    name: str
    points: int
    run: Callable[[], object]
    goal_ms: float | None = None
    real_time_ms: float | None = None
    share: float = 1.0
    """Of the repeats: what takes long is repeated less."""


def machine() -> Machine:
    """Return the machine's figures as they are now."""
    one, five, _ = os.getloadavg()
    info = Path("/proc/cpuinfo")
    lines = info.read_text().splitlines() if info.exists() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    usable = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return Machine(
        names[0] if names else platform.processor() or platform.machine(),
        os.cpu_count() or 1, usable or 1, one, five, platform.python_version(),
    )  # fmt: skip


def measure(repeats: int, seed: int) -> Iterator[Row]:
    """Yield a row for each step, on the turbine that the seed draws."""
    second = second_before_hub(seed)
    for step in steps(second, seed):
        yield _timed(step, max(3, round(repeats * step.share)))


def _timed(step: Step, repeats: int) -> Row:
    step.run()
    cpu, wall = np.empty(repeats), np.empty(repeats)
    for k in range(repeats):
        wall_s, cpu_s = time.perf_counter(), time.process_time()
        step.run()
        cpu[k], wall[k] = time.process_time() - cpu_s, time.perf_counter() - wall_s
    (cpu50, cpu99), (wall50, wall99) = (
        (1e3 * np.quantile(values, [0.5, 0.99])).tolist() for values in (cpu, wall)
    )
    return Row(
        step.name, step.points, cpu50, cpu99, wall50, wall99, step.goal_ms, step.real_time_ms
    )


def steps(second: Second, seed: int) -> Iterator[Step]:
    """Yield all that is measured, as functions."""
    rng = np.random.default_rng(seed)
    numbers = rng.random(1_000_000)
    yield Step("yardstick: a million numbers sorted", len(numbers), lambda: np.sort(numbers))
    again = rng.integers(len(second.turbine_w), size=MANY)
    many = second.turbine_w[again] + rng.normal(0.0, 0.02, (MANY, 3))
    yield _fermat("the paper's method, one pass, a second", second.points_w, second, 5.0, 1.0)
    yield _fermat("the paper's method, one pass, 200 k points", many, second, 50.0, 0.3)
    yield from _parts_of_fermat(second)
    yield _fit("rotor fit, shape free, a second", second, None, 20.0)
    yield _fit("rotor fit, shape known, a second", second, second.turbine, 20.0)
    yield from _tracking(second)
    yield _exposure(second)
    yield _simulated(second, seed)


def _fermat(name: str, points: Float, second: Second, goal_ms: float, share: float) -> Step:
    settings = Settings()
    origins = np.broadcast_to(second.eye_w, points.shape)
    state = [FermatEstimator(settings.fermat)]

    def one_pass() -> object:
        if state[0].iterations == PASSES:
            state[0] = FermatEstimator(settings.fermat)
        return state[0].update(points, origins, second.prior_hub_w)

    return Step(name, len(points), one_pass, goal_ms, share=share)


def _parts_of_fermat(second: Second) -> Iterator[Step]:
    """Yield the steps of the paper's method by themselves, on the returns round the hub."""
    settings = Settings().fermat
    away = np.linalg.norm(second.points_w - second.hub_w, axis=1)
    points = np.ascontiguousarray(second.points_w[away < REACH_M])
    hub, normal, eye = second.hub_w, second.normal_w, second.eye_w
    yield Step(
        "  rotor plane",
        len(points),
        lambda: fit_rotor_plane(points, eye, threshold_m=settings.plane_threshold_m),
    )
    grid = GridMap(hub, half_m=settings.ring_radius_m + 10.0, resolution_m=settings.voxel_m)
    origins = np.broadcast_to(eye, points.shape)
    yield Step("  grid map", len(points), lambda: grid.fuse(points, origins))
    before_m = float((hub - eye) @ normal) - NEAREST_M
    centres = search_points(
        hub - before_m * normal, normal, settings.search_step_m, settings.search_count
    )
    yield Step(
        "  ring search",
        len(centres),
        lambda: search_rings(grid, centres, normal, settings.ring_radius_m, settings.ring_step_m),
    )


def _fit(name: str, second: Second, turbine: Turbine | None, goal_ms: float) -> Step:
    def fit() -> object:
        return fit_rotor(
            second.points_w,
            second.eye_w,
            prior_hub_w=second.prior_hub_w,
            prior_normal_w=second.normal_w,
            turbine=turbine,
            radius_m=second.turbine.rotor_radius_m,
        )

    return Step(name, len(second.points_w), fit, goal_ms)


def _tracking(second: Second) -> Iterator[Step]:
    """Yield what every scan goes through while a blade is followed."""
    settings, scan, poses = Settings(), second.scan, second.poses
    placed, origins = points_in_world(scan, poses, settings.lidar)
    yield Step(
        "scan put into the world",
        len(scan.points_l),
        lambda: points_in_world(scan, poses, settings.lidar),
    )
    memory = OccupancyMemory()
    stamps = itertools.count(0.0, SCAN_S)
    eye = origins[-1]

    def clearance() -> object:
        memory.update(placed, next(stamps), eye)
        return memory.nearest(eye), memory.around(eye, AROUND_M, AROUND_POINTS)

    yield Step("clearance and occupancy of a scan", len(placed), clearance)
    root, tip = second.blade_w
    yield Step(
        "line of the blade in a scan",
        len(placed),
        lambda: fit_blade_line(placed, eye, root, tip, 3.0, half_thickness_m=0.3),
    )


def _exposure(second: Second) -> Step:
    """Return the loop on one picture: project, mask, meter, histogram, control."""
    settings = Settings()
    height, width = PICTURE_PX
    grey = np.random.default_rng(0).integers(90, 170, PICTURE_PX, np.uint8)
    root, tip = second.blade_w
    middle = 0.5 * (root + tip)
    eye = middle - 12.0 * second.normal_w
    camera = CameraPose(0.0, eye, camera_looking_along(middle - eye))
    focal_px = settings.camera.focal_length_mm / settings.camera.sensor_width_mm * width
    matrix = pinhole_matrix(focal_px, width, height)
    blade = second.turbine.blade
    span = np.linspace(0.0, 1.0, 60)
    half_m = 0.3 * np.interp(span, blade.span, blade.chord_m)
    half_m = half_m * np.interp(span, blade.span, blade.thickness)
    control = exposure_control(settings.exposure, EvSteps.spaced(-3.0, 3.0, 1 / 3))
    control.confirmed(0.0, 0.0)
    stamps = itertools.count(0.0, SCAN_S)
    near_px = 4 * settings.exposure.disc_radius * width

    def loop() -> float:
        seen_px = project(middle, camera, matrix)
        outline = blade_outline(root, tip, half_m, camera, matrix)
        metered = meter_outline(grey, outline, seen_px, near_px)
        if metered is None:
            return math.nan
        return control.update(metered, next(stamps), histogram_of(grey))

    return Step("exposure of a picture of 1080 lines", width * height, loop, 1.0)


def _simulated(second: Second, seed: int) -> Step:
    """Return the casting of one scan in full azimuth, as the renderer does it."""
    scanner = Scanner(second.caster, second.history, Settings().lidar, seed)
    return Step(
        "simulated scan of 0.1 s",
        round(200_000 * SCAN_S),
        lambda: scanner.scan(0.2, SCAN_S),
        1e3 * SCAN_S / 15.0,
        1e3 * SCAN_S,
        share=0.5,
    )
