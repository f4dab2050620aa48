"""The sensor's bytes, through driver and bus into the file, as the stock reader sees them."""

import struct
from collections import Counter

import numpy as np
from foxglove_schemas_protobuf.PackedElementField_pb2 import PackedElementField
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from config.settings import Settings
from drivers.bus import Key
from drivers.codecs import encode_scan
from drivers.livox.assembly import ScanAssembler
from drivers.livox.sensor_clock import SensorClock
from drivers.simulated.mid360_wire import pack_packets, pack_points
from mission.records.recording import Recording

PACKETS, INTERVAL_NS = 520, 5000
NUMPY_OF = {
    PackedElementField.FLOAT32: "<f4",
    PackedElementField.UINT8: "u1",
}


def datagrams():
    """Return packets of a quarter of a second, a third of their rays without a return."""
    draw, count = np.random.default_rng(6), PACKETS * 96
    points = draw.uniform(-40, 40, (count, 3)).astype(np.float32)
    brightness = draw.integers(0, 256, count).astype(np.uint8)
    tags = draw.integers(0, 64, count).astype(np.uint8)
    records = pack_points(points, brightness, tags, draw.random(count) < 0.66)
    return [row.tobytes() for row in pack_packets(records, 10**9, INTERVAL_NS, 65_300)]


def by_hand(datagram):
    """Return (time, x, y, z, reflectivity, tag) of each return in a packet: ns, mm, as sent."""
    (first_ns,) = struct.unpack_from("<Q", datagram, 28)
    points = struct.iter_unpack("<iiiBB", datagram[36:])
    return [(first_ns + k * INTERVAL_NS, *one) for k, one in enumerate(points) if any(one[:3])]


def recorded(path):
    """Return (time, x, y, z, reflectivity, tag) of each point in a file: ns, mm."""
    found = []
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for one in reader.iter_decoded_messages(topics=["/sensor/lidar/scan"]):
            cloud = one.decoded_message
            fields = [field.name for field in cloud.fields]
            layout = {
                "names": fields,
                "formats": [NUMPY_OF[field.type] for field in cloud.fields],
                "offsets": [field.offset for field in cloud.fields],
                "itemsize": cloud.point_stride,
            }
            points = np.frombuffer(cloud.data, np.dtype(layout))
            stamp_ns = cloud.timestamp.seconds * 10**9 + cloud.timestamp.nanos
            at_ns = stamp_ns - points["age_s"].astype(np.float64) * 1e9
            columns = [np.rint(points[axis].astype(np.float64) * 1000) for axis in "xyz"]
            columns += [points["reflectivity"], points["tag"]]
            found += zip(at_ns, *(column.astype(int).tolist() for column in columns), strict=True)
    return found


def test_every_return_of_the_sensor_is_in_the_file_with_its_time_and_nothing_else(tmp_path):
    assembler = ScanAssembler(0.1, (0.0, 100.0), SensorClock(), Counter())
    recording = Recording(tmp_path / "r.mcap", Settings())
    sent = datagrams()
    scans = []
    for number, datagram in enumerate(sent):
        assembler.slot[: len(datagram)] = datagram
        scan = assembler.accept(len(datagram))
        assembler.observe(assembler.newest_ns, assembler.newest_ns * 1e-9)
        if scan is not None:
            scans.append((scan, number))
    for scan, _ in scans:
        payload, attachment = encode_scan(scan)
        recording.add(Key.SCAN, payload, round(scan.stamp_s * 1e9), attachment=attachment)
    recording.close()
    assert len(scans) == 2
    file = recorded(tmp_path / "r.mcap")
    wire = [one for datagram in sent for one in by_hand(datagram)][: len(file)]
    assert len(file) > 0.6 * 0.2e9 / INTERVAL_NS
    assert [one[1:] for one in file] == [one[1:] for one in wire]
    # An age is a float: to a microsecond or so.
    assert max(abs(a[0] - b[0]) for a, b in zip(file, wire, strict=True)) < 2000
