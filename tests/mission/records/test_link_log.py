import errno

import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import common as mavlink

from mission.records.link_log import LinkLog

UTC_NS = 1_772_360_000_123_456_000


def a_frame(second):
    one = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    return bytes(one.attitude_encode(1000 * second, 0.1, 0.2, 0.3, 0, 0, 0).pack(one))


def test_the_ground_stations_reader_reads_every_message_with_its_time(tmp_path):
    path = tmp_path / "link.tlog"
    log = LinkLog(path)
    for second in range(5):
        log.add(a_frame(second) + a_frame(second), UTC_NS + second * 1_000_000_000)
    log.close()
    reader = mavutil.mavlink_connection(str(path), dialect="common")
    read = []
    while (message := reader.recv_match()) is not None:
        read.append((message.get_type(), message.time_boot_ms, message._timestamp))
    reader.close()
    wanted = [
        ("ATTITUDE", 1000 * second, pytest.approx(UTC_NS * 1e-9 + second, abs=1e-4))
        for second in range(5)
        for _ in range(2)
    ]
    assert read == wanted
    assert log.lost() == ()
    assert log.frames == 10


def test_a_disk_that_fails_ends_the_log_and_is_named(tmp_path, monkeypatch):
    monkeypatch.setattr("mission.records.link_log.FLUSH_S", 0.0)
    monkeypatch.setattr("mission.records.spool.MAX_WAITING_BYTES", 200)

    def full(_file, _data):
        raise OSError(errno.ENOSPC, "No space left on device")

    log = LinkLog(tmp_path / "link.tlog")
    monkeypatch.setattr("mission.records.spool.os.write", full)
    for second in range(60):
        log.add(a_frame(second), UTC_NS)
    log.close()
    (words,) = log.lost()
    assert words == "the MAVLink log is cut short: No space left on device"
