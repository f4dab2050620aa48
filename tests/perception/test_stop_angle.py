import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from config.inspection import FermatMethod
from perception.geometry import stop_angle_difference_deg
from perception.rotor import Refusal, RefusalCode, Rotor, direction_at
from perception.stop_angle import FermatEstimator, stop_angle_deg

DOWN = np.array([0.0, 0, -1])


def estimate(turbine, *, error=(1.5, 0.5, -1.0), passes=3, seconds=1.0, **scan):
    prior = turbine.hub_w + np.array(error)
    estimator = FermatEstimator(FermatMethod())
    found = None
    for k in range(passes):
        level = np.array([*turbine.normal_w[:2], 0.0])
        place = prior - 20.0 * level / np.linalg.norm(level)
        points, origin = turbine.scan(place, seconds, seed=k, heading_w=turbine.normal_w, **scan)
        found = estimator.update(points, origin, prior)
        if isinstance(found, Rotor):
            prior = found.hub_w
    return found, estimator


@pytest.mark.parametrize("stop", [0.0, 60.0, 119.95])
@pytest.mark.parametrize("pitch", [86.0, 2.0])
def test_the_stop_angle_is_found_from_the_front(synthetic_turbine, stop, pitch):
    turbine = synthetic_turbine(
        stop_angle_deg=stop, pitch_deg=pitch, upwind_deg=200.0 + stop, trees=False
    )
    found, _ = estimate(turbine)
    assert abs(stop_angle_difference_deg(found.stop_angle_deg, stop)) < 3.5
    assert np.linalg.norm(found.hub_w - turbine.hub_w) < 2.0
    assert found.normal_w @ turbine.normal_w > 0.99
    assert found.method == "fermat"
    assert [blade.name for blade in found.blades] == ["A", "B", "C"]
    assert all(blade.pitch_deg is None for blade in found.blades)
    for blade in found.blades:
        assert max(blade.direction_w @ d for d in turbine.blade_directions()) > 0.99


def test_two_passes_that_agree_have_converged(synthetic_turbine):
    turbine = synthetic_turbine(stop_angle_deg=33.0, trees=False)
    estimator = estimate(turbine, passes=3, seconds=2.0)[1]
    assert estimator.iterations == 3
    first = FermatEstimator(FermatMethod(), agree_deg=100.0)
    points, origin = turbine.scan(
        turbine.hub_w - 20 * turbine.normal_w, 1.0, heading_w=turbine.normal_w
    )
    first.update(points, origin, turbine.hub_w)
    assert not first.converged
    first.update(points, origin, turbine.hub_w)
    assert first.converged


@pytest.mark.parametrize("count", [0, 1, 30])
def test_too_little_is_refused(count):
    found = FermatEstimator(FermatMethod()).update(
        np.zeros((count, 3)), np.array([0.0, -20, 0]), np.zeros(3)
    )
    assert isinstance(found, Refusal)
    assert found.code is RefusalCode.NO_POINTS


def test_points_that_cannot_be_are_refused():
    bad = np.full((500, 3), np.nan)
    bad[::2] = np.inf
    found = FermatEstimator(FermatMethod()).update(bad, np.zeros(3), np.zeros(3))
    assert isinstance(found, Refusal)


def test_a_wall_is_no_rotor():
    rng = np.random.default_rng(0)
    wall = rng.uniform((-15, -0.1, -15), (15, 0.1, 15), (8000, 3))
    found = FermatEstimator(FermatMethod()).update(wall, np.array([0, -20.0, 0]), np.zeros(3))
    assert isinstance(found, Refusal)
    assert found.code is RefusalCode.NO_RING


def test_two_blades_are_refused(synthetic_turbine):
    turbine = synthetic_turbine(stop_angle_deg=60.0, trees=False)
    place = turbine.hub_w - 20 * turbine.normal_w
    points, origin = turbine.scan(place, 1.0, heading_w=turbine.normal_w)
    gone = turbine.blade_directions()[2]
    along = (points - turbine.hub_w) @ gone
    aside = np.linalg.norm(points - turbine.hub_w - along[:, None] * gone, axis=1)
    kept = points[~((along > 3) & (aside < 3))]
    kept = kept[np.abs((kept - turbine.hub_w) @ turbine.normal_w) < 2.0]
    found = FermatEstimator(FermatMethod()).update(kept, origin, turbine.hub_w)
    assert isinstance(found, Refusal)
    assert found.code is RefusalCode.TWO_BLADES


@given(
    angle=st.floats(0, 119.999), tilt=st.floats(0, 0.15), yaw=st.floats(-3.1, 3.1),
    first=st.integers(0, 2),
)  # fmt: skip
def test_the_angle_is_the_definition_s_whichever_blade_comes_first(angle, tilt, yaw, first):
    normal = np.array([np.cos(tilt) * np.cos(yaw), np.cos(tilt) * np.sin(yaw), -np.sin(tilt)])
    directions = [
        direction_at(np.radians(angle + 120 * (k + first)), normal, DOWN) for k in range(3)
    ]
    found = stop_angle_deg(np.array(directions), normal, DOWN)
    assert 0 <= found < 120
    assert abs(stop_angle_difference_deg(found, angle)) < 1e-6
