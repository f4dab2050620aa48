import math

import cv2
import numpy as np
import piexif
import pytest

from benchmarks.exposure_brackets import NoBrackets, brackets, measure
from benchmarks.exposure_camera import REFERENCE, BenchCamera, CameraKind, Curve
from benchmarks.exposure_defects import (
    Defect,
    contrast_to_noise,
    draw_defects,
    with_defects,
)
from benchmarks.exposure_figure import curves
from benchmarks.exposure_methods import OURS, ours, paper
from benchmarks.exposure_passes import Pass, Still, entropy_nats
from benchmarks.exposure_play import Record
from benchmarks.exposure_scene import Lighting, Shown, Surface
from benchmarks.exposure_steps import Event, play

BLADE = np.zeros((48, 64), bool)
BLADE[16:32] = True
RNG = np.random.default_rng(5)
LOOK = Shown(
    np.where(BLADE, REFERENCE, 0.5 * RNG.uniform(0.1, 2.0, BLADE.shape)).astype(np.float32), BLADE
)


@pytest.mark.parametrize("curve", list(Curve))
def test_ev_zero_renders_the_reference_at_the_target(curve):
    camera = BenchCamera(CameraKind(curve), 1)
    grey = camera.expose(LOOK.radiance, 0.0)
    assert grey[BLADE].mean() == pytest.approx(135, abs=2)


def test_a_setting_shows_a_latency_later_and_its_word_says_nothing_of_when():
    camera = BenchCamera(CameraKind(latency_s=0.4, jitter_s=0.0), 1)
    assert camera.ask(-1.0, 1.0) == (-1.0, pytest.approx(1.03))
    assert camera.ask(-1.0, 1.1) is None
    assert camera.ev_at(1.39) == 0.0
    assert camera.ev_at(1.41) == -1.0


def test_the_automatic_works_against_the_light():
    camera = BenchCamera(CameraKind(manual=False, wander_ev=0.0), 1)
    for k in range(100):
        camera.expose(LOOK.radiance * np.float32(4.0 if k > 20 else 1.0), 0.1 * k)
        if k == 20:
            before = camera.total_ev(0.1 * k)
    assert camera.total_ev(10.0) == pytest.approx(before - 2.0, abs=0.3)


def test_each_answer_s_latency_is_counted_from_the_frame_that_asked_for_it():
    asked = [0.0, 0.0, -1.0, -1.0, -2.0, -2.0, -2.0, -2.0, 3.0]
    evs = [0.0, 0.0, 0.0, 0.0, -1.0, -1.0, -1.0, -2.0, -2.0]
    record = Record(evs=evs, asked=asked)
    assert record.delays(2) == [2, 3]
    assert record.delays(3) == [3]
    assert record.delays(5) == []


@pytest.mark.parametrize("manual", [True, False])
def test_ours_answers_a_step_in_its_latency_and_the_paper_takes_longer(manual):
    event = Event(2.0, 1, CameraKind(Curve.SHOULDER, manual, 0.2), 10)
    own, theirs = (play(event, make, LOOK, 3) for make in (ours, paper))
    assert own.outside <= own.answered + (0 if manual else 1)
    assert not own.restless
    assert theirs.outside > own.outside


def test_what_the_camera_cannot_do_is_held_against_nobody():
    event = Event(14.0, 1, CameraKind(Curve.GAMMA, True, 0.1), 10)
    assert play(event, paper, LOOK, 3).outside == 0


def test_a_defect_on_a_quiet_blade_has_the_contrast_that_it_was_given():
    blade = np.ones((80, 80), bool)
    defect = Defect(40.0, 40.0, 8.0, 0.2)
    radiance = with_defects(np.full((80, 80), 100.0, np.float32), [defect])
    noisy = radiance + RNG.normal(0, 2.0, radiance.shape)
    (found,) = contrast_to_noise(np.round(noisy).astype(np.uint8), blade, [defect])
    assert found.cnr == pytest.approx(20.0 / 2.0, rel=0.15)


def test_a_clipped_defect_counts_for_nothing_even_after_processing():
    blade = np.ones((80, 80), bool)
    defect = Defect(40.0, 40.0, 8.0, 0.2)
    white = np.full((80, 80), 255, np.uint8)
    processed = np.round(RNG.normal(100, 2, white.shape)).astype(np.uint8)
    (found,) = contrast_to_noise(processed, blade, [defect], taken=white)
    assert found.cnr == 0.0


def test_defects_lie_on_the_blade_and_apart():
    blade = np.zeros((200, 300), bool)
    blade[60:160] = True
    defects = draw_defects(blade, np.random.default_rng(1))
    assert len(defects) >= 4
    for one in defects:
        assert 60 + one.radius_px < one.y_px < 160 - one.radius_px
        assert 0.05 <= one.contrast <= 0.2


def test_the_entropy_is_in_nats():
    assert entropy_nats(np.arange(256, dtype=np.uint8)) == pytest.approx(math.log(256))


def bracketed(folder, evs, exif=True):
    folder.mkdir()
    for k, ev in enumerate(evs):
        grey = BenchCamera(CameraKind(Curve.FILMIC), k).develop(LOOK.radiance, ev)
        large = cv2.resize(grey, (640, 480))
        file = folder / f"IMG_{k:02d}.jpg"
        cv2.imwrite(str(file), large)
        if exif:
            time = (round(1e6 * 2.0**ev / 1000), 1000000)
            fields = {piexif.ExifIFD.ExposureTime: time, piexif.ExifIFD.ISOSpeedRatings: 100}
            piexif.insert(piexif.dump({"Exif": fields}), str(file))
    return folder


def test_a_folder_of_bracketed_photos_is_read_and_every_method_put_to_it(tmp_path):
    evs = [-3, -2, -1, 0, 1, 2, 3]
    folder = bracketed(tmp_path / "photos", evs + evs)
    scenes = brackets(folder)
    assert [len(scene.evs) for scene in scenes] == [7, 7]
    own = [line for line in measure(scenes[:1]) if line.method == OURS]
    assert [line.start for line in own] == ["darkest", "brightest"]
    assert all(line.in_range and abs(line.ev) < 0.1 for line in own)


def test_photos_without_exposure_are_refused_in_a_sentence(tmp_path):
    with pytest.raises(NoBrackets, match="no 3 photos"):
        brackets(bracketed(tmp_path / "photos", [-1, 0, 1], exif=False))


def test_the_curves_of_all_methods_are_drawn():
    stills = [Still(5.0 * k, 20.0 * k, 10.0, 2.0, (), ()) for k in range(1, 9)]
    made = [Pass("a", surface, Lighting.SUN, stills) for surface in Surface]
    picture = curves(made, ("a", "none"), "title")
    assert (picture < 250).any(axis=2).sum() > 2000
