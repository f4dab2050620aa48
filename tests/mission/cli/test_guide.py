"""The help: every command in one group, every example a command that can be typed."""

import shlex

import pytest
from typer.main import get_command
from typer.testing import CliRunner

from mission.cli.guide import GROUPS
from mission.cli.main import app

COMMANDS = get_command(app).commands
EXAMPLES = [
    (name, example)
    for commands in GROUPS.values()
    for name, examples in commands.items()
    for example in examples
]


def test_every_command_stands_in_one_group():
    listed = [name for commands in GROUPS.values() for name in commands]
    assert sorted(listed) == sorted(COMMANDS)


@pytest.mark.parametrize(("name", "example"), EXAMPLES)
def test_an_example_can_be_typed_as_it_stands(name, example):
    words = shlex.split(example)
    words = words[1:] if words[0] == "sudo" else words
    assert words[0].endswith("bladescout")
    assert words[1] == name
    assert COMMANDS[name].make_context(name, words[2:]) is not None


@pytest.mark.parametrize("width", ["80", "140"])
def test_the_help_shows_groups_and_examples_whatever_the_width(monkeypatch, width):
    monkeypatch.setenv("COLUMNS", width)
    whole = CliRunner().invoke(app, ["--help"]).stdout
    assert all(title in whole for title in GROUPS)
    assert max(len(line) for line in whole.splitlines()) <= int(width)
    said = " ".join(CliRunner().invoke(app, ["keys", "--help"]).stdout.split())
    assert "bladescout keys keys --remove eve" in said
