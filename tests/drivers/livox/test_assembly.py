"""From packets to scans, over a bad network and from a sensor that misbehaves."""

import zlib
from collections import Counter

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.livox.assembly import ScanAssembler
from drivers.livox.sensor_clock import SensorClock
from drivers.livox.statistics import Dropped
from drivers.simulated.mid360_wire import pack_packets, pack_points

STEP_NS = 96 * 5000


def packets(count, first_ns=0, first_number=0, range_m=10.0):
    points = count * 96
    records = pack_points(
        np.tile(np.float32([range_m, 0, 0]), (points, 1)),
        np.full(points, 50, np.uint8),
        np.zeros(points, np.uint8),
        np.arange(points) % 4 == 0,
    )
    return [row.tobytes() for row in pack_packets(records, first_ns, 5000, first_number)]


class Rig:
    """An assembler and the mission time at which packets arrive: 1000 s after their stamp."""

    def __init__(self):
        self.dropped = Counter()
        self.assembler = ScanAssembler(0.1, (0.5, 70.0), SensorClock(), self.dropped)
        self.scans = []

    def feed(self, datagrams, delay_s=0.001):
        for datagram in datagrams:
            size = min(len(datagram), len(self.assembler.slot))
            self.assembler.slot[:size] = datagram[:size]
            before = self.assembler.packets
            scan = self.assembler.accept(size)
            if self.assembler.packets > before:
                newest_ns = self.assembler.newest_ns
                self.assembler.observe(newest_ns, 1000.0 + newest_ns * 1e-9 + delay_s)
            if scan is not None:
                self.scans.append(scan)
        return self


def test_a_tenth_of_a_second_of_packets_makes_a_scan():
    rig = Rig().feed(packets(2084))
    assert len(rig.scans) == 10
    assert [scan.sequence for scan in rig.scans] == list(range(1, 11))
    scan = rig.scans[3]
    assert len(scan.points_l) == pytest.approx(5000, abs=50)
    np.testing.assert_allclose(scan.points_l[0], [10, 0, 0])
    assert scan.lost_packets == 0
    assert not rig.dropped


def test_the_age_of_a_point_is_counted_from_the_newest_of_the_scan():
    rig = Rig().feed(packets(300))
    scan = rig.scans[0]
    # Every fourth ray returned: the first was fired 208 packets before the end, at 5 us a ray.
    assert scan.age_s[0] == pytest.approx((208 * 96 - 1) * 5e-6, abs=1e-6)
    assert scan.age_s[-1] == pytest.approx(3 * 5e-6, abs=1e-6)
    assert (np.diff(scan.age_s) < 0).all()
    assert scan.stamp_s == pytest.approx(1000.001 + (208 * 96 - 1) * 5e-6, abs=1e-5)


def test_the_running_number_may_wrap_and_loss_is_counted_over_it():
    whole = packets(400, first_number=65_400)
    rig = Rig().feed(whole[:100] + whole[110:])
    assert rig.assembler.lost == 10
    assert rig.scans[0].lost_packets == 10


def test_duplicates_are_dropped_and_reordered_packets_are_used():
    whole = packets(420)
    for at in range(0, 400, 7):
        whole[at], whole[at + 1] = whole[at + 1], whole[at]
    rig = Rig().feed([datagram for datagram in whole for _ in range(2)])
    assert rig.assembler.lost == 0
    assert rig.assembler.packets >= 417
    assert rig.dropped[Dropped.REPEATED] + rig.dropped[Dropped.PAST] >= 417


def test_a_sensor_that_repeats_itself_delivers_no_scan():
    rig = Rig().feed(packets(416))
    good = len(rig.scans)
    rig.feed(packets(208) * 20)
    assert len(rig.scans) == good
    assert rig.dropped[Dropped.PAST] + rig.dropped[Dropped.REPEATED] == 208 * 20


