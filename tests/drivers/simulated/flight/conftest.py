"""The simulated vehicle stepped by hand, and a MAVLink client on loopback."""

import math
import socket
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from pymavlink.dialects.v20 import development as mavlink

from config.presets import load_turbine
from config.settings import Settings
from drivers.simulated.scene import Scene
from drivers.simulated.world import World

NAN = math.nan


class HandClock:
    """A clock that stands where it is put."""

    def __init__(self) -> None:
        self.time_s = 0.0

    def now_s(self) -> float:
        return self.time_s

    def factor(self) -> float:
        return 1.0

    def mission_time_of(self, monotonic_ns: int) -> float:
        return self.time_s


class Client:
    """Another MAVLink system on the vehicle's link."""

    def __init__(self, port_socket: socket.socket, system: int = 1, component: int = 191) -> None:
        self._socket = port_socket
        self._packer = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)
        self._parser = mavlink.MAVLink(None)
        self._parser.robust_parsing = True
        self.heard: list[Any] = []
        self.to: tuple[str, int] | None = None

    def listen(self) -> None:
        while True:
            try:
                data, self.to = self._socket.recvfrom(2048)
            except BlockingIOError:
                return
            self.heard += self._parser.parse_buffer(bytearray(data)) or []

    def send(self, message: Any) -> None:
        assert self.to is not None
        self._socket.sendto(message.pack(self._packer), self.to)

    def send_bytes(self, data: bytes) -> None:
        assert self.to is not None
        self._socket.sendto(data, self.to)

    def command(self, number: int, *params: float, component: int = 1) -> None:
        seven = (*params, *([NAN] * (7 - len(params))))
        self.send(mavlink.MAVLink_command_long_message(1, component, number, 0, *seven))

    def of(self, name: str) -> list[Any]:
        return [message for message in self.heard if message.get_type() == name]


class Flight:
    """World, clock and clients, advanced together in mission time."""

    def __init__(self, world: World, clock: HandClock, client: Client, payload: Client) -> None:
        self.world, self._clock = world, clock
        self.client, self.payload = client, payload
        self.to_renderer: list[Any] = []

    @property
    def now_s(self) -> float:
        return self.world.now_s

    def advance(self, seconds: float, each_tick: Callable[[int], None] | None = None) -> None:
        for tick in range(round(seconds / 0.02)):
            if each_tick is not None:
                each_tick(tick)
            self._clock.time_s += 0.02
            for link in self.world.links:
                link.read(self._clock.time_s)
            self.world.step()
            self.client.listen()
            self.payload.listen()

    def ack_of(self, number: int, *params: float, component: int = 1) -> int | None:
        client = self.client if component == 1 else self.payload
        client.heard.clear()
        client.command(number, *params, component=component)
        self.advance(0.2)
        acks = [ack.result for ack in client.of("COMMAND_ACK") if ack.command == number]
        return acks[0] if acks else None

    def setpoint(self, east: float, north: float, up: float) -> None:
        self.client.send(
            mavlink.MAVLink_set_position_target_local_ned_message(
                0, 1, 1, 1, 0x9C0, north, east, -up, 0, 0, 0, 0, 0, 0, 0.0, 0
            )
        )


def _socket_at_loopback() -> socket.socket:
    port_socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    port_socket.bind(("127.0.0.1", 0))
    port_socket.setblocking(False)
    return port_socket


@pytest.fixture
def flight() -> Iterator[Flight]:
    sockets = [_socket_at_loopback(), _socket_at_loopback()]
    urls = [f"udpin://127.0.0.1:{s.getsockname()[1]}" for s in sockets]
    settings = Settings.model_validate(
        {
            "autopilot": {"url": urls[0], "payload_url": urls[1]},
            "simulation": {"wind": {"turbulence": 0.05}},
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
        prior_error_m=(3.0, 0.0, 0.0),
    )
    clock = HandClock()
    sent: list[Any] = []
    world = World(settings, scene, clock, sent.append)
    built = Flight(world, clock, Client(sockets[0]), Client(sockets[1]))
    built.to_renderer = sent
    built.advance(2.2)
    yield built
    world.close()
    for port_socket in sockets:
        port_socket.close()


@pytest.fixture
def hovering(flight: Flight) -> Flight:
    flight.client.command(22)
    flight.client.command(400, 1)
    flight.advance(8.0)
    assert flight.world.airborne
    return flight
