import json
import multiprocessing

import psutil
import pytest

from benchmarks import replayed_stream
from benchmarks.daemon_flood import gaps
from benchmarks.daemon_usage import Usage, memory_mb


def spin(over):
    while not over.is_set():
        sum(range(1000))


def test_the_share_of_a_process_is_its_cpu_time_by_the_mission_time_that_passed():
    spawn = multiprocessing.get_context("spawn")
    over = spawn.Event()
    process = spawn.Process(target=spin, args=(over,), daemon=True)
    process.start()
    try:
        root = psutil.Process(process.pid)
        before = Usage.now(root, at_s=10.0)
        used_s = sum(before.cpu_s.values())
        while sum(Usage.now(root, 0.0).cpu_s.values()) < used_s + 0.2:
            pass
        after = Usage.now(root, at_s=12.0)
        shares = after.since(before)
        grown = sum(after.cpu_s.values()) - used_s
        assert shares.total == pytest.approx(grown / 2.0 * 100)
        assert sum(shares.by_process().values()) == pytest.approx(shares.total)
        assert [share for _, _, share in shares.by_thread(1.0)] == sorted(
            (share for _, _, share in shares.by_thread(1.0)), reverse=True
        )
        assert 5.0 < sum(memory_mb(root).values()) < 2000.0
    finally:
        over.set()
        process.join(10)


def test_a_wanted_key_picture_begins_the_replayed_film_anew(monkeypatch):
    monkeypatch.setattr(replayed_stream, "_PICTURES", 4)
    film = replayed_stream.ReplayedPictures(seed=1)
    nothing = None
    first = [film.encode(nothing, 0.0) for _ in range(4)]
    assert film.encode(nothing, 0.0) == first[0]
    assert film.encode(nothing, 0.0) == first[1]
    assert film.encode(nothing, 0.0, key_frame=True) == first[0]
    kinds = [{unit[0] & 0x1F for unit in units} for units in first]
    assert 5 in kinds[0]  # a picture that needs no other
    assert all(5 not in kind for kind in kinds[1:])


class Ticks:
    """A bus on which ticks come while something is waited for."""

    def __init__(self, ticks):
        self.ticks = ticks

    def follow(self, key, take):
        self.key, self.take = key, take
        return lambda: None

    def play(self):
        for now_s, sent in self.ticks:
            text = json.dumps({"sent": sent, "observation": {"now_s": now_s}})
            self.take(type("Sample", (), {"payload": text.encode()}))


def test_only_ticks_whose_setpoint_left_count_as_such():
    bus = Ticks([(1.00, True), (1.05, True), (1.10, False), (1.15, True), (1.20, True)])
    found = gaps(bus, bus.play)
    assert bus.key == "mission/command"
    assert found.setpoints == 4
    assert found.most == pytest.approx(100.0)
    assert found.p50 == pytest.approx(50.0)


def test_where_no_setpoint_leaves_that_is_told():
    bus = Ticks([(1.0, False)])
    with pytest.raises(RuntimeError, match="no setpoints"):
        gaps(bus, bus.play)
