"""`bladescout estimate`: the rotor in a recorded cloud, without any mission."""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mission.cli.exits import Exit, end
from mission.cli.typed import AsJson

if TYPE_CHECKING:
    from config.settings import Settings
    from config.turbine import Turbine
    from perception.cloud_estimate import CloudAnswer, Question
    from perception.values import Float


def estimate(
    cloud: Annotated[
        Path,
        typer.Argument(metavar="CLOUD", help="NPZ, PCD, PLY, LVX2, PCAP or PCAPNG; metres, z up."),
    ],
    viewpoint: Annotated[
        str | None, typer.Option(help="X,Y,Z: where the sensor stood, in the cloud's frame.")
    ] = None,
    poses: Annotated[
        Path | None,
        typer.Option(
            help="For clouds in the sensor's frame: t_s x y z qx qy qz qw, world from body."
        ),
    ] = None,
    time_offset: Annotated[
        float | None, typer.Option(help="Seconds added to the points' times to get the poses'.")
    ] = None,
    turbine: Annotated[
        str | None, typer.Option(help="Type of the turbine (config/turbines), where known.")
    ] = None,
    scale: Annotated[float, typer.Option(help="Factor of the type's lengths.")] = 1.0,
    rotor_diameter: Annotated[
        float | None, typer.Option(min=5, max=400, help="Metres, where the type is not known.")
    ] = None,
    prior_hub: Annotated[
        str | None, typer.Option(help="X,Y,Z: about where the hub is, within 5 m.")
    ] = None,
    prior_normal: Annotated[
        str | None, typer.Option(help="X,Y,Z: from rotor to nacelle, within 40 deg.")
    ] = None,
    method: Annotated[str | None, typer.Option(help="rotor_fit or fermat (the paper's).")] = None,
    config: Annotated[
        list[Path] | None, typer.Option(help="Settings file: the LiDAR's mounting, the method.")
    ] = None,
    set_: Annotated[
        list[str] | None, typer.Option("--set", help="section.key=value, as in a file.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Find stop angle, hub, shaft and pitch in a recorded point cloud."""
    from drivers.bad_file import BadFile
    from mission.records.cloud_record import cloud_record
    from mission.records.recorded_cloud import load_cloud
    from perception.cloud_estimate import Question, estimate_cloud
    from perception.recorded_cloud import UnusableCloud

    options = {"--method": f"estimation.method={method}"} if method is not None else {}
    settings = _settings(config or [], set_ or [], options)
    question = Question(
        turbine=_turbine(turbine, scale),
        rotor_radius_m=None if rotor_diameter is None else rotor_diameter / 2,
        hub_w=_vector("--prior-hub", prior_hub),
        normal_w=_direction("--prior-normal", prior_normal),
    )
    eye = _vector("--viewpoint", viewpoint)
    if eye is not None and poses is not None:
        end(Exit.CONFIGURATION, "--viewpoint: the poses say it; leave one of the two out")
    try:
        placed = load_cloud(
            cloud, settings.lidar, viewpoint_w=eye, poses_path=poses, time_offset_s=time_offset
        )
        answer = estimate_cloud(placed.cloud, question, settings)
    except BadFile as error:
        end(Exit.CONFIGURATION, str(error))
    except UnusableCloud as error:
        end(Exit.CONFIGURATION, f"{cloud}: {error}")
    if as_json:
        sys.stdout.write(json.dumps(cloud_record(answer, placed.notes)) + "\n")
    else:
        _show(cloud, answer, question, placed.notes)
    raise typer.Exit(int(_exit(answer)))


def _exit(answer: CloudAnswer) -> Exit:
    from perception.rotor import Refusal

    return Exit.REFUSED if isinstance(answer.rotor, Refusal) else Exit.DONE


def _settings(files: list[Path], overrides: list[str], options: dict[str, str]) -> Settings:
    from config.sources import ConfigError, load_settings

    try:
        return load_settings(files, overrides=overrides, options=options)
    except ConfigError as error:
        end(Exit.CONFIGURATION, str(error))


def _turbine(name: str | None, scale: float) -> Turbine | None:
    from config.errors import ConfigError
    from config.presets import load_turbine

    if name is None:
        if scale != 1.0:
            end(Exit.CONFIGURATION, f"--scale {scale:g}: of which type? Name it by --turbine")
        return None
    try:
        return load_turbine(name, scale)
    except ConfigError as error:
        end(Exit.CONFIGURATION, f"--turbine: {error}")


def _vector(option: str, text: str | None) -> Float | None:
    import numpy as np

    if text is None:
        return None
    try:
        values = [float(word) for word in text.split(",")]
    except ValueError:
        values = []
    if len(values) != 3 or not all(map(math.isfinite, values)):
        end(Exit.CONFIGURATION, f"{option} {text}: must be three numbers, X,Y,Z")
    return np.array(values)


def _direction(option: str, text: str | None) -> Float | None:
    vector = _vector(option, text)
    if vector is None:
        return None
    level = math.hypot(float(vector[0]), float(vector[1]))
    if level <= 2.0 * abs(float(vector[2])):
        end(Exit.CONFIGURATION, f"{option} {text}: a shaft is nearly level; give X and Y of it")
    return vector


def _show(path: Path, answer: CloudAnswer, question: Question, notes: tuple[str, ...]) -> None:
    """Print the answer for a person; warnings go to standard error."""
    from rich.console import Console

    from mission.cli.estimate_view import answer_table, blade_table
    from perception.rotor import Refusal

    errors = Console(stderr=True, highlight=False)
    for note in notes:
        errors.print(f"[yellow]warning:[/] {note}", soft_wrap=True)
    out = Console(highlight=False)
    if not isinstance(answer.rotor, Refusal):
        out.print(blade_table(answer.rotor))
    out.print(answer_table(path, answer, question))


def mount(app: typer.Typer) -> None:
    """Add the command to the command line."""
    app.command()(estimate)
