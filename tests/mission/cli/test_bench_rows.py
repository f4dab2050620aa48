import json

import pytest
import typer
from typer.testing import CliRunner

from mission.cli.bench_daemon import daemon
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


def test_what_the_daemons_benchmark_is_at_is_shown_while_it_measures(monkeypatch):
    shown = []
    monkeypatch.setattr("rich.status.Status.update", lambda _status, words: shown.append(words))

    def measure(*_args, tell, **_options):
        tell("on the way up")
        raise SimulationFailed("it ended")

    monkeypatch.setattr("benchmarks.daemon.measure", measure)
    with pytest.raises(typer.Exit):
        daemon(3.0, 1.0, 1, fly=True, track=True, light=False, threads=False, as_json=False)
    assert shown == ["on the way up"]
