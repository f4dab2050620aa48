"""`bladescout simulate`: a whole inspection on this machine."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mission.cli.exits import Exit, end, exit_of, want_json
from mission.cli.junit import Flown, write_junit
from mission.cli.typed import Seed, SetAgain, Speed

if TYPE_CHECKING:
    from rich.console import Console

    from config.settings import Settings

_URLS = ("udpin://", "udpout://", "udp://")


def simulate_command(
    scenarios: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="SCENARIO",
            help="Packaged scenarios (see --list) or TOML files of your own, flown one after the "
            "other; demo where none is named.",
        ),
    ] = None,
    seed: Seed = None,
    speed: Speed = None,
    sensors: Annotated[
        str | None,
        typer.Option(help="wire: LiDAR by UDP, picture by RTSP, as on a drone; or bus: cheaper."),
    ] = None,
    autopilot: Annotated[
        str | None,
        typer.Option(help="URL of another PX4-like simulator instead of the mock: udpin://..."),
    ] = None,
    out: Annotated[Path | None, typer.Option(help="Folder of the missions, else missions.")] = None,
    set_: SetAgain = None,
    as_json: Annotated[
        bool,
        typer.Option(
            "--json",
            callback=want_json,
            help="Print mission.json (of several: {missions: [...]}), and nothing else.",
        ),
    ] = False,
    junit: Annotated[Path | None, typer.Option(help="Write a JUnit report there, for CI.")] = None,
    keep: Annotated[
        Path | None,
        typer.Option(help="An empty folder for the processes' logs, else thrown away."),
    ] = None,
    list_: Annotated[
        bool, typer.Option("--list", help="List the packaged scenarios, and fly nothing.")
    ] = False,
) -> None:
    """Fly whole inspections here: synthetic world, production path; exit 0 when all completed."""
    from rich.console import Console

    if list_:
        _list_scenarios()
        return
    options = as_settings(
        ("--seed", "simulation.seed", seed),
        ("--speed", "simulation.speed", speed),
        ("--sensors", "simulation.sensors", sensors),
        ("--autopilot", "simulation.autopilot_url", autopilot),
        ("--out", "missions_dir", out),
    )
    names = scenarios or ["demo"]
    loaded = [(name, load_scenario(name, set_ or [], options)) for name in names]
    if junit is not None:
        make_room(junit.parent, None)
        if junit.is_dir():
            end(Exit.CONFIGURATION, f"--junit {junit}: is a folder; name a file")
    console = Console(file=sys.stderr if as_json else sys.stdout)
    flown: list[Flown] = []
    try:
        for number, (name, settings) in enumerate(loaded, 1):
            folder = keep / f"{number}-{Path(name).stem}" if keep and len(loaded) > 1 else keep
            make_room(Path(settings.missions_dir), folder)
            flown.append(_fly(name, settings, console, folder, silent=as_json))
    except KeyboardInterrupt:
        end(Exit.UNFINISHED, "interrupted: the simulation was broken off")
    finally:
        if junit is not None:
            write_junit(junit, flown)
    if len(flown) == 1 and flown[0].code is Exit.DEVICE:
        end(Exit.DEVICE, flown[0].words)
    if as_json:
        missions = [one.mission for one in flown]
        answer = missions[0] if len(missions) == 1 else {"missions": missions}
        sys.stdout.write(json.dumps(answer) + "\n")
    elif len(flown) > 1:
        for one in flown:
            console.print(f"{one.scenario}: {one.words}", highlight=False)
    raise typer.Exit(int(max(one.code for one in flown)))


def _fly(
    name: str, settings: Settings, console: Console, keep: Path | None, *, silent: bool
) -> Flown:
    """Fly one scenario, show it unless silent, and return how it ended."""
    from drivers.bus import BusUnreachable
    from mission.cli.progress import LiveProgress
    from mission.cli.summary import print_summary
    from mission.processes.simulation import SimulationFailed, simulate
    from mission.records.summary import add_truth
    from mission.remote.client import NoReply

    progress = LiveProgress(
        console,
        f"bladescout - {Path(name).stem}",
        waits_for="starting the world, its sensors and the daemon",
        silent=silent,
    )
    begun_s = time.monotonic()
    try:
        with progress:
            outcome = simulate(settings, progress.on_state, progress.on_event, keep_run_dir=keep)
    except (SimulationFailed, BusUnreachable, NoReply) as error:
        return Flown(name, Exit.DEVICE, str(error), time.monotonic() - begun_s, None, {})
    mission = add_truth(outcome.mission_dir, outcome.truth)
    if not silent:
        print_summary(console, mission, outcome.mission_dir)
    words = f"{outcome.state}: {outcome.words}"
    wall_s = time.monotonic() - begun_s
    return Flown(name, exit_of(outcome.state), words, wall_s, outcome.mission_dir, mission)


def make_room(missions: Path, keep: Path | None) -> None:
    """Make the folders that will be written to, before anything flies; end where one cannot be."""
    if keep is not None and (keep / "field").exists():
        end(Exit.CONFIGURATION, f"--keep {keep}: holds an earlier run; name an empty folder")
    for folder in (missions, keep):
        try:
            if folder is not None:
                folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            end(Exit.CONFIGURATION, f"{folder}: no folder can be made there: {error.strerror}")


def _list_scenarios() -> None:
    from config.scenarios import scenario_names, scenario_summary

    names = scenario_names()
    width = max(map(len, names))
    for name in names:
        typer.echo(f"{name:<{width}}  {scenario_summary(name)}")


def as_settings(*given: tuple[str, str, object]) -> dict[str, str]:
    """Return ``key=value`` of the options that were given, by their names.

    ``given``: option, key of the settings, value or None, of each.
    """
    return {option: f"{key}={value}" for option, key, value in given if value is not None}


def load_scenario(scenario: str, overrides: list[str], options: Mapping[str, str]) -> Settings:
    """Return the settings of a scenario, or end with one sentence.

    ``options``: what single options set, by their names (`config.sources.load`).
    """
    from config.sources import ConfigError, load_settings, scenario_path

    try:
        path = Path(scenario) if scenario.endswith(".toml") else scenario_path(scenario)
        settings = load_settings([path], overrides=overrides, options=options)
    except ConfigError as error:
        end(Exit.CONFIGURATION, str(error))
    if not settings.sites:
        end(Exit.CONFIGURATION, f"{path}: sites: no turbine is listed; add a [[sites]] table")
    url = settings.simulation.autopilot_url
    if url and not url.startswith(_URLS):
        end(
            Exit.CONFIGURATION,
            f"simulation.autopilot_url = {url!r}: must be udpin://HOST:PORT or udpout://HOST:PORT",
        )
    return settings
