import math

import pytest

from config.errors import ConfigError
from config.presets import load_turbine, turbine_names

ALL = turbine_names()
PUBLISHED = [name for name in ALL if load_turbine(name).shape == "published"]


def test_at_least_ten_types_have_a_published_blade():
    assert len(PUBLISHED) >= 10


@pytest.mark.parametrize("name", ALL)
def test_every_type_carries_its_name_and_where_it_was_published(name):
    turbine = load_turbine(name)
    assert turbine.name == name
    assert len(turbine.source) > 20
    assert turbine.shape == "published" or "assumed" in turbine.source


@pytest.mark.parametrize("name", ALL)
def test_the_dimensions_of_every_type_fit_together(name):
    turbine = load_turbine(name)
    tip_radius_m = turbine.hub_radius_m + turbine.blade_length_m
    assert turbine.rotor_radius_m == pytest.approx(tip_radius_m, rel=0.01)
    assert turbine.tower_height_m < turbine.hub_height_m
    rise_m = turbine.overhang_m * math.sin(math.radians(turbine.tilt_deg))
    above_top_m = turbine.hub_height_m - turbine.tower_height_m - rise_m
    assert 0.5 < above_top_m < 5
    assert turbine.tower_top_diameter_m < turbine.tower_base_diameter_m


@pytest.mark.parametrize("name", ALL)
def test_every_blade_is_round_at_the_root_and_thin_at_the_tip(name):
    blade = load_turbine(name).blade
    assert blade.thickness[0] == 1.0
    assert blade.pitch_axis[0] == pytest.approx(0.5, abs=0.01)
    assert 0.1 < blade.thickness[-1] < 0.3
    pairs = zip(blade.thickness, blade.thickness[1:], strict=False)
    assert all(inner >= outer for inner, outer in pairs)
    assert 0 < blade.chord_m[-1] < max(blade.chord_m)
    assert all(0 < axis < 1 for axis in blade.pitch_axis)


def test_published_figures_are_kept():
    turbine = load_turbine("nrel-5mw")
    assert turbine.hub_height_m == 90
    assert turbine.blade_length_m == 61.5
    assert max(turbine.blade.chord_m) == 4.652
    assert turbine.blade.twist_deg[0] == pytest.approx(13.31)


def test_scaling_multiplies_lengths_and_says_so_in_the_name():
    whole, scaled = load_turbine("iea-3.4-130"), load_turbine("iea-3.4-130", 0.6)
    assert scaled.name == "iea-3.4-130 x0.60"
    assert scaled.blade_length_m == pytest.approx(0.6 * whole.blade_length_m)
    assert scaled.tower_base_diameter_m == pytest.approx(0.6 * whole.tower_base_diameter_m)
    assert scaled.blade.chord_m[3] == pytest.approx(0.6 * whole.blade.chord_m[3])
    assert scaled.blade.prebend_m[-1] == pytest.approx(0.6 * whole.blade.prebend_m[-1])
    assert scaled.blade.twist_deg == whole.blade.twist_deg
    assert scaled.tilt_deg == whole.tilt_deg


def test_a_generic_machine_keeps_its_public_figures_and_borrows_the_rest():
    machine, family = load_turbine("v117-3.45"), load_turbine("iea-3.4-130")
    assert machine.shape == "generic"
    assert (machine.rotor_diameter_m, machine.hub_height_m) == (117, 91.5)
    assert machine.blade_length_m == 57.5
    ratio = machine.blade_length_m / family.blade_length_m
    assert max(machine.blade.chord_m) == pytest.approx(max(family.blade.chord_m) * ratio)


def test_an_unknown_type_is_one_sentence_with_the_nearest_name():
    with pytest.raises(ConfigError, match="'nrel-5m' is not known; did you mean 'nrel-5mw'"):
        load_turbine("nrel-5m")


@pytest.mark.parametrize("scale", [0.0, -1.0, 2.1, math.nan, math.inf])
def test_a_scale_out_of_range_is_refused(scale):
    with pytest.raises(ConfigError, match="scale"):
        load_turbine("nrel-5mw", scale)
