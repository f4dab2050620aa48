"""A network capture of a MID-360: PCAP and PCAPNG, as tcpdump and Wireshark write them.

Any UDP datagram that is a point packet by its own header counts, whatever its ports. The link may
be Ethernet (VLAN tags too), Linux's `any` device, a loopback or raw IP.
"""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from drivers.bad_file import BadFile, read_bytes
from drivers.livox.packets import HEADER, HEADER_BYTES, POINT_BYTES, read_header
from drivers.livox.recording import RecordedPacket

_AGAIN = "capture again: tcpdump -s 0 -w FILE udp"
_GLOBAL = struct.Struct("<IHHiIII")
_MAGIC_US, _MAGIC_NS = 0xA1B2C3D4, 0xA1B23C4D
_PCAPNG = 0x0A0D0D0A
_SECTION_ORDER = 0x1A2B3C4D
_INTERFACE, _SIMPLE, _ENHANCED = 1, 3, 6
_ETHERNET, _RAW, _NULL, _LOOP, _LINUX, _LINUX_2, _IPV4 = 1, 101, 0, 108, 113, 276, 228
#: Bytes before the IP header of a link type; Ethernet is longer by its VLAN tags.
_LINK_BYTES = {_RAW: 0, _IPV4: 0, _NULL: 4, _LOOP: 4, _LINUX: 16, _LINUX_2: 20}
_IP_TYPE, _VLANS = 0x0800, (0x8100, 0x88A8)
_UDP = 17


@dataclass(frozen=True, slots=True)
class Captured:
    """One datagram: when it arrived (UTC seconds), from where, and what it says."""

    arrival_s: float
    sender: str
    payload: bytes
    whole: bool
    """False where the capture kept only its beginning."""


@dataclass(frozen=True, slots=True)
class Capture:
    """One sensor's packets of a capture."""

    sender: str
    """Its IP address."""
    packets: tuple[RecordedPacket, ...]
    sensors: int
    """In the whole capture; the one with the most packets is returned."""
    cut_off: bool
    """Whether the file ends within a packet: what stands before it is returned."""


def read_capture(path: Path) -> Capture:
    """Return the point packets of a PCAP or PCAPNG file; raise `BadFile`."""
    reader = _Reader(path, read_bytes(path))
    found: list[tuple[str, RecordedPacket]] = []
    shortened = datagrams = 0
    for datagram in reader.datagrams():
        datagrams += 1
        packet = _packet(datagram)
        if packet is not None:
            found.append((datagram.sender, packet))
        elif not datagram.whole:
            shortened += 1
    if not found and shortened:
        raise BadFile(path, "its packets were cut short while capturing", _AGAIN)
    if not found:
        raise BadFile(
            path, f"holds no point packet of a MID-360 among {datagrams} UDP datagrams", _AGAIN
        )
    (sender, _), *others = Counter(who for who, _ in found).most_common()
    packets = tuple(packet for who, packet in found if who == sender)
    return Capture(sender, packets, 1 + len(others), reader.cut_off)


def _packet(datagram: Captured) -> RecordedPacket | None:
    data = datagram.payload
    header = read_header(data, len(data))
    if header is None:
        return None
    return RecordedPacket(
        header.stamp_ns, header.interval_ns, header.number, header.data_type,
        data[HEADER_BYTES:], datagram.arrival_s,
    )  # fmt: skip


class _Reader:
    """Walks through the records of either format."""

    def __init__(self, path: Path, content: bytes) -> None:
        self._path, self._content = path, content
        self.cut_off = False

    def datagrams(self) -> Iterator[Captured]:
        """Yield the UDP datagrams; raise `BadFile` for what is no capture."""
        content = self._content
        if len(content) >= _GLOBAL.size:
            little = int.from_bytes(content[:4], "little")
            big = int.from_bytes(content[:4], "big")
            if little == _PCAPNG:
                yield from self._pcapng()
                return
            for order, magic in (("<", little), (">", big)):
                if magic in (_MAGIC_US, _MAGIC_NS):
                    yield from self._pcap(order, 1e-6 if magic == _MAGIC_US else 1e-9)
                    return
        raise BadFile(self._path, "is neither PCAP nor PCAPNG", _AGAIN)

    def _pcap(self, order: str, unit_s: float) -> Iterator[Captured]:
        content = self._content
        link = struct.unpack_from(order + "I", content, 20)[0] & 0xFFFF
        record = struct.Struct(order + "IIII")
        at = _GLOBAL.size
        while at < len(content):
            if at + record.size > len(content):
                self.cut_off = True
                return
            second, part, kept, sent = record.unpack_from(content, at)
            at += record.size
            if at + kept > len(content):
                self.cut_off = True
                return
            yield from _udp(content[at : at + kept], link, second + part * unit_s, kept == sent)
            at += kept

    def _pcapng(self) -> Iterator[Captured]:
        content = self._content
        order, at = "<", 0
        links: list[tuple[int, float]] = []
        while at < len(content):
            if at + 12 > len(content):
                self.cut_off = True
                return
            kind = struct.unpack_from(order + "I", content, at)[0]
            if kind == _PCAPNG:
                little = struct.unpack_from("<I", content, at + 8)[0] == _SECTION_ORDER
                order, links = ("<" if little else ">"), []
            size = struct.unpack_from(order + "I", content, at + 4)[0]
            if size < 12 or at + size > len(content):
                self.cut_off = True
                return
            body = content[at + 8 : at + size - 4]
            if kind == _INTERFACE and len(body) >= 8:
                links.append((struct.unpack_from(order + "H", body)[0], _unit_s(order, body[8:])))
            elif kind == _ENHANCED and len(body) >= 20:
                which, high, low, kept, sent = struct.unpack_from(order + "5I", body)
                if which < len(links):
                    link, unit_s = links[which]
                    time_s = ((high << 32) + low) * unit_s
                    yield from _udp(body[20 : 20 + kept], link, time_s, kept == sent)
            at += size


