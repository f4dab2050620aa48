"""Every row of the fault table is true, and SAFETY.md says the same."""

import ast
import json
from pathlib import Path

import pytest

from tests.faults import safety
from tests.faults.fault import Seen
from tests.faults.table import CASES, FAULTS

ROOT = Path(__file__).parents[2]

QUICK = [f for f in FAULTS if not isinstance(f.inject, str) and not f.slow]
SLOW = [f for f in FAULTS if not isinstance(f.inject, str) and f.slow]
ELSEWHERE = [f for f in FAULTS if isinstance(f.inject, str)]


def holds(fault) -> Seen:
    """Inject a fault and hold what is seen against its row."""
    seen = fault.inject()
    assert seen.disturbed > 0, "the disturbance was not applied"
    if fault.event:
        assert set(fault.event.split()) & seen.events, seen.events
    if fault.react_within_s is not None:
        assert seen.reacted_s is not None, "no reaction"
        assert seen.reacted_s <= fault.react_within_s + 1e-6
    if fault.end_state:
        assert seen.end in fault.end_state.split()
    assert seen.closed_m <= seen.allowed_m
    assert seen.clearance_m >= 8.0
    return seen


@pytest.mark.parametrize("fault", QUICK, ids=lambda f: f.key)
def test_it_is_noticed_in_time_and_ends_where_it_should(fault, measured):
    measured(fault, holds(fault))


@pytest.mark.faults
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("fault", SLOW, ids=lambda f: f.key)
def test_it_is_noticed_in_time_and_ends_where_it_should_however_long_that_takes(fault, measured):
    measured(fault, holds(fault))


@pytest.mark.parametrize("fault", ELSEWHERE, ids=lambda f: f.key)
def test_a_row_that_names_a_test_names_one_that_is_there(fault):
    file, _, name = fault.inject.partition("::")
    tree = ast.parse((ROOT / file).read_text())
    kinds = (ast.FunctionDef, ast.AsyncFunctionDef)
    assert name in {node.name for node in ast.walk(tree) if isinstance(node, kinds)}


def test_all_46_cases_have_a_row():
    assert {fault.number for fault in FAULTS} == set(range(1, 47)) == set(CASES)


def test_no_two_rows_have_the_same_name():
    assert len({fault.key for fault in FAULTS}) == len(FAULTS)


def test_safety_md_is_what_the_table_renders():
    figures = json.loads(safety.FIGURES.read_text())
    assert safety.OUT.read_text() == safety.rendered(figures), "run `make safety`"


def test_no_figure_is_of_a_row_that_is_gone():
    assert set(json.loads(safety.FIGURES.read_text())) <= {fault.key for fault in FAULTS}
