"""The metre of a photo and its uncertainty, against a true world with a vehicle that errs."""

import math
from dataclasses import replace
from random import Random

import numpy as np
import pytest
from pydantic import TypeAdapter

from config.photos import Positioning
from config.presets import load_turbine
from config.settings import Settings
from drivers.bus import Key
from drivers.simulated.position_error import EstimatorError
from mission.flight.command import PhotoCommand, SensingMode, SensingTask
from mission.flight.observation import (
    BladeEstimate,
    BladeTrack,
    FlightMode,
    GimbalState,
    RotorEstimate,
    Vehicle,
)
from mission.records.photo_moment import ROTOR_SIGMA_M, PhotoHistory
from mission.records.photo_view import view_of
from mission.remote.messages import PhotoTakenMessage, VehicleMessage

TURBINE = load_turbine("windpact-1.5")
HUB = np.array([10.0, 60.0, 84.0])
NORMAL = np.array([0.0, 1.0, 0.0])
STEP_S = 0.1
SPEED_MPS = 1.2
BLACK = np.zeros((486, 648), np.uint8)
_TASK, _ROTOR, _BLADE = (TypeAdapter(kind) for kind in (SensingTask, RotorEstimate, BladeTrack))


def settings_of(method):
    return Settings().model_copy(update={"positioning": Positioning(method=method)})


def xyz(values):
    return tuple(float(value) for value in values)


