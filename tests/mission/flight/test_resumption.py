"""An inspection in several flights: nothing that is on the disk is flown again."""

import dataclasses
import itertools
import os

import numpy as np
import pytest

from benchmarks.virtual_flight import TERMINAL, VirtualFlight
from benchmarks.virtual_turbine import Truth
from config.inspection import Inspection
from config.presets import load_turbine
from config.settings import Settings
from config.turbine import Site
from mission.flight.command import MissionState, Phase
from mission.flight.earlier import Earlier, EarlierPhoto, OnBlade
from mission.flight.ledger import PhotoStatus
from mission.flight.observation import BladeEstimate, RequestKind, RotorEstimate
from mission.flight.resumption import look_from, renamed, section_of, turned_words
from mission.flight.sides import blade_frame
from perception.rotor import blade_angles_deg
from tests.faults.killing import SAME_PLACE_M, SAME_SIGHT

TURBINE = load_turbine("v27")


def mission(truth=None, battery=1.0, earlier=None, sides=("PS", "SS"), blades=("A", "B")):
    settings = Settings(inspection=Inspection(sides=sides, blades=blades))
    apart = TURBINE.rotor_radius_m + 30.0
    site = Site(name="t1", turbine="v27", tower_north_m=apart + 3.0, tower_east_m=-2.0)
    truth = dataclasses.replace(truth or Truth(), tower_w=(0.0, apart, 0.0))

    def hook(flight, observation):
        if flight.tick == 5:
            return dataclasses.replace(observation, earlier=earlier)
        return observation

    flight = VirtualFlight(settings, site, TURBINE, truth, hook, seed=2 if earlier else 1)
    flight._battery = battery
    flight.start(sides=sides, blades=blades, flight=1 if earlier is None else earlier.flights + 1)
    return flight


def left_behind(flight, flights=1):
    """Return what a flight leaves for the next, as the recorder reads it from the disk."""
    machine = flight.machine
    if machine.plan is None:
        return Earlier(flights, 1)
    frames = {frame.name: frame for frame in machine.plan.model.frames}
    photos = []
    for book in machine.ledger.sides.values():
        for photo in book.photos:
            if photo.status not in (PhotoStatus.TAKEN, PhotoStatus.REJECTED):
                continue
            centre, directions = section_of(frames[photo.leg.blade], flight.turbine, photo.metre)
            eye = directions.T @ (photo.look.eye_w - centre)
            sight = directions.T @ photo.look.sight_w
            photos.append(
                EarlierPhoto(
                    photo.photo_id, photo.leg.blade, photo.leg.side, photo.metre,
                    photo.status is PhotoStatus.TAKEN,
                    OnBlade(photo.metre, tuple(eye.tolist()), tuple(sight.tolist())),
                )
            )  # fmt: skip
    rotor = machine.report().rotor
    skipped = tuple(key for key, book in machine.ledger.sides.items() if book.skipped)
    return Earlier(
        flights, max((p.photo_id for p in photos), default=0) + 1, tuple(photos),
        rotor.stop_angle_deg, rotor.sigma_deg, skipped,
    )  # fmt: skip


@pytest.fixture(scope="module")
def whole():
    return mission().run()


@pytest.fixture(scope="module")
def broken_off():
    """A flight that is gone, process and all, in the middle of its second pass."""
    flight = mission()
    flown = flight.run(until=Phase.TRACK)
    while flight.machine.ledger.taken() < 11:
        flight.one_tick(flown)
    return flight, flown


def taken_twice(photos):
    """Return the pairs of photos of one metre that look the same way."""
    return [
        (a, b)
        for a, b in itertools.combinations(photos, 2)
        if abs(a.target_m - b.target_m) < 0.5
        and float(a.look.sight_w @ b.look.sight_w) > SAME_SIGHT
        and float(np.linalg.norm(a.look.eye_w - b.look.eye_w)) < SAME_PLACE_M
    ]


def test_what_is_missing_is_flown_and_nothing_twice(whole, broken_off):
    first, _ = broken_off
    earlier = left_behind(first)
    second = mission(earlier=earlier)
    after = second.run()
    assert second.machine.state is MissionState.COMPLETED
    assert len(earlier.photos) >= 10
    assert len(earlier.photos) + len(after.photos) == len(whole.photos)
    for book in second.machine.ledger.sides.values():
        assert taken_twice(book.photos) == []
    numbers = [photo.photo_id for photo in after.photos]
    assert min(numbers) >= earlier.next_photo_id
    done, anew = whole.machine.report().passes, second.machine.report().passes
    for one, other in zip(done, anew, strict=True):
        assert (one.blade, one.side) == (other.blade, other.side)
        assert other.photographed_m == pytest.approx(one.photographed_m, abs=0.7)
        assert other.coverage == pytest.approx(one.coverage, abs=0.02)


SEED = 20261122
#: `make kills` asks for as many as on the wire.
KILLS = int(os.environ.get("KILLS", "3"))


@pytest.fixture(scope="module")
def lost(whole):
    """What is left behind at random moments of a flight."""
    moments = np.random.default_rng(SEED).uniform(0.0, whole.duration_s, KILLS)
    flight, found = mission(), []
    begun_s, flown = flight.now_s, flight.run(0.0)
    for moment in np.sort(moments):
        while flight.now_s - begun_s < moment:
            flight.one_tick(flown)
        found.append((float(moment), left_behind(flight)))
    return found


