from __future__ import annotations

import numpy as np
import pytest

from config.simulation import Weather
from drivers.simulated.light import Sky


def test_clouds_pass_slowly_and_a_clear_sky_is_steady() -> None:
    cloudy, clear = Sky(Weather(), 1), Sky(Weather(clouds=False), 1)
    direct = np.array([cloudy.at(t).direct for t in np.arange(0.0, 300.0, 0.1)])
    assert direct.max() > 1.8 * direct.min() > 0.0
    assert np.abs(np.diff(np.log2(direct))).max() < 0.2  # EV per frame at 10 Hz
    assert clear.at(0.0).direct == clear.at(100.0).direct


def test_overcast_and_dusk_take_the_sun_and_then_the_sky() -> None:
    noon, covered = (Sky(Weather(overcast=o, clouds=False), 1).at(0.0) for o in (0.0, 1.0))
    assert covered.direct == 0.0
    assert covered.diffuse > noon.diffuse
    dusk = Sky(Weather(sun_elevation_deg=-4.0), 1).at(0.0)
    assert dusk.direct == 0.0
    assert 0.0 < dusk.diffuse < 0.1 * noon.diffuse


def test_the_sun_stands_where_the_compass_says() -> None:
    east = Sky(Weather(sun_azimuth_deg=90.0, sun_elevation_deg=30.0), 1).at(0.0).sun_w
    assert east == pytest.approx([np.cos(np.radians(30)), 0.0, 0.5], abs=1e-6)
