"""The synthetic world of `bladescout simulate`: what is drawn, how hard, how fast."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from config.model import ConfigModel, Fraction, NotNegative, Port, Positive

Draw = float | Literal["random"]
Word = Literal["ok", "off", "stuck", "garbage", "wrong", "slow", "delayed", "intermittent"]
Device = Literal["lidar", "camera", "stream", "gimbal", "gps", "battery", "link", "compass", "baro"]


class TruthDraws(ConfigModel):
    """The turbine as it really stands; `random` is drawn by the seed."""

    stop_angle_deg: Draw = "random"
    nacelle_yaw_deg: Draw = "random"
    """Compass direction into which the rotor faces (upwind)."""
    pitch_deg: Draw = "random"
    pitch_spread_deg: NotNegative = 1.0
    launch_bearing_deg: Draw = "random"
    """Compass bearing from the tower to the take-off point."""
    launch_bearing_from_rotor_deg: Annotated[float, Field(ge=-180, le=180)] | None = None
    """The same bearing, clockwise from where the rotor faces: 0 in front of it, 90 crosswind, 180
    behind. Where given, it takes the place of `launch_bearing_deg`."""
    launch_distance_m: Draw = "random"
    prior_error_m: Draw = "random"
    """Horizontal error of the tower position told to the mission (0-5 m when random)."""
    rotor_rate_dps: float = 0.0
    """The rotor still turns: degrees per second."""
    yaw_rate_dps: float = 0.0


class Wind(ConfigModel):
    """Mean wind at hub height and Dryden turbulence."""

    mean_mps: Annotated[float, Field(ge=0, le=25)] | Literal["random"] = "random"
    """Random draws 2-8 m/s."""
    direction_deg: Draw = "random"
    """Compass direction it blows from."""
    turbulence: Fraction = 0.10
    """Intensity: standard deviation over mean."""
    gust_mps: NotNegative = 0.0
    """One extreme gust added on top of the mean; 0 for none."""
    gust_at_s: NotNegative = 120.0


class Weather(ConfigModel):
    """Light and air."""

    sun_elevation_deg: Annotated[float, Field(ge=-5, le=90)] = 40.0
    sun_azimuth_deg: Annotated[float, Field(ge=0, lt=360)] = 200.0
    overcast: Fraction = 0.3
    """0: clear sun, 1: diffuse only."""
    clouds: bool = True
    """Passing clouds change the light during the flight."""
    fog_extinction_per_m: Annotated[float, Field(ge=0, le=0.2)] = 0.0


class Fault(ConfigModel):
    """One rehearsed failure of one device, in mission time."""

    device: Device
    word: Word
    at_s: NotNegative
    for_s: Positive | None = None


class SimulatedCamera(ConfigModel):
    """How the simulated camera behaves."""

    exposure_mode: Literal["manual", "compensation"] = "manual"
    latency_s: NotNegative = 0.08
    """From a setting acknowledged to the first frame exposed with it."""
    stream_width_px: Annotated[int, Field(ge=160, le=1920)] = 640
    stream_height_px: Annotated[int, Field(ge=120, le=1080)] = 480
    stream_fps: Annotated[float, Field(gt=0, le=30)] = 10.0
    still_scale: Annotated[float, Field(gt=0.05, le=1)] = 0.25
    """Linear size of the stills; 1 renders all pixels."""
    http_port: Port = 8555


class Simulation(ConfigModel):
    """The field: everything the synthetic world needs and the mission must not know."""

    seed: Annotated[int, Field(ge=0)] = 1
    speed: Annotated[float, Field(gt=0, le=20)] | Literal["auto"] = "auto"
    sensors: Literal["wire", "bus"] = "wire"
    position_profile: Literal["rtk", "gnss"] = "rtk"
    autopilot_url: str = ""
    """Another PX4-like simulator in the place of the mock."""
    truth: TruthDraws = TruthDraws()
    wind: Wind = Wind()
    weather: Weather = Weather()
    camera: SimulatedCamera = SimulatedCamera()
    faults: tuple[Fault, ...] = ()
    max_duration_s: Positive = 3600.0
