"""A PX4 log (ULog 1) of given poses, as PX4 writes one: for tests, and read by pyulog too."""

import struct

MAGIC = b"ULog\x01\x12\x35\x01"
FORMATS = (
    (
        "vehicle_local_position:uint64_t timestamp;uint64_t timestamp_sample;float x;float y;"
        "float z;float[2] delta_xy;float vx;float vy;float vz;bool xy_valid;uint8_t[3] _padding0;"
    ),
    (
        "vehicle_attitude:uint64_t timestamp;uint64_t timestamp_sample;float[4] q;"
        "float[4] delta_q_reset;uint8_t quat_reset_counter;uint8_t[7] _padding0;"
    ),
    (
        "sensor_gps:uint64_t timestamp;uint64_t timestamp_sample;uint64_t time_utc_usec;"
        "double latitude_deg;"
    ),
)


def message(kind, body):
    return struct.pack("<HB", len(body), ord(kind)) + body


def ulog(places, turns, utc_us=None):
    """Return a log; ``places``: (boot_us, ned, velocity_ned); ``turns``: (boot_us, q FRD-NED)."""
    parts = [MAGIC, struct.pack("<Q", 1000), message("B", bytes(40))]
    parts += [message("F", text.encode()) for text in FORMATS]
    info = b"char[3] sys_name"
    parts.append(message("I", bytes([len(info)]) + info + b"PX4"))
    for number, text in enumerate(FORMATS):
        parts.append(message("A", struct.pack("<BH", 0, number) + text.split(":")[0].encode()))
    # A second estimator's position is none of ours.
    parts.append(message("A", struct.pack("<BH", 1, 9) + b"vehicle_local_position"))
    rows = [(us, 0, struct.pack("<QQ3f2f3fB", us, us, *ned, 0, 0, *v, 1)) for us, ned, v in places]
    rows += [(us, 9, row) for us, _, row in rows[:1]]
    rows += [(us, 1, struct.pack("<QQ4f4fB", us, us, *q, 1, 0, 0, 0, 0)) for us, q in turns]
    if utc_us is not None:
        rows += [(0, 2, struct.pack("<QQQd", us, us, value, 54.0)) for us, value in utc_us]
    for _, number, row in sorted(rows, key=lambda one: one[0]):
        parts.append(message("D", struct.pack("<H", number) + row))
    return b"".join(parts)
