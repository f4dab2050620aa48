import json

import pytest
import typer
from typer.testing import CliRunner

from mission.cli.bench_rows import measuring
from mission.cli.typed import AsJson
from mission.processes.simulation import SimulationFailed
from mission.remote.client import NoReply


@pytest.mark.parametrize("error", [SimulationFailed("it ended"), NoReply("it ended")])
def test_a_daemon_that_does_not_go_on_ends_a_benchmark_in_one_sentence_and_one_object(error):
    app = typer.Typer()

    @app.command()
    def bench(as_json: AsJson = False) -> None:
        del as_json  # its callback has taken it
        with measuring("asking"):
            raise error

    shown = CliRunner().invoke(app, ["--json"])
    assert shown.exit_code == 5
    assert shown.stderr.count("error: it ended") == 1
    assert json.loads(shown.stdout) == {"ok": False, "exit_code": 5, "error": "it ended"}
