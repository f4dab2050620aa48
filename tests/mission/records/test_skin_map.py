"""A straight blade along east, its pressure side up, photographed from above."""

import numpy as np
import pytest

from mission.records.mission_file import MissionFile, read_mission
from mission.records.not_inspected import not_inspected
from mission.records.photo_record import Station, View, stored_records
from mission.records.report_blade_map import side_maps
from mission.records.skin_map import BINS, ROWS, Why, skin_map
from perception.geometry import camera_looking_along, quaternion_from_rotation

LENGTH_M, CHORD_M, AWAY_M = 30.0, 2.0, 12.0


@pytest.fixture
def a_record(mission_dir):
    return stored_records(mission_dir)[0]


def photo(a_record, metre, *, aside_m=0.0, away_m=AWAY_M, kept=True):
    """Return a photo of the pressure side at a metre, taken from above and aside."""
    eye = np.array([metre, aside_m, away_m])
    down = np.array([0.0, -aside_m, -away_m])
    turn = quaternion_from_rotation(camera_looking_along(down / np.linalg.norm(down)))
    stations = tuple(
        Station(metre=m, centre_w=(m, 0.0, 0.0), leading_w=(0.0, 1.0, 0.0),
                pressure_w=(0.0, 0.0, 1.0), chord_m=CHORD_M, thickness=0.2, pitch_axis=0.5)
        for m in np.linspace(max(0.0, metre - 8), min(LENGTH_M, metre + 8), 33)
    )  # fmt: skip
    # 10 m of blade at 12 m: 1000 px wide, 1200 px of focal length.
    view = View(
        matrix=((1200.0, 0.0, 500.0), (0.0, 1200.0, 375.0), (0.0, 0.0, 1.0)),
        distortion=(0.0,) * 5, position_w=tuple(eye), quaternion_wc=tuple(turn),
        position_sigma_m=(0.1,) * 3, yaw_sigma_deg=1.0, pitch_sigma_deg=0.2, stations=stations,
    )  # fmt: skip
    size = {"width_px": 1000, "height_px": 750, "gsd_mm": 10.0, "gsd_full_mm": 1.0}
    place = {"blade": "A", "side": "PS", "metre": metre, "kept": kept}
    return a_record.model_copy(update={"view": view, **size, **place})


def shown(skin, low, high):
    columns = slice(round(low / LENGTH_M * BINS), round(high / LENGTH_M * BINS))
    part = skin.on_side[:, columns]
    return skin.seen[:, columns].sum() / part.sum()


def test_skin_within_a_kept_photo_is_seen_at_its_size_and_the_rest_is_not(a_record):
    skin = skin_map([photo(a_record, 8), photo(a_record, 22, kept=False)], "PS", LENGTH_M, 1.5)
    assert skin.on_side.shape == (ROWS, BINS)
    assert shown(skin, 3.5, 12.5) > 0.95
    assert shown(skin, 14.0, 30.0) == 0.0
    assert np.nanmedian(skin.gsd_mm) == pytest.approx(1.0, abs=0.03)
    assert set(skin.why[skin.on_side & ~skin.seen]) == {Why.NOT_IN_VIEW}


def test_the_other_side_is_seen_by_no_photo_of_this_one(a_record):
    skin = skin_map([photo(a_record, 8), photo(a_record, 15)], "SS", LENGTH_M, 1.5)
    assert skin.on_side.any()
    assert not skin.seen.any()


def test_what_is_met_too_flat_or_too_coarse_is_not_seen_and_says_so(a_record):
    flat = skin_map([photo(a_record, 15, aside_m=30.0)], "PS", LENGTH_M, 1.5)
    coarse = skin_map([photo(a_record, 15, away_m=24.0)], "PS", LENGTH_M, 1.5)
    for skin, why in ((flat, Why.FLAT), (coarse, Why.COARSE)):
        assert not skin.seen.any()
        assert why in skin.why[skin.on_side]


def test_without_the_blade_in_a_record_there_is_no_map(a_record):
    assert skin_map([a_record.model_copy(update={"view": None})], "PS", LENGTH_M, 1.5) is None


def test_the_report_draws_the_skin_and_names_the_strip_that_is_seen_too_flat(a_record, mission_dir):
    mission = read_mission(mission_dir)
    one = mission.passes[0].model_copy(
        update={"length_m": LENGTH_M, "photographed_m": ((0.0, LENGTH_M),), "unseen": ()}
    )
    mission = mission.model_copy(update={"passes": (one,)})
    assert isinstance(mission, MissionFile)
    photos = [photo(a_record, 8), photo(a_record, 22, aside_m=30.0)]
    skins = {("A", "PS"): skin_map(photos, "PS", LENGTH_M, 1.5)}
    (drawn,) = side_maps(mission, skins)
    kinds = {patch.kind for patch in drawn.skin}
    assert kinds == {"seen", "missed"}
    assert all(patch.path.startswith("M") for patch in drawn.skin)
    words = {gap.why for gap in not_inspected(mission, skins)}
    assert "along the middle: only seen too flat, at more than 60°" in words
    assert not_inspected(mission, {}) == []
