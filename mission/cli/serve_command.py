"""`bladescout serve`: the daemon."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mission.cli.exits import Exit, end

if TYPE_CHECKING:
    from config.settings import Settings


def serve(
    config: Annotated[
        list[Path] | None, typer.Option("--config", help="Settings file; may be given again.")
    ] = None,
    set_: Annotated[
        list[str] | None, typer.Option("--set", help="section.key=value, as in a file.")
    ] = None,
    clock: Annotated[
        Path | None, typer.Option(help="Clock file of a simulated world (bladescout field).")
    ] = None,
    runtime: Annotated[
        Path | None,
        typer.Option(help="Run directory with settings (set by simulate).", hidden=True),
    ] = None,
) -> None:
    """Run the onboard daemon until it is told to end (SIGTERM or Ctrl-C)."""
    import asyncio
    import shutil
    import tempfile

    from config.settings import Settings
    from config.sources import ConfigError, load_settings
    from drivers.bus import BusUnreachable
    from drivers.bus_access import BadRoles
    from drivers.bus_session import BusNotSafe
    from mission.processes.logs import configure_logging
    from mission.processes.runtime import CLOCK_FILE, SETTINGS_FILE

    if runtime is not None:
        settings = Settings.model_validate_json((runtime / SETTINGS_FILE).read_bytes())
        run_dir = runtime
    else:
        try:
            settings = load_settings(config or [], overrides=set_ or [])
        except ConfigError as error:
            end(Exit.CONFIGURATION, str(error))
        run_dir = Path(tempfile.mkdtemp(prefix="bladescout-serve-"))
        if clock is not None:
            if not clock.is_file():
                end(Exit.CONFIGURATION, f"--clock {clock}: there is no such file")
            (run_dir / CLOCK_FILE).symlink_to(clock.resolve())
    configure_logging("serve", form=settings.service.logs)
    _see_missions_dir(Path(settings.missions_dir))
    try:
        asyncio.run(_serve(settings, run_dir, leave_with_parent=runtime is not None))
    except (BusNotSafe, BadRoles) as error:
        end(Exit.CONFIGURATION, str(error))
    except BusUnreachable:
        end(
            Exit.DEVICE,
            f"the bus cannot be opened at {settings.bus.listen}: another daemon runs there, or "
            "the address is not this machine's; choose another with --set bus.listen=...",
        )
    finally:
        if runtime is None:
            shutil.rmtree(run_dir, ignore_errors=True)


def _see_missions_dir(folder: Path) -> None:
    """Tell at once what would refuse every start; a disk that is mounted later mends it."""
    import logging
    import tempfile

    try:
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
    except OSError as error:
        logging.getLogger(__name__).error(
            "missions_dir = %s cannot be written: %s: every start will be refused",
            folder,
            error.strerror or error,
        )


async def _serve(settings: Settings, run_dir: Path, *, leave_with_parent: bool) -> None:
    import asyncio
    import signal

    from mission.processes.children import parent_gone
    from mission.processes.supervisor import Supervisor

    told = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(number, told.set)
    # A simulation that is killed leaves no daemon behind: its end of our input closes.
    parent = asyncio.create_task(parent_gone()) if leave_with_parent else None
    if parent is not None:
        parent.add_done_callback(lambda _: told.set())
    try:
        await Supervisor(settings, run_dir).run(told)
    finally:
        if parent is not None:
            parent.cancel()
