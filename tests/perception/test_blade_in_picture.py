import cv2
import numpy as np
import pytest

from config.sensors import Camera
from perception.blade_in_picture import BladeStations, clipped, outline_px, see
from perception.geometry import camera_looking_along
from perception.lens import lens_of
from perception.outline_match import match_outline
from perception.tip_in_picture import find_tip
from perception.values import CameraPose

LENS = lens_of(Camera(), 1296, 972)
#: 12 m in front of a blade that stands up, its leading edge to the viewer's right.
CAMERA = CameraPose(0.0, np.array([0.0, -12.0, 20.0]), camera_looking_along((0.0, 1.0, 0.0)))
CENTRE = np.array([[648.0, 486.0]])


def a_blade(aside_m=0.0, chord_m=2.0, lean=0.0, end_m=30.0):
    metres = np.arange(10.0, end_m + 0.1, 0.5)
    ones = np.ones(len(metres))
    return BladeStations(
        metre_m=metres,
        centre_w=np.column_stack([aside_m + lean * (metres - 20), 0 * ones, metres]),
        leading_w=np.outer(ones, (1.0, 0.0, 0.0)),
        pressure_w=np.outer(ones, (0.0, -1.0, 0.0)),
        chord_m=chord_m - 0.04 * (metres - 20),
        thickness=0.3 * ones,
        pitch_axis=0.3 * ones,
    )


def test_a_pixel_tells_metre_chord_and_side():
    seen = see(a_blade(), CENTRE, CAMERA, LENS)
    assert seen.hit.all()
    assert seen.metre_m[0] == pytest.approx(20.0, abs=1e-6)
    # The pitch axis is straight ahead: three tenths of the chord from the leading edge.
    assert seen.chord_share[0] == pytest.approx(0.3, abs=0.02)
    assert seen.pressure[0]
    # The skin is half a thickness nearer than the axis.
    assert seen.depth_m[0] == pytest.approx(12 - 0.3, abs=0.08)
    assert seen.cosine[0] > 0.95


def test_from_behind_it_is_the_suction_side():
    behind = CameraPose(0.0, np.array([0.0, 12.0, 20.0]), camera_looking_along((0.0, -1.0, 0.0)))
    seen = see(a_blade(), CENTRE, behind, LENS)
    assert seen.hit[0]
    assert not seen.pressure[0]


def test_pixels_beside_the_blade_show_nothing_of_it():
    seen = see(a_blade(), np.array([[5.0, 486.0], [1290.0, 486.0]]), CAMERA, LENS)
    assert not seen.hit.any()
    assert np.isnan(seen.metre_m).all()


def test_up_in_the_picture_is_up_the_blade_by_the_size_of_a_pixel():
    seen = see(a_blade(), CENTRE - np.array([0.0, 100.0]), CAMERA, LENS)
    mm_per_px = seen.depth_m[0] * 1000 / LENS.focal_px
    assert (seen.metre_m[0] - 20.0) * 1000 == pytest.approx(100 * mm_per_px, rel=1e-3)


def test_every_pixel_inside_the_outline_hits_and_none_outside():
    blade = a_blade()
    outline = outline_px(blade, CAMERA, LENS).astype(np.float32)
    rng = np.random.default_rng(2)
    pixels = rng.uniform((0, 0), (1296, 972), (200, 2))
    inside = np.array([cv2.pointPolygonTest(outline, (x, y), measureDist=True) for x, y in pixels])
    hit = see(blade, pixels, CAMERA, LENS).hit
    assert hit[inside > 2].all()
    assert not hit[inside < -2].any()
    assert 0.2 < hit.mean() < 0.8


def test_an_outline_is_cut_at_the_picture():
    polygon = clipped(outline_px(a_blade(), CAMERA, LENS), 1296, 972)
    assert len(polygon) >= 4
    assert (polygon >= -1e-6).all()
    assert (polygon <= [1296 + 1e-6, 972 + 1e-6]).all()
    away = CameraPose(0.0, CAMERA.position_w, camera_looking_along((0.0, -1.0, 0.0)))
    assert len(clipped(outline_px(a_blade(), away, LENS), 1296, 972)) == 0


def drawn(blade, grey=180, sky=90):
    rng = np.random.default_rng(1)
    picture = np.full((972, 1296), sky, np.uint8)
    cv2.fillPoly(picture, [np.round(outline_px(blade, CAMERA, LENS)).astype(int)], (grey,))
    return np.clip(picture + rng.normal(0, 4, picture.shape), 0, 255).astype(np.uint8)


@pytest.mark.parametrize(("aside_m", "lean"), [(0.0, 0.0), (0.6, 0.02), (-0.5, -0.03)])
def test_the_outline_finds_the_edges_in_the_picture(aside_m, lean):
    match = match_outline(drawn(a_blade(aside_m, lean=lean)), a_blade(), CAMERA, LENS)
    assert match is not None
    off = match.stations.centre_w - a_blade(aside_m, lean=lean).centre_w
    middle = np.abs(match.stations.metre_m - 20) < 1.5
    assert np.abs(off[middle, 0]).max() < 0.05
    assert np.abs(off[:, 1]).max() < 0.01


def test_a_picture_without_the_blade_matches_nothing():
    rng = np.random.default_rng(4)
    clouds = cv2.GaussianBlur(rng.normal(120, 60, (972, 1296)), (0, 0), 25)
    picture = np.clip(clouds, 0, 255).astype(np.uint8)
    assert match_outline(picture, a_blade(), CAMERA, LENS) is None


@pytest.mark.parametrize("true_m", [20.0, 20.5, 21.0])
def test_the_end_of_a_blade_is_found_where_it_is(true_m):
    picture = drawn(a_blade(end_m=true_m))
    found = find_tip(picture, a_blade(end_m=20.5), CAMERA, LENS, 20.5, 0.6)
    # The drawn blade's sections end at multiples of half a metre.
    shown = float(a_blade(end_m=true_m).metre_m[-1])
    assert found == pytest.approx(shown, abs=0.06)


def test_a_blade_that_goes_on_or_is_not_drawn_to_its_tip_has_no_end():
    assert find_tip(drawn(a_blade()), a_blade(end_m=20.5), CAMERA, LENS, 20.5, 0.6) is None
    picture = drawn(a_blade(end_m=20.5))
    assert find_tip(picture, a_blade(end_m=20.5), CAMERA, LENS, 30.0, 0.6) is None
    # Its end would lie above the picture.
    assert find_tip(picture, a_blade(end_m=22.0), CAMERA, LENS, 22.0, 0.4) is None
