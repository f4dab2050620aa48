"""Random setpoints near the true mesh, through the guard, judged by that mesh."""

from __future__ import annotations

import dataclasses
import math
import time
from functools import cache

import numpy as np

from config.settings import Settings
from config.simulation import Simulation, TruthDraws
from config.turbine import Site
from drivers.open3d_runtime import load_open3d
from drivers.simulated.mesh import join
from drivers.simulated.rotor_frame import rotor_frame
from drivers.simulated.scene import draw_scene
from drivers.simulated.turbine_mesh import turbine_meshes
from mission.flight.command import (
    Command,
    MissionState,
    Phase,
    Progress,
    SensingMode,
    SensingTask,
    Setpoint,
)
from mission.flight.guard import REST_S, Airspace, Guard, Surroundings
from mission.flight.observation import ClearanceState, FlightMode, Observation, Vehicle
from mission.flight.rotor_model import MeasuredBlade, rotor_model
from perception.clearance import OccupancyMemory
from tests.faults.fault import Seen

NOW = 100.0
#: Returns scattered over the whole turbine, of three scans, and what each is off by.
RETURNS, NOISE_M = 60_000, 0.02
AROUND_M = 30.0
#: The guard's own allowance for its points holds but for what their noise adds to it.
TOLERATED_M = 0.03


@dataclasses.dataclass(frozen=True, eq=False)
class World:
    """A turbine's true mesh, what the LiDAR's memory keeps of it, and the model fitted to it."""

    judge: object
    tensor: object
    points: np.ndarray
    memory: object
    model: object
    hub_w: np.ndarray
    sphere_m: float

    def distance(self, places):
        """Return the true distance (N,) of places (N, 3) to the mesh."""
        flat = np.asarray(places, np.float32)
        return self.judge.compute_distance(self.tensor(flat), nthreads=1).numpy()


@cache
def world(seed):
    settings = Settings(
        sites=(Site(name="t", turbine="windpact-1.5"),),
        simulation=Simulation(seed=seed, truth=TruthDraws()),
    )
    scene, rng = draw_scene(settings), np.random.default_rng(seed)
    meshes = turbine_meshes(scene)
    mesh = join([meshes.rotor, meshes.nacelle, meshes.tower])
    open3d = load_open3d()
    judge = open3d.t.geometry.RaycastingScene()
    tensor = open3d.core.Tensor
    judge.add_triangles(tensor(mesh.vertices), tensor(mesh.triangles))
    corners = mesh.vertices[mesh.triangles].astype(float)
    area = np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    chosen = rng.choice(len(corners), RETURNS, p=area / area.sum())
    u, v = rng.random((2, RETURNS, 1))
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    a, b, c = (corners[chosen, k] for k in range(3))
    points = a + u * (b - a) + v * (c - a)
    memory = OccupancyMemory()
    for scan, part in enumerate(np.array_split(points, 3)):
        memory.update(part + rng.normal(0, NOISE_M, part.shape), NOW + 0.1 * scan)
    frame = rotor_frame(scene)
    blades = [
        MeasuredBlade(name, tuple(blade.axis_w), pitch)
        for name, blade, pitch in zip("ABC", frame.blades, scene.pitch_deg, strict=True)
    ]
    hub = frame.hub_w + rng.normal(0, 0.1, 3)
    model = rotor_model(hub, frame.normal_w, blades, scene.turbine)
    sphere = scene.turbine.rotor_radius_m + settings.guard.closed_sphere_margin_m
    return World(judge, tensor, points, memory, model, frame.hub_w, sphere)


def drawn(rng, world, count):
    """Return places (N, 3) whose airframe is 8 to 20 m from the mesh."""
    feet = world.points[rng.integers(0, len(world.points), 2 * count)]
    away = rng.normal(0, 1, feet.shape)
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    places = feet + away * rng.uniform(8.95, 18.0, (len(feet), 1))
    apart = world.distance(places)
    good = (apart > 8.9) & (apart < 21.0) & (places[:, 2] > 12.0)
    return places[good][:count]


