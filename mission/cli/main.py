"""The command `bladescout`.

The modules of the commands import what they need when they run, so that `--help` and a short
request answer at once.
"""

from __future__ import annotations

import errno
import signal
import sys
from pathlib import Path
from typing import Annotated

import typer

from mission.cli import (
    bench_command,
    config_command,
    console_command,
    estimate_command,
    farm_command,
    field_command,
    guide,
    keys_command,
    live_command,
    remote_commands,
    replay_command,
    report_commands,
    router_command,
    serve_command,
    service_command,
    watch_command,
)
from mission.cli import simulate_command as simulation
from mission.cli.exits import Exit, tell, want_json

app = typer.Typer(
    name="bladescout",
    help="Inspect the blades of a stopped wind turbine by drone.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode="markdown",
    pretty_exceptions_enable=False,
)
app.command("simulate")(simulation.simulate_command)
app.command("field")(field_command.field)
app.command("serve")(serve_command.serve)
remote_commands.mount(app)
app.command("watch")(watch_command.watch)
app.command("console")(console_command.console)
app.command("live")(live_command.live)
app.command("farm")(farm_command.farm)
app.command("keys")(keys_command.keys)
app.command("router")(router_command.router)
app.command("install-service")(service_command.install_service)
report_commands.mount(app)
replay_command.mount(app)
estimate_command.mount(app)
app.add_typer(config_command.app, name="config", help="Show and check the configuration.")
app.add_typer(bench_command.app, name="bench", help="Measure what the README states.")
guide.lay_out(app)


def _version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        typer.echo(f"bladescout {version('bladescout')}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version.")
    ] = False,
) -> None:
    """Inspect the blades of a stopped wind turbine by drone."""
    del version  # its callback has answered
    want_json(False)


#: What the command-line library says by itself: a question that nobody answered, Ctrl-C.
_OURS = {1: Exit.CONFIGURATION, 130: Exit.UNFINISHED}

#: What a disk says, and is no defect of ours: full, over its quota, read-only, broken.
_OF_THE_DISK = (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EIO)


def run() -> None:
    """Entry point: no traceback reaches a user."""
    # A shell starts what it sends to the background deaf to Ctrl-C; an inspection must hear it.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        app()
    except SystemExit as ended:
        code = ended.code
        sys.exit(_OURS.get(code, code) if isinstance(code, int) else code)
    except Exception as error:  # noqa: BLE001 - the last line of defence; logged in full below
        if isinstance(error, OSError) and error.errno in _OF_THE_DISK:
            where = f"{error.filename}: " if error.filename else ""
            tell(Exit.FAILED, f"{where}{error.strerror}")
            sys.exit(int(Exit.FAILED))
        tell(Exit.FAILED, f"{type(error).__name__}: {error}")
        typer.echo(f"This is a defect of bladescout; {_kept(error)}.", err=True)
        sys.exit(int(Exit.FAILED))


def _kept(error: Exception) -> str:
    """Write the traceback to a file, here or where one can be written; say where it is."""
    import tempfile
    import traceback

    for folder in (Path(), Path(tempfile.gettempdir())):
        file = folder / "bladescout-error.log"
        try:
            file.write_text("".join(traceback.format_exception(error)))
        except OSError:
            continue
        return f"the details are in {file}"
    return f"no file could be written with the details: {traceback.format_exception(error)[-2]}"


if __name__ == "__main__":
    run()
