"""Scenes of the angle bench: a stopped turbine, seen by a MID-360 that errs as real ones do.

Independent of `perception`'s estimators: their constants are not known here and vice versa.
World ENU, metres. Truth is expressed in the frame of the returned points.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.angle_sites import Site, site_parts
from benchmarks.blade_family import Planform, TowerShape, blade_mesh, draw_planform, known_turbine
from config.turbine import Turbine
from drivers.open3d_runtime import load_open3d
from perception.geometry import lidar_in_body, rotation_from_euler
from perception.rotor import direction_at
from perception.values import Float

RATE_HZ = 200_000
DETECTABLE = 3.9e-5
"""Reflectivity x cos(incidence) x attenuation / range^2 at which half the pulses are detected."""
CLEAR_M = 8.5
"""The guard's 8 m, and half a metre."""

Array = NDArray[Any]  # vertices, triangles, float32 rays: whatever Open3D takes


def _tensor(values: Array) -> Any:
    return load_open3d().core.Tensor(values)


@dataclass(frozen=True, slots=True)
class SceneOptions:
    """What is drawn; each field can be fixed for a stratum or an ablation."""

    stand_off_m: tuple[float, float] = (20.0, 30.0)
    prior_error_m: tuple[float, float] = (0.0, 3.0)
    pitch_deg: tuple[float, float] | None = None
    """None: the field mix (40 % at 0-5, 45 % at 82-90, 15 % between)."""
    seconds: float = 1.0
    window_deg: float = 360.0
    fog_per_m: float = 0.0
    droop: bool = True
    lean: bool = True
    attitude_deg: float = 0.5
    extrinsic_deg: float = 0.3
    pose_noise_m: float = 0.03
    """Short noise of the told position (time constant 0.3 s); a walk of 0.2 m (60 s) beside it."""
    range_bias_m: float = 0.02
    spacing_deg: float = 0.2
    """Blade bearings stand this far from even, at most."""
    sway_m: float = 0.12
    """Amplitude of the tower top, at most."""
    prebend: bool = True
    mixed: bool = True
    """Whether pulses split by an edge return between the two surfaces."""
    feather_one: float = 0.05
    """Share of scenes with one blade 90 deg from the others."""
    models: tuple[str, ...] | None = None
    """Blade families to draw from (`blade_family.published_models`, `DRAWN`); None: all."""
    site: Site = Site.FIELDS


@dataclass(frozen=True, slots=True, eq=False)
class AngleScene:
    """One look at a rotor, and the truth about it."""

    points_w: Float
    origins_w: Float
    viewpoint_w: Float
    prior_hub_w: Float
    prior_normal_w: Float
    down_w: Float
    turbine: Turbine
    """As its owner knows it."""
    radius_m: float
    stop_angle_deg: float
    """Of the first blade's own axis, its bearing's place included (design, Definitions)."""
    hub_w: Float
    normal_w: Float
    tower_down_w: Float
    pitch_deg: tuple[float, float, float]
    """At stop angle + 0, 120, 240 deg."""
    directions_w: Float
    """(3, 3) true axis of each blade, a row each: bearing and cone included."""
    time_s: Float
    """(N,) when each point was measured, from the first frame on."""
    plan: Planform = field(repr=False)
    site: Site = Site.FIELDS


@dataclass(frozen=True, slots=True, eq=False)
class World:
    """A turbine, its truth in world ENU, metres."""

    scene: Any  # open3d's RaycastingScene has no types
    hub: Float
    normal: Float
    tower_down: Float
    stop_angle_deg: float
    pitch: tuple[float, float, float]
    directions: Float
    plan: Planform
    turbine: Turbine


@dataclass(frozen=True, slots=True, eq=False)
class Approach:
    """What one flight knows of a turbine beforehand, and how it errs throughout."""

    prior_hub_w: Float
    prior_normal_w: Float
    stand_off_m: float
    attitude: Float
    """(3, 3) told world from true world."""
    extrinsic: Float
    """(3, 3) of the mounting, as it is from as it is told."""


