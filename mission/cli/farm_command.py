"""`bladescout farm`: many turbines and vehicles, flown as a queue."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mission.cli.exits import Exit, end
from mission.cli.remote_commands import Keys

if TYPE_CHECKING:
    from mission.remote.farm import Farm, Ledger


def farm(
    file: Annotated[
        Path, typer.Argument(metavar="FILE", help="Farm file: turbines, vehicles (docs/fleet.md).")
    ],
    rotor_locked: Annotated[
        bool,
        typer.Option(
            "--rotor-locked",
            help="The operator's word for every turbine: rotor braked and locked, yaw off.",
        ),
    ] = False,
    keys: Keys = "",
    ledger: Annotated[
        Path | None, typer.Option(help="What is done so far; FILE with .ledger.json by default.")
    ] = None,
) -> None:
    """Fly every turbine of a farm, one for each free vehicle; run again, it goes on from there."""
    import logging

    from pydantic import ValidationError

    from config.errors import ConfigError
    from drivers.bus_session import BusNotSafe
    from drivers.certificates import BadCertificate
    from mission.remote.farm import load_farm, waits_for
    from mission.remote.farm_run import FarmRun

    logging.basicConfig(level=logging.WARNING)
    path = ledger or file.with_suffix(".ledger.json")
    try:
        wanted = load_farm(file)
        if rotor_locked:
            turbines = tuple(t.model_copy(update={"rotor_locked": True}) for t in wanted.turbines)
            wanted = wanted.model_copy(update={"turbines": turbines})
        with FarmRun(wanted, path, keys, typer.echo) as run:
            for name in waits_for(wanted, run.ledger):
                typer.echo(f"{name}: left out, its rotor_locked is not given")
            done = run.run()
    except ConfigError as error:
        end(Exit.CONFIGURATION, str(error))
    except (BusNotSafe, BadCertificate) as error:
        end(Exit.CONFIGURATION, str(error))
    except ValidationError:
        end(Exit.CONFIGURATION, f"{path} is not a ledger of this version")
    except KeyboardInterrupt:
        typer.echo(f"ended; what flies goes on flying, and {path} knows it")
        raise typer.Exit(int(Exit.UNFINISHED)) from None
    _summary(wanted, done)


def _summary(farm: Farm, done: Ledger) -> None:
    from mission.remote.farm import Stage

    for turbine in farm.turbines:
        record = done.of(turbine.name)
        typer.echo(f"{turbine.name}: {record.stage} {record.mission_dir} {record.words}".rstrip())
    if any(done.of(turbine.name).stage is not Stage.COMPLETED for turbine in farm.turbines):
        raise typer.Exit(int(Exit.UNFINISHED))
