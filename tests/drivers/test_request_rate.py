import pytest

from drivers.request_rate import MAX_CLIENTS, RequestRate


def test_after_a_burst_a_client_is_held_to_its_rate():
    rate = RequestRate(20)
    allowed = [rate.allows("a", n / 1000) for n in range(1000)]
    assert all(allowed[:20])
    assert sum(allowed) == pytest.approx(40, abs=1)


def test_one_client_takes_nothing_from_another():
    rate = RequestRate(20)
    for _ in range(100):
        rate.allows("a", 0.0)
    assert not rate.allows("a", 0.0)
    assert rate.allows("b", 0.0)


def test_silence_fills_the_bucket_no_higher_than_full():
    rate = RequestRate(5)
    for _ in range(5):
        rate.allows("a", 0.0)
    assert sum(rate.allows("a", 100.0) for _ in range(20)) == 5


def test_less_than_one_a_second_is_one_now_and_then():
    rate = RequestRate(0.5)
    assert rate.allows("a", 0.0)
    assert not rate.allows("a", 1.0)
    assert rate.allows("a", 2.0)


def test_many_names_cost_no_more_memory_than_some():
    rate = RequestRate(1)
    for number in range(10 * MAX_CLIENTS):
        rate.allows(str(number), 0.0)
    assert len(rate._buckets) == MAX_CLIENTS
