import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from config.inspection import Exposure
from perception.exposure import exposure_control
from perception.exposure_limits import EvSteps
from perception.exposure_step import StepExposure
from perception.metering import Metered

STEP = 1 / 3


def filmic(x):
    curve = (x * (2.51 * x + 0.03)) / (x * (2.43 * x + 0.59) + 0.14)
    return 255 * np.clip(curve, 0, 1) ** (1 / 2.2)


def film(x):
    return 255 * (1 - np.exp(-1.6 * x)) ** (1 / 1.8)


def gamma(x):
    return 255 * np.clip(x, 0, 1) ** (1 / 2.2)


def control(method="predictive", *, min_ev=-3.0, max_ev=3.0, automatic=False):
    steps = EvSteps.spaced(min_ev, max_ev, STEP)
    return exposure_control(Exposure(method=method), steps, automatic=automatic)


def metered(values):
    counts = np.bincount(values, minlength=256)
    return Metered(
        mean_grey=float(values.mean()),
        clipped=float((values >= 253).mean()),
        black=float((values <= 2).mean()),
        pixels=len(values),
        low_grey=float(np.searchsorted(np.cumsum(counts), 0.1 * len(values))),
    )


def fly(controller, light_ev, response, *, latency=1, seed=0, period_s=0.1):
    """Grey of every frame: the camera applies each asked EV `latency` frames late, unannounced."""
    rng = np.random.default_rng(seed)
    pending, greys, evs = [0.0] * (latency + 1), [], []
    controller.confirmed(0.0, -1.0)
    asked = 0.0
    for k, light in enumerate(light_ev):
        ev = pending.pop(0)
        exposed = 2.0 ** (light + ev)
        disc = np.round(response(exposed * rng.lognormal(0, 0.08, 400))).astype(int)
        rest = np.round(response(exposed * np.geomspace(0.2, 4.0, 2000))).astype(int)
        seen = metered(disc)
        greys.append(seen.mean_grey)
        evs.append(ev)
        histogram = np.bincount(np.concatenate([disc, rest]), minlength=256)
        wanted = controller.update(seen, period_s * k, histogram)
        pending.append(round(wanted / STEP) * STEP)
        if abs(pending[-1] - asked) > 1e-6:
            asked = pending[-1]
            controller.confirmed(asked, period_s * k + 0.01)
    return np.array(greys), np.array(evs)


def out_of_range(greys):
    return (greys < 110) | (greys > 160)


@settings(deadline=None, max_examples=25)
@given(
    jump=st.floats(-4, 4),
    latency=st.integers(0, 3),
    response=st.sampled_from([filmic, film, gamma]),
    seed=st.integers(0, 99),
)
def test_after_a_step_of_light_the_blade_is_soon_in_range_and_stays(jump, latency, response, seed):
    light = np.concatenate([np.full(25, -2.0 - jump / 2), np.full(40, -2.0 + jump / 2)])
    greys, _ = fly(control(min_ev=-6, max_ev=6), light, response, latency=latency, seed=seed)
    after = out_of_range(greys[25:])
    assert after.sum() <= 3 * (latency + 1)
    assert not after[-20:].any()


@pytest.mark.parametrize("latency", [0, 1, 3])
def test_an_unclipped_step_costs_latency_plus_one_frames_on_a_known_curve(latency):
    light = np.concatenate([np.full(25, -3.0), np.full(40, -1.0)])
    greys, _ = fly(control(min_ev=-6, max_ev=6), light[::-1], gamma, latency=latency)
    assert out_of_range(greys[25:]).sum() <= latency + 1


@pytest.mark.parametrize("frames", [30, 60])
def test_a_ramp_of_light_is_followed_without_leaving_the_range(frames):
    ramp = np.linspace(-2.5, 0.5, frames)
    light = np.concatenate([np.full(25, -2.5), ramp, np.full(20, 0.5)])
    greys, _ = fly(control(min_ev=-6, max_ev=6), light, gamma)
    assert not out_of_range(greys[15:]).any()


def test_under_steady_light_the_exposure_rests():
    _, evs = fly(control(min_ev=-6, max_ev=6), np.full(80, -1.7), filmic)
    assert len(set(np.round(evs[20:], 3))) == 1


def test_a_camera_that_cannot_go_on_causes_no_wind_up():
    controller = control(min_ev=-1, max_ev=1)
    controller.confirmed(-1.0, -1.0)
    for k in range(50):
        assert -1 <= controller.update(metered(np.full(100, 255)), 0.1 * k) <= 1
    assert controller.at_limit
    assert controller.update(metered(np.full(100, 60)), 5.1) > -1


@settings(deadline=None)
@given(st.floats(), st.floats(), st.floats(), st.floats())
def test_whatever_is_metered_the_answer_is_within_the_camera_s_limits(grey, clipped, low, stamp):
    controller = control()
    controller.confirmed(0.0, 0.0)
    for _ in range(2):
        seen = Metered(grey, clipped, 0.0, 100, low)
        assert -3 <= controller.update(seen, stamp) <= 3


def test_before_the_camera_confirmed_anything_nothing_is_asked_of_it():
    assert control().update(metered(np.full(100, 30)), 0.0) == 0.0


def test_the_paper_s_steps_are_as_printed():
    controller = control("step")
    assert isinstance(controller, StepExposure)
    controller.confirmed(0.0, 0.0)
    assert controller.update(metered(np.full(50, 200)), 0.0) == pytest.approx(-STEP)
    assert controller.update(metered(np.full(50, 161)), 0.1) == pytest.approx(-2 * STEP)
    assert controller.update(metered(np.full(50, 135)), 0.2) == pytest.approx(-2 * STEP)
    assert controller.update(metered(np.full(50, 109)), 0.3) == pytest.approx(-STEP)


def test_the_paper_s_steps_ring_at_three_frames_of_latency_and_ours_do_not():
    light = np.concatenate([np.full(25, -3.0), np.full(60, -1.0)])
    paper, _ = fly(control("step", min_ev=-6, max_ev=6), light, filmic, latency=3)
    ours, _ = fly(control(min_ev=-6, max_ev=6), light, filmic, latency=3)
    assert out_of_range(paper[-20:]).any()
    assert not out_of_range(ours[-20:]).any()


@pytest.mark.parametrize("method", ["predictive", "step"])
def test_where_stills_stand_apart_the_live_picture_is_aimed_aside(method):
    aside = control(method, min_ev=-6, max_ev=6)
    aside.aim(105.0)
    greys, _ = fly(aside, np.full(80, 0.8), film)
    plain, _ = fly(control(method, min_ev=-6, max_ev=6), np.full(80, 0.8), film)
    assert 80 <= greys[-1] <= 130
    assert 110 <= plain[-1] <= 160
    assert greys[-1] < plain[-1]
