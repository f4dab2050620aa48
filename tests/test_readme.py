"""What README, ARCHITECTURE.md and the pages of docs tell one to type and open is there."""

import ast
import re
import shlex
import tomllib
from pathlib import Path

import pytest
from typer.main import get_command

import bladescout
from config.explain import schema_of
from config.settings import Settings
from config.sources import load
from drivers.bus import Key
from mission.cli.exits import Exit
from mission.cli.main import app
from mission.remote.farm import load_farm

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text()
ARCHITECTURE = (ROOT / "ARCHITECTURE.md").read_text()
MEASURED = (ROOT / "docs" / "measured.md").read_text()
#: README and what it leads to.
PAGES = "\n".join(
    [
        README,
        MEASURED,
        *((ROOT / "docs" / f"{name}.md").read_text() for name in ("estimate", "mission-folder")),
    ]
)
#: Everything that is written for a reader.
ALL_PAGES = {
    path.relative_to(ROOT).as_posix(): path.read_text()
    for path in (*sorted(ROOT.glob("*.md")), *sorted(ROOT.glob("docs/*.md")))
}
#: Of files and modules, which are no settings.
SUFFIXES = (
    ".py",
    ".md",
    ".toml",
    ".json",
    ".jsonl",
    ".html",
    ".mcap",
    ".xml",
    ".yaml",
    ".tlog",
    ".geojson",
)
PLACEHOLDERS = {
    "FILE": "drone.toml",
    "TURBINE": "hill-3",
    "DIR": "missions/x",
    "SCENARIO": "demo",
    "FOLDER": "keys",
}


def blocks(language, text=PAGES):
    """Return the code blocks of a language, without the indentation of a list."""
    found = re.findall(rf"^( *)```{language}\n(.*?)^ *```", text, re.MULTILINE | re.DOTALL)
    return [
        "\n".join(line.removeprefix(indent) for line in text.splitlines()) for indent, text in found
    ]


def typed(text=PAGES):
    """Return every command of a page: lines of its sh blocks, and inline code."""
    lines = [line for block in blocks("sh", text) for line in block.splitlines() if line.strip()]
    inline = re.findall(r"`((?:bladescout|make) [^`]+)`", text)
    return list(
        dict.fromkeys(lines + [code for code in inline if not code.startswith("bladescout-")])
    )


def words_of(command):
    words = shlex.split(command.replace("[", "").replace("]", ""))
    return [PLACEHOLDERS.get(word, word) for word in words]


def context_of(words):
    """Parse words as the command line would, without doing anything."""
    command, context = get_command(app), None
    while True:
        name = "bladescout" if context is None else context.info_name
        if not hasattr(command, "commands"):
            return command.make_context(name, list(words))
        context = command.make_context(name, list(words), resilient_parsing=True)
        assert words, f"{name} needs a command"
        assert words[0] in command.commands, f"there is no command {words[0]!r}"
        command, words = command.commands[words[0]], words[1:]


@pytest.mark.parametrize(
    "command",
    [c for c in typed("\n".join(ALL_PAGES.values())) if c.startswith("bladescout")],
)
def test_every_command_can_be_typed_as_it_stands(command):
    words = words_of(command)
    if len(words) == 2:
        # Named, not typed.
        assert words[1] in get_command(app).commands
    else:
        assert context_of(words[1:]) is not None


