"""`bladescout router`: a router on the ground that several vehicles join."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mission.cli.exits import Exit, end

if TYPE_CHECKING:
    from config.links import Bus as BusSettings


def router(
    keys: Annotated[Path, typer.Option(help="Folder of the router's certificate and roles.")],
    remote: Annotated[
        str, typer.Option(help="TLS end point for vehicles and people.")
    ] = "tls/0.0.0.0:7448",
    listen: Annotated[
        str, typer.Option(help="End point for this computer's own console and commands.")
    ] = "tcp/127.0.0.1:7447",
) -> None:
    """Run a router on the ground until Ctrl-C; vehicles join it by `bus.uplink`."""
    import asyncio
    import logging

    from pydantic import ValidationError

    from config.errors import first_fault
    from config.links import Bus as BusSettings
    from drivers.bus import BusUnreachable
    from drivers.bus_access import BadRoles
    from drivers.bus_session import BusNotSafe

    logging.basicConfig(level=logging.WARNING)
    try:
        settings = BusSettings(listen=listen, remote=remote, keys=str(keys))
        asyncio.run(_route(settings))
    except ValidationError as error:
        end(Exit.CONFIGURATION, f"--{first_fault(error, found=True)}")
    except (BusNotSafe, BadRoles) as error:
        end(Exit.CONFIGURATION, str(error))
    except BusUnreachable:
        end(
            Exit.DEVICE,
            f"the bus cannot be opened at {listen} and {remote}: a daemon or another router runs "
            "there; choose others with --listen and --remote",
        )


async def _route(settings: BusSettings) -> None:
    import asyncio
    import signal

    from drivers.bus import Bus

    told = asyncio.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        asyncio.get_running_loop().add_signal_handler(number, told.set)
    with Bus.open_router(settings, "ground"):
        typer.echo(f"the router is open at {settings.remote} (Ctrl-C ends it)")
        await told.wait()
