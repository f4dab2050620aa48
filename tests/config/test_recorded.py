import pytest
from pydantic import ValidationError

from config.recorded import recorded_settings
from config.settings import Settings


def test_settings_of_today_are_read_whole():
    flown = Settings().model_copy(update={"vehicle": "heron"})
    assert recorded_settings(flown.model_dump(mode="json")) == (flown, ())


def test_what_this_version_no_longer_has_is_left_out_and_named():
    table = {"tracking": {"distance_m": 13.0, "of_old": 1}, "gone": {"x": 2}}
    table["sites"] = [{"name": "a", "turbine": "v27", "tower_north_m": 40.0, "hum": 3}]
    settings, gone = recorded_settings(table)
    assert settings.tracking.distance_m == 13.0
    assert settings.sites[0].name == "a"
    assert sorted(gone) == ["gone", "sites.0.hum", "tracking.of_old"]
    assert table["gone"] == {"x": 2}


def test_a_value_that_cannot_be_used_is_refused_as_ever():
    with pytest.raises(ValidationError, match="distance_m"):
        recorded_settings({"tracking": {"distance_m": -1.0, "of_old": 1}})
