"""The flight's own coverage: which skin a photo shows."""

import math

import numpy as np
import pytest

from config.presets import load_turbine
from config.settings import Settings
from mission.flight.ledger import Ledger, PhotoStatus
from mission.flight.passes import side_steps
from mission.flight.rotor_model import MeasuredBlade, rotor_model
from mission.flight.sides import blade_frame, side_view
from mission.flight.skin import Look, blade_skin

SETTINGS = Settings()
TURBINE = load_turbine("nrel-5mw")
HUB, NORMAL = np.array([0.0, 0.0, 90.0]), np.array([0.0, 1.0, 0.0])
DOWN = (0.0, 0.0, -1.0)


@pytest.fixture(scope="module")
def frame():
    return blade_frame("A", HUB, NORMAL, np.array(DOWN), 2.0, TURBINE)


@pytest.fixture(scope="module")
def skins(frame):
    return blade_skin(frame, TURBINE)


def look_at(frame, metre, view_w, distance_m=12.0, aside_m=0.0):
    across = np.cross(frame.axis_w, view_w)
    eye = frame.root_w + metre * frame.axis_w + distance_m * view_w + aside_m * across
    return Look(eye, -view_w)


def test_the_sides_face_their_views(frame, skins):
    for side, skin in skins.items():
        view = side_view(frame, side, TURBINE)
        assert float((skin.normals_w @ view).min()) >= math.cos(math.radians(45.0)) - 1e-9
        assert skin.areas_m2.sum() > 5.0
    # The two flat sides are about chord times length.
    chord = np.interp(np.linspace(0, 1, 100), TURBINE.blade.span, TURBINE.blade.chord_m).mean()
    assert skins["PS"].areas_m2.sum() == pytest.approx(chord * TURBINE.blade_length_m, rel=0.15)


def test_a_photo_shows_its_footprint_of_the_side_before_it_alone(frame, skins):
    view = side_view(frame, "PS", TURBINE)
    look = look_at(frame, 40.0, view)
    seen = skins["PS"].seen_in(look, SETTINGS)
    shown = skins["PS"].metres[seen]
    assert shown.min() > 37.5
    assert shown.max() < 42.5
    assert not skins["SS"].seen_in(look, SETTINGS).any()
    # The blade hangs: the picture's height of 3.42 m lies along it.
    assert np.ptp(shown) == pytest.approx(3.3, abs=0.6)


def test_what_is_too_far_or_beside_the_picture_is_not_shown(frame, skins):
    view = side_view(frame, "PS", TURBINE)
    assert not skins["PS"].seen_in(look_at(frame, 40.0, view, distance_m=25.0), SETTINGS).any()
    assert not skins["PS"].seen_in(look_at(frame, 40.0, view, aside_m=6.0), SETTINGS).any()


def test_without_a_pitch_there_are_no_sides():
    unknown = blade_frame("A", HUB, NORMAL, np.array(DOWN), None, TURBINE)
    assert blade_skin(unknown, TURBINE) == {}


@pytest.fixture
def flown():
    """A ledger with one side planned, and its leg."""
    names = (("A", DOWN), ("B", (0.866, 0.0, 0.5)), ("C", (-0.866, 0.0, 0.5)))
    blades = [MeasuredBlade(name, direction, 2.0) for name, direction in names]
    model = rotor_model(HUB, NORMAL, blades, TURBINE)
    *_, side = side_steps(model.frames[0], "PS", model, TURBINE, SETTINGS, 0.0)
    ledger = Ledger()
    ledger.measured({"A": blade_skin(model.frames[0], TURBINE)})
    ledger.open_side(side)
    return ledger, side


def photograph(ledger, leg, metre, status=PhotoStatus.TAKEN, aside_w=0.0):
    photo = ledger.ask(leg, metre, metre, 0.0)
    sight = leg.target(metre) - leg.position(metre)
    look = Look(leg.position(metre) + aside_w, sight / np.linalg.norm(sight))
    ledger.looked(photo, look, SETTINGS)
    ledger.settle(photo.photo_id, status)


