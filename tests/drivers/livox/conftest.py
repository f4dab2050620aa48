import socket
from contextlib import ExitStack

import pytest

from config.sensors import Lidar


@pytest.fixture
def loopback():
    """LiDAR settings on free ports of this host."""
    with ExitStack() as stack:
        socks = [stack.enter_context(socket.socket(type=socket.SOCK_DGRAM)) for _ in range(5)]
        for sock in socks:
            sock.bind(("127.0.0.1", 0))
        ports = [sock.getsockname()[1] for sock in socks]
    return Lidar(
        lidar_ip="127.0.0.1",
        host_ip="127.0.0.1",
        lidar_command_port=ports[0],
        host_command_port=ports[1],
        host_push_port=ports[2],
        host_point_port=ports[3],
        host_imu_port=ports[4],
    )
