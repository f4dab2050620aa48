import socket
import threading
import time

import av
import numpy as np
import pytest

from drivers.simulated.h264 import RtpPacketizer, split_units
from drivers.simulated.rtsp_server import RtspServer


@pytest.mark.parametrize("transport", ["tcp", "udp"])
def test_a_player_receives_pictures_over_both_transports(transport: str) -> None:
    server = RtspServer(0, 160, 120, 20)
    server.start()
    stop = threading.Event()

    def push() -> None:
        colours = np.zeros((120, 160, 3), np.uint8)
        colours[:, :, 2] = 200
        while not stop.wait(0.03):
            server.push(colours, time.monotonic())

    pusher = threading.Thread(target=push)
    pusher.start()
    try:
        options = {"rtsp_transport": transport, "analyzeduration": "1", "fpsprobesize": "0"}
        with av.open(server.url, options=options, timeout=(5.0, 5.0)) as container:
            picture = next(container.decode(video=0)).to_ndarray(format="bgr24")
    finally:
        stop.set()
        pusher.join()
        server.close()
    assert picture.shape == (120, 160, 3)
    np.testing.assert_allclose(picture[60, 80], (0, 0, 200), atol=8)


def test_pushing_without_players_costs_no_encoding_and_never_waits() -> None:
    server = RtspServer(0, 160, 120, 20)
    server.start()
    begin_s = time.monotonic()
    for _ in range(500):
        server.push(np.zeros((120, 160), np.uint8), begin_s)
    assert time.monotonic() - begin_s < 0.5
    assert server.encoded == 0
    server.close()


def test_a_picture_of_the_wrong_size_is_refused() -> None:
    server = RtspServer(0, 160, 120, 20)
    with pytest.raises(ValueError, match="120, 160"):
        server.push(np.zeros((100, 160), np.uint8), 0.0)
    server.close()


def test_a_client_that_talks_nonsense_is_let_go() -> None:
    server = RtspServer(0, 160, 120, 20)
    server.start()
    with socket.create_connection(("127.0.0.1", server.port), timeout=2.0) as client:
        client.sendall(b"BREW coffee RTSP/1.0\r\nCSeq: 4\r\n\r\n")
        assert client.recv(200).startswith(b"RTSP/1.0 501")
        client.sendall(b"x" * 10_000)
        assert client.recv(200) == b""
    server.close()


def test_a_long_unit_is_cut_and_its_last_packet_is_marked() -> None:
    unit = b"\x65" + bytes(range(256)) * 20
    packets = list(RtpPacketizer().packets([b"\x67abc", unit], 2.0))
    payloads = [packet[12:] for packet in packets]
    assert payloads[0] == b"\x67abc"
    joined = bytes([payloads[1][0] & 0xE0 | payloads[1][1] & 0x1F])
    joined += b"".join(payload[2:] for payload in payloads[1:])
    assert joined == unit
    assert [packet[1] >> 7 for packet in packets] == [0] * (len(packets) - 1) + [1]
    assert max(map(len, packets)) <= 1412


def test_start_codes_of_three_and_four_bytes_are_found() -> None:
    assert split_units(b"\0\0\0\1\x67ab\0\0\1\x68c\0\0\0\1\x65d") == [b"\x67ab", b"\x68c", b"\x65d"]
