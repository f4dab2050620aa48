"""LVX2 and network captures: what was written is read, however it was captured."""

import struct

import numpy as np
import pytest

from drivers.bad_file import BadFile
from drivers.livox.capture import datagram_of, read_capture, write_capture
from drivers.livox.lvx2 import read_lvx2, write_lvx2
from drivers.livox.packets import POINTS_PER_PACKET
from drivers.livox.recording import RecordedPacket, points_of
from drivers.simulated.mid360_wire import pack_points

COUNT = 120


@pytest.fixture(scope="module")
def packets():
    rng = np.random.default_rng(0)
    made = []
    for k in range(COUNT):
        points = rng.uniform(-40, 40, (POINTS_PER_PACKET, 3)).astype(np.float32)
        returned = rng.random(POINTS_PER_PACKET) < 0.5
        tag = rng.integers(0, 2, POINTS_PER_PACKET).astype(np.uint8) * 16
        packed = pack_points(points, np.full(POINTS_PER_PACKET, 40, np.uint8), tag, returned)
        # Three seconds with a pause: frames of 50 ms, most of them not there.
        stamp_ns = 7_000_000_000 + k * 480_000 + (2_000_000_000 if k > 60 else 0)
        made.append(RecordedPacket(stamp_ns, 475_000, 65_500 + k & 0xFFFF, 1, packed.tobytes()))
    return made


def ethernet(packet, *, tags=b"", part=0):
    payload = datagram_of(packet)
    udp = struct.pack(">HHHH", 56300, 56301, 8 + len(payload), 0)
    ip = struct.pack(
        ">BBHHHBBH4s4s",
        0x45, 0, 28 + len(payload), 0, part, 64, 17, 0, bytes((192, 168, 1, 3)), bytes(4),
    )  # fmt: skip
    return bytes(12) + tags + b"\x08\x00" + ip + udp + payload


def block(kind, body):
    body += bytes(-len(body) % 4)
    size = len(body) + 12
    return struct.pack("<II", kind, size) + body + struct.pack("<I", size)


def test_lvx2_keeps_every_packet(tmp_path, packets):
    path = tmp_path / "a.lvx2"
    write_lvx2(path, packets, "47MDTEST0000001")
    file = read_lvx2(path)
    assert file.packets == tuple(packets)
    assert file.serial == "47MDTEST0000001"
    assert (file.sensors, file.cut_off, file.mounting) == (1, False, None)


def test_lvx2_lies_in_the_file_as_the_vendor_writes_it(tmp_path, packets):
    """Offsets and sizes by the specification, not by our own structures."""
    path = tmp_path / "a.lvx2"
    write_lvx2(path, packets[:3], "S")
    data = path.read_bytes()
    assert data[:16] == b"livox_tech" + bytes(6)
    assert data[16:20] == bytes((2, 0, 0, 0))
    assert int.from_bytes(data[20:24], "little") == 0xAC0EA767
    assert int.from_bytes(data[24:28], "little") == 50
    assert data[28] == 1
    device = data[29 : 29 + 63]
    assert device[37] == 9
    frame = 29 + 63
    own, following, index = struct.unpack_from("<qqq", data, frame)
    assert (own, following, index) == (frame, len(data), 0)
    package = frame + 24
    assert int.from_bytes(data[package + 7 : package + 15], "little") == packets[0].stamp_ns
    assert int.from_bytes(data[package + 15 : package + 17], "little") == packets[0].number
    assert data[package + 17] == 1
    assert int.from_bytes(data[package + 18 : package + 22], "little") == 96 * 14
    assert data[package + 27 : package + 27 + 14] == packets[0].payload[:14]
    assert len(data) == frame + 24 + 3 * (27 + 96 * 14)


def test_lvx2_tells_how_the_sensor_is_mounted(tmp_path, packets):
    path = tmp_path / "a.lvx2"
    write_lvx2(path, packets)
    data = bytearray(path.read_bytes())
    struct.pack_into("<B6f", data, 29 + 38, 1, 0, 90, 0, 1, 2, 3)
    path.write_bytes(data)
    rotation, offset = read_lvx2(path).mounting
    assert np.allclose(rotation @ [1, 0, 0], [0, 0, -1], atol=1e-6)
    assert offset.tolist() == [1, 2, 3]