@pytest.mark.slow
@pytest.mark.parametrize("number", range(KILLS))
def test_killed_at_a_random_moment_it_is_completed_and_nothing_is_flown_twice(whole, lost, number):
    moment, earlier = lost[number]
    second = mission(earlier=earlier)
    after = second.run()
    words = f"seed {SEED}, killed after {moment:.1f} s with {len(earlier.photos)} photos"
    assert second.machine.state is MissionState.COMPLETED, words
    books = second.machine.ledger.sides.values()
    kept = {photo.photo_id for book in books for photo in book.photos}
    assert kept >= {photo.photo_id for photo in earlier.photos}, words
    for book in books:
        assert taken_twice(book.photos) == [], words
    # One more at most: what the flight that was killed had just taken, and not told yet.
    assert len(earlier.photos) + len(after.photos) <= len(whole.photos) + 1, words


def test_an_autopilot_that_counts_from_elsewhere_changes_nothing(whole, broken_off):
    """After a battery swap the local frame begins anew, and the nacelle may have yawed a little."""
    earlier = left_behind(broken_off[0])
    second = mission(truth=Truth(upwind_deg=258.0, pitch_deg=3.0), earlier=earlier)
    after = second.run()
    assert second.machine.state is MissionState.COMPLETED
    # A rotor that faces elsewhere is seen past its tower from elsewhere: other views may be chosen.
    assert len(earlier.photos) + len(after.photos) <= len(whole.photos) + 4


def test_a_battery_that_does_not_suffice_ends_the_flight_between_two_passes(whole):
    first = mission()
    flown = first.run(until=Phase.TRACK)
    first._battery = 0.25
    while first.machine.state not in TERMINAL:
        first.one_tick(flown)
    report = first.machine.report()
    assert report.state is MissionState.ENDED_SAFELY
    assert report.swap
    assert "resume with a fresh one" in report.words
    assert not first.armed
    assert first._battery > 0.2
    passes = [event.text for event in report.events if event.name == "pass"]
    assert 0 < len(passes) < 4
    # What was begun was finished.
    begun = {tuple(text.split(",")[0].split()) for text in passes}
    for side in report.passes:
        if (side.blade, side.side) in begun:
            assert side.photographed_m > 0.95 * side.planned_m
    second = mission(earlier=left_behind(first))
    after = second.run()
    assert second.machine.state is MissionState.COMPLETED
    assert len(flown.photos) + len(after.photos) == len(whole.photos)


def test_a_battery_that_suffices_changes_nothing(whole):
    flown = mission(battery=0.75).run()
    assert flown.machine.state is MissionState.COMPLETED
    assert flown.track == whole.track


def test_a_rotor_that_has_turned_is_refused_in_words(broken_off):
    earlier = left_behind(broken_off[0])
    second = mission(truth=Truth(stop_angle_deg=51.0), earlier=earlier)
    flown = second.run()
    report = second.machine.report()
    assert report.state is MissionState.REFUSED
    assert "the rotor has turned by +31" in report.words
    assert not flown.photos
    assert not second.armed


def test_a_side_that_the_operator_left_out_stays_left_out():
    first = mission()
    flown = first.run(until=Phase.TRACK)
    first.ask(RequestKind.SKIP)
    while first.machine.ledger.taken() < 4:
        first.one_tick(flown)
    earlier = left_behind(first)
    second = mission(earlier=earlier)
    second.run()
    assert second.machine.state is MissionState.COMPLETED
    assert earlier.skipped == tuple(
        (one.blade, one.side) for one in second.machine.report().passes if one.skipped
    )


def test_a_later_flight_does_not_take_off_before_it_knows_of_the_earlier_ones():
    flight = mission()
    flight.requests = [dataclasses.replace(flight.requests[0], flight=2)]
    flight.run(130.0)
    assert flight.machine.state is MissionState.REFUSED
    assert "earlier flights" in flight.machine.report().words
    assert flight.position[2] == 0.0


@pytest.mark.parametrize(("then", "now"), [(74.0, 75.5), (75.5, 74.0), (10.0, 10.3), (119.9, 0.2)])
def test_blades_keep_their_names_across_the_cut(then, now):
    angles = dict(zip("ABC", names_at(then), strict=True))
    named = zip("ABC", names_at(now), strict=True)
    blades = tuple(BladeEstimate(name, (angle, 0.0, 0.0), 2.0) for name, angle in named)
    anew = RotorEstimate(0.0, 1, stop_angle_deg=now, blades=blades)
    found = renamed(anew, then)
    assert [blade.name for blade in found.blades] == ["A", "B", "C"]
    for blade in found.blades:
        off = (blade.direction_w[0] - angles[blade.name] + 180.0) % 360.0 - 180.0
        assert abs(off) < 2.0
    assert not turned_words(Earlier(1, 1, stop_angle_deg=then), anew)


def names_at(stop_angle_deg):
    return blade_angles_deg(stop_angle_deg)


def test_a_place_on_a_blade_is_the_same_wherever_the_blade_stands():
    normal = np.array([0.0, 1.0, 0.0])
    place = OnBlade(9.0, (0.4, 12.0, -0.3), (0.0, -1.0, 0.0))
    for direction, pitch in (((0.0, 0.0, -1.0), 2.0), ((0.6, 0.0, 0.8), 40.0)):
        frame = blade_frame("A", np.zeros(3), normal, np.array(direction), pitch, TURBINE)
        look = look_from(place, frame, TURBINE)
        centre, directions = section_of(frame, TURBINE, 9.0)
        assert directions.T @ (look.eye_w - centre) == pytest.approx(place.eye)
        assert directions.T @ directions == pytest.approx(np.eye(3), abs=1e-9)