def make_scene(seed: int, options: SceneOptions | None = None) -> AngleScene:
    """Return the scene of a seed. The same seed and options give the same scene."""
    opt = options or SceneOptions()
    rng = np.random.default_rng([seed, 77])
    world = build_world(rng, opt, seed)
    approach = draw_approach(world, rng, opt)
    start = approach.prior_hub_w - approach.prior_normal_w * approach.stand_off_m
    return look(world, approach, clear_place(world, start, approach.prior_normal_w), rng, opt)


def _draw_pitch(rng: np.random.Generator, opt: SceneOptions) -> tuple[float, float, float]:
    if opt.pitch_deg is not None:
        base = rng.uniform(*opt.pitch_deg)
    else:
        kind = rng.random()
        base = (
            rng.uniform(0, 5)
            if kind < 0.40
            else rng.uniform(82, 90)
            if kind < 0.85
            else rng.uniform(5, 82)
        )
    each = base + rng.uniform(-1.5, 1.5, 3)
    # Bearings turn from fine pitch to feather: a quarter turn from between would leave that range.
    odd, k = rng.random() < opt.feather_one, int(rng.integers(3))
    if odd and not 8.0 < base < 78.0:
        each[k] += 90.0 if base < 45 else -90.0
    return float(each[0]), float(each[1]), float(each[2])


def _cylinder(a: Float, b: Float, r0: float, r1: float, n: int = 48) -> tuple[Float, Array]:
    axis = (b - a) / np.linalg.norm(b - a)
    side = np.cross(axis, [0.3, 0.9, 0.1])
    side = side / np.linalg.norm(side)
    other = np.cross(axis, side)
    t = np.linspace(0, 2 * np.pi, n, endpoint=False)[:, None]
    ring = np.cos(t) * side + np.sin(t) * other
    v = np.concatenate([a + r0 * ring, b + r1 * ring, a[None], b[None]])
    i = np.arange(n)
    j = (i + 1) % n
    faces = np.concatenate(
        [
            np.stack([i, j, i + n], 1),
            np.stack([j, j + n, i + n], 1),
            np.stack([j, i, np.full(n, 2 * n)], 1),
            np.stack([i + n, j + n, np.full(n, 2 * n + 1)], 1),
        ]
    )
    return v, faces