def test_after_a_reboot_scans_come_again_within_six_tenths_of_a_second():
    rig = Rig().feed(packets(416, first_ns=10**12))
    good = len(rig.scans)
    rig.feed(packets(1500))
    assert len(rig.scans) >= good + 1
    assert rig.dropped[Dropped.PAST] <= 1100
    assert rig.assembler.lost == 0


def test_one_packet_from_the_future_is_dropped_and_harms_nothing():
    rig = Rig().feed(packets(300))
    rig.feed(packets(1, first_ns=10**15))
    rig.feed(packets(200, first_ns=300 * STEP_NS, first_number=300))
    assert rig.dropped[Dropped.FUTURE] == 1
    assert len(rig.scans) == 2
    assert abs(rig.scans[1].stamp_s - 1000.2) < 0.01


def test_a_pause_cuts_the_scan_and_the_next_one_is_whole():
    rig = Rig().feed(packets(100))
    rig.assembler.expect(1002.0)
    rig.feed(packets(300, first_ns=2_000_000_000, first_number=100))
    assert len(rig.scans[0].points_l) == 2400
    assert len(rig.scans[1].points_l) == pytest.approx(5000, abs=50)


@pytest.mark.parametrize("range_m", [0.3, 90.0])
def test_what_is_too_near_or_too_far_is_left_out(range_m):
    scan = Rig().feed(packets(300, range_m=range_m)).scans[0]
    assert len(scan.points_l) == 0


def test_a_change_of_data_type_cuts_the_scan():
    wide = packets(100)
    short = [
        packet[:1] + (804).to_bytes(2, "little") + packet[3:10] + b"\x02" + packet[11:804]
        for packet in packets(20, first_ns=100 * STEP_NS, first_number=100)
    ]
    rig = Rig().feed(wide + short)
    assert len(rig.scans) == 1
    assert not rig.dropped


@settings(max_examples=30, deadline=None)
@given(st.lists(st.binary(max_size=1600), max_size=20), st.integers(0, 2**32 - 1))
def test_wild_bytes_in_between_are_counted_and_the_valid_packets_used(wild, seed):
    valid = packets(250)
    at = np.random.default_rng(seed).integers(0, 250, len(wild))
    mixed = list(valid)
    for place, datagram in sorted(zip(at.tolist(), wild, strict=True), reverse=True):
        mixed.insert(place, datagram)
    rig = Rig().feed(mixed)
    assert rig.assembler.packets == 250
    assert sum(rig.dropped.values()) == len(wild)
    assert len(rig.scans) == 1


def test_a_fragment_is_no_scan():
    rig = Rig().feed(packets(20))
    assert rig.assembler.finish() is None
    assert rig.dropped == {Dropped.FRAGMENT: 20}


def test_thirty_percent_loss_still_makes_scans():
    kept = np.random.default_rng(0).random(2084) < 0.7
    rig = Rig().feed([one for one, ok in zip(packets(2084), kept, strict=True) if ok])
    assert 9 <= len(rig.scans) <= 10
    assert rig.assembler.lost == pytest.approx(625, abs=60)


def test_an_imu_sample_that_came_sooner_sets_the_clock_and_one_from_the_future_does_not():
    rig = Rig().feed(packets(100), delay_s=0.3)
    rig.assembler.observe(100_000_000, 1000.1 + 0.002)
    rig.assembler.observe(10**15, 1000.1)
    rig.feed(packets(200, first_ns=100 * STEP_NS, first_number=100), delay_s=0.3)
    assert rig.scans[0].stamp_s == pytest.approx(1000.002 + 208 * 96 * 5e-6, abs=1e-3)


def test_one_packet_from_ahead_costs_no_scan():
    valid = packets(2084)
    (ahead,) = packets(1, first_ns=1000 * STEP_NS + 300_000_000, first_number=77)
    rig = Rig().feed([*valid[:1000], ahead, *valid[1000:]])
    assert len(rig.scans) == 10
    assert rig.assembler.packets == len(valid)
    assert rig.dropped == {Dropped.FUTURE: 1}


