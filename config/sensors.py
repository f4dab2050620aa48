"""LiDAR, camera and gimbal: where they are mounted, reached, and what they can do."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import Field

from config.model import ConfigModel, NotNegative, Port, Positive


class Lidar(ConfigModel):
    """A Livox MID-360, its mounting on the body (FLU) and its network end points."""

    source: Literal["livox", "bus"] = "livox"
    """`livox`: the sensor's own UDP protocol; `bus`: someone else publishes scans on Zenoh."""
    nose_down_deg: Annotated[float, Field(ge=-90, le=90)] = 23.0
    """Mounting pitch; positive looks down (the paper writes -23)."""
    min_elevation_deg: Annotated[float, Field(ge=-90, le=0)] = -7.0
    max_elevation_deg: Annotated[float, Field(ge=0, le=90)] = 52.0
    """Field of view in the sensor's own frame."""
    offset_m: tuple[float, float, float] = (0.15, 0.0, 0.10)
    """Sensor origin in the body frame (forward, left, up)."""
    lidar_ip: str = "192.168.1.100"
    """Of the sensor: 192.168.1.1XX, where its serial number ends in XX."""
    host_ip: str = "192.168.1.5"
    """Of this computer, on the LiDAR's network."""
    lidar_command_port: Port = 56100
    host_command_port: Port = 56101
    host_push_port: Port = 56201
    host_point_port: Port = 56301
    host_imu_port: Port = 56401
    serial: str = ""
    """Accept only this serial number; empty accepts the one at `lidar_ip`."""
    scan_period_s: Annotated[float, Field(ge=0.02, le=1)] = 0.1
    """Points of so long make one scan."""
    max_range_m: Positive = 70.0
    """Farther returns are not used."""
    blind_range_m: NotNegative = 0.5
    """Nor nearer ones: they are of the vehicle itself."""
    receive_buffer_bytes: Annotated[int, Field(ge=65536)] = 4 * 1024 * 1024
    """Asked of the kernel for the points' socket (`net.core.rmem_max` has to allow it)."""

    @property
    def field_of_view_sr(self) -> float:
        """Solid angle that the sensor looks into."""
        low, high = math.radians(self.min_elevation_deg), math.radians(self.max_elevation_deg)
        return 2 * math.pi * (math.sin(high) - math.sin(low))


class Camera(ConfigModel):
    """The inspection camera: picture geometry, live stream and shutter."""

    source: Literal["rtsp", "bus"] = "rtsp"
    """`rtsp`: the camera's own stream; `bus`: someone else publishes frames on Zenoh."""
    stream_url: str = "rtsp://127.0.0.1:8554/live"
    """The live picture, by which exposure is set."""
    width_px: Annotated[int, Field(ge=64)] = 5184
    """Of a photo at its full size."""
    height_px: Annotated[int, Field(ge=64)] = 3888
    """Of a photo at its full size."""
    sensor_width_mm: Positive = 7.6
    sensor_height_mm: Positive = 5.7
    focal_length_mm: Positive = 20.0
    """The lens's own, not that of 35 mm film."""
    principal_point_px: tuple[float, float] | None = None
    """Where the optical axis meets the picture at its full size; None: at its centre."""
    distortion: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)
    """k1, k2, p1, p2, k3 of Brown and Conrady, in the order of OpenCV; from a calibration."""
    maker: str = ""
    """Written into photos whose camera does not say it itself."""
    model: str = ""
    time_sigma_s: Annotated[float, Field(ge=0, le=1)] = 0.03
    """How far the time of a photo may be off."""
    offset_m: tuple[float, float, float] = (0.20, 0.0, -0.10)
    """Optical centre in the body frame (forward, left, up)."""
    min_interval_s: Positive = 1.2
    """Shortest time between two photos."""
    shutter_s: Positive = 1 / 4000
    """Exposure time asked of the camera (a higher ISO makes up for it), and assumed for the
    motion-blur limit until the camera reports its own."""
    max_blur_px: Positive = 0.7
    """A photo is taken where motion blurs it by no more, in pixels of the full size."""
    stream_timeout_s: Positive = 2.0
    """After so long without a picture the stream is opened anew."""
    live_rate_hz: Annotated[float, Field(ge=5, le=60)] = 15.0
    """Of the live stream's pictures at most so many a second are looked at and recorded."""
    live_width_px: Annotated[int, Field(ge=320)] = 1280
    """Wider live pictures are scaled down to this."""
    component_id: Annotated[int, Field(ge=1, le=255)] = 100
    """Of the camera on the MAVLink network."""


class Gimbal(ConfigModel):
    """Gimbal limits, in degrees; pitch is positive upward, yaw relative to the nose."""

    min_pitch_deg: Annotated[float, Field(ge=-120, le=0)] = -90.0
    """Straight down is -90."""
    max_pitch_deg: Annotated[float, Field(ge=0, le=120)] = 30.0
    """What it cannot look up at is not seen: undersides."""
    max_yaw_deg: Annotated[float, Field(ge=0, le=320)] = 60.0
    max_rate_dps: Positive = 60.0
    aim_tolerance_deg: Positive = 1.0
    """A photo waits until the gimbal points this well."""
    pitch_sigma_deg: NotNegative = 0.2
    """How far the optical axis is off its reported pitch (standard deviation)."""
    yaw_sigma_deg: NotNegative = 1.0
    """How far it is off its reported heading: mostly the error of the vehicle's compass."""
    component_id: Annotated[int, Field(ge=1, le=255)] = 154
    """Of the gimbal on the MAVLink network."""
