import types

import cv2
import numpy as np
import pytest

from mission.records.photo_record import Station, View
from mission.records.turned_photo import shown_m, turned
from perception.geometry import camera_looking_along, quaternion_from_rotation

FOCAL, WIDTH, HEIGHT, AWAY_M = 800.0, 640, 480, 10.0
LENS = ((FOCAL, 0.0, WIDTH / 2), (0.0, FOCAL, HEIGHT / 2), (0.0, 0.0, 1.0))
ROTATION = camera_looking_along((0.0, 1.0, 0.0))


def a_record(lean_deg, beyond_m=0.0):
    """A photo from the south of a blade that leans; ten metres of it, metre 5 in the middle."""
    lean = np.radians(lean_deg)
    along = np.array([np.cos(lean), 0.0, np.sin(lean)])
    stations = tuple(
        Station(
            metre=m, centre_w=tuple((m - 5.0) * along), leading_w=(0, 0, 1), pressure_w=(0, -1, 0),
            chord_m=1.0, thickness=0.2, pitch_axis=0.3,
        )
        for m in (0.0, 2.5, 5.0, 10.0)
    )  # fmt: skip
    view = View(
        matrix=LENS,
        distortion=(0.0,) * 5,
        position_w=(0.0, beyond_m - AWAY_M, 0.0),
        quaternion_wc=tuple(quaternion_from_rotation(ROTATION)),
        position_sigma_m=(0.1,) * 3,
        yaw_sigma_deg=1.0,
        pitch_sigma_deg=0.2,
        stations=stations,
    )
    record = types.SimpleNamespace(view=view, width_px=WIDTH, height_px=HEIGHT, metre=5.0)
    return record, along


def seen_at(place_w):
    x, _, z = place_w
    return WIDTH / 2 + FOCAL * x / AWAY_M, HEIGHT / 2 - FOCAL * z / AWAY_M


def middle_of_mark(picture):
    """Return the centre of what is whiter than the page round a photo."""
    y, x = np.nonzero((picture > 247).all(axis=2))
    return x.mean() + 0.5, y.mean() + 0.5


@pytest.mark.parametrize("lean_deg", [0.0, 37.0, 90.0, 151.0, -100.0])
@pytest.mark.parametrize("shrunk", [1.0, 0.5])
@pytest.mark.parametrize("span_m", [2.0, 8.0])
def test_the_root_is_left_and_a_place_lies_where_its_metre_says_unmirrored(
    lean_deg, shrunk, span_m
):
    record, along = a_record(lean_deg)
    across = np.array([-along[2], 0.0, along[0]])  # up, where the blade points east
    picture = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    mark = 0.8 * along + 0.4 * across
    cv2.circle(picture, tuple(int(v) for v in seen_at(mark)), 6, (255, 255, 255), -1)
    picture = cv2.resize(picture, None, fx=shrunk, fy=shrunk, interpolation=cv2.INTER_AREA)
    shown = turned(picture, record, 5.0, span_m, (400, 220))
    per_metre = 400 / span_m
    wanted = (200 + 0.8 * per_metre, 110 - 0.4 * per_metre)
    assert middle_of_mark(shown) == pytest.approx(wanted, abs=0.03 * per_metre + 1.5)


def test_a_photo_shows_its_shorter_side_worth_of_blade():
    assert shown_m(a_record(20.0)[0]) == pytest.approx(HEIGHT * AWAY_M / FOCAL)


def test_a_photo_that_knows_no_blade_or_has_it_behind_is_not_turned():
    picture = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    behind, _ = a_record(0.0, beyond_m=2 * AWAY_M)
    none, _ = a_record(0.0)
    none.view = none.view.model_copy(update={"stations": ()})
    for record in (behind, none, types.SimpleNamespace(view=None, metre=5.0)):
        assert shown_m(record) is None
        assert turned(picture, record, 5.0, 4.0, (400, 220)) is None