def build_world(rng: np.random.Generator, opt: SceneOptions, seed: int) -> World:
    """Draw a turbine and put it on its site; ``seed`` is the site's."""
    plan = draw_planform(rng, opt.models)
    length = plan.length_m
    tilt, cone = rng.uniform(0.0, 8.0), rng.uniform(-1.0, 5.0)
    yaw = rng.uniform(-np.pi, np.pi)
    level = np.array([math.cos(yaw), math.sin(yaw), 0.0])
    tilt_rad = math.radians(tilt)
    normal = math.cos(tilt_rad) * level - math.sin(tilt_rad) * np.array([0, 0, 1.0])
    lean = np.deg2rad(np.clip(rng.normal(0, 0.25, 2), -0.5, 0.5)) * (1.0 if opt.lean else 0.0)
    tower_up = np.array([lean[0], lean[1], 1.0])
    tower_up /= np.linalg.norm(tower_up)
    # Steel towers of 1.5-5 MW machines: 2.0-3.9 m across at the top.
    top_radius = rng.uniform(1.0, 1.3) + 0.65 * (length - 25.0) / 40.0 * rng.uniform(0.2, 1.0)
    overhang = max(rng.uniform(3.0, 4.2) * math.sqrt(length / 45.0), top_radius + 1.6)
    height = 1.25 * length + rng.uniform(10, 35)
    tower_top = tower_up * (height - 2.0)
    hub = tower_top + np.array([0, 0, 2.0]) - overhang * normal
    first, pitch = rng.uniform(0, 120), _draw_pitch(rng, opt)
    if not opt.droop:
        plan = replace(plan, sag_flap=0.0, sag_edge=0.0)
    if not opt.prebend:
        plan = replace(plan, prebend_m=np.zeros_like(plan.prebend_m))
    base_radius = top_radius * rng.uniform(1.25, 1.9)
    parts = [_cylinder(tower_up * 0.0, tower_top, base_radius, top_radius)]
    parts += _nacelle(hub, normal, plan, overhang)
    angles = _spaced(rng, first, opt.spacing_deg)
    directions = []
    for k in range(3):
        a = math.radians(angles[k])
        z = direction_at(a, normal, -tower_up, math.radians(cone))
        x = direction_at(a + math.pi / 2, normal, -tower_up)
        y = np.cross(z, x)
        y = y if y @ normal > 0 else -y
        vertices, faces = blade_mesh(plan, pitch[k], (float(-x[2]), float(-y[2])), 1.0)
        parts.append((hub + vertices @ np.stack([x, y, z]), faces))
        directions.append(z)
    parts += site_parts(opt.site, hub, normal, plan.radius_m, seed)
    scene = load_open3d().t.geometry.RaycastingScene(nthreads=1)
    for vertices, faces in parts:
        scene.add_triangles(_tensor(vertices.astype(np.float32)), _tensor(faces.astype(np.uint32)))
    told = np.random.default_rng([seed, 0x70]).uniform(0.98, 1.02, 2)  # of the diameters
    tower = TowerShape(
        float(hub[2]), height - 2.0, 2 * base_radius * told[0], 2 * top_radius * told[1]
    )
    turbine = known_turbine(plan, tilt, cone, overhang, tower, rng)
    return World(
        scene, hub, normal, -tower_up, angles[0], pitch, np.stack(directions), plan, turbine
    )


def _nacelle(
    hub: Float, normal: Float, plan: Planform, overhang: float
) -> list[tuple[Float, Array]]:
    r = plan.hub_radius_m * 1.05 + 0.5 * float(plan.chord_m[0])
    body = _cylinder(hub - 0.7 * r * normal, hub + 0.7 * r * normal, 0.75 * r, 0.9 * r)
    nose = _cylinder(hub - 1.3 * r * normal, hub - 0.7 * r * normal, 0.3 * r, 0.75 * r)
    w = 0.045 * plan.length_m + 0.6
    hull = _cylinder(hub + 0.7 * r * normal, hub + (overhang + 4 * w) * normal, w * 0.8, w * 0.9, 8)
    return [body, nose, hull]


def _rays(rng: np.random.Generator, count: int, window_deg: float) -> Float:
    """Directions in the sensor's frame, evenly over 360 x (-7..52) deg, with angular noise."""
    k = np.arange(count) + rng.integers(1 << 20)
    azimuth = 2 * np.pi * ((k * 0.7548776662466927) % 1.0) - np.pi
    elevation = np.deg2rad(-7.0 + 59.0 * ((k * 0.5698402909980532) % 1.0))
    keep = np.abs(np.rad2deg(azimuth)) <= window_deg / 2
    azimuth, elevation = azimuth[keep], elevation[keep]
    return np.stack(
        [
            np.cos(elevation) * np.cos(azimuth),
            np.cos(elevation) * np.sin(azimuth),
            np.sin(elevation),
        ],
        axis=1,
    )


def draw_approach(world: World, rng: np.random.Generator, opt: SceneOptions) -> Approach:
    """Draw prior hub and axis, stand-off and the errors that last the whole flight."""
    direction = rng.normal(size=3)
    direction /= np.linalg.norm(direction)
    prior_hub = world.hub + direction * rng.uniform(*opt.prior_error_m)
    prior_yaw = math.atan2(world.normal[1], world.normal[0]) + math.radians(rng.normal(0, 4.0))
    prior_normal = np.array([math.cos(prior_yaw), math.sin(prior_yaw), 0.0])
    stand_off = rng.uniform(*opt.stand_off_m)
    attitude = rotation_from_euler(*np.deg2rad(rng.normal(0, opt.attitude_deg, 3)))
    extrinsic = rotation_from_euler(*np.deg2rad(rng.normal(0, opt.extrinsic_deg, 3)))
    return Approach(prior_hub, prior_normal, stand_off, attitude, extrinsic)


