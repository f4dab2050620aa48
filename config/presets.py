"""Turbine types shipped with the product, and their named scaling.

A file in `config/turbines/` states what is published of one type and where. A blade whose form
is published is a table of stations. A machine of which only rating, rotor and hub height are
public names a family instead (``like = "windpact-1.5"``); what it does not state is taken from
that family, scaled by blade length, and the shape is marked `generic`:

- chord, prebend, hub radius, overhang and nacelle by the ratio of blade lengths,
- the tower's diameters and the drop from hub to tower top by the ratio of hub heights,
- angles, section thickness and pitch axis unchanged.
"""

from __future__ import annotations

import difflib
import tomllib
from collections.abc import Iterable
from functools import lru_cache
from importlib.resources import files

from pydantic import ConfigDict, Field, ValidationError

from config.errors import ConfigError, first_fault
from config.model import ConfigModel
from config.turbine import BladeShape, Site, Turbine

_FOLDER = files("config") / "turbines"

_LENGTHS = (
    "hub_height_m",
    "rotor_diameter_m",
    "blade_length_m",
    "hub_radius_m",
    "overhang_m",
    "tower_height_m",
    "tower_base_diameter_m",
    "tower_top_diameter_m",
    "nacelle_length_m",
    "nacelle_width_m",
    "nacelle_height_m",
)

Station = tuple[float, float, float, float, float, float]
"""span, chord_m, twist_deg, thickness, prebend_m, pitch_axis"""


class _Stations(ConfigModel):
    """The blade as the file writes it: one row a station, as in the published tables."""

    stations: tuple[Station, ...] = Field(min_length=3)

    def shape(self) -> BladeShape:
        span, chord, twist, thickness, prebend, axis = zip(*self.stations, strict=True)
        return BladeShape(
            span=span,
            chord_m=chord,
            twist_deg=twist,
            thickness=thickness,
            prebend_m=prebend,
            pitch_axis=axis,
        )


@lru_cache(maxsize=1)
def turbine_names() -> tuple[str, ...]:
    """Return the names of the turbine types that `load_turbine` knows, sorted."""
    return tuple(
        sorted(
            entry.name.removesuffix(".toml")
            for entry in _FOLDER.iterdir()
            if entry.name.endswith(".toml")
        )
    )


@lru_cache(maxsize=64)
def load_turbine(name: str, scale: float = 1.0) -> Turbine:
    """Return a turbine type, all its lengths multiplied by ``scale``.

    A scaled type says so in its name ("nrel-5mw x0.60"); angles and proportions stay, the
    rating follows the swept area. Raises `ConfigError` for a name that is not known.
    """
    if name not in turbine_names():
        close = difflib.get_close_matches(name.lower(), turbine_names(), n=1)
        hint = f"; did you mean {close[0]!r}?" if close else ""
        raise ConfigError(
            f"turbine {name!r} is not known{hint} (known: {', '.join(turbine_names())})"
        )
    if not 0.1 < scale <= 2:
        raise ConfigError(f"turbine {name!r}: scale {scale:g} must be above 0.1 and at most 2")
    turbine = _read(name)
    return turbine if scale == 1.0 else _scaled(turbine, scale)


def turbines_of(sites: Iterable[Site]) -> dict[str, Turbine]:
    """Return the turbine of each site, by the site's name. Raises `ConfigError`."""
    return {site.name: load_turbine(site.turbine, site.scale) for site in sites}


def _read(name: str) -> Turbine:
    """Return the type as its file states it, completed from its family where it names one."""
    table = tomllib.loads((_FOLDER / f"{name}.toml").read_text("utf-8"))
    family = table.pop("like", None)
    try:
        if family is None:
            table["blade"] = _Stations.model_validate(table["blade"]).shape()
            return Turbine.model_validate(table)
        return _completed(table, load_turbine(str(family)))
    except ValidationError as error:
        raise ConfigError(f"turbines/{name}.toml: {first_fault(error)}") from error


def _completed(table: dict[str, object], family: Turbine) -> Turbine:
    """Return the type of ``table``, its unknown fields scaled from ``family`` (module text)."""
    partial = _Public.model_validate(table)
    radius_m = partial.rotor_diameter_m / 2
    share = family.blade_length_m / (family.blade_length_m + family.hub_radius_m)
    blade_m = partial.blade_length_m or radius_m * share
    by_blade = blade_m / family.blade_length_m
    by_tower = partial.hub_height_m / family.hub_height_m
    assumed: dict[str, object] = {
        "blade_length_m": blade_m,
        "hub_radius_m": max(radius_m - blade_m, 0.5),
        "overhang_m": family.overhang_m * by_blade,
        "tilt_deg": family.tilt_deg,
        "cone_deg": family.cone_deg,
        "tower_height_m": family.tower_height_m * by_tower,
        "tower_base_diameter_m": family.tower_base_diameter_m * by_tower,
        "tower_top_diameter_m": family.tower_top_diameter_m * by_tower,
        "nacelle_length_m": family.nacelle_length_m * by_blade,
        "nacelle_width_m": family.nacelle_width_m * by_blade,
        "nacelle_height_m": family.nacelle_height_m * by_blade,
    }
    blade = _scaled_blade(family.blade, by_blade)
    return Turbine.model_validate({**assumed, **table, "blade": blade})


class _Public(ConfigModel):
    """The figures from which the rest of a generic machine is scaled."""

    model_config = ConfigDict(extra="ignore")

    rotor_diameter_m: float = Field(gt=0)
    hub_height_m: float = Field(gt=0)
    blade_length_m: float | None = Field(default=None, gt=0)


def _scaled(turbine: Turbine, scale: float) -> Turbine:
    fields = turbine.model_dump(exclude={"blade"})
    lengths = {name: fields[name] * scale for name in _LENGTHS}
    return Turbine.model_validate(
        {
            **fields,
            **lengths,
            "name": f"{turbine.name} x{scale:.2f}",
            "rated_mw": turbine.rated_mw * scale**2,
            "blade": _scaled_blade(turbine.blade, scale),
        }
    )


def _scaled_blade(blade: BladeShape, scale: float) -> BladeShape:
    return blade.model_copy(
        update={
            "chord_m": tuple(chord * scale for chord in blade.chord_m),
            "prebend_m": tuple(bend * scale for bend in blade.prebend_m),
        }
    )
