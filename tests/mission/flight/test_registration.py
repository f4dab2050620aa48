"""What the flight believes of a measured offset, and what it takes for a moved rotor."""

from types import SimpleNamespace

import numpy as np
import pytest

from config.settings import Settings
from mission.flight.observation import BladeTrack, RotorEstimate, TurbineSeen
from mission.flight.phases.registration import Registration

#: Of a sighting: its place within 0.2 m, its heading within 0.1 deg.
SURE = (0.04, 0.0, 0.0, 0.0, 0.04, 0.0, 0.0, 0.04, 0.0, 3e-6)
LEG = SimpleNamespace(
    blade="A", view_w=np.array([0.0, -1.0, 0.0]), metre_of=lambda _: 10.0, axis_w=np.eye(3)[2],
    beside=lambda _: 10.0, looked_at=lambda beside_m: beside_m,
    centre=lambda _: np.zeros(3), length_m=40.0, blind=False,
    distance_at=lambda _: 12.0,
)  # fmt: skip


def seen(registration, offsets, *, blade="A", begin_s=0.0, settings=None):
    """Feed offsets (N, 3), ten a second; return the last shift and the longest `moved_s`."""
    longest, shift = 0.0, np.zeros(3)
    for index, offset in enumerate(offsets):
        now_s = begin_s + 0.1 * index
        track = BladeTrack(now_s, blade, (0, 0, 0), (0, 0, 1), 12.0, 500.0, tuple(offset), 0.1)
        flight = SimpleNamespace(
            observation=SimpleNamespace(blade=track, clearance=None), now_s=now_s, dt_s=0.1,
            here_w=np.zeros(3), settings=settings or Settings(), rotor=None,
            vehicle=SimpleNamespace(velocity_w=(0.0, 0.0, 0.0)),
        )  # fmt: skip
        shift = registration.update(flight, LEG)
        longest = max(longest, registration.moved_s)
    return shift, longest


@pytest.fixture
def registration():
    """One that has followed a blade 0.5 m beside its model for three seconds."""
    registration = Registration()
    registration.begin("A")
    seen(registration, np.tile([0.5, 0.0, 0.0], (30, 1)))
    return registration


def test_the_plan_follows_a_steady_offset(registration):
    shift, longest = seen(registration, np.tile([0.5, 0.0, 0.0], (30, 1)), begin_s=3.0)
    assert shift == pytest.approx([0.5, 0.0, 0.0], abs=0.02)
    assert longest == 0.0


@pytest.mark.parametrize(("method", "followed_m"), [("gnss", 7.5), ("rtk", 6.0)])
def test_a_drift_is_followed_as_far_as_such_a_position_drifts(method, followed_m):
    registration = Registration()
    registration.begin("A")
    drift = np.zeros((200, 3))
    drift[:, 1] = np.minimum(0.05 * np.arange(200), 7.5)
    shift, _ = seen(registration, drift, settings=Settings(positioning={"method": method}))
    assert shift == pytest.approx([0.0, followed_m, 0.0], abs=0.1)


def test_an_offset_that_jumps_for_a_moment_is_not_followed(registration):
    shift, longest = seen(registration, np.tile([0.5, 3.7, 0.0], (25, 1)), begin_s=3.0)
    assert shift == pytest.approx([0.5, 0.0, 0.0], abs=0.1)
    assert longest == 0.0


def test_an_offset_found_elsewhere_after_a_loss_is_the_positions_drift(registration):
    shift, longest = seen(registration, np.tile([0.5, 3.2, 0.0], (70, 1)), begin_s=40.0)
    assert shift == pytest.approx([0.5, 3.2, 0.0], abs=0.1)
    assert longest == 0.0


def test_a_blade_that_creeps_away_is_a_moved_rotor(registration):
    creep = np.zeros((120, 3))
    creep[:, 0] = 0.5 + 0.08 * np.arange(120)
    _, longest = seen(registration, creep, begin_s=3.0)
    assert longest > 2.0


def test_an_offset_that_jumped_and_stays_is_a_moved_rotor(registration):
    _, longest = seen(registration, np.tile([0.5, 4.5, 0.0], (70, 1)), begin_s=3.0)
    assert longest > 2.0


def test_a_blade_that_is_lost_is_flown_past_from_14_metres(registration):
    LEG.distance_at = lambda _: 12.0
    clearance = SimpleNamespace(nearest_m=30.0, nearest_w=(0.0, 30.0, 0.0))
    push = []
    for index in range(200):
        now_s = 3.0 + 0.05 * index
        flight = SimpleNamespace(
            observation=SimpleNamespace(blade=None, clearance=clearance), now_s=now_s, dt_s=0.05,
            here_w=np.zeros(3), settings=Settings(), rotor=None,
            vehicle=SimpleNamespace(velocity_w=(0.0, 0.0, 0.0)),
        )  # fmt: skip
        shift = registration.update(flight, LEG)
        push.append(float((shift - [0.5, 0.0, 0.0]) @ LEG.view_w))
    assert max(push[:35]) < 0.01
    assert push[-1] == pytest.approx(2.0, abs=0.1)


