"""A vehicle that hovers is taken over: after a flight was lost in the air, or by wish."""

import dataclasses

import numpy as np
import pytest

from mission.flight.command import MissionState, Phase
from mission.flight.earlier import Standing
from mission.flight.observation import FlightMode
from mission.flight.phases.ascend import Ascend
from tests.mission.flight.test_resumption import left_behind, mission

LATITUDE, LONGITUDE, DEG_M = 54.0, 6.0, 111_320.0


def on_the_globe(flight, shift_m=0.0):
    """Let the vehicle tell where on the globe it is; ``shift_m``: of the local frame's origin."""
    told = flight.hook

    def hook(flight, observation):
        observation = told(flight, observation)
        x, y, _ = observation.vehicle.position_w
        east = (x + shift_m) / (DEG_M * np.cos(np.radians(LATITUDE)))
        vehicle = dataclasses.replace(
            observation.vehicle, latitude_deg=LATITUDE + y / DEG_M, longitude_deg=LONGITUDE + east
        )
        return dataclasses.replace(observation, vehicle=vehicle)

    flight.hook = hook
    return flight


def standing(first):
    """Return what the journal of a lost flight tells of the rotor."""
    report = first.machine.report()
    if report.rotor is None:
        return None
    blades = tuple((b.name, b.direction_w, b.pitch_deg) for b in report.rotor.blades)
    return Standing(
        report.rotor.hub_w, report.rotor.normal_w, blades, first.machine.tower_foot_w(),
        LATITUDE, LONGITUDE, (0.0, 0.0, 0.0),
    )  # fmt: skip


def hovering(first, shift_m=0.0):
    """Return the next flight, of a vehicle that hovers where the first one left it."""
    earlier = dataclasses.replace(left_behind(first), standing=standing(first))
    second = on_the_globe(mission(earlier=earlier), shift_m)
    second.requests = [dataclasses.replace(second.requests[0], airborne=True)]
    second.position, second.yaw = first.position.copy(), first.yaw
    second.armed, second.mode = True, FlightMode.HOLD
    return second


def flown_to(photos, side="PS"):
    """Fly until so many photos are taken, beside the rotor; the process is lost there."""
    first = mission(sides=(side,), blades=("A", "B"))
    flown = first.run(until=Phase.TRACK)
    while first.machine.ledger.taken() < photos:
        first.one_tick(flown)
    return first


@pytest.mark.parametrize("photos", [2, 7])
def test_lost_beside_the_rotor_it_is_flown_out_and_completes(photos):
    first = flown_to(photos)
    assert np.linalg.norm(first.position - first._model.hub_w) < 25.0
    second = hovering(first)
    flown = second.run()
    report = second.machine.report()
    assert report.state is MissionState.COMPLETED, report.words
    assert flown.min_clearance_m >= 8.0
    order = [phase for phase in flown.phases if phase not in (Phase.IDLE, Phase.HOLD)]
    assert order[:3] == [Phase.PREFLIGHT, Phase.STAND_OFF, Phase.ASCEND]
    assert Phase.TAKEOFF not in flown.phases
    assert {event.name for event in report.events} >= {"takeover", "resumed"}
    assert not second.armed


def test_what_the_pilot_took_is_taken_back_only_by_a_request():
    first = flown_to(2)
    flown = first.run(limit_s=0.05)
    first.pilot_takes()
    while first.machine.state is MissionState.RUNNING:
        first.one_tick(flown)
    assert first.machine.state is MissionState.RELEASED
    place = first.position.copy()
    for _ in range(200):
        assert first.one_tick(flown).command.setpoint is None
    assert first.position == pytest.approx(place, abs=1.5)
    second = hovering(first)
    second.mode = FlightMode.PILOT
    after = second.run(until=Phase.TRACK)
    assert second.machine.phase is Phase.TRACK, second.machine.report().words
    assert min(flown.min_clearance_m, after.min_clearance_m) >= 8.0
    earlier = left_behind(first)
    kept = {p.photo_id for book in second.machine.ledger.sides.values() for p in book.photos}
    assert kept >= {photo.photo_id for photo in earlier.photos}