def test_every_make_target_exists():
    targets = set(re.findall(r"^([a-z]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    asked = {words_of(c)[1] for c in typed() if c.startswith("make ")}
    assert asked >= {"mission", "test"}
    assert asked <= targets


def test_nothing_else_is_typed():
    known = ("bladescout ", "make ", ". .venv/bin/activate")
    assert [command for command in typed() if not command.startswith(known)] == []


def test_every_command_of_the_command_line_is_told():
    told = {words_of(c)[1] for c in typed(README) if c.startswith("bladescout ")}
    assert told == set(get_command(app).commands)


def test_the_settings_file_can_be_used(tmp_path):
    (text,) = blocks("toml")
    tomllib.loads(text)
    file = tmp_path / "drone.toml"
    file.write_text(text)
    settings = load([file], environment={}).settings
    assert settings.sites[0].name == "hill-3"
    assert settings.vehicle == "heron"


def test_the_farm_of_the_page_can_be_flown(tmp_path):
    (text,) = blocks("toml", ALL_PAGES["docs/fleet.md"])
    file = tmp_path / "farm.toml"
    file.write_text(text)
    farm = load_farm(file)
    assert farm.turbines[1].vehicles == ("stork",)
    assert farm.vehicles[1].router == "tls/192.168.1.6:7448"


SETTINGS = sorted(
    {
        (page, key)
        for page, text in ALL_PAGES.items()
        for key in re.findall(r"(?:`|--set )([a-z_]+\.[a-z_0-9.]+)\b", text)
        if key.partition(".")[0] in Settings.model_fields and not key.endswith(SUFFIXES)
    }
)


@pytest.mark.parametrize(("page", "key"), SETTINGS)
def test_every_setting_that_is_named_exists(page, key):
    parts = tuple(int(part) if part.isdecimal() else part for part in key.split("."))
    assert schema_of(parts) is not None


def test_the_variable_and_the_override_of_the_readme_are_understood():
    settings = load(environment={"BLADESCOUT_GUARD__MAX_HEIGHT_M": "150"}).settings
    assert settings.guard.max_height_m == 150
    assert load(overrides=["guard.max_height_m=150"], environment={}).settings == settings
    assert "BLADESCOUT_GUARD__MAX_HEIGHT_M=150" in README
    assert "--set guard.max_height_m=150" in README


def test_the_python_example_uses_names_that_exist():
    tree = ast.parse("\n".join(blocks("python")))
    lines = [node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
    assert {line.module for line in lines} == {"bladescout"}
    imported = [name.name for line in lines for name in line.names]
    assert set(imported) <= set(bladescout.__all__)
    called = {
        node.func.attr
        for node in ast.walk(tree)
        if isinstance(node, ast.Call)
        and isinstance(node.func, ast.Attribute)
        and isinstance(node.func.value, ast.Name)
        and node.func.value.id == "drone"
    }
    assert called
    assert called <= set(dir(bladescout.Client))


def test_the_exit_codes_are_those_of_the_command_line():
    told = {int(code) for code in re.findall(r"^\| (\d) \|", README, re.MULTILINE)}
    assert told == {int(code) for code in Exit}


@pytest.mark.parametrize("page", [ROOT / "README.md", ROOT / "docs" / "measured.md"])
def test_the_pictures_are_there_and_light(page):
    names = re.findall(r"!\[[^]]*\]\(([^)]+)\)", page.read_text())
    assert names
    for name in names:
        assert (page.parent / name).stat().st_size < 400_000


def test_the_figures_of_the_readme_are_those_that_were_measured():
    rows = README.partition("## Measured")[2].partition("\n\n|")[2].partition("\n\n")[0]
    values = [row.split("|")[2].strip() for row in rows.splitlines()[2:]]
    assert len(values) == 10
    stale = [value for value in values if value not in MEASURED]
    assert stale == [], "docs/measured.md says otherwise now"


NAMED = re.findall(r"`([a-zA-Z_]+(?:/[a-z_0-9]+)*(?:/|\.py|\.md|\.lock))`", ARCHITECTURE + PAGES)


@pytest.mark.parametrize("name", sorted(set(NAMED) - {"log/"}))
def test_every_file_that_is_named_exists(name):
    assert (ROOT / name).exists()


@pytest.mark.parametrize("key", list(Key))
def test_the_table_of_flows_names_every_key(key):
    assert f"| `{key}` |" in ARCHITECTURE


@pytest.mark.parametrize(
    "name", ["README.md", "ARCHITECTURE.md", "docs/measured.md", "docs/mission-folder.md"]
)
def test_every_table_has_the_same_number_of_columns_in_each_row(name):
    for table in re.findall(r"(?:^ *\|.*\|\n)+", (ROOT / name).read_text(), re.MULTILINE):
        assert len({len(re.findall(r"(?<!\\)\|", row)) for row in table.splitlines()}) == 1, table


def test_what_the_commands_leave_is_neither_committed_nor_put_into_an_image():
    ignored = (ROOT / ".gitignore").read_text().splitlines()
    left_out = (ROOT / ".dockerignore").read_text().splitlines()
    for folder in ("missions", "keys", "field"):
        assert f"/{folder}/" in ignored
        assert folder in left_out