def asked(here, rng, phase=Phase.TRACK):
    """Return a command and the setpoint before it, both random."""
    lead, velocity = rng.normal(0, 0.8, 3), rng.normal(0, 1.2, 3)
    setpoint = Setpoint(tuple(here + lead), tuple(velocity), 0.0)
    before = Setpoint(tuple(here), tuple(velocity + rng.normal(0, 0.05, 3)), 0.0)
    progress = Progress(phase, MissionState.RUNNING, "")
    task = SensingTask(SensingMode.IDLE, 0)
    return Command(1, setpoint, None, None, None, None, task, progress), before


def observed(here, velocity):
    vehicle = Vehicle(
        stamp_s=NOW, position_w=tuple(here), velocity_w=tuple(velocity),
        quaternion_wb=(1.0, 0.0, 0.0, 0.0), yaw_rad=0.0, mode=FlightMode.OFFBOARD,
        mode_stamp_s=NOW, armed=True, in_air=True, landed=False, heartbeat_stamp_s=NOW,
    )  # fmt: skip
    return Observation(NOW, 1, vehicle, clearance=ClearanceState(NOW, 1, None, None))


def random_setpoints(count, seed, turbines=4):
    """Check so many setpoints; assert what was sent against the mesh; say what was found."""
    settings = Settings()
    guard, radius = Guard(settings), settings.airframe.radius_m
    passed = changed = refused = 0
    least, fastest_excess = math.inf, -math.inf
    start_s = time.process_time()
    for turbine in range(turbines):
        here_world = world(seed + turbine)
        rng = np.random.default_rng([seed, turbine])
        places = drawn(rng, here_world, count // turbines)
        while len(places) < count // turbines:
            more = drawn(rng, here_world, count // turbines - len(places))
            places = np.concatenate([places, more])
        found = _checked(guard, here_world, places, rng, radius)
        kinds, ends, now_m = found
        apart = here_world.distance(ends.reshape(-1, 3)).reshape(len(places), -1) - radius
        short = np.minimum(now_m, 8.0)[:, None] - apart
        assert short.max() <= TOLERATED_M, f"seed {seed}, turbine {turbine}: {short.max():.2f} m"
        least = min(least, float(apart.min()))
        fastest_excess = max(fastest_excess, float(short.max()))
        passed += int((kinds == 0).sum())
        changed += int((kinds == 1).sum())
        refused += int((kinds == 2).sum())
    took_s = time.process_time() - start_s
    assert min(passed, changed, refused) > count // 200, (passed, changed, refused)
    words = (
        f"{count} setpoints, {turbines} turbines, seed {seed}: {passed} passed, {changed} "
        f"changed, {refused} refused; what was sent ends no nearer than {least:.2f} m; "
        f"{took_s / count * 1e3:.2f} ms each"
    )
    return Seen(refused + changed, frozenset({"guard"}), end="clear", figure=words)


def _checked(guard, here_world, places, rng, radius):
    """Send a setpoint at each place through the guard; return kinds, ends and clearances."""
    kinds, ends = np.zeros(len(places), int), np.zeros((len(places), 4, 3))
    for k, here in enumerate(places):
        command, before = asked(here, rng)
        space = Airspace(
            here_world.hub_w, here_world.sphere_m, True,
            here_world.model if k % 3 else None, here[None], (0.0, 0.0, 0.0),
        )  # fmt: skip
        near = here_world.memory.around(here, AROUND_M).astype(float)
        points = near if k % 3 != 1 else near[::4]
        velocity = rng.normal(0, 0.3, 3)
        guarded = guard.check(
            command, observed(here, velocity), Surroundings(points, NOW), space, before
        )
        sent = guarded.command.setpoint
        kinds[k] = 2 if guarded.refused else int(sent != command.setpoint)
        position = np.array(sent.position_w)
        rest = position + REST_S * np.array(sent.velocity_w)
        ends[k] = here, position, (position + rest) / 2, rest
    return kinds, ends, here_world.distance(places) - radius
