import itertools

import numpy as np
import pytest

from benchmarks.virtual_turbine import Truth, true_model
from config.presets import load_turbine
from config.settings import Settings
from mission.flight.footprint import footprint_m, photo_metres
from mission.flight.plan import plan, plan_steps
from mission.flight.skin import Look, blade_skin

SETTINGS = Settings()
RADIUS = SETTINGS.airframe.radius_m
WANTED = [(blade, side) for blade in "ABC" for side in ("PS", "SS", "LE", "TE")]


def planned(stop, pitch, name="windpact-1.5", wanted=WANTED, settings=SETTINGS):
    turbine = load_turbine(name)
    model = true_model(Truth(stop_angle_deg=stop, pitch_deg=pitch), turbine)
    start = model.hub_w - 20 * model.normal_w
    return model, start, plan(model, turbine, settings, wanted, start, 0.0)


@pytest.mark.parametrize("stop", [0.0, 17.0, 30.0, 60.0, 90.0, 119.95])
@pytest.mark.parametrize("pitch", [0.0, 20.0, 45.0, 70.0, 90.0])
def test_every_pass_is_clear_every_metre_flown_or_reasoned_and_every_way_clear(stop, pitch):
    model, here, found = planned(stop, pitch)
    for side_pass in found.passes:
        unseen = sum(gap.to_m - gap.from_m for gap in side_pass.unseen)
        assert side_pass.planned_m + unseen == pytest.approx(side_pass.length_m, abs=1e-6)
        assert all(gap.reason for gap in side_pass.unseen)
    assert sum(p.planned_m for p in found.passes) > 0.8 * sum(p.length_m for p in found.passes)
    for leg in found.legs:
        line = leg.line()
        assert model.distance(line).min() - RADIUS >= 8.9
        way = found.roadmap.way(here, line[0])
        assert way is not None
        for a, b in itertools.pairwise(way):
            points = a + np.linspace(0, 1, 60)[:, None] * (b - a)
            assert model.distance(points).min() - RADIUS >= 8.5
        here = line[-1]
        out = found.roadmap.way_out(here)
        assert out is not None
        assert np.linalg.norm(out[-1] - model.hub_w) > model.rotor_radius_m + 12.0


def test_the_last_leg_lies_towards_home():
    turbine = load_turbine("windpact-1.5")
    model = true_model(Truth(stop_angle_deg=0.0, pitch_deg=5.0), turbine)
    start = model.hub_w - 20 * model.normal_w
    wanted = [(blade, side) for blade in "ABC" for side in ("PS", "SS")]
    home = model.hub_w + np.array([100.0, 0.0, -80.0])

    def turn_home_deg(home_w):
        *_, found = plan_steps(
            model, turbine, SETTINGS, wanted, start, 0.0, home_w=home_w
        )  # fmt: skip
        leg = found.legs[-1]
        east, north = (leg.position(leg.photos[-1]) - model.hub_w)[:2]
        return abs(np.degrees(np.arctan2(north, east)))

    assert turn_home_deg(home) < 45.0 < 90.0 < turn_home_deg(None)


def test_the_way_out_that_is_homeward_ends_nearer_to_home_than_the_shortest():
    model, _, found = planned(17.0, 85.0)
    nearer_m = []
    for leg in found.legs:
        here = leg.line()[-1]
        shortest = found.roadmap.way_out(here)
        # Home lies where the shortest way does not lead.
        home = model.hub_w - 2.0 * (shortest[-1] - model.hub_w)
        home[2] = 0.0
        homeward = found.roadmap.way_out(here, home)
        ends = np.linalg.norm(np.array([shortest[-1], homeward[-1]]) - home, axis=1)
        nearer_m.append(ends[0] - ends[1])
    assert min(nearer_m) > -1e-6
    assert np.median(nearer_m) > 5.0


@pytest.mark.parametrize("name", ["v27", "nrel-1.72-103", "iea-15-240"])
def test_other_sizes_are_planned_as_well(name):
    _, _, found = planned(40.0, 85.0, name, [("A", "PS"), ("B", "SS"), ("C", "LE")])
    assert sum(p.planned_m for p in found.passes) > 0.6 * sum(p.length_m for p in found.passes)


def test_what_the_gimbal_cannot_see_is_told_by_metre():
    # A level blade that turns its side straight down would have to be looked up at.
    level = SETTINGS.gimbal.model_copy(update={"max_pitch_deg": 10.0})
    settings = SETTINGS.model_copy(update={"gimbal": level})
    _, _, found = planned(30.0, 0.0, settings=settings)
    blind = [p for p in found.passes if not p.legs]
    assert blind
    assert all("gimbal" in gap.reason for p in blind for gap in p.unseen)


def test_a_side_that_faces_the_ground_is_shown_by_oblique_passes():
    model, _, found = planned(30.0, 0.0, "nrel-1.72-103")
    turbine = load_turbine("nrel-1.72-103")
    for frame in model.frames:
        skins = blade_skin(frame, turbine)
        looks = [
            Look(leg.position(metre), -leg.view_w)
            for leg in found.legs
            if leg.blade == frame.name
            for metre in leg.photos
        ]
        for side in ("PS", "SS"):
            seen = np.any([skins[side].seen_in(look, SETTINGS) for look in looks], axis=0)
            assert skins[side].share(seen) > 0.8


def test_the_view_is_within_the_gimbals_limits():
    _, _, found = planned(60.0, 88.0)
    for leg in found.legs:
        elevation = np.degrees(np.arcsin(-leg.view_w[2]))
        assert -90 <= elevation <= 28


def test_photos_cover_the_leg_with_overlap():
    metres = photo_metres(0.0, 33.0, 4.0, 0.3)
    assert metres[0] <= 2.0
    assert metres[-1] >= 31.0
    assert np.diff(metres).max() <= 4.0 * 0.7 + 1e-9
    assert photo_metres(3.0, 5.0, 4.0, 0.3) == (4.0,)


def test_the_footprint_depends_on_how_the_blade_lies_in_the_picture():
    view = np.array([0.0, -1.0, 0.0])
    level = footprint_m(np.array([1.0, 0.0, 0.0]), view, 12.0, SETTINGS)
    upright = footprint_m(np.array([0.0, 0.0, 1.0]), view, 12.0, SETTINGS)
    assert level == pytest.approx(4.56, abs=0.01)
    assert upright == pytest.approx(3.42, abs=0.01)
