"""The views of a side are few, show its skin, and show it finely where they can."""

import math
from dataclasses import astuple

import numpy as np
import pytest

from benchmarks.virtual_turbine import Truth, true_model
from config.presets import load_turbine
from config.settings import Settings
from mission.flight.footprint import gsd_m
from mission.flight.occlusion import behind_tower
from mission.flight.passes import UPRIGHT
from mission.flight.section import Section
from mission.flight.skin import INCIDENCE_COS, Skin, blade_skin
from mission.flight.view_cover import FINE_GSD_MM, MIN_GAIN, cover_steps
from mission.flight.views import Around

TURBINE = load_turbine("nrel-1.72-103")


def views_of(blade, side, *, stop=20.0, pitch=3.0, settings=None):
    """Return the chosen views, the side's skin, and which metre each facet lies at."""
    model = true_model(Truth(stop_angle_deg=stop, pitch_deg=pitch), TURBINE)
    frame = next(each for each in model.frames if each.name == blade)
    grid = np.linspace(0.0, frame.length_m, math.ceil(frame.length_m) + 1)
    around = Around(model, settings or Settings(), 0.0, UPRIGHT)
    *slices, chosen = cover_steps(frame, side, Section(frame, TURBINE, grid), around)
    assert all(step is None for step in slices)
    skin = blade_skin(frame, TURBINE)[side]
    place = np.clip(np.rint(skin.metres / (grid[1] - grid[0])), 0, len(grid) - 1).astype(int)
    return chosen, skin, place


def shown(one, skin, place):
    return (skin.normals_w @ one.view.view_w >= INCIDENCE_COS) & one.stretch[place]


def coarse(one):
    """Return along how many metres a view is flown from where pixels are coarse."""
    distance = one.view.distance_m[one.stretch]
    return int((1000.0 * gsd_m(1.0, Settings()) * distance > FINE_GSD_MM).sum())


def test_a_side_that_the_straight_view_shows_is_flown_straight_and_once():
    (only,), skin, place = views_of("A", "PS")
    assert (only.view.turn_deg, only.view.slant_deg) == (0, 0)
    assert skin.share(shown(only, skin, place)) > 0.98


def test_a_root_that_the_nacelle_keeps_at_a_distance_is_looked_at_from_nearer_as_well():
    chosen, _, _ = views_of("A", "SS")
    first, *others = chosen
    assert others
    far = first.view.distance_m > 15.0
    assert far.any()
    nearer = np.fmin.reduce([np.where(o.stretch, o.view.distance_m, np.nan) for o in others])
    assert np.nanmin(first.view.distance_m[far] - nearer[far]) > 1.0


@pytest.mark.parametrize("side", ["PS", "SS", "LE", "TE"])
@pytest.mark.parametrize(("stop", "pitch"), [(0.0, 3.0), (60.0, 3.0), (60.0, 85.0), (90.0, 85.0)])
def test_each_further_view_adds_skin_or_shows_it_finely(side, stop, pitch):
    for blade in "ABC":
        chosen, skin, place = views_of(blade, side, stop=stop, pitch=pitch)
        seen = np.zeros(len(skin.metres), bool)
        fine = np.full(len(skin.metres), np.inf)
        for index, one in enumerate(chosen):
            new = shown(one, skin, place)
            distance = np.where(new, one.view.distance_m[place], np.inf)
            if index:
                better = new & ~seen | (distance < fine - 0.5)
                assert skin.share(better) > MIN_GAIN / 2
            seen |= new
            fine = np.minimum(fine, distance)


def test_the_first_view_is_turned_no_farther_than_the_settings_let_it():
    settings = Settings()
    narrow = settings.tracking.model_copy(update={"max_view_turn_deg": 15.0})
    settings = settings.model_copy(update={"tracking": narrow})
    for blade in "ABC":
        for side in ("PS", "SS", "LE", "TE"):
            chosen, *_ = views_of(blade, side, stop=60.0, pitch=85.0, settings=settings)
            if any(abs(one.view.turn_deg) <= 15 and one.stretch.any() for one in chosen):
                assert abs(chosen[0].view.turn_deg) <= 15


def test_a_side_that_the_lidar_does_not_see_is_still_flown_near_enough_for_fine_pixels():
    blind = [
        one
        for blade in "ABC"
        for side in ("PS", "SS", "LE", "TE")
        for one in views_of(blade, side, stop=60.0, pitch=85.0)[0]
        if one.view.blind and one.view.seen.sum() > 20
    ]
    assert blind
    assert min(coarse(one) / one.stretch.sum() for one in blind) < 0.3


def test_a_side_that_no_gimbal_can_look_at_still_tells_why():
    settings = Settings()
    stiff = settings.gimbal.model_copy(update={"min_pitch_deg": -5.0, "max_pitch_deg": 5.0})
    settings = settings.model_copy(update={"gimbal": stiff})
    chosen, *_ = views_of("B", "LE", stop=90.0, pitch=3.0, settings=settings)
    unseen = ~chosen[0].view.seen
    assert unseen.any()
    assert all(chosen[0].view.reason[metre] for metre in np.flatnonzero(unseen))


def test_an_edge_too_sharp_to_have_skin_is_flown_straight(monkeypatch):
    def sharp(frame, turbine):
        skins = blade_skin(frame, turbine)
        none = np.zeros(len(skins["TE"].metres), bool)
        empty = Skin(*(column[none] for column in astuple(skins["TE"])))
        return {**skins, "TE": empty}

    monkeypatch.setattr("mission.flight.view_cover.blade_skin", sharp)
    (only,), *_ = views_of("A", "TE")
    assert (only.view.turn_deg, only.view.slant_deg) == (0, 0)
    assert only.stretch.any()


@pytest.mark.parametrize(("stop", "blade"), [(5.0, "A"), (0.0, "A"), (113.0, "C")])
def test_a_blade_before_the_tower_is_looked_at_past_it(stop, blade):
    model = true_model(Truth(stop_angle_deg=stop, pitch_deg=3.0), TURBINE)
    frame = next(each for each in model.frames if each.name == blade)
    chosen, skin, place = views_of(blade, "SS", stop=stop)
    section = Section(frame, TURBINE, np.linspace(0.0, frame.length_m, place.max() + 1))
    feet_w = frame.root_w + skin.metres[:, None] * frame.axis_w
    seen = np.zeros(len(skin.areas_m2), bool)
    for one in chosen:
        distance = np.nan_to_num(one.view.distance_m, nan=1e4)
        aimed = section.centre(one.view.view_w) + distance[:, None] * one.view.view_w
        free = ~behind_tower(feet_w + aimed[place], skin.points_w, model)
        seen |= shown(one, skin, place) & free
    assert skin.share(seen) > 0.9
