"""`bladescout replay`: compute a recorded mission again and compare."""

from __future__ import annotations

import dataclasses
import json
import math
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from mission.cli.exits import Exit, end
from mission.cli.replay_own import needs_poses, replay_own
from mission.cli.typed import AsJson, mission_typed

if TYPE_CHECKING:
    from config.settings import Settings
    from mission.replay.commands import CommandReplay
    from mission.replay.perception import PerceptionReplay
    from mission.replay.recorded import Mission

Part = Literal["all", "commands", "estimates"]


def replay(
    mission: Annotated[
        Path,
        typer.Argument(
            metavar="MISSION",
            help="A mission folder, or its recording.mcap; or LVX2, PCAP, PCAPNG of your own.",
        ),
    ],
    method: Annotated[
        str | None,
        typer.Option(help="What the other method would have found: rotor_fit or fermat."),
    ] = None,
    overrides: Annotated[
        list[str] | None,
        typer.Option("--set", help="What another setting would have done: section.key=value."),
    ] = None,
    only: Annotated[Part, typer.Option(help="Replay only this.")] = "all",
    poses: Annotated[
        Path | None,
        typer.Option(
            help="Your own data: where the body was (as estimate reads it, or a PX4 .ulg)."
        ),
    ] = None,
    time_offset: Annotated[
        float | None, typer.Option(help="Your own data: seconds from its times to the poses'.")
    ] = None,
    turbine: Annotated[
        str | None,
        typer.Option(help="Your own data: type of the turbine (config/turbines), where known."),
    ] = None,
    scale: Annotated[
        float, typer.Option(help="Your own data: factor of the type's lengths.")
    ] = 1.0,
    as_json: AsJson = False,
) -> None:
    """Compute a recorded mission again: commands tick by tick, then estimates and exposure.

    Exits 6 with the first difference. With --method or --set it tells what would have been
    otherwise, on the same recorded observations, and exits 0.

    Of your own recording of a MID-360, with poses, it tells what the workers of a mission would
    have said scan by scan: clearance, and each second the rotor.
    """
    from config.errors import ConfigError
    from mission.replay.commands import replay_commands
    from mission.replay.own_data import RECORDINGS, OwnData
    from mission.replay.perception import replay_perception
    from mission.replay.recorded import NotARecording, RecordedMission

    changes = list(overrides or ())
    if method is not None:
        changes.append(f"estimation.method={method}")
    if mission.suffix.lower() in RECORDINGS:
        if poses is None:
            needs_poses(mission)
        own = OwnData(mission, poses, time_offset, turbine, scale)
        replay_own(own, changes, as_json=as_json)
        return
    commands: CommandReplay | None = None
    estimates: PerceptionReplay | None = None
    try:
        recorded = RecordedMission(mission_typed(mission))
        settings = _changed(recorded.mission.settings, changes) if changes else None
        if only != "estimates":
            commands = replay_commands(recorded, settings)
        if only != "commands":
            estimates = replay_perception(recorded, settings)
        flown = recorded.mission
    except (NotARecording, ConfigError) as error:
        end(Exit.CONFIGURATION, str(error))
    if as_json:
        typer.echo(json.dumps(_json(commands, estimates), indent=1, allow_nan=False))
    else:
        _tell(flown, commands, estimates, asked=bool(changes), cut_short=recorded.cut_short)
    if changes:
        return
    failed = (commands is not None and commands.first is not None) or (
        estimates is not None and not estimates.agrees
    )
    if failed:
        raise typer.Exit(int(Exit.FAILED))


def _changed(settings: Settings, changes: list[str]) -> Settings:
    """Return the recorded settings with changes, checked as any others. Raises `ConfigError`."""
    from config.sources import load_settings, to_toml

    with TemporaryDirectory() as folder:
        file = Path(folder) / "recorded.toml"
        file.write_text(to_toml(settings))
        return load_settings([file], changes, {})


def _tell(
    flown: Mission,
    commands: CommandReplay | None,
    estimates: PerceptionReplay | None,
    *,
    asked: bool,
    cut_short: bool,
) -> None:
    from mission.records.code_digest import code_digest

    if cut_short:
        typer.echo("the recording ends without its summary: replayed as far as it goes")
    if flown.code and flown.code != code_digest():
        typer.echo(f"flown by other code (bladescout {flown.version}, {flown.code})")
    if flown.gone:
        typer.echo(f"settings of then that there are no more: {', '.join(flown.gone)}")
    if commands is not None:
        _tell_commands(commands, asked=asked)
    if estimates is not None:
        _tell_estimates(estimates)


def _tell_commands(commands: CommandReplay, *, asked: bool) -> None:
    typer.echo(
        f"commands    {commands.equal} of {commands.ticks} ticks equal "
        f"({commands.flown_s:.0f} s of flight, {commands.speed:.0f} x real time)"
    )
    if commands.first is not None:
        typer.echo(f"first       {commands.first.words()}")
        for field, count in commands.fields.most_common(5):
            typer.echo(f"            {field}: {count} ticks")
    if commands.without_surroundings:
        typer.echo(f"            {commands.without_surroundings} ticks without their occupancy")
    if asked:
        typer.echo(
            f"guard       replaced {commands.refused_anew} setpoints, as flown {commands.refused}"
        )
        typer.echo(f"state       {commands.state}, on the observations as they were recorded")


def _tell_estimates(estimates: PerceptionReplay) -> None:
    typer.echo(f"estimates   {estimates.speed:.0f} x real time")
    if not estimates.told:
        typer.echo("            (the recording does not say which scans the workers took up)")
    for key, one in estimates.kinds.items():
        typer.echo(
            f"  {key.removeprefix('perception/'):<10}{one.equal} of {one.recorded} equal; "
            f"the others {one.mean:.3f} apart on average, {one.largest:.3f} at most ({one.unit})"
        )
        if one.first:
            typer.echo(f"            first: {one.first}")


def _json(commands: CommandReplay | None, estimates: PerceptionReplay | None) -> dict[str, object]:
    told: dict[str, object] = {}
    if commands is not None:
        told["commands"] = {
            "ticks": commands.ticks,
            "equal": commands.equal,
            "first": None if commands.first is None else commands.first.words(),
            "fields": dict(commands.fields),
            "refused": commands.refused,
            "refused_anew": commands.refused_anew,
            "events_anew": dict(commands.events_anew),
            "without_surroundings": commands.without_surroundings,
            "state": commands.state,
            "flown_s": commands.flown_s,
            "real_time_factor": commands.speed,
        }
    if estimates is not None:
        told["estimates"] = {
            key: _finite({**dataclasses.asdict(one), "mean": one.mean})
            for key, one in estimates.kinds.items()
        }
        told["estimates_real_time_factor"] = estimates.speed
    return told


def _finite(values: dict[str, object]) -> dict[str, object]:
    """JSON has no infinity: where one estimate has a figure and the other none, it is null."""
    return {
        key: None if isinstance(value, float) and not math.isfinite(value) else value
        for key, value in values.items()
    }


def mount(app: typer.Typer) -> None:
    """Add `replay` to the command line."""
    app.command()(replay)
