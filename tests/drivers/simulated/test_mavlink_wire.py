import socket
from contextlib import closing

import pytest

from drivers.free_port import free_port
from drivers.simulated.mavlink_wire import MavlinkLink, mavlink


@pytest.mark.parametrize(
    ("arrived_s", "due_s"), [(4.0, 4.02), (99.0, 10.02)], ids=["in time", "not from the future"]
)
def test_what_came_while_nobody_read_is_delivered_in_its_time(arrived_s, due_s):
    port = free_port(socket.SOCK_DGRAM)
    heartbeat = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)
    with (
        closing(MavlinkLink(f"udpout://127.0.0.1:{port}", delay_s=0.02)) as link,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender,
    ):
        sender.sendto(heartbeat.pack(mavlink.MAVLink(None, 255, 190)), ("127.0.0.1", port))
        link.read(10.0, lambda _: arrived_s)
        assert link.due(due_s - 0.001) == []
        (received,) = link.due(due_s)
    assert received.message.get_type() == "HEARTBEAT"
