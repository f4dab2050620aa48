"""Writes the clouds of this folder anew: ``python tests/clouds/make_clouds.py``.

A small turbine of the simulator, seen by its MID-360: an ascent, then a second of hovering before
the hub, thinned so that the files stay small. PCD and PLY are written by Open3D, so that our
readers are held to another's writer; LVX2 and PCAP hold the packets that show the most of it.
"""

from __future__ import annotations

import json
import math
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from config.settings import Settings
from config.simulation import Simulation, TruthDraws
from config.turbine import Site
from drivers.livox.capture import datagram_of, write_capture
from drivers.livox.lvx2 import write_lvx2
from drivers.livox.packets import POINTS_PER_PACKET
from drivers.livox.recording import RecordedPacket
from drivers.open3d_runtime import load_open3d
from drivers.simulated.link import TruthState
from drivers.simulated.mesh import Part
from drivers.simulated.mid360_wire import pack_points
from drivers.simulated.raycaster import Raycaster
from drivers.simulated.rotor_frame import rotor_frame
from drivers.simulated.scanner import RawScan, Scanner
from drivers.simulated.scene import Scene, draw_scene
from drivers.simulated.truth_history import TruthHistory
from perception.deskew import points_in_world
from perception.geometry import quaternion_from_rotation, rotation_from_euler
from perception.values import Pose, Scan

FOLDER = Path(__file__).parent
SEED = 11
STAND_OFF_M = 20.0
CLIMB_S, HOVER_S = 18.0, 1.2
POSE_S = 0.1
#: Clocks of the sensor (since it was switched on) and of the computer that captured (UTC).
SWITCHED_ON_S, UTC_S, TRAVEL_S = 1234.5, 1_790_000_000.0, 0.0004
PACKETS = 160


@dataclass(frozen=True)
class Recorded:
    """All that the files are made of."""

    points_w: np.ndarray
    origins_w: np.ndarray
    time_s: np.ndarray
    scans: list[RawScan]
    poses: list[Pose]


def settings_of() -> Settings:
    truth = TruthDraws(pitch_deg=80.0, stop_angle_deg=35.0, nacelle_yaw_deg=140.0)
    return Settings(
        sites=(Site(name="t", turbine="iea-3.4-130", scale=0.6),),
        simulation=Simulation(seed=SEED, truth=truth),
    )


def flown(scene: Scene) -> list[Pose]:
    """Return the poses of a climb in front of the rotor, and of hovering before the hub."""
    frame = rotor_frame(scene)
    up = frame.upwind_level_w
    aside = np.array([-up[1], up[0], 0.0])
    heading = rotation_from_euler(0.01, 0.02, math.atan2(-up[1], -up[0]))
    quaternion = quaternion_from_rotation(heading)
    high = frame.hub_w + STAND_OFF_M * up + 1.5 * aside
    low = np.array([*(30.0 * up + 4.0 * aside)[:2], 8.0])
    poses = []
    for k in range(round((CLIMB_S + HOVER_S) / POSE_S) + 2):
        t = k * POSE_S
        share = min(1.0, t / CLIMB_S)
        sway = 0.05 * np.array([math.sin(2 * t), math.cos(1.7 * t), 0.3 * math.sin(3 * t)])
        poses.append(Pose(t, low + share * (high - low) + sway, quaternion, np.zeros(3)))
    return poses


def record(settings: Settings) -> tuple[Scene, Recorded]:
    scene = draw_scene(settings)
    caster = Raycaster(scene, settings)
    poses = flown(scene)
    history = TruthHistory()
    for pose in poses:
        w, x, y, z = map(float, pose.quaternion_wb)
        e, n, u = map(float, pose.position_w)
        history.add(
            TruthState(pose.stamp_s, (e, n, u), (0, 0, 0), (w, x, y, z), (0, 0, 0), (1, 0, 0, 0), 0)
        )
    scanner = Scanner(caster, history, settings.lidar, SEED)
    rng = np.random.default_rng(SEED)
    parts, scans = [], []
    for k in range(round((CLIMB_S + HOVER_S) * 10)):
        t, hovering = 0.1 * k, 0.1 * k >= CLIMB_S - 1e-6
        if not hovering and k % 10:
            continue
        raw = scanner.scan(t, 0.1)
        if hovering:
            scans.append(raw)
        turbine = raw.part <= Part.TOWER
        kept = raw.returned & (raw.tag == 0)
        kept &= rng.random(len(kept)) < np.where(turbine, 0.6 if hovering else 0.5, 0.06)
        age = (0.1 - raw.offsets_s[kept]).astype(np.float32)
        zeros = np.zeros(len(age), np.uint8)
        scan = Scan(t + 0.1, k, raw.points_l[kept], age, zeros, zeros)
        points, origins = points_in_world(scan, poses, settings.lidar)
        parts.append((points, origins, np.full(len(points), t + 0.05)))
    points, origins, time_s = (np.concatenate([part[i] for part in parts]) for i in range(3))
    return scene, Recorded(points, origins, time_s, scans, poses)