def _unit_s(order: str, options: bytes) -> float:
    """Return the unit of an interface's time stamps (option if_tsresol), 1 us unless told."""
    at = 0
    while at + 4 <= len(options):
        code, size = struct.unpack_from(order + "HH", options, at)
        if code == 9 and size == 1 and at + 4 < len(options):
            power = options[at + 4]
            return 2.0 ** -(power & 0x7F) if power & 0x80 else 10.0**-power
        if code == 0:
            break
        at += 4 + size + (-size % 4)
    return 1e-6


def _udp(frame: bytes, link: int, arrival_s: float, whole: bool) -> Iterator[Captured]:
    """Yield the datagram in a frame, if it is one of IPv4 and UDP, not a fragment."""
    at = _ip_at(frame, link)
    if at is None or len(frame) < at + 28 or frame[at] >> 4 != 4 or frame[at + 9] != _UDP:
        return
    if int.from_bytes(frame[at + 6 : at + 8], "big") & 0x3FFF:
        return
    sender = ".".join(map(str, frame[at + 12 : at + 16]))
    at += 4 * (frame[at] & 15)
    length = int.from_bytes(frame[at + 4 : at + 6], "big")
    payload = frame[at + 8 : at + length]
    yield Captured(arrival_s, sender, payload, whole and len(payload) == length - 8)


def _ip_at(frame: bytes, link: int) -> int | None:
    if link != _ETHERNET:
        return _LINK_BYTES.get(link)
    at = 12
    while int.from_bytes(frame[at : at + 2], "big") in _VLANS:
        at += 4
    return at + 2 if int.from_bytes(frame[at : at + 2], "big") == _IP_TYPE else None


def write_capture(
    path: Path,
    datagrams: Sequence[tuple[float, bytes]],
    sender: str = "192.168.1.100",
    receiver: str = "192.168.1.5",
) -> None:
    """Write (UTC seconds, packet) pairs of one sensor's point stream as a PCAP of raw IP."""
    parts = [_GLOBAL.pack(_MAGIC_NS, 2, 4, 0, 0, 65535, _RAW)]
    for arrival_s, payload in datagrams:
        udp = struct.pack(">HHHH", 56300, 56301, 8 + len(payload), 0)
        ip = struct.pack(
            ">BBHHHBBH4s4s", 0x45, 0, 28 + len(payload), 0, 0, 64, _UDP, 0,
            bytes(map(int, sender.split("."))), bytes(map(int, receiver.split("."))),
        )  # fmt: skip
        frame = ip[:10] + _checksum(ip) + ip[12:] + udp + payload
        second, rest = divmod(round(arrival_s * 1e9), 1_000_000_000)
        parts.append(struct.pack("<IIII", second, rest, len(frame), len(frame)) + frame)
    path.write_bytes(b"".join(parts))


def datagram_of(packet: RecordedPacket) -> bytes:
    """Return a packet as it goes over the wire, header and all."""
    size = HEADER_BYTES + len(packet.payload)
    points = len(packet.payload) // POINT_BYTES[packet.data_type]
    header = bytearray(HEADER_BYTES)
    HEADER.pack_into(
        header, 0, 0, size, packet.interval_ns // 100, points, packet.number & 0xFFFF,
        0, packet.data_type, 0, 0, packet.stamp_ns,
    )  # fmt: skip
    return bytes(header) + packet.payload


def _checksum(header: bytes) -> bytes:
    total = sum(struct.unpack(">10H", header))
    while total >> 16:
        total = (total & 0xFFFF) + (total >> 16)
    return struct.pack(">H", ~total & 0xFFFF)
