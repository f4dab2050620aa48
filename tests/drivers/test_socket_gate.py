import socket
import sys
from contextlib import ExitStack

import pytest

from drivers.livox.sockets import bound
from drivers.socket_gate import Gate

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the filter is the Linux kernel's")


@pytest.fixture
def line():
    """A bound socket, and a function that sends it a datagram."""
    with ExitStack() as stack:
        here = stack.enter_context(bound("127.0.0.1", 0))
        there = stack.enter_context(bound("127.0.0.1", 0))
        yield here, lambda data: there.sendto(data, here.getsockname())


def waiting(sock):
    found = []
    while True:
        try:
            found.append(sock.recv(100))
        except BlockingIOError:
            return found


def test_what_comes_while_the_gate_is_shut_never_arrives(line):
    here, send = line
    gate = Gate(here)
    send(b"before")
    assert gate.close()
    for _ in range(3):
        send(b"while shut")
    gate.open()
    send(b"after")
    assert waiting(here) == [b"before", b"after"]


def test_a_gate_that_was_never_shut_may_be_opened(line):
    here, send = line
    Gate(here).open()
    send(b"through")
    assert waiting(here) == [b"through"]


def test_where_there_is_no_such_filter_everything_goes_through(line):
    here, send = line
    gone = socket.socket()
    gone.close()
    gate = Gate(here, gone)
    assert not gate.close()
    assert not gate.shut
    send(b"through")
    assert waiting(here) == [b"through"]