def test_after_a_loss_the_running_number_bears_the_time_out():
    valid = packets(2084)
    rig = Rig().feed([*valid[:800], *valid[1000:]])
    assert not rig.dropped[Dropped.FUTURE]
    assert rig.assembler.packets == len(valid) - 200


def test_where_the_number_began_anew_too_the_second_packet_is_believed():
    rig = Rig().feed([*packets(800), *packets(1000, first_ns=1000 * STEP_NS, first_number=5)])
    assert rig.dropped[Dropped.FUTURE] == 1
    assert rig.assembler.packets == 1799


@pytest.mark.parametrize("interval", [0, 1, 65535])
def test_packets_that_state_no_usable_interval_are_timed_by_their_stamps(interval):
    stated = packets(2084)
    wrong = [p[:3] + interval.to_bytes(2, "little") + p[5:] for p in stated]
    right, rig = Rig().feed(stated), Rig().feed(wrong)
    assert len(rig.scans) >= 9
    assert not rig.dropped
    scan = rig.scans[3]
    assert scan.age_s.max() == pytest.approx(right.scans[3].age_s.max(), abs=2e-3)
    assert scan.stamp_s == pytest.approx(right.scans[3].stamp_s, abs=2e-3)


def test_a_sensor_that_sends_its_tenth_of_a_second_in_one_burst_makes_scans():
    burst, rig = packets(2084), Rig()
    for number, first in enumerate(range(0, 2080, 208)):
        rushed = []
        for place, packet in enumerate(burst[first : first + 208]):
            stamp_ns = number * 100_000_000 + place * 7_000
            rushed.append(packet[:28] + stamp_ns.to_bytes(8, "little") + packet[36:])
        rig.feed(rushed)
    assert len(rig.scans) >= 8


@pytest.mark.parametrize("points", [48, 90])
def test_packets_of_fewer_points_make_scans_too(points):
    few = []
    for number, packet in enumerate(packets(2084)):
        head, payload = packet[:36], packet[36 : 36 + points * 14]
        size = (36 + len(payload)).to_bytes(2, "little")
        interval = ((points - 1) * 50).to_bytes(2, "little")
        stamp = (number * points * 5000).to_bytes(8, "little")
        few.append(
            head[:1] + size + interval + points.to_bytes(2, "little") + head[7:28] + stamp + payload
        )
    rig = Rig().feed(few)
    assert len(rig.scans) == pytest.approx(2084 * points * 5e-6 / 0.1, abs=1.01)
    assert not rig.dropped


def test_a_sensor_that_is_synchronised_in_flight_goes_on_after_half_a_second():
    before = packets(1042)
    after = packets(4168, first_ns=1_790_000_000_000_000_000, first_number=1042)
    rig = Rig().feed(before)
    rig.feed(after[:2084], delay_s=-1_790_000_000.0 + 0.5)
    assert len(rig.scans) == pytest.approx(5 + 10 - 5, abs=2)


def with_sums(datagrams, wrong):
    summed = []
    for datagram in datagrams:
        value = zlib.crc32(datagram[28:]) ^ wrong
        summed.append(datagram[:24] + value.to_bytes(4, "little") + datagram[28:])
    return summed


def test_a_sensor_whose_check_sums_are_of_another_kind_is_read_without():
    rig = Rig().feed(with_sums(packets(2084), wrong=0x5A5A))
    assert len(rig.scans) == pytest.approx(7, abs=1)
    assert rig.dropped[Dropped.MALFORMED] == 512


def test_a_damaged_packet_of_a_sensor_with_check_sums_is_dropped():
    good = with_sums(packets(2084), wrong=0)
    damaged = [d if k % 3 else with_sums([d], wrong=1)[0] for k, d in enumerate(good)]
    rig = Rig().feed(damaged)
    assert rig.dropped[Dropped.MALFORMED] == pytest.approx(695)
