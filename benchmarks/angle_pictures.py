"""Pictures of the angle bench's scenes before hard backgrounds, as a wide camera takes them.

The scene's rotor, seen from where its scan was taken, with a gimbal aimed at the prior hub. What
makes the real thing hard is drawn: ridges, other turbines, a village, roads, cloud edges, a sun
behind the rotor, shadows, haze, an exposure that meters the whole frame, lens blur, noise, JPEG.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from benchmarks.angle_scenes import AngleScene
from benchmarks.picture_background import Backdrop, Site, draw_site
from benchmarks.picture_shading import shade
from benchmarks.picture_turbine import turbine_mesh
from drivers.open3d_runtime import load_open3d
from drivers.simulated.mesh import Mesh, Part, join
from perception.geometry import camera_looking_along, pinhole_matrix
from perception.values import Bytes, Float, Float32

_FINER = 2
"""Rays per pixel, each way."""


@dataclass(frozen=True, slots=True)
class PictureOptions:
    """The camera, and what it stands before."""

    width_px: int = 640
    height_px: int = 480
    field_of_view_deg: float = 66.0
    """Horizontal: a navigation camera, not the inspection camera's 22 deg."""
    backdrop: Backdrop | None = None
    """None: each kind equally often."""
    roll_deg: float = 1.0
    """Standard deviation of the camera's roll, which it reports."""
    roll_error_deg: float = 0.3
    """Standard deviation of that report."""
    aim_error_deg: float = 0.7


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """What a vision method is given, and what kind it is."""

    grey: Bytes
    """(H, W)"""
    roll_rad: float
    """As reported: the camera turned clockwise about its axis, seen from behind it."""
    matrix: Float
    """(3, 3)"""
    backdrop: Backdrop


def take_picture(scene: AngleScene, seed: int, options: PictureOptions | None = None) -> Picture:
    """Return the picture of a scene. The same scene, seed and options give the same picture."""
    opt = options or PictureOptions()
    rng = np.random.default_rng([seed, 0x1C])
    kinds = tuple(Backdrop)
    kind = kinds[int(rng.integers(len(kinds)))]
    kind = opt.backdrop or kind
    turbine = turbine_mesh(scene, rng)
    aim = scene.prior_hub_w - scene.viewpoint_w
    aim = aim / np.linalg.norm(aim) + rng.normal(0, math.radians(opt.aim_error_deg), 3)
    told = math.radians(rng.normal(0, opt.roll_deg))
    rolled = told + math.radians(rng.normal(0, opt.roll_error_deg))
    c, s = math.cos(rolled), math.sin(rolled)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])
    rotation = camera_looking_along(aim) @ turn
    site = draw_site(kind, aim, turbine, rng)
    half_tan = math.tan(math.radians(opt.field_of_view_deg) / 2)
    matrix = pinhole_matrix(opt.width_px / 2 / half_tan, opt.width_px, opt.height_px)
    radiance = _radiance(turbine, site, scene.viewpoint_w, rotation, matrix)
    return Picture(_developed(radiance, rng), told, matrix, kind)


def _radiance(turbine: Mesh, site: Site, eye_w: Float, rotation: Float, matrix: Float) -> Float32:
    """Return (H, W) radiance by `_FINER` x `_FINER` rays a pixel."""
    width, height = int(2 * matrix[0, 2]), int(2 * matrix[1, 2])
    u = (np.arange(width * _FINER) + 0.5) / _FINER
    v = (np.arange(height * _FINER) + 0.5) / _FINER
    x = (u - matrix[0, 2]) / matrix[0, 0]
    y = (v - matrix[1, 2]) / matrix[1, 1]
    rays = np.stack([*np.meshgrid(x, y), np.ones((len(y), len(x)))], axis=-1).reshape(-1, 3)
    rays = (rays / np.linalg.norm(rays, axis=1, keepdims=True) @ rotation.T).astype(np.float32)
    mesh = join([turbine, site.mesh])
    out = _shaded(mesh, site, eye_w.astype(np.float32), rays)
    # Light adds up before the lens and the sensor do anything to it; the sun's own disc is capped.
    fine = np.minimum(out, 12.0).reshape(height, _FINER, width, _FINER)
    return np.asarray(fine.mean(axis=(1, 3)), np.float32)


