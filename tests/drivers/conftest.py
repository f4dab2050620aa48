"""A simulated vehicle with its payload on loopback, for tests of the drivers."""

import asyncio
import socket
from collections.abc import AsyncIterator, Awaitable, Callable
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from config.presets import load_turbine
from config.settings import Settings
from drivers.clock import SharedClockWriter
from drivers.free_port import free_port
from drivers.simulated.link import CameraSetting, StillDone, StillRequest
from drivers.simulated.scene import Scene
from drivers.simulated.world import ToRenderer, World

SPEED = 5.0


@dataclass
class SimulatedVehicle:
    settings: Settings
    clock: SharedClockWriter
    world: World | None = None
    still_s: float = 0.3
    settings_told: list[CameraSetting] = field(default_factory=list)

    def to_renderer(self, message: ToRenderer) -> None:
        if isinstance(message, StillRequest):
            asyncio.get_running_loop().call_later(
                self.still_s / SPEED, self._still_done, message.index, message.t_s
            )
        elif isinstance(message, CameraSetting):
            self.settings_told.append(message)

    def _still_done(self, index: int, t_s: float) -> None:
        assert self.world is not None
        url = f"http://127.0.0.1:1/{index}.jpg"
        self.world.payload.camera.still_done(
            StillDone(index, t_s, url, ok=True, ev=0.0, shutter_s=0.0005, iso=100.0)
        )

    @property
    def truth(self) -> World:
        assert self.world is not None
        return self.world


@pytest.fixture
async def fly_vehicle(tmp_path: Path) -> AsyncIterator[Callable[..., Awaitable[SimulatedVehicle]]]:
    tasks: list[asyncio.Task[None]] = []
    worlds: list[World] = []

    async def start(*, shared_link: bool = False, exposure: str = "manual") -> SimulatedVehicle:
        payload_url = "" if shared_link else f"udpin://127.0.0.1:{free_port(socket.SOCK_DGRAM)}"
        settings = Settings.model_validate(
            {
                "autopilot": {
                    "url": f"udpin://127.0.0.1:{free_port(socket.SOCK_DGRAM)}",
                    "payload_url": payload_url,
                    "connect_timeout_s": 5.0,
                },
                "simulation": {
                    "wind": {"turbulence": 0.0},
                    "camera": {"exposure_mode": exposure},
                },
            }
        )
        scene = Scene(
            turbine=load_turbine("v90-2.0"),
            stop_angle_deg=10.0,
            nacelle_yaw_deg=180.0,
            tilt_deg=5.0,
            cone_deg=3.0,
            pitch_deg=(0.0, 0.0, 0.0),
            launch_w=(80.0, 0.0, 0.0),
            wind_mean_mps=4.0,
            wind_from_deg=180.0,
            prior_error_m=(0.0, 0.0, 0.0),
        )
        vehicle = SimulatedVehicle(settings, SharedClockWriter(tmp_path / "clock", SPEED))
        vehicle.world = World(settings, scene, vehicle.clock, vehicle.to_renderer)
        await vehicle.world.start()
        worlds.append(vehicle.world)
        tasks.append(asyncio.create_task(vehicle.world.run()))
        return vehicle

    yield start
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)
    for world in worlds:
        world.close()
