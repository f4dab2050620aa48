import socket

import pytest

from drivers.free_port import FIRST, LAST, free_port


@pytest.mark.parametrize("kind", [socket.SOCK_STREAM, socket.SOCK_DGRAM])
def test_the_port_can_be_taken_and_is_none_that_the_system_gives_away(kind):
    port = free_port(kind)
    assert FIRST <= port < LAST
    with socket.socket(socket.AF_INET, kind) as taken:
        taken.bind(("127.0.0.1", port))


def test_a_port_that_is_taken_is_not_given(monkeypatch):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        wanted = free_port(socket.SOCK_DGRAM)
        taken.bind(("127.0.0.1", wanted))
        drawn = iter([wanted, wanted, FIRST + (wanted - FIRST + 7) % (LAST - FIRST)])
        monkeypatch.setattr("random.SystemRandom.randrange", lambda *_: next(drawn))
        assert free_port(socket.SOCK_DGRAM) != wanted
