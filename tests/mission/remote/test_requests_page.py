"""docs/requests.md names every verb, field and code, and who may do what."""

import json
import re
from pathlib import Path

import pytest

from drivers.bus_access import SHOWN, VERBS, Role
from mission.remote.messages import Code, ResumeRequest, StartRequest

PAGE = (Path(__file__).parents[3] / "docs" / "requests.md").read_text()
NAMED = set(re.findall(r"`([a-z_]+)`", PAGE))


@pytest.mark.parametrize("code", list(Code))
def test_every_code_is_told(code):
    assert code in NAMED


@pytest.mark.parametrize("model", [StartRequest, ResumeRequest])
def test_every_field_is_told(model):
    assert set(model.model_fields) - {"version"} <= NAMED


def test_the_example_is_a_request():
    (example,) = re.findall(r"```json\n(.*?)```", PAGE, re.DOTALL)
    assert StartRequest.model_validate(json.loads(example)).rotor_locked


def test_the_table_of_verbs_is_that_of_the_roles():
    table = re.findall(r"^\| `(\w+)` \|[^|]*\|([^|]*)\|([^|]*)\|([^|]*)\|$", PAGE, re.MULTILINE)
    told = {
        role: {verb for verb, *may in table if may[column].strip() == "yes"}
        for column, role in enumerate((Role.VIEWER, Role.PILOT, Role.OPERATOR))
    }
    assert told == {role: set(verbs) for role, verbs in VERBS.items()}


def test_what_is_published_is_what_may_be_heard():
    published = PAGE.partition("## What is published")[2]
    braces = re.sub(
        r"`(\w+)/\{([\w,]+)\}`",
        lambda m: " ".join(f"`{m[1]}/{name}`" for name in m[2].split(",")),
        published,
    )
    assert set(re.findall(r"`(\w+(?:/\w+)+)`", braces)) == set(SHOWN)
