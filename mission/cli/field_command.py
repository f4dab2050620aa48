"""`bladescout field`: the simulated devices alone, for a daemon of one's own."""

from __future__ import annotations

import signal
import time
from pathlib import Path
from typing import Annotated

import typer

from mission.cli.exits import Exit, end
from mission.cli.simulate_command import as_settings, load_scenario
from mission.cli.typed import Seed, SetAgain, Speed


def field(
    scenario: Annotated[
        str,
        typer.Argument(
            metavar="SCENARIO",
            help="A packaged scenario (bladescout simulate --list) or a TOML file.",
        ),
    ] = "demo",
    seed: Seed = None,
    speed: Speed = None,
    out: Annotated[
        Path, typer.Option(help="Folder that its settings and its clock are written to.")
    ] = Path("field"),
    set_: SetAgain = None,
) -> None:
    """Play autopilot, LiDAR, camera and gimbal of a drone at a turbine until Ctrl-C.

    Writes OUT/drone.toml, the settings for a daemon that flies it, and OUT/clock, its time.
    """
    from config.links import Bus
    from config.service import Service
    from config.simulation import Simulation
    from config.sources import to_toml
    from mission.processes.runtime import CLOCK_FILE
    from mission.processes.simulation import Field, SimulationFailed, on_loopback

    options = as_settings(
        ("--seed", "simulation.seed", seed),
        ("--speed", "simulation.speed", speed),
    )
    settings = on_loopback(
        load_scenario(scenario, [*(set_ or []), "simulation.sensors=wire"], options)
    )
    world_dir = out / "world"
    try:
        world_dir.mkdir(parents=True, exist_ok=True)
        # Whoever waits for the settings waits for this world's, not for those of the one before.
        (out / "drone.toml").unlink(missing_ok=True)
    except OSError as error:
        end(Exit.CONFIGURATION, f"{out}: no folder can be made there: {error.strerror}")
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    world = Field(settings, world_dir)
    try:
        site = world.wait_ready()
        # The daemon is told what a drone's owner knows, and nothing of the scenario.
        told = settings.model_copy(
            update={
                "sites": (site,),
                "simulation": Simulation(),
                "bus": Bus(),
                "service": Service(),
            }
        )
        (out / "drone.toml").write_text(to_toml(told))
        clock = out / CLOCK_FILE
        clock.unlink(missing_ok=True)
        clock.symlink_to((world_dir / CLOCK_FILE).resolve())
        typer.echo(
            f"the field is up, its turbine is {site.name}; a daemon for it (Ctrl-C ends it):"
        )
        typer.echo(f"  bladescout serve --config {out / 'drone.toml'} --clock {clock}")
        while world.runs():
            time.sleep(0.5)
        end(Exit.DEVICE, f"the field has ended; its log: {world_dir / 'field.log'}")
    except SimulationFailed as error:
        end(Exit.DEVICE, str(error))
    except KeyboardInterrupt:
        return
    finally:
        world.close()