def test_an_autopilot_that_began_to_count_anew_is_not_told_where_the_rotor_was():
    second = hovering(flown_to(2), shift_m=40.0)
    flown = second.run(limit_s=20.0)
    assert "takeover" not in {event.name for event in flown.machine.report().events}


def test_lost_in_the_ascent_it_goes_on_from_there():
    first = mission(sides=("PS",), blades=("A", "B"))
    flown = first.run(until=Phase.ASCEND)
    for _ in range(100):
        first.one_tick(flown)
    second = hovering(first)
    after = second.run()
    assert second.machine.state is MissionState.COMPLETED
    assert after.min_clearance_m >= 8.0


def test_taken_over_above_the_rotor_it_comes_down_beside_the_sphere_to_see_the_tower():
    first = flown_to(2)
    second = hovering(first)
    hub, radius = first._model.hub_w, first.turbine.rotor_radius_m
    second.position = hub + np.array([4.0, -3.0, radius + 16.0])
    second.run(until=Phase.ASCEND)
    flight = second.machine._flight
    Ascend().step(flight)
    path = flight.follower.path
    places = np.stack([path.point(s)[0] for s in np.linspace(0.0, path.length_m, 60)])
    assert places[-1][2] <= flight.hub_w[2] + 0.1
    assert np.linalg.norm(places - flight.hub_w, axis=1).min() > flight.sphere_radius_m - 0.5


def test_without_the_word_for_it_nothing_in_the_air_is_taken_over():
    second = hovering(flown_to(2))
    second.requests = [dataclasses.replace(second.requests[0], airborne=False)]
    place = second.position.copy()
    flown = second.run(limit_s=130.0)
    assert second.machine.state is MissionState.REFUSED
    assert "--airborne" in second.machine.report().words
    assert second.mode is FlightMode.HOLD
    assert second.position == pytest.approx(place)
    assert not flown.photos


def test_a_hovering_vehicle_is_handed_back_hovering_where_it_was_asked_for():
    flight = mission(sides=("PS",), blades=("A",))
    place = np.array([6.0, -4.0, 30.0])
    flight.requests = [
        dataclasses.replace(flight.requests[0], airborne=True, rendezvous_w=(6.0, -4.0, 30.0))
    ]
    flight.position, flight.armed, flight.mode = np.array([2.0, 1.0, 22.0]), True, FlightMode.HOLD
    flown = flight.run()
    assert flight.machine.state is MissionState.COMPLETED
    assert flight.armed
    assert flight.mode is FlightMode.HOLD
    assert np.linalg.norm(flight.position - place) < 2.0
    assert flown.min_clearance_m >= 8.0
    assert len(flown.photos) > 3


def test_a_home_that_moved_is_where_it_lands():
    flight = mission(sides=("PS",), blades=("A",))
    told = flight.hook

    def hook(flight, observation):
        observation = told(flight, observation)
        if flight.now_s < 160.0:
            return observation
        vehicle = dataclasses.replace(observation.vehicle, home_w=(-9.0, 3.0, 0.0))
        return dataclasses.replace(observation, vehicle=vehicle)

    flight.hook = hook
    flight.run()
    assert flight.machine.state is MissionState.COMPLETED
    assert flight.position[:2] == pytest.approx([-9.0, 3.0], abs=2.0)


def test_offboard_that_is_refused_leaves_the_vehicle_where_it_hovers():
    second = hovering(flown_to(2))
    told = second.hook

    def hook(flight, observation):
        return dataclasses.replace(told(flight, observation), offboard_refused="no")

    second.hook = hook
    place = second.position.copy()
    second.run(limit_s=60.0)
    # Beside the rotor the autopilot's own landing would be the worst that can be asked for.
    assert second.machine.state is MissionState.RELEASED
    assert second.mode is not FlightMode.LAND
    assert second.position == pytest.approx(place, abs=0.1)
