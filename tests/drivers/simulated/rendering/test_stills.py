from __future__ import annotations

import urllib.error
import urllib.request
from pathlib import Path

import cv2
import numpy as np
import pytest

from config.settings import Settings
from drivers.simulated.camera_model import ExposureControl
from drivers.simulated.light import Sky
from drivers.simulated.link import CameraSetting, StillDone, StillRequest, TruthState
from drivers.simulated.picture import Picture
from drivers.simulated.raycaster import Raycaster
from drivers.simulated.rotor_frame import rotor_frame
from drivers.simulated.scene import Scene
from drivers.simulated.stills import StillCamera, StillServer
from drivers.simulated.texture import draw_defects
from perception.geometry import camera_looking_along
from perception.values import CameraPose


@pytest.fixture
def camera(caster: Raycaster, scene: Scene, settings: Settings, tmp_path: Path) -> StillCamera:
    length = scene.turbine.blade_length_m
    picture = Picture(
        caster, settings.camera, draw_defects(length, np.full(10, 2.0, np.float32), 1), length
    )
    control = ExposureControl(settings.simulation.camera)
    control.set(CameraSetting(0.0, "manual", 1.0))
    return StillCamera(picture, Sky(settings.simulation.weather, 1), control, settings, tmp_path)


def shoot(camera: StillCamera, scene: Scene, index: int, speed_mps: float = 0.0) -> StillDone:
    frame = rotor_frame(scene)
    blade = frame.blades[0]
    look = -blade.pressure_w()
    eye = frame.hub_w + 22.0 * blade.axis_w - 12.0 * look
    pose = CameraPose(1.0, eye, camera_looking_along(look))
    vx, vy, vz = (float(v) for v in speed_mps * blade.axis_w)
    state = TruthState(1.0, (0, 0, 0), (vx, vy, vz), (1, 0, 0, 0), (0, 0, 0), (1, 0, 0, 0), 0.0)
    answers = list(camera.take(StillRequest(1.0, index), pose, state))
    assert answers[:-1] == [None] * (len(answers) - 1)
    done = answers[-1]
    assert done is not None
    return done


def test_a_photo_is_drawn_between_other_work_and_fetched_by_its_url(
    camera: StillCamera, scene: Scene, tmp_path: Path
) -> None:
    done = shoot(camera, scene, 7)
    assert done.ok
    assert done.ev == 1.0
    server = StillServer(tmp_path, 0)
    try:
        url = f"http://127.0.0.1:{server.port}/"
        with urllib.request.urlopen(url + "7.jpg") as answer:
            picture = cv2.imdecode(np.frombuffer(answer.read(), np.uint8), cv2.IMREAD_COLOR)
        assert picture is not None
        assert picture.shape == (972, 1296, 3)
        for path in ("8.jpg", "../7.jpg", "7.jpg/", ""):
            with pytest.raises(urllib.error.HTTPError):
                urllib.request.urlopen(url + path)
    finally:
        server.close()


def test_motion_shows_as_blur_in_pixels_of_the_full_size(
    camera: StillCamera, scene: Scene, settings: Settings
) -> None:
    shoot(camera, scene, 0, speed_mps=2.0)
    focal_px = (
        settings.camera.focal_length_mm / settings.camera.sensor_width_mm * settings.camera.width_px
    )
    truth = camera.truths[0]
    expected = 2.0 / 12.0 * truth.exposure.shutter_s * focal_px
    assert truth.blur_full_px == pytest.approx(expected, rel=0.06)


def test_failure_words_do_what_they_say(camera: StillCamera, scene: Scene) -> None:
    shoot(camera, scene, 0)
    camera.fault = "off"
    assert not shoot(camera, scene, 1).ok
    camera.fault = "stuck"
    shoot(camera, scene, 2)
    assert camera.path_of(2).read_bytes() == camera.path_of(0).read_bytes()
    assert camera.truths[2].spoilt
    camera.fault = "wrong"
    shoot(camera, scene, 3)
    black = cv2.imread(str(camera.path_of(3)))
    assert black is not None
    assert black.max() < 5
    camera.fault = "ok"
    assert shoot(camera, scene, 4).ok
    assert not camera.truths[4].spoilt
