"""`bladescout serve`: the daemon."""

from __future__ import annotations

import asyncio
import signal
import tempfile
from pathlib import Path
from typing import Annotated

import typer

from config.settings import Settings
from config.sources import ConfigError, load_settings
from drivers.bus import BusUnreachable
from mission.cli.exits import Exit, end
from mission.processes.runtime import SETTINGS_FILE, configure_logging
from mission.processes.supervisor import Supervisor


def serve(
    config: Annotated[
        list[Path] | None, typer.Option("--config", help="Settings file; may be given again.")
    ] = None,
    set_: Annotated[
        list[str] | None, typer.Option("--set", help="section.key=value, as in a file.")
    ] = None,
    runtime: Annotated[
        Path | None,
        typer.Option(help="Run directory with settings (set by simulate).", hidden=True),
    ] = None,
) -> None:
    """Run the onboard daemon until it is told to end (SIGTERM or Ctrl-C)."""
    configure_logging("serve")
    if runtime is not None:
        settings = Settings.model_validate_json((runtime / SETTINGS_FILE).read_bytes())
        run_dir = runtime
    else:
        try:
            settings = load_settings(config or [], overrides=set_ or [])
        except ConfigError as error:
            end(Exit.CONFIGURATION, str(error))
        run_dir = Path(tempfile.mkdtemp(prefix="bladescout-serve-"))
    try:
        asyncio.run(_serve(settings, run_dir))
    except BusUnreachable as error:
        end(
            Exit.DEVICE,
            f"the bus cannot be opened at {settings.bus.listen}: is another daemon running? "
            f"Choose another with bus.listen. ({error})",
        )


async def _serve(settings: Settings, run_dir: Path) -> None:
    told = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(number, told.set)
    await Supervisor(settings, run_dir).run(told)
