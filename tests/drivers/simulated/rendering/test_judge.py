from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from config.settings import Settings
from drivers.simulated.blade_mesh import axis_points
from drivers.simulated.camera_model import exposure_of
from drivers.simulated.judge import (
    judgement,
    kept_indices,
    reachable,
    seen_in,
    side_view_w,
    skin_samples,
)
from drivers.simulated.raycaster import Raycaster
from drivers.simulated.rotor_frame import rotor_frame
from drivers.simulated.scene import Scene
from drivers.simulated.stills import StillTruth
from perception.geometry import camera_looking_along
from perception.values import CameraPose


def still(
    scene: Scene,
    *,
    index: int = 0,
    side: str = "PS",
    along_m: float = 20.0,
    distance_m: float = 12.0,
    grey: float = 135.0,
    blur_px: float = 0.2,
) -> StillTruth:
    frame = rotor_frame(scene)
    blade = frame.blades[0]
    view = side_view_w(blade, 0.0, side)
    eye = frame.hub_w + along_m * blade.axis_w + distance_m * view
    pose = CameraPose(0.0, eye, camera_looking_along(-view))
    return StillTruth(index, 0.0, pose, exposure_of(0.0), blur_px, grey, spoilt=False)


def photos_of(folder: Path, **kept: bool) -> Path:
    (folder / "photos" / "A" / "PS").mkdir(parents=True)
    for index, is_kept in kept.items():
        sidecar = {"still_index": int(index.removeprefix("i")), "kept": is_kept}
        (folder / "photos" / "A" / "PS" / f"{index}.json").write_text(json.dumps(sidecar))
    return folder


def judged(
    scene: Scene, settings: Settings, caster: Raycaster, folder: Path, *stills: StillTruth
) -> dict[str, object]:
    truths = {one.index: one for one in stills}
    text = judgement(scene, settings, caster, truths, 12.0, 100.0, folder)
    out = json.loads(text)
    assert isinstance(out, dict)
    return out


def test_samples_face_their_sides_view(scene: Scene, caster: Raycaster) -> None:
    skins = skin_samples(caster.mesh, scene)
    assert len(skins) == 12
    for skin in skins:
        view = side_view_w(rotor_frame(scene).blades[skin.blade], 0.0, skin.side)
        # The view is taken at half span, whose twist is a degree or two.
        assert (skin.normals_w @ view).min() > math.cos(math.radians(48.0))


def test_a_photo_sees_its_side_and_not_the_back(
    scene: Scene, caster: Raycaster, settings: Settings
) -> None:
    skins = {(s.blade, s.side): s for s in skin_samples(caster.mesh, scene)}
    photo = still(scene)
    front = seen_in(skins[0, "PS"], photo, caster, settings)
    # 12 m before the blade the picture is 4.6 m wide.
    assert 0.05 < front.mean() < 0.35
    assert not seen_in(skins[0, "SS"], photo, caster, settings).any()
    assert not seen_in(skins[1, "PS"], photo, caster, settings).any()
    away = np.linalg.norm(skins[0, "PS"].points_w[front] - photo.pose.position_w, axis=1)
    assert away.max() < 14.0


def test_beyond_the_gsd_limit_nothing_counts(
    scene: Scene, caster: Raycaster, settings: Settings
) -> None:
    skins = skin_samples(caster.mesh, scene)
    limit = settings.tracking.max_gsd_mm
    focal = settings.camera.focal_length_mm * settings.camera.width_px
    reach_m = limit * focal / settings.camera.sensor_width_mm / 1000
    far = still(scene, distance_m=reach_m + 1.0)
    assert not seen_in(skins[0], far, caster, settings).any()


def test_most_of_every_side_is_reachable(
    scene: Scene, caster: Raycaster, settings: Settings
) -> None:
    for skin in skin_samples(caster.mesh, scene)[:4]:
        assert reachable(skin, caster, settings).mean() > 0.7