def test_a_recording_that_was_cut_off_gives_what_stands_before(tmp_path, packets):
    for path, write, read in (
        (tmp_path / "a.lvx2", lambda p: write_lvx2(p, packets), read_lvx2),
        (
            tmp_path / "a.pcap",
            lambda p: write_capture(p, [(1.0, datagram_of(one)) for one in packets]),
            read_capture,
        ),
    ):
        write(path)
        data = path.read_bytes()
        path.write_bytes(data[: len(data) // 2])
        found = read(path)
        assert found.cut_off
        assert 40 < len(found.packets) < COUNT


def test_a_capture_keeps_packets_and_arrivals(tmp_path, packets):
    path = tmp_path / "a.pcap"
    arrivals = [1.79e9 + p.stamp_ns * 1e-9 for p in packets]
    pairs = [(at, datagram_of(p)) for at, p in zip(arrivals, packets, strict=True)]
    write_capture(path, pairs)
    found = read_capture(path)
    assert found.sender == "192.168.1.100"
    assert [p.payload for p in found.packets] == [p.payload for p in packets]
    assert [p.stamp_ns for p in found.packets] == [p.stamp_ns for p in packets]
    assert np.allclose([p.arrival_s for p in found.packets], arrivals, atol=1e-6)


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize(
    ("link", "lead"), [(1, None), (101, b""), (113, bytes(16)), (276, bytes(20)), (0, bytes(4))]
)
def test_links_and_byte_orders(tmp_path, packets, order, link, lead):
    path = tmp_path / "a.pcap"
    data = struct.pack(order + "IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 65535, link)
    for k, packet in enumerate(packets):
        vlan = b"\x81\x00\x00\x05" * (k % 3)
        frame = ethernet(packet, tags=vlan) if lead is None else lead + ethernet(packet)[14:]
        data += struct.pack(order + "IIII", 100, 250_000, len(frame), len(frame)) + frame
    path.write_bytes(data)
    found = read_capture(path)
    assert len(found.packets) == COUNT
    assert found.packets[0].arrival_s == pytest.approx(100.25)


@pytest.mark.parametrize(("options", "unit"), [(b"", 1e-6), (b"\x09\0\x01\0\x09\0\0\0", 1e-9)])
def test_pcapng_with_its_unit_of_time(tmp_path, packets, options, unit):
    path = tmp_path / "a.pcapng"
    data = block(0x0A0D0D0A, struct.pack("<IHHq", 0x1A2B3C4D, 1, 0, -1))
    data += block(1, struct.pack("<HHI", 1, 0, 0) + options)
    data += block(5, bytes(12))
    for packet in packets:
        frame = ethernet(packet)
        ticks = round(12.5 / unit)
        head = struct.pack("<5I", 0, ticks >> 32, ticks & 0xFFFFFFFF, len(frame), len(frame))
        data += block(6, head + frame)
    path.write_bytes(data)
    found = read_capture(path)
    assert len(found.packets) == COUNT
    assert found.packets[5].arrival_s == pytest.approx(12.5)
    path.write_bytes(data[:-40])
    assert read_capture(path).cut_off


def test_other_traffic_fragments_and_other_sensors_are_left_out(tmp_path, packets):
    path = tmp_path / "a.pcap"
    frames = [ethernet(p) for p in packets]
    frames[3] = ethernet(packets[3], part=0x2000)
    frames[4] = bytes(12) + b"\x08\x06" + bytes(40)
    frames[5] = frames[5][:60]
    other = frames[6]
    frames[6] = other[:26] + bytes((10, 0, 0, 9)) + other[30:]
    data = struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 65535, 1)
    for frame in frames:
        data += struct.pack("<IIII", 1, 0, len(frame), len(frame)) + frame
    path.write_bytes(data)
    found = read_capture(path)
    assert len(found.packets) == COUNT - 4
    assert (found.sender, found.sensors) == ("192.168.1.3", 2)


def test_packets_cut_short_while_capturing_are_told(tmp_path, packets):
    path = tmp_path / "a.pcap"
    data = struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 96, 1)
    for packet in packets:
        frame = ethernet(packet)
        data += struct.pack("<IIII", 1, 0, 96, len(frame)) + frame[:96]
    path.write_bytes(data)
    with pytest.raises(BadFile, match="cut short while capturing; capture again: tcpdump -s 0"):
        read_capture(path)


def test_points_come_in_order_with_their_times(packets):
    found = points_of(list(reversed(packets)))
    assert np.all(np.diff(found.time_s) >= 0)
    assert found.arrival_s is None
    raw = np.frombuffer(packets[0].payload, np.uint8).reshape(-1, 14)
    xyz = raw[:, :12].copy().view("<i4")
    first = int(np.flatnonzero(xyz.any(axis=1))[0])
    assert found.points_l[0] == pytest.approx(xyz[first] * 1e-3)
    assert found.time_s[0] == pytest.approx(7.0 + first * 5e-6, abs=1e-9)
    assert set(np.unique(found.tag)) == {0, 16}


def test_the_smallest_delay_puts_the_sensor_s_clock_on_the_computer_s(packets):
    rng = np.random.default_rng(1)
    late = [
        RecordedPacket(
            p.stamp_ns, p.interval_ns, p.number, p.data_type, p.payload,
            500.0 + p.stamp_ns * 1e-9 + (0.0 if k == 9 else rng.uniform(0.001, 0.1)),
        )
        for k, p in enumerate(packets)
    ]  # fmt: skip
    found = points_of(late)
    assert np.allclose(found.arrival_s - found.time_s, 500.0, atol=1e-6)
