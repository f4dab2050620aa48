from perception.exposure_sweep import OFFSETS_EV, SETTLED_FRAMES, Sweep


def play(sweep, frames, *, spare=True, settled=True, start_s=0.0):
    return [sweep.offset_ev(start_s + 0.1 * k, spare=spare, settled=settled) for k in range(frames)]


def test_every_exposure_is_tried_once_and_then_never_again():
    sweep = Sweep()
    offsets = play(sweep, 60)
    assert [ev for k, ev in enumerate(offsets) if ev and ev != offsets[k - 1]] == list(OFFSETS_EV)
    assert sweep.done
    assert not any(play(sweep, 60, start_s=6.0))


def test_nothing_is_tried_while_a_photo_is_near():
    sweep = Sweep()
    assert not any(play(sweep, 60, spare=False))
    assert not sweep.done


def test_a_photo_that_comes_near_ends_it_at_once():
    sweep = Sweep()
    play(sweep, SETTLED_FRAMES)
    assert sweep.under_way
    assert sweep.offset_ev(0.5, spare=False, settled=True) == 0.0
    assert sweep.done


def test_an_exposure_that_never_shows_is_left():
    sweep = Sweep()
    play(sweep, SETTLED_FRAMES)
    assert play(sweep, 60, settled=False, start_s=0.4)[-1] == 0.0
    assert sweep.done