class World:
    """A vehicle that flies along blades 12 m before them and reports itself with errors."""

    def __init__(self, method, seed, pitch_deg=0.0):
        self.settings = settings_of(method)
        self.history = PhotoHistory(self.settings.positioning)
        self.error = EstimatorError(method, Random(seed))
        self.rng = np.random.default_rng(seed)
        self.pitch_deg = pitch_deg
        self.now_s = 0.0
        self.at(HUB, 30.0)
        rotor_error = np.array(self.error.position)
        # The fit has its own error, the vehicle's wander at that moment comes on top.
        self.hub = HUB + rotor_error + self.rng.normal(0.0, ROTOR_SIGMA_M, 3)
        self.say_rotor()

    def at(self, place, seconds):
        for _ in range(round(seconds / STEP_S)):
            self.now_s += STEP_S
            self.error.step(STEP_S, xyz(place), (0.0, 0.0, 0.0))

    def direction(self, angle_deg):
        angle = math.radians(angle_deg)
        return np.array([math.sin(angle), 0.0, -math.cos(angle)])

    def say_rotor(self):
        blades = tuple(
            BladeEstimate(name, xyz(self.direction(angle)), self.pitch_deg)
            for name, angle in (("A", 30.0), ("B", 150.0), ("C", 270.0))
        )
        rotor = RotorEstimate(
            self.now_s, 1, hub_w=xyz(self.hub), normal_w=xyz(NORMAL), blades=blades
        )
        self.history.take(Key.ROTOR, _ROTOR.dump_json(rotor))

    def fly(self, blade, angle_deg, metres):
        """Fly along a blade; return (true metre, view) of a photo every few metres."""
        axis = self.direction(angle_deg)
        length = TURBINE.blade_length_m
        root = self.hub + TURBINE.hub_radius_m * axis
        task = SensingTask(
            SensingMode.BLADE, 1, hub_w=xyz(self.hub), normal_w=xyz(NORMAL), blade=blade,
            side="PS", blade_root_w=xyz(root), blade_tip_w=xyz(root + length * axis),
        )  # fmt: skip
        self.history.take(Key.TASK, _TASK.dump_json(task))
        photos = []
        velocity = SPEED_MPS * math.copysign(1.0, metres[-1] - metres[0]) * axis
        steps = round(abs(metres[-1] - metres[0]) / SPEED_MPS / STEP_S)
        for tick, metre in enumerate(np.linspace(metres[0], metres[-1], steps)):
            foot = HUB + (TURBINE.hub_radius_m + metre) * axis
            place = foot - 12.0 * NORMAL
            self.at(place, STEP_S)
            self.say(place, velocity)
            self.say_blade(blade, axis, foot, root, metre, length)
            if tick % 20 == 10:
                photos.append((metre, self.photo(blade, metre, foot, place)))
        return photos

    def say(self, place, velocity):
        """The vehicle's report: position and heading err; so does the gimbal's heading."""
        position = place + np.array(self.error.position)
        self.yaw = math.pi / 2 + self.error.yaw
        vehicle = Vehicle(
            self.now_s, xyz(position), xyz(velocity),
            (math.cos(self.yaw / 2), 0.0, 0.0, math.sin(self.yaw / 2)), self.yaw,
            FlightMode.OFFBOARD, self.now_s, True, True, False, self.now_s,
        )  # fmt: skip
        # The gimbal truly looks straight at the blade, a little off.
        self.true_yaw = math.pi / 2 + self.rng.normal(0.0, 0.002)
        self.true_pitch = self.rng.normal(0.0, 0.002)
        gimbal = GimbalState(self.now_s, self.true_yaw + self.error.yaw, self.true_pitch)
        message = VehicleMessage(vehicle=vehicle, gimbal=gimbal)
        self.history.take(Key.VEHICLE, message.model_dump_json().encode())

    def say_blade(self, blade, axis, foot, root, metre, length):
        """What the LiDAR sees of the blade, put where the vehicle believes to be."""
        seen = foot + np.array(self.error.position) + self.rng.normal(0.0, 0.03, 3)
        offset = seen - root
        offset = offset - (offset @ axis) * axis
        along = float(np.array(self.error.position) @ axis) - float((self.hub - HUB) @ axis)
        tip = length + along + self.rng.normal(0.0, 0.1) if length - metre < 5.0 else None
        track = BladeTrack(
            self.now_s, blade, xyz(seen), xyz(axis), 12.0, 500.0, xyz(offset), 0.05, tip_m=tip
        )
        self.history.take(Key.BLADE, _BLADE.dump_json(track))

    def photo(self, blade, metre, foot, place):
        """A photo now: where its optical axis truly meets the blade, and what is made of it."""
        taken = PhotoTakenMessage(
            command=PhotoCommand(1, blade, "PS", metre, 12.0), url="", index=0,
            stamp_s=self.now_s + self.rng.normal(0.0, 0.01), utc="2026-03-01T10:20:30.500Z",
            position_w=(0.0, 0.0, 0.0), quaternion_wb=(1.0, 0.0, 0.0, 0.0),
            gimbal_yaw_rad=0.0, gimbal_pitch_rad=0.0,
        )  # fmt: skip
        moment = self.history.moment(taken)
        view = view_of(moment, TURBINE, self.settings, BLACK)
        # The camera sits a little before and below the body; the truth is a ray on a line.
        x, _, z = self.settings.camera.offset_m
        eye = place + np.array([0.0, x, z])
        ray = np.array(
            [
                math.cos(self.true_pitch) * math.cos(self.true_yaw),
                math.cos(self.true_pitch) * math.sin(self.true_yaw),
                math.sin(self.true_pitch),
            ]
        )
        axis = foot - HUB
        axis = axis / np.linalg.norm(axis)
        away = eye - HUB
        lean = float(axis @ ray)
        along = float(away @ axis - lean * (away @ ray)) / (1 - lean**2)
        return along - TURBINE.hub_radius_m, view


def errors_of(method, runs):
    """Return errors and stated sigmas of the photos of several flights round the rotor."""
    errors, sigmas = [], []
    for seed in range(runs):
        world = World(method, seed, pitch_deg=None)
        for blade, angle, metres in (
            ("A", 30.0, (1.0, 32.0)), ("B", 150.0, (32.0, 1.0)), ("C", 270.0, (1.0, 32.0)),
        ):  # fmt: skip
            world.at(HUB, 15.0)
            for _, (true_metre, view) in world.fly(blade, angle, metres):
                errors.append(view.metre_m - true_metre)
                sigmas.append(view.metre_sigma_m)
    return np.array(errors), np.array(sigmas)