def packets_of(scans: list[RawScan], step_ns: int = 5_000) -> list[RecordedPacket]:
    """Return the packets that show the most of the turbine."""
    packets: list[tuple[int, RecordedPacket]] = []
    for scan in scans:
        packed = pack_points(scan.points_l, scan.reflectivity, scan.tag, scan.returned)
        shown = scan.returned & (scan.part <= Part.TOWER)
        for k in range(len(packed) // POINTS_PER_PACKET):
            rows = slice(k * POINTS_PER_PACKET, (k + 1) * POINTS_PER_PACKET)
            stamp_s = SWITCHED_ON_S + scan.t0_s + float(scan.offsets_s[rows.start])
            packet = RecordedPacket(
                round(stamp_s * 1e9), 95 * step_ns, len(packets) & 0xFFFF, 1, packed[rows].tobytes()
            )
            packets.append((int(shown[rows].sum()), packet))
    best = sorted(range(len(packets)), key=lambda k: -packets[k][0])[:PACKETS]
    return [packets[k][1] for k in sorted(best)]


def write_poses(path: Path, poses: list[Pose], begin_s: float, separator: str) -> None:
    lines = ["t_s,x,y,z,qx,qy,qz,qw"] if separator == "," else ["# t_s x y z qx qy qz qw"]
    for pose in poses:
        w, x, y, z = pose.quaternion_wb
        values = [*pose.position_w, x, y, z, w]
        lines.append(
            separator.join([f"{begin_s + pose.stamp_s:.3f}", *(f"{v:.5f}" for v in values)])
        )
    path.write_text("\n".join(lines) + "\n")


def write_open3d(points: np.ndarray) -> None:
    open3d = load_open3d()
    cloud = open3d.t.geometry.PointCloud(open3d.core.Tensor(points.astype(np.float32)))
    write = open3d.t.io.write_point_cloud
    write(str(FOLDER / "hover-ascii.pcd"), cloud, write_ascii=True)
    write(str(FOLDER / "hover-binary.pcd"), cloud)
    write(str(FOLDER / "hover-compressed.pcd"), cloud, compressed=True)
    write(str(FOLDER / "hover-ascii.ply"), cloud, write_ascii=True)
    write(str(FOLDER / "hover-binary.ply"), cloud)


def main() -> None:
    settings = settings_of()
    scene, recorded = record(settings)
    frame = rotor_frame(scene)
    hovering = recorded.time_s > CLIMB_S
    hover = recorded.points_w[hovering]
    eye = np.median(recorded.origins_w[hovering], axis=0)
    np.savez_compressed(
        FOLDER / "ascent.npz",
        points=recorded.points_w.astype(np.float32),
        viewpoint=recorded.origins_w.astype(np.float32),
        time_s=recorded.time_s,
    )
    write_open3d(hover)
    packets = packets_of(recorded.scans)
    write_lvx2(FOLDER / "hover.lvx2", packets, "47MDSIM00000011")
    arrivals = [UTC_S + p.stamp_ns * 1e-9 - SWITCHED_ON_S + TRAVEL_S for p in packets]
    pairs = [(at, datagram_of(p)) for at, p in zip(arrivals, packets, strict=True)]
    write_capture(FOLDER / "hover.pcap", pairs)
    late = [pose for pose in recorded.poses if pose.stamp_s > CLIMB_S - 0.3]
    write_poses(FOLDER / "hover.tum", late, SWITCHED_ON_S, " ")
    write_poses(FOLDER / "hover.csv", late, UTC_S, ",")
    names = {
        "stop_angle_deg": scene.stop_angle_deg,
        "pitch_deg": scene.pitch_deg,
        "hub_m": frame.hub_w.tolist(),
        "normal": frame.normal_w.tolist(),
        "viewpoint_m": [round(float(v), 3) for v in eye],
        "turbine": "iea-3.4-130",
        "scale": 0.6,
        "seed": SEED,
    }
    (FOLDER / "truth.json").write_text(json.dumps(names, indent=2) + "\n")
    sys.stdout.write(f"{len(hover)} points hovering, {len(recorded.points_w)} in all\n")


if __name__ == "__main__":
    main()
