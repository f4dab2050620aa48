"""A small RTSP server: the live stream of the simulated camera, H.264 over RTP (TCP and UDP).

RTSP 1.0 (RFC 2326) with the methods that players use, RTP of H.264 by RFC 6184 (single NAL units
and FU-A), encoded by libx264 through PyAV. RTP time stamps are the pictures' own times, so that a
receiver can tell a late picture from a fresh one.
"""

from __future__ import annotations

import contextlib
import logging
import re
import secrets
import socket
import struct
import threading
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from drivers.simulated.h264 import CLOCK_HZ, H264Encoder, RtpPacketizer

_log = logging.getLogger(__name__)

Picture = NDArray[np.uint8]

_MAX_REQUEST = 8192
_SEND_TIMEOUT = struct.pack("ll", 0, 500_000)  # timeval: 0.5 s
_PUBLIC = "OPTIONS, DESCRIBE, SETUP, PLAY, GET_PARAMETER, TEARDOWN"


class PictureEncoder(Protocol):
    """What makes NAL units of pictures."""

    parameter_sets: str
    """`fmtp` fields of the session description."""

    def encode(self, picture: Picture, t_s: float, *, key_frame: bool = False) -> list[bytes]:
        """Return the NAL units of a picture."""
        ...


@dataclass(slots=True, eq=False)
class _Client:
    """One connected player; `lock` keeps replies and interleaved packets apart."""

    connection: socket.socket
    address: tuple[str, int]
    session: str = field(default_factory=lambda: secrets.token_hex(4))
    lock: threading.Lock = field(default_factory=threading.Lock)
    udp: socket.socket | None = None
    udp_target: tuple[str, int] = ("", 0)
    channel: int = 0
    playing: bool = False
    packetizer: RtpPacketizer = field(default_factory=RtpPacketizer)

    def send_packet(self, packet: bytes) -> None:
        """Send one RTP packet the way that SETUP agreed."""
        if self.udp is not None:
            self.udp.sendto(packet, self.udp_target)
            return
        with self.lock:
            self.connection.sendall(struct.pack(">BBH", 0x24, self.channel, len(packet)) + packet)

    def close(self) -> None:
        """Close the sockets; a thread that still reads from them ends."""
        self.playing = False
        with contextlib.suppress(OSError):
            self.connection.shutdown(socket.SHUT_RDWR)
        self.connection.close()
        if self.udp is not None:
            self.udp.close()


