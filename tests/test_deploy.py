"""What lies in deploy/ for others to copy names commands and files that exist."""

import importlib.util
import shlex
import sys
from pathlib import Path

import pytest
from typer.main import get_command

from config.sources import scenario_path
from mission.cli.main import app
from tests.system.readme_mission import MOST, lines_of, stays

ROOT = Path(__file__).parents[1]
WORKFLOW = (ROOT / "deploy" / "ci" / "missions.yml").read_text()
COMPOSE = (ROOT / "deploy" / "compose.yaml").read_text()


@pytest.fixture(scope="module")
def image_proof():
    spec = importlib.util.spec_from_file_location("image_proof", ROOT / "deploy" / "image_proof.py")
    module = importlib.util.module_from_spec(spec)
    # A dataclass looks its module up.
    sys.modules["image_proof"] = module
    spec.loader.exec_module(module)
    yield module
    del sys.modules["image_proof"]


def understood(words):
    """Parse words as the command line would, without doing anything."""
    group = get_command(app)
    command = group.commands[words[0]]
    context = command.make_context(words[0], list(words[1:]))
    return context.params


def test_the_workflow_flies_scenarios_that_exist_and_keeps_the_report_that_it_writes():
    (line,) = [line for line in WORKFLOW.splitlines() if "bladescout simulate" in line]
    words = shlex.split(line.partition("bladescout ")[2])
    told = understood(words)
    for name in told["scenarios"]:
        assert scenario_path(name).is_file()
    assert f"            {told['junit']}\n" in WORKFLOW
    assert f"            {told['out']}/\n" in WORKFLOW
    assert "run: make env" in WORKFLOW


def test_every_service_of_the_compose_file_types_a_command_that_exists():
    commands = [
        line.partition("command: ")[2] for line in COMPOSE.splitlines() if "command: " in line
    ]
    names = []
    for text in commands:
        words = [word.strip().strip('"') for word in text.strip("[]").split(",")]
        understood(words)
        names.append(words[0])
    assert names == ["field", "serve", "start", "console"]


def test_the_dockerfile_copies_every_package_and_the_proof_knows_each_of_its_steps(image_proof):
    text = (ROOT / "Dockerfile").read_text()
    steps = image_proof.instructions(text)
    copied = [rest.split()[0] for keyword, rest in steps if keyword == "COPY"]
    for package in ("config", "perception", "drivers", "mission", "bladescout", "benchmarks"):
        assert package in copied
    known = {"FROM", "RUN", "COPY", "ENV", "WORKDIR", "USER", "ENTRYPOINT", "CMD", "HEALTHCHECK"}
    assert {keyword for keyword, _ in steps} <= known | {"VOLUME", "STOPSIGNAL"}
    # Not root, and by a number that every host knows.
    assert [rest for keyword, rest in steps if keyword == "USER"] == ["10001"]


def test_the_readmes_remote_mission_takes_fewer_than_ten_commands_and_each_is_understood():
    lines = lines_of((ROOT / "README.md").read_text())
    assert len(lines) < MOST
    commands = [shlex.split(line)[1:] for line in lines if line.startswith("bladescout ")]
    for words in commands:
        understood(words)
    assert [words[0] for words in commands if stays(shlex.join(["bladescout", *words]))] == [
        "field",
        "serve",
        "console",
    ]
    # Whoever starts comes by TLS, with a certificate that the second command made.
    start = understood(next(words for words in commands if words[0] == "start"))
    assert start["router"].startswith("tls/")
    assert start["keys"] == "keys/ada"