def test_a_leg_flown_as_planned_covers_its_side(flown):
    ledger, side = flown
    for leg in side.legs:
        for metre in leg.photos:
            photograph(ledger, leg, metre)
    assert ledger.skin_share("A", "PS") > 0.97
    assert all(ledger.thin(leg, SETTINGS) == () for leg in side.legs)


def test_blurred_photos_and_photos_aimed_aside_leave_skin_to_be_shown(flown):
    ledger, side = flown
    leg = side.legs[0]
    for index, metre in enumerate(leg.photos):
        status = PhotoStatus.BLURRED if index == 5 else PhotoStatus.TAKEN
        aside = 3.0 * np.cross(leg.axis_w, leg.view_w) if index == 9 else 0.0
        photograph(ledger, leg, metre, status, aside)
    thin = ledger.thin(leg, SETTINGS)
    assert leg.photos[5] in thin
    assert leg.photos[9] in thin
    assert leg.photos[2] not in thin
    # A blurred photo stays one, whatever the camera says of it later.
    blurred = next(p for p in ledger.side(leg).photos if p.status is PhotoStatus.BLURRED)
    assert ledger.settle(blurred.photo_id, PhotoStatus.TAKEN) is None


def test_photos_out_of_the_range_of_exposure_are_kept_but_prove_nothing(flown):
    ledger, side = flown
    for leg in side.legs:
        for metre in leg.photos:
            photograph(ledger, leg, metre)
    whole = ledger.skin_share("A", "PS")
    for photo_id in range(1, 7):
        ledger.judged(photo_id, exposed=False)
    assert ledger.skin_share("A", "PS") < 0.8 * whole
    # They were asked for again where that could help: the pass as such is flown.
    assert ledger.coverage() == 1.0


def test_a_side_whose_skin_is_shown_is_done_whichever_photos_show_it(flown):
    ledger, side = flown
    for leg in side.legs:
        for metre in leg.photos:
            photograph(ledger, leg, metre)
    # Of photos as close as these, every fifth may be missing.
    leg = max(side.legs, key=lambda one: len(one.photos))
    near = ledger.side(leg).photos[4]
    ledger.settle(near.photo_id, PhotoStatus.FAILED)
    book = ledger.side(leg)
    shown = ledger.covered("A", "PS").mean()
    assert ledger.coverage() >= min(1.0, book.photographed_m() / side.planned_m)
    assert ledger.coverage() > 0.98 * shown


def test_what_two_photos_of_a_metre_did_not_show_is_not_flown_a_third_time(flown):
    ledger, side = flown
    leg = side.legs[0]
    aside = 3.0 * np.cross(leg.axis_w, leg.view_w)
    for index, metre in enumerate(leg.photos):
        photograph(ledger, leg, metre, aside_w=aside if index == 5 else 0.0)
    assert ledger.thin(leg, SETTINGS) == (leg.photos[5],)
    photograph(ledger, leg.with_photos((leg.photos[5],), again=True), leg.photos[5], aside_w=aside)
    assert ledger.thin(leg, SETTINGS) == ()


def test_a_chord_wider_than_the_picture_is_photographed_in_rows():
    broad = load_turbine("dtu-10mw")
    hub = np.array([0.0, 0.0, 119.0])
    model = rotor_model(hub, NORMAL, [MeasuredBlade("A", DOWN, 2.0)], broad)
    *_, side = side_steps(model.frames[0], "PS", model, broad, SETTINGS, 0.0)
    one, other = side.legs
    widest = other.photos[len(other.photos) // 2]
    assert one.aside(widest) == pytest.approx(-other.aside(widest))
    assert np.linalg.norm(one.aside(widest)) > 0.4
    # Away from the widest chord one row does.
    assert np.linalg.norm(one.aside(70.0)) < 1e-6
    assert max(other.photos) < 50.0


def test_photos_lie_closer_where_that_spares_a_row(flown):
    _, side = flown
    (leg,) = side.legs
    assert leg.spacing_m < 0.72 * leg.footprint_m
    assert leg.spacing_m >= 2.0
