"""A turbine type: public dimensions and, where published, the shape of its blade."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from config.model import ConfigModel, NotNegative, Positive


class BladeShape(ConfigModel):
    """Spanwise law of a blade; station 0 is the root flange, 1 the tip."""

    span: tuple[float, ...]
    """Station as a share of the blade's length, rising from 0 to 1."""
    chord_m: tuple[float, ...]
    twist_deg: tuple[float, ...]
    """Positive turns the leading edge upwind (towards feather)."""
    thickness: tuple[float, ...]
    """Section thickness as a share of the chord (1 = circular root)."""
    prebend_m: tuple[float, ...]
    """Upwind positive."""
    pitch_axis: tuple[float, ...]
    """Where the pitch axis passes, as a share of the chord from the leading edge."""

    @model_validator(mode="after")
    def _columns_match(self) -> Self:
        columns = (self.chord_m, self.twist_deg, self.thickness, self.prebend_m, self.pitch_axis)
        if any(len(column) != len(self.span) for column in columns):
            raise ValueError("every column of the blade needs one value per span station")
        rising = all(b > a for a, b in zip(self.span, self.span[1:], strict=False))
        if len(self.span) < 3 or not rising or self.span[0] != 0 or self.span[-1] != 1:
            raise ValueError("span must rise from 0 to 1 over at least three stations")
        return self


class Turbine(ConfigModel):
    """Dimensions of a turbine type; `shape` says whether the blade's form is published."""

    name: str
    source: Annotated[str, Field(min_length=3)]
    shape: Literal["published", "generic"] = "generic"
    rated_mw: Positive
    hub_height_m: Positive
    rotor_diameter_m: Positive
    blade_length_m: Positive
    hub_radius_m: Positive
    """From the shaft to the blade bearings (root flanges)."""
    tilt_deg: Annotated[float, Field(ge=0, le=12)] = 5.0
    cone_deg: Annotated[float, Field(ge=-5, le=10)] = 2.5
    overhang_m: Positive = 4.0
    """From the tower's axis to the hub centre, along the shaft."""
    tower_height_m: Positive
    tower_base_diameter_m: Positive
    tower_top_diameter_m: Positive
    nacelle_length_m: Positive = 10.0
    nacelle_width_m: Positive = 4.0
    nacelle_height_m: Positive = 4.0
    rotation: Literal["clockwise", "counter-clockwise"] = "clockwise"
    """Seen from upwind."""
    blade: BladeShape

    @property
    def rotor_radius_m(self) -> float:
        """Radius of the rotor disc."""
        return self.rotor_diameter_m / 2


class Site(ConfigModel):
    """One turbine where it stands: its type and what is known of its place beforehand."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]{1,64}$")]
    turbine: str
    """Name of the turbine type (preset)."""
    scale: Annotated[float, Field(gt=0.1, le=2)] = 1.0
    """Named scaling of the type's lengths, for smaller or larger blades of the same family."""
    tower_east_m: float = 0.0
    """Tower base relative to the take-off point (prior, metres)."""
    tower_north_m: float = 60.0
    tower_up_m: float = 0.0
    nacelle_yaw_deg: Annotated[float, Field(ge=0, lt=360)] | None = None
    """Compass direction into which the rotor faces (upwind), where known."""
    blade_pitch_deg: Annotated[float, Field(ge=-10, le=100)] | None = None
    position_sigma_m: NotNegative = 5.0
    blade_serials: dict[Literal["A", "B", "C"], str] = Field(default_factory=dict)
    """Which physical blade stands in which position, where that is known."""
