import socket

import pytest

from drivers.systemd import Systemd


@pytest.fixture
def listener(tmp_path):
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as receiver:
        receiver.bind(str(tmp_path / "notify"))
        receiver.settimeout(2)
        yield receiver, str(tmp_path / "notify")


def test_ready_alive_and_stopping_are_told(listener):
    receiver, path = listener
    systemd = Systemd({"NOTIFY_SOCKET": path, "WATCHDOG_USEC": "10000000"})
    systemd.ready("idle")
    systemd.alive("track: along A")
    systemd.stopping()
    assert systemd.watchdog_s == 10
    assert [receiver.recv(200) for _ in range(3)] == [
        b"READY=1\nSTATUS=idle",
        b"WATCHDOG=1\nSTATUS=track: along A",
        b"STOPPING=1",
    ]


def test_outside_a_service_nothing_is_sent():
    systemd = Systemd({})
    systemd.ready("idle")
    assert not systemd.listens
    assert systemd.watchdog_s is None


def test_a_socket_that_is_gone_disturbs_nobody(tmp_path):
    Systemd({"NOTIFY_SOCKET": str(tmp_path / "gone")}).alive("x")
