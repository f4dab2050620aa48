"""`bladescout.estimate`: a file and an array say the same, and mistakes are told in a sentence."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from bladescout import Refusal, Rotor, estimate

FOLDER = Path(__file__).parents[1] / "clouds"
TRUTH = json.loads((FOLDER / "truth.json").read_text())
POINTS = np.ones((100, 3))


def test_an_array_gives_what_its_file_gives():
    with np.load(FOLDER / "ascent.npz") as file:
        arrays = dict(file)
    by_file = estimate(FOLDER / "ascent.npz").rotor
    by_array = estimate(
        arrays["points"], viewpoint=arrays["viewpoint"], time_s=arrays.get("time_s")
    ).rotor
    assert isinstance(by_file, Rotor)
    assert isinstance(by_array, Rotor)
    assert by_array.stop_angle_deg == by_file.stop_angle_deg
    assert abs(by_file.stop_angle_deg - TRUTH["stop_angle_deg"]) < 1.0


def test_what_is_no_rotor_is_refused_in_words():
    cloud = np.random.default_rng(1).uniform(-20, 20, (500, 3))
    found = estimate(cloud, viewpoint=(40, 0, 0)).rotor
    assert isinstance(found, Refusal)
    assert found.text


@pytest.mark.parametrize(
    ("cloud", "given", "said"),
    [
        (POINTS, {}, "viewpoint is missing"),
        (POINTS, {"viewpoint": (1, 2)}, r"viewpoint has shape \(2,\)"),
        (POINTS, {"viewpoint": (1, 2, 3), "time_s": [0.0]}, r"time_s has shape \(1,\)"),
        (POINTS.T, {"viewpoint": (1, 2, 3)}, r"cloud has shape \(3, 100\)"),
        (POINTS, {"poses": "poses.tum"}, "poses are for files"),
        (POINTS, {"viewpoint": (1, 2, 3), "turbine": "v90"}, "did you mean 'v90-2.0'"),
        ("cloud.npz", {"time_s": [0.0]}, "time_s is of an array"),
        ("cloud.npz", {}, "cloud.npz: no such file"),
    ],
)
def test_what_cannot_be_used_is_told_in_a_sentence(cloud, given, said):
    with pytest.raises(ValueError, match=said):
        estimate(cloud, **given)


def test_the_example_of_the_page_runs(monkeypatch, capsys):
    root = FOLDER.parents[1]
    page = (root / "docs" / "estimate.md").read_text()
    (example,) = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    monkeypatch.chdir(root)
    exec(compile(example, "docs/estimate.md", "exec"), {})
    first, *blades = capsys.readouterr().out.splitlines()
    assert abs(float(first.split()[0]) - TRUTH["stop_angle_deg"]) < 1.0
    assert [line[0] for line in blades] == ["A", "B", "C"]
