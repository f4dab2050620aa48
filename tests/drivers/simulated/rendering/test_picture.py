from __future__ import annotations

import numpy as np
import pytest

from config.settings import Settings
from drivers.simulated.light import Sky
from drivers.simulated.picture import Picture
from drivers.simulated.raycaster import Raycaster
from drivers.simulated.rotor_frame import rotor_frame
from drivers.simulated.scene import Scene
from drivers.simulated.texture import draw_defects
from perception.geometry import camera_looking_along
from perception.values import CameraPose

GREEN = 6


@pytest.fixture(scope="module")
def picture(caster: Raycaster, scene: Scene, settings: Settings) -> Picture:
    length = scene.turbine.blade_length_m
    defects = draw_defects(length, np.full(10, 2.0, np.float32), 1)
    return Picture(caster, settings.camera, defects, length)


def before_blade(scene: Scene, distance_m: float = 12.0) -> CameraPose:
    frame = rotor_frame(scene)
    blade = frame.blades[0]
    target = frame.hub_w + 22.0 * blade.axis_w
    look = -blade.pressure_w()
    return CameraPose(0.0, target - distance_m * look, camera_looking_along(look))


def test_the_blade_fills_as_much_of_the_picture_as_the_pinhole_says(
    picture: Picture, scene: Scene, settings: Settings
) -> None:
    drawn = picture.draw(before_blade(scene), Sky(settings.simulation.weather, 1).at(0.0), 320, 240)
    assert drawn.centre_m == pytest.approx(12.0, abs=0.6)
    blade = scene.turbine.blade
    span = (22.0 - scene.turbine.hub_radius_m) / scene.turbine.blade_length_m
    chord = float(np.interp(span, blade.span, blade.chord_m))
    focal_px = 320 * settings.camera.focal_length_mm / settings.camera.sensor_width_mm
    axis = rotor_frame(scene).blades[0].axis_w @ before_blade(scene).rotation_wc
    # A band of the chord's width that crosses the picture at the blade's slope.
    wide = chord / 12.0 * focal_px / max(abs(axis[0]), abs(axis[1]))
    across = (drawn.part < 3).sum(axis=0 if abs(axis[0]) > abs(axis[1]) else 1)
    assert np.median(across) == pytest.approx(wide, rel=0.12)


def test_refining_the_grid_gives_what_casting_each_pixel_gives(
    picture: Picture, scene: Scene, settings: Settings, caster: Raycaster
) -> None:
    pose = before_blade(scene)
    drawn = picture.draw(pose, Sky(settings.simulation.weather, 1).at(0.0), 160, 120)
    focal = 160 * settings.camera.focal_length_mm / settings.camera.sensor_width_mm
    y, x = np.mgrid[:120, :160].astype(np.float32)
    ways = np.stack([(x + 0.5 - 80) / focal, (y + 0.5 - 60) / focal, np.ones_like(x)], axis=-1)
    ways = (ways / np.linalg.norm(ways, axis=-1, keepdims=True)).reshape(-1, 3)
    ways_w = (ways @ pose.rotation_wc.T).astype(np.float32)
    eyes = np.broadcast_to(pose.position_w.astype(np.float32), ways_w.shape)
    triangle = caster.cast(eyes, ways_w, 0.0).triangle
    part = np.where(triangle < 0, 10, caster.mesh.part[triangle]).reshape(120, 160)
    assert np.mean(part != drawn.part) < 0.002


def test_drawing_in_bands_changes_nothing_but_the_time_between(
    picture: Picture, scene: Scene, settings: Settings
) -> None:
    pose, light = before_blade(scene), Sky(settings.simulation.weather, 1).at(0.0)
    whole = list(picture.draw_in_bands(pose, light, 160, 120, 120))
    bands = list(picture.draw_in_bands(pose, light, 160, 120, 40))
    assert len(whole) == 1
    assert bands[:-1] == [None, None]
    first, second = whole[-1], bands[-1]
    assert first is not None
    assert second is not None
    np.testing.assert_allclose(first.radiance, second.radiance, atol=1e-4)


def test_sunny_sides_are_brighter_than_shaded_ones(
    picture: Picture, scene: Scene, settings: Settings
) -> None:
    weather = settings.simulation.weather.model_copy(update={"clouds": False, "overcast": 0.0})
    pose = before_blade(scene)
    look = pose.rotation_wc[:, 2]
    towards = float(np.degrees(np.arctan2(-look[0], -look[1]))) % 360.0
    means = []
    for azimuth in (towards, (towards + 180.0) % 360.0):
        lit = weather.model_copy(update={"sun_azimuth_deg": azimuth, "sun_elevation_deg": 20.0})
        drawn = picture.draw(pose, Sky(lit, 1).at(0.0), 160, 120)
        means.append(float(drawn.radiance[drawn.part < 3].mean()))
    assert means[0] > 2.0 * means[1] > 0.0


def test_fog_hides_what_is_far(picture: Picture, scene: Scene, settings: Settings) -> None:
    weather = settings.simulation.weather.model_copy(update={"fog_extinction_per_m": 0.1})
    drawn = picture.draw(before_blade(scene), Sky(weather, 1).at(0.0), 160, 120)
    clear = picture.draw(before_blade(scene), Sky(settings.simulation.weather, 1).at(0.0), 160, 120)
    ground = drawn.part == GREEN
    assert drawn.radiance[ground].std() < 0.3 * clear.radiance[ground].std() + 0.01
