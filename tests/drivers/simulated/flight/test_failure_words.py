"""Every device takes every failure word while the world runs, and what it reports changes."""

import math
import typing
from random import Random

import numpy as np
import pytest

from config.airframe import Battery
from config.simulation import Device, Word
from drivers.simulated.battery import Pack
from drivers.simulated.link import FaultChange
from drivers.simulated.position_error import EstimatorError

GIMBAL = 154
ALL_WORDS = typing.get_args(Word)
WORDS = [word for word in ALL_WORDS if word != "ok"]


def test_every_word_is_taken_at_any_time_and_kept_in_the_truth(flight):
    asked = [(device, word) for device in typing.get_args(Device) for word in ALL_WORDS]
    for device, word in asked:
        flight.world.fault(device, word)
        flight.advance(0.02)
    applied = [(f["device"], f["word"]) for f in flight.world.facts().faults]
    assert applied == asked
    for device in ("lidar", "camera", "stream"):
        for word in ALL_WORDS:
            assert FaultChange(device, word) in flight.to_renderer


@pytest.mark.parametrize("word", WORDS)
@pytest.mark.parametrize(("device", "axis", "least"), [("gps", 0, 0.8), ("baro", 2, 0.8)])
def test_the_position_is_disturbed_by_every_word(device, axis, least, word):
    assert disturbed(device, word, lambda error: abs(error.position[axis])) > least


@pytest.mark.parametrize("word", WORDS)
def test_the_heading_is_disturbed_by_every_word(word):
    assert disturbed("compass", word, lambda error: abs(error.yaw)) > math.radians(3.0)


def disturbed(device, word, off):
    """Return the worst error while flying to and fro, up and down; infinite for a lost position."""
    error, worst = EstimatorError("rtk", Random(5)), 0.0
    error.fault(device, word, (0.0, 0.0, 10.0))
    for k in range(200):
        angle = 0.05 * k
        place = (4 * math.sin(angle), 0.0, 10 + 3 * math.sin(angle))
        error.step(0.1, place, (2 * math.cos(angle), 0.0, 1.5 * math.cos(angle)))
        worst = max(worst, math.inf if not error.position_ok else off(error))
    return worst


@pytest.mark.parametrize("word", ["off", "stuck", "intermittent", "slow", "delayed"])
def test_what_is_told_of_the_battery_is_disturbed(word):
    pack, away, off = Pack(Battery()), 0, 0.0
    pack.word = word
    for _ in range(600):
        pack.step(0.1, flying=True, airspeed_mps=5.0, climb_mps=0.0)
        away += not pack.present
        off = max(off, pack.told - pack.charge)
    assert away > 100 or off > 0.003


@pytest.mark.parametrize("word", ["garbage", "wrong"])
def test_what_the_battery_is_is_disturbed(flight, word):
    flight.world.fault("battery", word)
    flight.advance(0.1)
    told = flight.world.aircraft.telemetry
    assert not flight.world.aircraft.battery_ok or told.charge < 0.2


@pytest.mark.parametrize("word", WORDS)
def test_the_gimbal_is_disturbed_by_every_word(flight, word):
    def looks():
        flight.payload.heard.clear()
        for k in range(16):
            flight.payload.command(1000, -2.0 * k, 2.0 * k, 0, 0, 0, component=GIMBAL)
            flight.advance(0.1)
        told = flight.payload.of("GIMBAL_DEVICE_ATTITUDE_STATUS")
        return np.array([message.q for message in told]).reshape(-1, 4)

    flight.ack_of(1001, 1, 191, component=GIMBAL)
    before = looks()
    flight.payload.command(1000, 0, 0, 0, 0, 0, component=GIMBAL)
    flight.advance(1.0)
    flight.world.fault("gimbal", word)
    after = looks()
    assert len(before) > 5
    moved = float(np.abs(before[-1] - before[0]).sum())
    assert moved > 0.2
    fewer = len(after) < 0.9 * len(before)
    assert fewer or float(np.abs(after[-10:] - before[-10:]).max()) > 0.02 * moved