def test_only_kept_sharp_and_rightly_exposed_photos_count(
    scene: Scene, settings: Settings, caster: Raycaster, tmp_path: Path
) -> None:
    folder = photos_of(tmp_path, i0=True, i1=True, i2=True, i3=False)
    good, dark = still(scene, index=0), still(scene, index=1, along_m=12.0, grey=60.0)
    blurred = still(scene, index=2, along_m=28.0, blur_px=3.0)
    rejected = still(scene, index=3, along_m=8.0)
    both = judged(scene, settings, caster, folder, good, dark, blurred, rejected)
    alone = judged(scene, settings, caster, folder, good)
    assert both["coverage"] == alone["coverage"]
    assert both["stills"] == 4
    assert both["stills_kept"] == 3
    assert both["stills_out_of_range"] == 1
    assert both["stills_blurred"] == 1
    coverage = alone["coverage"]
    assert isinstance(coverage, dict)
    assert coverage["A"]["PS"] > 0.05
    assert coverage["B"]["PS"] == 0.0


def test_truth_is_told_by_the_definitions(
    scene: Scene, settings: Settings, caster: Raycaster, tmp_path: Path
) -> None:
    truth = judged(scene, settings, caster, tmp_path)
    assert truth["stop_angle_deg"] == pytest.approx(20.0)
    assert truth["min_clearance_m"] == pytest.approx(12.0 - settings.airframe.radius_m)
    assert truth["hub_m"] == pytest.approx(rotor_frame(scene).hub_w.tolist())


def test_half_written_and_foreign_sidecars_are_passed_over(tmp_path: Path) -> None:
    folder = photos_of(tmp_path, i4=True)
    photos = folder / "photos" / "A" / "PS"
    (photos / "half.json").write_text('{"still_index": 5, "ke')
    (photos / "list.json").write_text("[1]")
    (photos / "word.json").write_text('{"still_index": "x", "kept": true}')
    assert list(kept_indices(folder)) == [4]


def test_the_truth_says_which_metre_a_photo_shows(
    scene: Scene, settings: Settings, caster: Raycaster, tmp_path: Path
) -> None:
    folder = photos_of(tmp_path, i0=True)
    out = judged(scene, settings, caster, folder, still(scene, along_m=20.0))
    names = ("A", "B", "C") if scene.stop_angle_deg < 75.0 else ("B", "C", "A")
    blade, metre = out["still_metres"]["0"]  # type: ignore[index]
    assert blade == names[0]
    assert metre == pytest.approx(20.0 - scene.turbine.hub_radius_m, abs=0.1)


def aside(scene: Scene, index: int, beside_m: float) -> StillTruth:
    """Return a photo of a leading edge, aimed so far beside it."""
    straight = still(scene, index=index, side="LE")
    frame = rotor_frame(scene)
    blade = frame.blades[0]
    # A bent blade lies beside its straight axis.
    centre = frame.hub_w + axis_points(scene.turbine, blade, np.array([0.5]))[0]
    ahead = straight.pose.rotation_wc[:, 2]
    sight = 12.0 * ahead + beside_m * np.cross(ahead, blade.axis_w)
    rotation = camera_looking_along(sight / np.linalg.norm(sight))
    return replace(straight, pose=CameraPose(0.0, centre - 12.0 * ahead, rotation))


def test_the_truth_says_how_many_photos_have_the_blade_in_their_middle(
    scene: Scene, settings: Settings, caster: Raycaster, tmp_path: Path
) -> None:
    folder = photos_of(tmp_path, i0=True, i1=True, i2=True, i3=True, i4=False)
    # 5 % of the picture's width are 0.23 m there; aimed 12 m beside it, it shows no blade.
    aimed = [aside(scene, k, beside_m) for k, beside_m in enumerate((0.0, 0.1, -0.7, 12.0, 0.0))]
    assert judged(scene, settings, caster, folder, *aimed)["stills_centred"] == 0.5
    assert judged(scene, settings, caster, folder, *aimed[:2])["stills_centred"] == 1.0
    assert judged(scene, settings, caster, folder)["stills_centred"] is None


def test_a_blade_as_wide_as_the_picture_has_no_middle_to_be_in(
    scene: Scene, settings: Settings, caster: Raycaster, tmp_path: Path
) -> None:
    near = still(scene, along_m=scene.turbine.hub_radius_m + 8.0, distance_m=4.0)
    folder = photos_of(tmp_path, i0=True)
    assert judged(scene, settings, caster, folder, near)["stills_centred"] is None