def clear_place(world: World, place: Float, normal: Float) -> Float:
    """Return the first place upwind of one, against ``normal``, that is clear of everything."""
    while _distance(world, place) < CLEAR_M:
        place = place - normal * 0.5
    return place


def look(
    world: World, approach: Approach, view: Float, rng: np.random.Generator, opt: SceneOptions
) -> AngleScene:
    """Return what is measured from a true place ``view`` (3,)."""
    prior_normal, err, extrinsic = approach.prior_normal_w, approach.attitude, approach.extrinsic
    prior_yaw = math.atan2(prior_normal[1], prior_normal[0])
    sensor_body = lidar_in_body(23.0)
    frames = max(1, round(opt.seconds * 10))
    wander = np.cumsum(rng.normal(0, 0.03, (frames, 3)), axis=0)
    jitter = _markov(rng, frames, 0.2, 60.0) + _markov(rng, frames, opt.pose_noise_m, 0.3)
    sway = _sway(rng, frames, opt.sway_m)
    points, origins, times = [], [], []
    for f in range(frames):
        tilt = np.deg2rad(rng.normal(0, 1.0, 2))
        true_body = rotation_from_euler(tilt[0], tilt[1], prior_yaw)
        # The tower's top moves; it is the same to move the sensor the other way.
        p_true, p_told = view + wander[f] - sway[f], view + wander[f] + jitter[f]
        rays = _rays(rng, RATE_HZ // 10, opt.window_deg)
        d_l = rays + rng.normal(0, math.radians(0.05), rays.shape)
        ranges, keep = _cast(world, p_true, d_l @ (true_body @ sensor_body @ extrinsic).T, rng, opt)
        told = err @ true_body @ sensor_body
        points.append(p_told + (rays[keep] * ranges[:, None]) @ told.T)
        origins.append(np.broadcast_to(p_told, (len(ranges), 3)))
        times.append(np.full(len(ranges), 0.1 * f))
    mean_true = view + wander.mean(0) - sway.mean(0)
    mean_told = view + wander.mean(0) + jitter.mean(0)
    # Truth in the told frame: the extrinsic error turns the cloud about the vehicle as well.
    middle = rotation_from_euler(0.0, 0.0, prior_yaw) @ sensor_body
    turn = err @ middle @ extrinsic.T @ middle.T
    return AngleScene(
        np.concatenate(points),
        np.concatenate(origins),
        mean_told,
        approach.prior_hub_w,
        prior_normal,
        np.array([0.0, 0.0, -1.0]),
        world.turbine,
        world.plan.radius_m,
        world.stop_angle_deg,
        mean_told + turn @ (world.hub - mean_true),
        turn @ world.normal,
        turn @ world.tower_down,
        world.pitch,
        world.directions @ turn.T,
        np.concatenate(times),
        world.plan,
        opt.site,
    )


def _spaced(rng: np.random.Generator, first_deg: float, spacing_deg: float) -> list[float]:
    """Return the three blades' angles, the first in [0, 120), each off its even place."""
    while True:
        spaced = [first_deg + 120 * k + rng.uniform(-1, 1) * spacing_deg for k in range(3)]
        # A bearing's own error may carry the first blade over the cut.
        shift = next((k for k in range(3) if spaced[k] % 360 < 120), None)
        if shift is not None:
            return [spaced[(shift + k) % 3] % 360 for k in range(3)]


def _markov(rng: np.random.Generator, frames: int, sigma_m: float, time_s: float) -> Float:
    """Return (frames, 3) of a Gauss-Markov error at 10 Hz."""
    keep = math.exp(-0.1 / time_s)
    values = [rng.normal(0, sigma_m, 3)]
    for _ in range(frames - 1):
        values.append(values[-1] * keep + math.sqrt(1 - keep**2) * rng.normal(0, sigma_m, 3))
    return np.array(values)


def _sway(rng: np.random.Generator, frames: int, most_m: float) -> Float:
    """Return (frames, 3) displacements of the tower's top: its first mode, any direction."""
    bearing, phase = rng.uniform(0, 2 * math.pi, 2)
    time_s = 0.1 * np.arange(frames)
    swing = rng.uniform(0, most_m) * np.sin(2 * math.pi * rng.uniform(0.15, 0.45) * time_s + phase)
    return np.outer(swing, [math.cos(bearing), math.sin(bearing), 0.0])


def _distance(world: World, point: Float) -> float:
    query = _tensor(np.asarray(point, np.float32)[None])
    return float(world.scene.compute_distance(query, nthreads=1).numpy()[0])


def _cast(
    world: World, origin: Float, rays: Float, rng: np.random.Generator, opt: SceneOptions
) -> tuple[Float, Array]:
    """Return measured ranges of detected pulses and their indices among the rays."""
    n = len(rays)
    packed = np.empty((n, 6), np.float32)
    packed[:, :3], packed[:, 3:] = origin, rays
    answer = world.scene.cast_rays(_tensor(packed), nthreads=1)
    t = answer["t_hit"].numpy().astype(float)
    normals = answer["primitive_normals"].numpy()
    with np.errstate(invalid="ignore"):
        cos_inc = np.abs(np.einsum("ij,ij->i", normals, packed[:, 3:])) / np.linalg.norm(
            packed[:, 3:], axis=1
        )
        ground = origin[2] + t * rays[:, 2] < 0.05
        link = np.where(ground, 0.25, 0.8) * cos_inc * np.exp(-2 * opt.fog_per_m * t) / t**2
    seen = np.isfinite(t) & (t < 70.0)
    chance = np.zeros(n)
    chance[seen] = 1 / (1 + (DETECTABLE / link[seen]) ** 4)
    chance *= np.clip((np.deg2rad(88) - np.arccos(np.clip(cos_inc, 0, 1))) / np.deg2rad(10), 0, 1)
    hit = np.flatnonzero(rng.random(n) < chance)
    sigma = np.hypot(0.0034, 0.00073 * t[hit]) / np.clip(cos_inc[hit], 0.05, 1) ** 0.78
    ranges = t[hit] + rng.normal(0, 1, len(hit)) * sigma + opt.range_bias_m
    if opt.mixed:
        ranges = _mix_edges(world, packed[hit], t[hit], ranges, rng)
    if opt.fog_per_m > 0:
        share = 1 - math.exp(-opt.fog_per_m * 0.8)
        fog = np.flatnonzero(rng.random(n) < share * 0.05)
        near = rng.exponential(3.0, len(fog)) + 0.5
        free = near < np.where(np.isfinite(t[fog]), t[fog], 70.0)
        hit, ranges = np.concatenate([hit, fog[free]]), np.concatenate([ranges, near[free]])
    return ranges, hit


def _mix_edges(
    world: World, packed: Array, t: Float, ranges: Float, rng: np.random.Generator
) -> Float:
    """Pulses split by an edge return a range between the two surfaces, at times."""
    beside = packed.copy()
    beside[:, 3:] += rng.normal(0, math.radians(0.08), (len(packed), 3)).astype(np.float32)
    other = world.scene.cast_rays(_tensor(beside), nthreads=1)["t_hit"].numpy()
    gap = other.astype(float) - t
    mixed = (
        np.isfinite(gap) & (np.abs(gap) > 0.3) & (np.abs(gap) < 3.0) & (rng.random(len(t)) < 0.4)
    )
    return np.where(mixed, ranges + rng.random(len(t)) * np.where(mixed, gap, 0.0), ranges)
