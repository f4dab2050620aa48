import json
from types import SimpleNamespace

import pytest

from mission.records.second_shot import asks_again, rewrite, superseded
from tests.mission.records.straight_blade import LENGTH_M, photo


class Record(SimpleNamespace):
    def model_copy(self, update):
        return Record(**(vars(self) | update))

    def sidecar(self):
        return json.dumps({"kept": self.kept}).encode()


def record(metre=10.0, grey=180.0, marks=(), kept=True, file="a.jpg", side="PS"):
    within = None if grey is None else 110 <= grey <= 160
    return Record(
        blade="A", side=side, metre=metre, mean_grey=grey, exposure_in_range=within,
        marks=marks, kept=kept, reason="", file=file, blade_grey=None, view=None,
    )  # fmt: skip


def test_a_photo_out_of_range_is_taken_once_more():
    assert "180" in asks_again(record(), 0, 10, repeated=False)


def test_a_photo_right_in_its_middle_alone_says_what_all_of_the_blade_is():
    one = record(grey=158.0).model_copy({"blade_grey": 166.0, "exposure_in_range": False})
    assert "158, 166 over all of it" in asks_again(one, 0, 10, repeated=False)


@pytest.mark.parametrize(
    "one", [record(grey=140.0), record(grey=None), record(kept=False), record(marks=("limit",))]
)
def test_what_is_right_rejected_or_at_the_cameras_limit_is_not(one):
    assert asks_again(one, 0, 10, repeated=False) == ""


def test_a_second_shot_has_no_third():
    assert asks_again(record(), 0, 10, repeated=True) == ""


def test_a_camera_whose_photos_never_fit_does_not_have_everything_flown_twice():
    assert asks_again(record(), 2, 10, repeated=False)
    assert not asks_again(record(), 3, 10, repeated=False)
    assert asks_again(record(), 3, 100, repeated=False)


def test_the_first_shot_is_rejected_once_the_second_shows_the_same_in_range():
    first, second = superseded(
        [record(metre=10.0), record(metre=10.3, grey=140, file="b.jpg")], 1.5
    )
    assert not first.kept
    assert "b.jpg" in first.reason
    assert second.kept


@pytest.mark.parametrize(
    "other",
    [record(metre=12.0, grey=140), record(grey=140, side="SS"), record(grey=170)],
)
def test_without_a_better_one_of_the_same_place_it_stays(other):
    assert superseded([record(), other], 1.5)[0].kept


def taken(a_record, metre, grey):
    """Return a photo of 10 m of blade about a metre; the next of a pass lie 2.5 m farther."""
    seen = photo(a_record, metre)
    view = seen.view.model_copy(update={"blade_length_m": LENGTH_M})
    right = 110 <= grey <= 160
    new = {"view": view, "mean_grey": grey, "exposure_in_range": right, "marks": ()}
    return seen.model_copy(update=new)


def test_what_others_in_range_show_whole_needs_no_photo_out_of_range(a_record):
    between = [
        taken(a_record, m, grey) for m, grey in ((12.5, 135.0), (15.0, 180.0), (17.5, 135.0))
    ]
    assert [one.kept for one in superseded(between, 1.5)] == [True, False, True]


def test_what_alone_shows_a_strip_is_kept_though_it_is_out_of_range(a_record):
    greys = {8.0: 135.0, 15.0: 180.0, 22.0: 135.0}
    apart = [taken(a_record, metre, grey) for metre, grey in greys.items()]
    assert all(one.kept for one in superseded(apart, 1.5))


def test_what_changed_is_written_beside_the_photo(tmp_path):
    rewrite(tmp_path, [record(kept=False)])
    assert json.loads((tmp_path / "a.json").read_bytes()) == {"kept": False}
