"""The whole configuration as one frozen value."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from config.airframe import Airframe, Battery
from config.inspection import (
    Ascent,
    Estimation,
    Exposure,
    FermatMethod,
    Guard,
    Inspection,
    Tracking,
)
from config.links import Autopilot, Bus
from config.model import ConfigModel
from config.photos import Photos, Positioning
from config.report import Report
from config.sensors import Camera, Gimbal, Lidar
from config.service import Service
from config.simulation import Simulation
from config.turbine import Site


class Settings(ConfigModel):
    """Everything a person may set. `simulation` is read by the field process alone."""

    vehicle: Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]{1,32}$")] = "drone-1"
    """Name of this vehicle: the second part of each bus key."""
    missions_dir: str = "missions"
    """Where the missions' folders are made."""
    airframe: Airframe = Airframe()
    battery: Battery = Battery()
    autopilot: Autopilot = Autopilot()
    bus: Bus = Bus()
    service: Service = Service()
    lidar: Lidar = Lidar()
    camera: Camera = Camera()
    gimbal: Gimbal = Gimbal()
    ascent: Ascent = Ascent()
    estimation: Estimation = Estimation()
    fermat: FermatMethod = FermatMethod()
    tracking: Tracking = Tracking()
    exposure: Exposure = Exposure()
    guard: Guard = Guard()
    inspection: Inspection = Inspection()
    photos: Photos = Photos()
    positioning: Positioning = Positioning()
    report: Report = Report()
    sites: tuple[Site, ...] = ()
    """The turbines that missions may be started for."""
    simulation: Simulation = Simulation()
