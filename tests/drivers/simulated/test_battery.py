import pytest

from config.airframe import Battery
from drivers.simulated.battery import Pack


def drained(seconds, airspeed=0.0, climb=0.0, flying=True):
    pack = Pack(Battery())
    for _ in range(int(seconds)):
        pack.step(1.0, flying=flying, airspeed_mps=airspeed, climb_mps=climb)
    return pack


def test_hovering_a_tenth_of_an_hour_draws_the_power_of_the_model():
    pack = drained(360)
    assert pack.used_wh == pytest.approx((800 + 25) / 10)
    assert pack.charge == pytest.approx(1 - pack.used_wh / 500)


def test_wind_and_climb_cost_and_the_ground_hardly():
    assert drained(10, airspeed=12.0).charge < drained(10).charge
    assert drained(10, climb=3.0).charge < drained(10).charge
    assert drained(10, flying=False).used_wh < 0.1


def test_the_voltage_falls_with_the_charge():
    assert drained(1000).pack_v < drained(10).pack_v
    assert drained(5000).charge == 0.0


def test_a_charged_pack_takes_the_place_of_an_empty_one_and_what_was_used_stays_counted():
    pack = drained(600)
    used_wh = pack.used_wh
    assert pack.told < 0.8
    pack.renew()
    assert pack.charge == pack.told == 1.0
    assert pack.used_wh == used_wh
