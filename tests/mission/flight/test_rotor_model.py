import numpy as np
import pytest

from benchmarks.virtual_turbine import Truth, true_model
from config.presets import load_turbine
from mission.flight.rotor_model import BASE_INFLATION_M

TURBINE = load_turbine("windpact-1.5")


def test_a_point_beside_the_tower_has_the_distance_to_its_skin():
    model = true_model(Truth(tower_w=(0.0, 65.0, 0.0)), TURBINE)
    foot = model.tower_top_w - 40.0 * model.tower_axis_w
    point = foot + np.array([20.0, 0.0, 0.0])
    distance = model.part_distances(point[None])[0, 3]
    base, top = model.tower_radii
    radius = top + (base - top) * 40.0 / model.tower_height_m
    assert distance == pytest.approx(20.0 - radius)


@pytest.mark.parametrize("pitch", [0.0, 45.0, 90.0])
def test_distance_to_a_blade_agrees_with_its_densely_sampled_skin(pitch):
    model = true_model(Truth(pitch_deg=pitch), TURBINE)
    rng = np.random.default_rng(3)
    share = np.linspace(0.0, 1.0, 40)[:, None]
    skin, radius = [], []
    for station, along in enumerate(np.linspace(0.0, model.lengths[0], model.leading.shape[1])):
        line = model.leading[0, station] + share * model.chord[0, station]
        skin.append(model.roots[0] + along * model.axes[0] + line)
        radius.append(np.full(len(share), model.radius[0, station]))
    skin, radius = np.concatenate(skin), np.concatenate(radius)
    middle = model.roots[0] + 0.5 * model.lengths[0] * model.axes[0]
    for _ in range(40):
        direction = rng.normal(size=3)
        point = middle + rng.uniform(8, 25) * direction / np.linalg.norm(direction)
        sampled = (np.linalg.norm(skin - point, axis=1) - radius).min()
        assert model.part_distances(point[None])[0, 0] == pytest.approx(sampled, abs=0.35)


def test_an_unknown_pitch_takes_the_room_of_every_pitch():
    known = [true_model(Truth(pitch_deg=p), TURBINE) for p in (0.0, 30.0, 60.0, 90.0)]
    unknown = true_model(Truth(), TURBINE)
    from mission.flight.rotor_model import MeasuredBlade, rotor_model

    blades = [MeasuredBlade(f.name, tuple(f.axis_w), None) for f in unknown.frames]
    wide = rotor_model(unknown.hub_w, unknown.normal_w, blades, TURBINE)
    rng = np.random.default_rng(5)
    points = unknown.hub_w + rng.normal(0.0, 20.0, (200, 3))
    for model in known:
        narrow = model.part_distances(points)[:, :3]
        # Sampled stations and the slope of the chord leave a little either way.
        assert (wide.part_distances(points)[:, :3] <= narrow + 0.25).all()


def test_the_nearest_point_lies_at_the_distance_told():
    model = true_model(Truth(), TURBINE)
    point = model.hub_w - 20.0 * model.normal_w + np.array([3.0, 0.0, 5.0])
    distances, places = model.nearest(point)
    assert np.linalg.norm(places - point, axis=1) == pytest.approx(np.abs(distances), abs=1e-6)
    assert distances.min() == pytest.approx(model.distance(point[None])[0])


def test_everything_is_inflated():
    model = true_model(Truth(), TURBINE)
    assert (model.radius >= BASE_INFLATION_M).all()


def test_beside_a_blade_lie_tower_nacelle_and_the_inner_part_of_the_other_blades():
    model = true_model(Truth(pitch_deg=85.0), TURBINE)
    solids = model.beside("B")
    assert len(solids) == 4

    def within(point):
        for start, end, first, last in solids:
            axis = np.subtract(end, start)
            share = float(np.clip((point - start) @ axis / (axis @ axis), 0.0, 1.0))
            apart = float(np.linalg.norm(point - (start + share * axis)))
            if apart < first + share * (last - first):
                return True
        return False

    for index, frame in enumerate(model.frames):
        inner = model.roots[index] + 8.0 * model.axes[index]
        outer = model.roots[index] + 25.0 * model.axes[index]
        assert within(inner) == (frame.name != "B")
        assert not within(outer)