class RtspServer:
    """Serves the newest picture that was pushed, encoded once for all players.

    Pictures are (height, width) grey or (height, width, 3) BGR uint8. ``width`` and ``height`` are
    even. ``push`` never waits: a picture that the encoder had no time for is replaced by the next.
    ``encoder`` stands in for libx264, for pictures that were encoded before.
    """

    def __init__(
        self,
        port: int,
        width: int,
        height: int,
        fps: float,
        host: str = "127.0.0.1",
        *,
        encoder: PictureEncoder | None = None,
    ) -> None:
        self._encoder = encoder or H264Encoder(width, height, fps)
        self._shape = (height, width)
        self._clients: list[_Client] = []
        self._clients_lock = threading.Lock()
        self._wake = threading.Condition()
        self._newest: tuple[Picture, float] | None = None
        self._key_frame_wanted = False
        self._closed = False
        self.pushed = 0
        self.encoded = 0
        self._listener = socket.create_server((host, port), backlog=8)
        self.port = int(self._listener.getsockname()[1])
        """The port that is listened on (the given one, or a free one for 0)."""

    @property
    def url(self) -> str:
        """Where players find the stream."""
        host = self._listener.getsockname()[0]
        return f"rtsp://{host}:{self.port}/live"

    def start(self) -> None:
        """Begin to serve, in threads of its own."""
        threading.Thread(target=self._accept, name="rtsp-accept", daemon=True).start()
        self._encode_thread = threading.Thread(target=self._encode, name="rtsp-encode", daemon=True)
        self._encode_thread.start()

    def push(self, picture: Picture, t_s: float) -> None:
        """Offer a picture taken at mission time ``t_s``."""
        if picture.shape[:2] != self._shape or picture.dtype != np.uint8:
            raise ValueError(f"picture of {picture.shape} {picture.dtype}, not {self._shape} uint8")
        with self._wake:
            self._newest = (picture, t_s)
            self.pushed += 1
            self._wake.notify()

    def close(self) -> None:
        """Stop serving and let every player go."""
        with self._wake:
            self._closed = True
            self._wake.notify()
        # Closing alone does not wake a thread that waits in accept().
        with contextlib.suppress(OSError):
            self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()
        with self._clients_lock:
            clients, self._clients = self._clients, []
        for client in clients:
            client.close()
        if hasattr(self, "_encode_thread"):
            self._encode_thread.join(2.0)

    def _accept(self) -> None:
        while not self._closed:
            try:
                connection, address = self._listener.accept()
            except OSError:
                return
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            # A player that stops reading is let go instead of holding up the others.
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, _SEND_TIMEOUT)
            client = _Client(connection, (str(address[0]), int(address[1])))
            with self._clients_lock:
                self._clients.append(client)
            threading.Thread(
                target=self._serve, args=(client,), name="rtsp-client", daemon=True
            ).start()

    def _drop(self, client: _Client) -> None:
        with self._clients_lock:
            if client in self._clients:
                self._clients.remove(client)
        client.close()

    def _serve(self, client: _Client) -> None:
        buffer = b""
        try:
            while not self._closed:
                received = client.connection.recv(4096)
                if not received:
                    break
                buffer += received
                buffer = self._consume(client, buffer)
        except (OSError, ValueError) as error:
            _log.debug("player %s let go: %s", client.address, error)
        finally:
            self._drop(client)

    def _consume(self, client: _Client, buffer: bytes) -> bytes:
        """Answer every whole request in the buffer; return what is left of it."""
        while buffer:
            if buffer[0] == 0x24:  # interleaved RTCP from the player: skipped
                if len(buffer) < 4 or len(buffer) < 4 + int.from_bytes(buffer[2:4], "big"):
                    return buffer
                buffer = buffer[4 + int.from_bytes(buffer[2:4], "big") :]
                continue
            head, end, rest = buffer.partition(b"\r\n\r\n")
            if not end:
                if len(buffer) > _MAX_REQUEST:
                    raise ValueError("request too long")
                return buffer
            text = head.decode("utf-8", "replace")
            length = re.search(r"(?im)^content-length:\s*(\d{1,5})\s*$", text)
            body = int(length[1]) if length else 0
            if len(rest) < body:
                return buffer
            buffer = rest[body:]
            self._answer(client, text)
        return buffer

    def _answer(self, client: _Client, request: str) -> None:
        method, _, target = request.split("\r\n", 1)[0].partition(" ")
        url = target.split(" ", 1)[0]
        sequence = re.search(r"(?im)^cseq:\s*(\d+)", request)
        lines = [f"CSeq: {sequence[1] if sequence else 0}"]
        status, body = "200 OK", ""
        if method == "OPTIONS":
            lines.append(f"Public: {_PUBLIC}")
        elif method == "DESCRIBE":
            body = self._session_description()
            lines += [f"Content-Base: {url}/", "Content-Type: application/sdp"]
        elif method == "SETUP":
            transport = self._set_up(client, request)
            if transport is None:
                status = "461 Unsupported Transport"
            else:
                lines += [f"Transport: {transport}", f"Session: {client.session};timeout=60"]
        elif method in ("PLAY", "GET_PARAMETER", "TEARDOWN"):
            lines.append(f"Session: {client.session}")
        else:
            status = "501 Not Implemented"
        lines.append(f"Content-Length: {len(body)}")
        reply = f"RTSP/1.0 {status}\r\n" + "\r\n".join(lines) + "\r\n\r\n" + body
        with client.lock:
            client.connection.sendall(reply.encode())
        if method == "PLAY":
            client.playing = True
            with self._wake:
                self._key_frame_wanted = True
        elif method == "TEARDOWN":
            raise ValueError("torn down by the player")

    def _set_up(self, client: _Client, request: str) -> str | None:
        offered = re.search(r"(?im)^transport:\s*(.+)$", request)
        text = offered[1] if offered else ""
        if "TCP" in text:
            channel = re.search(r"interleaved=(\d+)", text)
            client.channel = int(channel[1]) & 0xFE if channel else 0
            return f"RTP/AVP/TCP;unicast;interleaved={client.channel}-{client.channel + 1}"
        port = re.search(r"client_port=(\d+)", text)
        if port is None:
            return None
        client.udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        client.udp.bind((self._listener.getsockname()[0], 0))
        client.udp_target = (client.address[0], int(port[1]))
        own = client.udp.getsockname()[1]
        return (
            f"RTP/AVP;unicast;client_port={port[1]}-{int(port[1]) + 1};"
            f"server_port={own}-{own + 1};ssrc={client.packetizer.ssrc:08X}"
        )

    def _session_description(self) -> str:
        host = self._listener.getsockname()[0]
        return "\r\n".join(
            [
                "v=0",
                f"o=- 1 1 IN IP4 {host}",
                "s=live",
                f"c=IN IP4 {host}",
                "t=0 0",
                "m=video 0 RTP/AVP 96",
                f"a=rtpmap:96 H264/{CLOCK_HZ}",
                f"a=fmtp:96 packetization-mode=1;{self._encoder.parameter_sets}",
                "a=control:trackID=0",
                "",
            ]
        )

    def _encode(self) -> None:
        while True:
            with self._wake:
                self._wake.wait_for(lambda: self._closed or self._newest is not None)
                if self._closed or self._newest is None:
                    return
                (picture, t_s), self._newest = self._newest, None
                key_frame, self._key_frame_wanted = self._key_frame_wanted, False
            with self._clients_lock:
                players = [client for client in self._clients if client.playing]
            if not players:
                self._key_frame_wanted = self._key_frame_wanted or key_frame
                continue
            units = self._encoder.encode(picture, t_s, key_frame=key_frame)
            self.encoded += 1
            for client in players:
                try:
                    for packet in client.packetizer.packets(units, t_s):
                        client.send_packet(packet)
                except OSError as error:
                    _log.debug("player %s let go: %s", client.address, error)
                    self._drop(client)
