import random
import socket
from contextlib import ExitStack

import pytest

from config.sensors import Lidar


@pytest.fixture
def loopback():
    """LiDAR settings on free ports of this host."""
    with ExitStack() as stack:
        ports = [_free_port(stack) for _ in range(5)]
    return Lidar(
        lidar_ip="127.0.0.1",
        host_ip="127.0.0.1",
        lidar_command_port=ports[0],
        host_command_port=ports[1],
        host_push_port=ports[2],
        host_point_port=ports[3],
        host_imu_port=ports[4],
    )


def _free_port(held):
    """Return a port that is free until ``held`` is closed, and that nobody is given by chance.

    Below those that the system hands out: what runs beside would be given one of them at any time.
    """
    while True:
        sock = held.enter_context(socket.socket(type=socket.SOCK_DGRAM))
        try:
            sock.bind(("127.0.0.1", random.randrange(20_000, 32_000)))
        except OSError:
            continue
        return sock.getsockname()[1]