def _shaded(mesh: Mesh, site: Site, eye: Float32, rays: Float32) -> Float32:
    open3d = load_open3d()
    tensor = open3d.core.Tensor
    caster = open3d.t.geometry.RaycastingScene(nthreads=1)
    caster.add_triangles(tensor(mesh.vertices), tensor(mesh.triangles))
    packed = np.concatenate([np.broadcast_to(eye, rays.shape), rays], axis=1)
    answer = caster.cast_rays(tensor(packed), nthreads=1)
    ranges = answer["t_hit"].numpy()
    hit = np.isfinite(ranges)
    triangle = answer["primitive_ids"].numpy()[hit].astype(np.int64)
    uv = answer["primitive_uvs"].numpy()[hit]
    weights = np.stack([1 - uv[:, 0] - uv[:, 1], uv[:, 0], uv[:, 1]], axis=1)
    corner = mesh.triangles[triangle]
    normals = np.zeros_like(rays)
    smooth = np.einsum("nk,nkj->nj", weights, mesh.normals[corner])
    normals[hit] = smooth / np.maximum(np.linalg.norm(smooth, axis=1, keepdims=True), 1e-6)
    metres = np.zeros(len(rays), np.float32)
    metres[hit] = np.einsum("nk,nk->n", weights, mesh.metre[corner])
    parts = np.full(len(rays), int(Part.SKY), np.uint8)
    parts[hit] = mesh.part[triangle]
    sunlit = np.zeros(len(rays), bool)
    start = eye + rays[hit] * ranges[hit, None] + 0.03 * normals[hit]
    towards = np.broadcast_to(site.light.sun_w, start.shape)
    shadow = np.concatenate([start, towards], axis=1).astype(np.float32)
    sunlit[hit] = ~caster.test_occlusions(tensor(shadow), 0.02, 4000.0, 1).numpy()
    return np.asarray(
        shade(
            parts, normals, metres, sunlit, rays, ranges, eye, site.light.packed(),
            site.site, site.roads, site.trails,
        ),
        np.float32,
    )  # fmt: skip


def _developed(radiance: Float32, rng: np.random.Generator) -> Bytes:
    """Return the grey picture: glare, exposure by the frame's mean, blur, noise, JPEG."""
    height, width = radiance.shape
    glare = cv2.GaussianBlur(np.minimum(radiance, 8.0), (0, 0), width / 12)
    light = 0.96 * radiance + 0.04 * glare
    light = cv2.GaussianBlur(light, (0, 0), float(rng.uniform(0.45, 0.8)) * width / 640)
    x, y = np.meshgrid(np.linspace(-1, 1, width), np.linspace(-1, 1, height))
    light = light * (1 - rng.uniform(0.05, 0.2) * (x**2 + y**2) / 2)
    # A meter that does not let the sun itself count for more than white.
    mean = float(np.minimum(light, 1.5).mean())
    exposed = np.clip(light * 0.26 / mean * 2.0 ** rng.normal(0, 0.4), 0, 1)
    electrons = float(rng.choice([1500.0, 4000.0, 9000.0]))
    counted = exposed + np.sqrt(exposed / electrons + 1.5e-6) * rng.normal(size=exposed.shape)
    tone = np.clip(counted, 0, 1) ** (1 / 2.2)
    tone = 0.5 * tone + 0.5 * tone**2 * (3 - 2 * tone)  # the contrast that cameras add
    grey = np.round(255 * tone).astype(np.uint8)
    quality = int(rng.integers(70, 93))
    packed = cv2.imencode(".jpg", grey, (cv2.IMWRITE_JPEG_QUALITY, quality))[1]
    return np.asarray(cv2.imdecode(packed, cv2.IMREAD_GRAYSCALE), np.uint8)
