"""The table of the angle bench: rows, strata, success and intervals; and the command."""

import json
from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

from benchmarks.angle import (
    ACTIVE,
    MODELS,
    OURS,
    OURS_KNOWN,
    OURS_LONGER,
    PAPER,
    PAPER_FLOWN,
    PASSIVE,
    VISION,
    Table,
    measure,
    on_a_site,
    one,
    stratum_row,
)
from benchmarks.angle_active import fly_estimate
from benchmarks.angle_goals import goals
from benchmarks.angle_kept import keep_trials, read_trials
from benchmarks.angle_scenes import SceneOptions, make_scene
from benchmarks.angle_summary import row, strata
from benchmarks.angle_trials import Trial, fermat, windowed
from mission.cli.bench_command import app


def _trial(error: float | None, pitch: float = 3.0, sigma: float = 0.5) -> Trial:
    return Trial(1, "v27", pitch, 0.02, "" if error is not None else "no", error, sigma)


def test_a_refusal_is_not_a_success_and_no_part_of_the_mean():
    told = row([_trial(0.5), _trial(-0.5), _trial(3.0), _trial(None)])
    assert told["refused"] == 1
    assert told["mean_deg"] == pytest.approx(4.0 / 3)
    assert told["success_5"] == 0.75
    assert told["success_1"] == 0.5
    assert told["within_1_sigma"] == pytest.approx(2 / 3)


def test_bounds_enclose_what_they_bound():
    told = row([_trial(0.1 * k) for k in range(-9, 10)])
    assert told["mean_low"] < told["mean_deg"] < told["mean_high"]
    assert 0.8 < told["success_1_low"] < 1.0


def test_a_row_of_refusals_has_no_errors():
    told = row([_trial(None)])
    assert told["mean_deg"] is None
    assert told["success_1"] == 0.0


def test_strata_are_fifteen_degrees_of_pitch():
    rows = strata([_trial(0.1, -1.0), _trial(0.2, 14.9), _trial(0.3, 93.0)])
    assert list(rows) == ["0-15", "75-90"]
    assert rows["0-15"]["trials"] == 2


def test_every_method_answers_the_same_scene():
    table = Table()
    one(table, 5, SceneOptions(), pictures=False)
    assert len(table.trials) == 8
    assert len({t.model for trials in table.trials.values() for t in trials}) == 1
    assert table.rows()["rotor fit, full azimuth, 1 s"]["mean_deg"] < 1.0


def test_in_fog_the_core_is_also_given_two_seconds():
    table = Table()
    one(table, 5, SceneOptions(fog_per_m=0.052), pictures=False, core=True)
    assert set(table.rows()) == {OURS, OURS_KNOWN, OURS_LONGER, PAPER, PAPER_FLOWN}


def test_a_window_keeps_what_lies_ahead():
    scene = make_scene(5)
    narrow = windowed(scene, 60.0)
    assert 0.1 < len(narrow.points_w) / len(scene.points_w) < 0.9
    assert len(narrow.origins_w) == len(narrow.points_w)


def test_the_paper_s_loop_takes_a_new_second_each_pass():
    scene = make_scene(5, SceneOptions(seconds=3.0, window_deg=60.0))
    later = scene.time_s > 0.95
    blind = replace(
        scene,
        points_w=np.where(later[:, None], scene.points_w, np.nan),
    )
    told = fermat(5, blind)
    assert abs(told.error_deg) < 5.0
    first = replace(
        blind,
        points_w=blind.points_w[~later],
        origins_w=blind.origins_w[~later],
        time_s=blind.time_s[~later],
    )
    assert fermat(5, first).error_deg is None


def test_scenes_and_loops_are_counted_as_they_are_done():
    table = Table()
    assert list(measure(table, 1, 5, effects=False, active=1)) == [1, 2]
    assert len(table.trials[VISION]) == 1
    assert len(table.trials[PASSIVE]) == len(table.trials[ACTIVE]) == 1


def test_every_model_stands_on_every_site():
    placed = [on_a_site(SceneOptions(), k) for k in range(50)]
    assert len({(options.models, options.site) for options in placed}) == 50
    assert len(MODELS) == 10


def test_the_loop_recentres_until_estimates_agree():
    first, last = fly_estimate(6, SceneOptions(prior_error_m=(12.0, 15.0)))
    assert last.error_deg is not None
    assert abs(last.error_deg) < 1.5
    assert last.looks >= 3
    assert last.phase_s is not None
    assert last.phase_s > 3.0
    assert first.looks == 1


def test_goals_tell_what_was_reached_and_what_was_not():
    table = Table()
    for k in range(100):
        table.add(OURS, _trial(0.3 if k else 2.0, sigma=0.3))
    told = {goal.what: goal for goal in goals(table)}
    assert told["ours: refused"].met is True
    assert told["ours: mean"].met is False
    assert told["ours: within 1 deg"].measured == pytest.approx(0.99)
    assert told["the paper's method: mean"].met is None
    assert told["ours: within 1 sigma"].met is False


def test_a_stratum_is_judged_by_all_its_scenes_and_not_by_a_few():
    table = Table()
    for k in range(15):
        table.add(OURS, _trial(0.1 if k else 0.5, pitch=33.0))
        table.add(stratum_row(30), _trial(0.3, pitch=33.0))
        table.add(OURS, _trial(5.0, pitch=70.0))
    told = {goal.what: goal.measured for goal in goals(table)}
    assert told["worst stratum of pitch: mean"] == pytest.approx((14 * 0.1 + 0.5 + 15 * 0.3) / 30)


def test_kept_outcomes_of_several_files_are_summed_and_a_scene_counts_once(tmp_path):
    keep_trials(tmp_path / "a", {OURS: [_trial(0.5), replace(_trial(None), seed=2)]})
    keep_trials(tmp_path / "b", {OURS: [_trial(0.7)], PAPER: [_trial(1.5)]})
    told = read_trials([tmp_path / "a", tmp_path / "b"])
    assert [(t.seed, t.error_deg) for t in told[OURS]] == [(1, 0.7), (2, None)]
    assert told[PAPER] == [_trial(1.5)]


def test_a_line_that_is_no_outcome_is_not_read(tmp_path):
    (tmp_path / "a").write_text('{"row": "x", "trial": {"seed": 1}}\n')
    with pytest.raises(ValueError, match="model"):
        read_trials([tmp_path / "a"])


def test_the_table_of_what_was_kept_measures_nothing(tmp_path):
    kept = tmp_path / "kept.jsonl"
    assert list(measure(Table(), 1, 5, effects=False, core=True, keep=kept)) == [1]
    result = CliRunner().invoke(app, ["angle", "--read", str(kept), "--json"])
    assert result.exit_code == 0, result.output
    told = json.loads(result.stdout)
    assert told["seeds"] == [5, 5]
    assert {name: row["trials"] for name, row in told["rows"].items()} == {
        OURS: 1, OURS_KNOWN: 1, PAPER: 1, PAPER_FLOWN: 1,
    }  # fmt: skip


def test_the_command_prints_one_json_object():
    arguments = ["angle", "--trials", "1", "--no-effects", "--active", "0", "--processes", "1"]
    result = CliRunner().invoke(app, [*arguments, "--json"])
    assert result.exit_code == 0, result.output
    told = json.loads(result.stdout)
    assert told["seeds"] == [1000, 1000]
    assert PAPER in told["rows"]
    assert told["sites"]["fields"][OURS]["trials"] == 1
    assert len(told["goals"]) > 20