@pytest.mark.parametrize(("method", "least_m", "most_m"), [("rtk", 0.1, 1.2), ("gnss", 0.5, 4.0)])
def test_the_stated_sigma_of_the_metre_is_honest(method, least_m, most_m):
    errors, sigmas = errors_of(method, runs=5)
    assert len(errors) > 150
    scaled = errors / sigmas
    assert 0.6 < np.sqrt(np.mean(scaled**2)) < 1.3
    assert np.mean(np.abs(scaled) < 2) > 0.88
    assert least_m < np.quantile(np.abs(errors), 0.95) < most_m


def test_the_tip_seen_by_the_lidar_makes_the_metre_surer():
    world = World("gnss", 5)
    photos = world.fly("A", 30.0, (1.0, 32.0))
    sigmas = [view.metre_sigma_m for _, (_, view) in photos]
    assert sigmas[-1] < 0.8 * max(sigmas)


def test_the_pose_is_taken_between_the_samples():
    world = World("rtk", 1)
    world.fly("A", 30.0, (5.0, 12.0))
    last = world.history._vehicles[-1]
    taken = PhotoTakenMessage(
        command=PhotoCommand(1, "A", "PS", 12.0, 12.0), url="", index=0,
        stamp_s=last.stamp_s + 0.04, utc="2026-03-01T10:20:30.500Z", position_w=(0.0, 0.0, 0.0),
        quaternion_wb=(1.0, 0.0, 0.0, 0.0), gimbal_yaw_rad=0.0, gimbal_pitch_rad=0.0,
    )  # fmt: skip
    moment = world.history.moment(taken)
    moved = moment.position_w - np.array(last.position_w)
    np.testing.assert_allclose(moved, 0.04 * np.array(last.velocity_w), atol=1e-9)
    assert moment.blade is not None
    assert moment.blade.track is not None


def test_a_photo_of_which_nothing_was_heard_keeps_what_its_message_tells():
    history = PhotoHistory(Positioning())
    taken = PhotoTakenMessage(
        command=PhotoCommand(1, "A", "PS", 12.0, 12.0), url="", index=0, stamp_s=50.0,
        utc="2026-03-01T10:20:30.500Z", position_w=(1.0, 2.0, 3.0),
        quaternion_wb=(1.0, 0.0, 0.0, 0.0), gimbal_yaw_rad=0.4, gimbal_pitch_rad=0.1,
    )  # fmt: skip
    moment = history.moment(taken)
    assert moment.position_w.tolist() == [1.0, 2.0, 3.0]
    assert (moment.gimbal_yaw_rad, moment.gimbal_pitch_rad) == (0.4, 0.1)
    assert math.isnan(moment.turning_rps)
    assert moment.blade is None


def test_without_a_pitch_the_metre_is_still_told_by_the_axis():
    world = World("rtk", 2, pitch_deg=None)
    (_, (true_metre, view)), *_ = world.fly("A", 30.0, (5.0, 12.0))
    assert view.stations is None
    assert view.metre_m == pytest.approx(true_metre, abs=4 * view.metre_sigma_m)


def test_a_turbine_that_is_not_known_leaves_the_camera_only():
    world = World("rtk", 2)
    world.fly("A", 30.0, (5.0, 8.0))
    taken = PhotoTakenMessage(
        command=PhotoCommand(1, "A", "PS", 8.0, 12.0), url="", index=0, stamp_s=world.now_s,
        utc="2026-03-01T10:20:30.500Z", position_w=(0.0, 0.0, 0.0),
        quaternion_wb=(1.0, 0.0, 0.0, 0.0), gimbal_yaw_rad=0.0, gimbal_pitch_rad=0.0,
    )  # fmt: skip
    moment = world.history.moment(taken)
    view = view_of(moment, None, world.settings, BLACK)
    assert view.metre_m is None
    unseen = view_of(replace(moment, blade=None), TURBINE, world.settings, BLACK)
    assert unseen.stations is None
