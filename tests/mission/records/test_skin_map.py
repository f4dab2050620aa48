"""A straight blade along east, its pressure side up, photographed from above."""

import numpy as np
import pytest

from mission.records.mission_file import MissionFile, read_mission
from mission.records.not_inspected import not_inspected
from mission.records.report_blade_map import side_maps
from mission.records.skin_map import BINS, ROWS, Why, skin_map
from tests.mission.records.straight_blade import LENGTH_M, photo


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
