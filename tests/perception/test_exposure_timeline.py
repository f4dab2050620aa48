import numpy as np
import pytest

from perception.exposure_timeline import EvTimeline


def play(timeline, latency_s, *, fps=30, changes=8, light=lambda t: 0.0, jitter_s=0.0, seed=0):
    """Settings every 0.9 s; return share of the frames whose EV was told rightly after half."""
    rng = np.random.default_rng(seed)
    timeline.confirmed(0.0, -1.0)
    evs, asked, right, last, before = [(-np.inf, 0.0)], 0.0, [], None, None
    for k in range(int(0.9 * changes * fps)):
        t = k / fps
        true = next(ev for since, ev in reversed(evs) if since <= t)
        level = light(t) + true
        found = timeline.ev_of(t, (level, level), last, 0.6 / fps)
        timeline.vote(t, None if before is None else level - before)
        before = level
        ev = found[0]
        last = (level - ev, level - ev)
        right.append(abs(ev - true) < 0.01)
        if k % int(0.9 * fps) == 5:
            asked = float(rng.choice([-2, -1, 1, 2])) / 1.5 + (0 if asked else 0.33)
            timeline.asked(asked, t)
            evs.append((t + latency_s + rng.uniform(-jitter_s, jitter_s), asked))
            timeline.confirmed(asked, t + 0.03)
    return np.mean(right[len(right) // 2 :])


@pytest.mark.parametrize("latency_s", [0.05, 0.1, 0.2, 0.4])
@pytest.mark.parametrize("fps", [10, 30])
def test_the_latency_is_learned_and_the_ev_of_every_frame_known(latency_s, fps):
    timeline = EvTimeline()
    assert play(timeline, latency_s, fps=fps) == 1.0
    assert timeline.latency_s + 0.03 == pytest.approx(latency_s, abs=1.0 / fps + 0.01)


def test_a_latency_that_varies_is_followed_by_the_light_standing_still():
    assert play(EvTimeline(), 0.15, jitter_s=0.04) > 0.98


def test_light_that_drifts_does_not_confuse_it():
    assert play(EvTimeline(), 0.2, light=lambda t: 0.4 * np.sin(t)) > 0.98


def test_a_wish_that_the_camera_never_confirmed_is_forgotten():
    timeline = EvTimeline()
    timeline.confirmed(0.0, 0.0)
    timeline.asked(2.0, 1.0)
    assert timeline.ev_of(4.0, (0.0, 0.0), (0.0, 0.0), 0.02) == (0.0, True)


def test_before_the_camera_spoke_no_ev_is_known():
    assert EvTimeline().ev_of(0.0, (0.0, 0.0), None, 0.02) is None


def test_a_frame_after_a_clipped_one_may_be_any_brighter_light():
    timeline = EvTimeline()
    play(timeline, 0.2, fps=10)
    timeline.confirmed(2.0, 20.0)
    timeline.asked(-1.0, 22.0)
    timeline.confirmed(-1.0, 22.03)
    # A frame earlier than usual: under EV 2 the light would have had to fall, under EV -1 not.
    assert timeline.ev_of(22.12, (1.0, 1.0), (0.0, float("inf")), 0.12)[0] == -1.0


def test_where_both_evs_explain_a_frame_after_a_clipped_one_the_older_is_taken():
    timeline = EvTimeline()
    play(timeline, 0.2, fps=10)
    timeline.confirmed(0.0, 20.0)
    timeline.asked(-1.7, 22.0)
    timeline.confirmed(-1.7, 22.03)
    # Hardly later than usual, and not as bright as white: the camera's automatic came first.
    assert timeline.ev_of(22.21, (2.0, 2.0), (1.9, float("inf")), 0.06) == (0.0, True)
