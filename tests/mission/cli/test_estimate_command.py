"""`bladescout estimate` as a person types it: every format, every exit code, every mistake."""

import io
import json
import shlex
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console
from typer.testing import CliRunner

import bladescout
from mission.cli.estimate_view import answer_table
from mission.cli.main import app
from perception.cloud_estimate import CloudAnswer, Question
from perception.geometry import stop_angle_difference_deg
from perception.rotor import Refusal, RefusalCode

ROOT = Path(__file__).parents[3]
FOLDER = ROOT / "tests" / "clouds"
TRUTH = json.loads((FOLDER / "truth.json").read_text())
EYE = ",".join(map(str, TRUTH["viewpoint_m"]))


def run(*words):
    return CliRunner().invoke(app, ["estimate", *map(str, words)])


def examples():
    text = (ROOT / "docs" / "estimate.md").read_text()
    lines = [line for line in text.splitlines() if line.startswith("bladescout estimate tests/")]
    assert len(lines) == 4
    return [shlex.split(line)[2:] for line in lines]


@pytest.mark.parametrize("words", examples(), ids=lambda words: Path(words[0]).name)
def test_what_the_page_types_finds_the_angle(words, monkeypatch):
    monkeypatch.chdir(ROOT)
    result = run(*words, *([] if "--json" in words else ["--json"]))
    assert result.exit_code == 0, result.stderr
    answer = json.loads(result.stdout)
    error = stop_angle_difference_deg(answer["stop_angle_deg"], TRUTH["stop_angle_deg"])
    assert abs(error) < 1.0
    assert np.linalg.norm(np.subtract(answer["hub_m"], TRUTH["hub_m"])) < 0.4
    assert answer["refusal"] is None
    assert result.stderr == ""


@pytest.mark.parametrize(
    "words",
    [
        ("hover-ascii.pcd", "--viewpoint", EYE),
        ("hover-binary.pcd", "--viewpoint", EYE),
        ("hover-compressed.pcd", "--viewpoint", EYE),
        ("hover-ascii.ply", "--viewpoint", EYE),
        ("hover.lvx2", "--poses", FOLDER / "hover.csv", "--time-offset", 1_790_000_000 - 1234.5),
    ],
    ids=lambda words: words[0],
)
def test_every_other_golden_file_gives_the_same(words):
    result = run(FOLDER / words[0], *words[1:], "--json")
    assert result.exit_code == 0, result.stderr
    answer = json.loads(result.stdout)
    error = stop_angle_difference_deg(answer["stop_angle_deg"], TRUTH["stop_angle_deg"])
    assert abs(error) < 1.0


def test_the_json_has_the_names_of_the_mission_file():
    answer = json.loads(run(FOLDER / "ascent.npz", "--json").stdout)
    assert answer["schema"] == "bladescout/estimate/1"
    assert {"sigma_deg", "reference", "normal", "method", "refusal", "looks"} <= set(answer)
    assert [blade["name"] for blade in answer["blades"]] == ["A", "B", "C"]
    assert set(answer["blades"][0]) >= {"name", "angle_deg", "direction", "pitch_deg"}
    assert -45 <= answer["blades"][0]["angle_deg"] < 75


def test_a_person_is_shown_angle_hub_pitch_and_how_it_was_found():
    result = run(FOLDER / "ascent.npz")
    assert result.exit_code == 0
    for word in ("stop angle", "+-", "hub", "normal", "pitch", "tower in the cloud", "looks"):
        assert word in result.stdout


def test_the_paper_s_method_can_be_asked_for():
    result = run(FOLDER / "ascent.npz", "--method", "fermat", "--json")
    answer = json.loads(result.stdout)
    assert answer["method"] == "fermat"
    error = stop_angle_difference_deg(answer["stop_angle_deg"], TRUTH["stop_angle_deg"])
    assert abs(error) < 5.0


def test_a_refusal_is_words_and_exit_3(tmp_path):
    with np.load(FOLDER / "ascent.npz") as file:
        ground = file["points"][:, 2] < 20.0
        path = tmp_path / "ground.npz"
        np.savez(path, points=file["points"][ground], viewpoint=np.array([20.0, -20.0, 30.0]))
    shown = run(path)
    assert shown.exit_code == 3
    assert "refused" in shown.stdout
    told = run(path, "--json")
    assert told.exit_code == 3
    answer = json.loads(told.stdout)
    assert answer["stop_angle_deg"] is None
    assert answer["blades"] == []
    assert answer["refusal"]["code"]
    assert answer["refusal"]["text"] in " ".join(shown.stdout.split())


@pytest.mark.parametrize("code", list(RefusalCode))
def test_every_refusal_has_words(code):
    answer = CloudAnswer(Refusal(code, "detail"), "rotor", 9, 0)
    console = Console(width=120, record=True, file=io.StringIO())
    console.print(answer_table(Path("a.npz"), answer, Question()))
    first, second, *_ = console.export_text().splitlines()
    assert first.startswith("refused")
    assert len(first.split()) >= 5
    assert second.strip() == "detail"