def sighted(leg, offset_w, turbine_w, *, heading_rad=0.0, settings=None):
    """Follow a blade for five seconds, the turbine sighted each; return registration and shift."""
    registration, shift = Registration(), np.zeros(3)
    registration.begin("A")
    rotor = RotorEstimate(stamp_s=1.0, sequence=1)
    for index in range(100):
        now_s = 60.0 + 0.05 * index
        seen = TurbineSeen(60.0 + index // 20, turbine_w, heading_rad, SURE)
        track = BladeTrack(
            now_s, "A", (0, 0, 0), tuple(leg.axis_w), 12.0, 500.0, offset_w, 0.1, turbine=seen
        )
        flight = SimpleNamespace(
            observation=SimpleNamespace(blade=track, clearance=None), now_s=now_s, dt_s=0.05,
            here_w=np.zeros(3), settings=settings or Settings(), rotor=rotor,
            vehicle=SimpleNamespace(velocity_w=(0.0, 0.0, 0.0), stamp_s=now_s),
        )  # fmt: skip
        shift = registration.update(flight, leg)
    return registration, shift


def by(method):
    settings = Settings()
    positioning = settings.positioning.model_copy(update={"method": method})
    return settings.model_copy(update={"positioning": positioning})


@pytest.mark.parametrize(
    ("method", "turbine_w", "moved"),
    [("gnss", (0.3, 4.9, 0.0), False), ("gnss", (0.0, 0.0, 0.0), True),
     ("rtk", (0.3, 4.9, 0.0), True)],
)  # fmt: skip
def test_a_blade_that_the_whole_turbine_went_with_has_not_moved_unless_no_position_drifts_so(
    method, turbine_w, moved
):
    registration, _ = sighted(LEG, (0.3, 4.9, 0.0), turbine_w, settings=by(method))
    assert (registration.moved_s > 2.0) is moved


def test_a_sighting_of_the_turbine_tells_the_drift_along_the_blade():
    registration, shift = sighted(LEG, (0.3, -0.2, 0.0), (0.3, -0.2, 2.0), settings=by("gnss"))
    assert shift == pytest.approx([0.3, -0.2, 2.0], abs=0.15)
    assert registration.drift_w[2] == pytest.approx(2.0, abs=0.1)


def test_a_blade_that_the_lidar_cannot_look_at_is_where_the_turbines_drift_puts_it(registration):
    blind = SimpleNamespace(**{**vars(LEG), "blind": True, "distance_at": lambda _: 14.0})
    rotor = RotorEstimate(stamp_s=0.0, sequence=1)
    seen = TurbineSeen(4.0, (0.2, -0.1, 0.3), 0.0, SURE)
    track = BladeTrack(
        4.0, "A", (0, 0, 0), (0, 0, 1), 14.0, 0.0, (9.0, 9.0, 0.0), 0.0, from_model=True,
        turbine=seen,
    )  # fmt: skip
    flight = SimpleNamespace(
        observation=SimpleNamespace(blade=track, clearance=None), now_s=4.0, dt_s=0.05,
        here_w=np.zeros(3), settings=Settings(), rotor=rotor,
        vehicle=SimpleNamespace(velocity_w=(0.0, 0.0, 0.0), stamp_s=4.0),
    )  # fmt: skip
    shift = registration.update(flight, blind)
    assert shift == pytest.approx(registration.drift_w)
    assert shift == pytest.approx([0.2, -0.1, 0.3], abs=0.1)


def test_where_a_leaning_view_looks_lies_aside_by_what_the_heading_is_wrong():
    """Seen from below, seven metres farther along than where the blade is seen."""
    leaning = SimpleNamespace(**{
        **vars(LEG), "axis_w": np.eye(3)[0], "view_w": -np.eye(3)[2],
        "distance_at": lambda _: 12.0, "looked_at": lambda beside_m: beside_m - 7.0,
    })  # fmt: skip
    registration, shift = sighted(leaning, (0.0, 0.5, 0.0), (0.0, 0.0, 0.0), heading_rad=0.02)
    assert shift[1] == pytest.approx(0.5, abs=0.05)
    assert registration.aim_w[1] - shift[1] == pytest.approx(-7.0 * 0.02, abs=0.02)