def millimetres(path):
    with np.load(FOLDER / "ascent.npz") as file:
        np.savez(path, points=1000 * file["points"], viewpoint=1000 * file["viewpoint"])


def not_finite(path):
    np.savez(path, points=np.full((100, 3), np.nan), viewpoint=np.zeros(3))


def grid(path):
    points = np.random.default_rng(0).uniform(-40, 40, (500, 3)) + np.array([5e5, 5.9e6, 0])
    np.savez(path, points=points.astype(np.float32), viewpoint=np.array([5e5, 5.9e6, 0]))


HOVER, LVX2, TUM = FOLDER / "hover-binary.pcd", FOLDER / "hover.lvx2", FOLDER / "hover.tum"


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (("nowhere.npz",), ("nowhere.npz", "no such file")),
        (("scan.las",), ("scan.las", "convert it", ".pcd")),
        ((HOVER,), ("hover-binary.pcd", "where the sensor stood", "--viewpoint X,Y,Z")),
        ((HOVER, "--viewpoint", "1,2"), ("--viewpoint 1,2", "three numbers")),
        ((HOVER, "--viewpoint", "1,2,x"), ("--viewpoint", "three numbers")),
        ((HOVER, "--viewpoint", EYE, "--prior-hub", "a"), ("--prior-hub", "three numbers")),
        ((HOVER, "--viewpoint", EYE, "--prior-normal", "0,0,1"), ("--prior-normal", "level")),
        ((HOVER, "--viewpoint", EYE, "--turbine", "mill"), ("--turbine", "mill", "known")),
        ((HOVER, "--viewpoint", EYE, "--method", "guess"), ("estimation.method", "guess")),
        ((HOVER, "--viewpoint", EYE, "--poses", TUM), ("--viewpoint", "poses")),
        ((HOVER, "--poses", TUM), ("says no times", "single pose")),
        ((LVX2,), ("hover.lvx2", "own frame", "--poses FILE")),
        ((LVX2, "--viewpoint", EYE), ("hover.lvx2", "own frame", "--poses FILE")),
        ((LVX2, "--poses", "nowhere.tum"), ("nowhere.tum", "no such file")),
        ((LVX2, "--poses", FOLDER / "truth.json"), ("truth.json", "column")),
        ((LVX2, "--poses", FOLDER / "hover.csv"), ("hover.csv", "poses run from", "--time-off")),
        ((millimetres,), ("made.npz", "not metres", "divide them by 1000")),
        ((not_finite,), ("made.npz", "0 finite points of 100")),
        ((grid,), ("made.npz", "32-bit", "subtract an offset")),
    ],
)
def test_what_cannot_be_used_is_one_sentence_and_exit_2(words, named, tmp_path):
    if callable(words[0]):
        words[0](tmp_path / "made.npz")
        words = (tmp_path / "made.npz", *words[1:])
    result = run(*words)
    assert result.exit_code == 2
    assert result.stdout == ""
    assert result.stderr.startswith("error: ")
    assert len(result.stderr.splitlines()) == 1
    for word in named:
        assert word in result.stderr


def test_points_without_a_pose_are_left_out_and_told(tmp_path):
    lines = TUM.read_text().splitlines()
    path = tmp_path / "short.tum"
    path.write_text("\n".join(lines[:9]) + "\n")
    result = run(LVX2, "--poses", path, "--json")
    answer = json.loads(result.stdout)
    assert len(answer["notes"]) == 1
    assert "no pose near in time" in answer["notes"][0]


def test_one_pose_places_a_whole_cloud(tmp_path):
    """A levelled scan in the sensor's frame with where it was taken."""
    with np.load(FOLDER / "ascent.npz") as file:
        late = file["time_s"] > 18.0
        np.savez(tmp_path / "local.npz", points=file["points"][late] - TRUTH["viewpoint_m"])
    place = " ".join(map(str, TRUTH["viewpoint_m"]))
    (tmp_path / "one.tum").write_text(f"0 {place} 0 0 0 1\n")
    level = ("--set", "lidar.nose_down_deg=0", "--set", "lidar.offset_m=[0,0,0]")
    result = run(tmp_path / "local.npz", "--poses", tmp_path / "one.tum", "--json", *level)
    assert result.exit_code == 0, result.stderr
    answer = json.loads(result.stdout)
    assert np.linalg.norm(np.subtract(answer["hub_m"], TRUTH["hub_m"])) < 0.4


def test_the_same_from_python():
    answer = bladescout.estimate(
        FOLDER / "hover-binary.ply", viewpoint=TRUTH["viewpoint_m"], prior_hub=TRUTH["hub_m"]
    )
    error = stop_angle_difference_deg(answer.rotor.stop_angle_deg, TRUTH["stop_angle_deg"])
    assert abs(error) < 1.0
    with pytest.raises(ValueError, match="no such file"):
        bladescout.estimate("nowhere.ply")
