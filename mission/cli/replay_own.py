"""`bladescout replay CLOUD --poses FILE`: the workers of a mission on a recording of one's own."""

from __future__ import annotations

import json
import statistics
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

import typer

from mission.cli.exits import Exit, end

if TYPE_CHECKING:
    from mission.replay.own_data import OwnData, OwnReplay


def replay_own(data: OwnData, changes: list[str], *, as_json: bool) -> None:
    """Replay a recording of one's own and tell what the workers said. Ends on what is wrong."""
    from config.errors import ConfigError
    from config.presets import load_turbine
    from config.sources import load_settings
    from drivers.bad_file import BadFile
    from mission.replay.own_data import replay_own_data
    from perception.cloud_estimate import Question
    from perception.recorded_cloud import UnusableCloud

    try:
        settings = load_settings([], changes)
        known = None if data.turbine is None else load_turbine(data.turbine, data.scale)
        found = replay_own_data(data, settings, Question(turbine=known))
    except (BadFile, ConfigError) as error:
        end(Exit.CONFIGURATION, str(error))
    except UnusableCloud as error:
        end(Exit.CONFIGURATION, f"{data.cloud}: {error}")
    if as_json:
        typer.echo(json.dumps(_json(found), allow_nan=False))
        return
    for note in found.notes:
        typer.echo(f"warning: {note}", err=True)
    for line in _words(found):
        typer.echo(line)


def needs_poses(cloud: Path) -> NoReturn:
    """End with a sentence: a sensor's recording alone says not where it was."""
    end(
        Exit.CONFIGURATION,
        f"{cloud}: holds what the sensor saw, in its own frame; add --poses FILE (a line each: "
        "t_s x y z qx qy qz qw, world from body) or the PX4 log of the flight (.ulg)",
    )


def _words(found: OwnReplay) -> list[str]:
    from perception.rotor import Refusal

    lines = [
        (
            f"scans       {found.scans} of {found.length_s:.1f} s, {found.points} points "
            f"({found.speed:.0f} x real time)"
        )
    ]
    nearest = found.nearest
    if nearest is None:
        lines.append("nearest     nothing within reach")
    else:
        lines.append(f"nearest     {nearest.nearest_m:.2f} m at {nearest.stamp_s:.2f} s")
    whole = found.whole.rotor
    if isinstance(whole, Refusal):
        return [*lines, f"rotor       refused: {whole.text}"]
    lines.append(
        f"rotor       {whole.stop_angle_deg:.2f} +- {whole.sigma_deg:.2f} deg "
        "by the whole recording"
    )
    for one in found.rotors:
        angle = f"{one.stop_angle_deg:.2f} +- {one.sigma_deg:.2f}"
        lines.append(f"  {one.stamp_s:10.2f} s  {one.refusal_text if one.refusal else angle}")
    return lines


def _json(found: OwnReplay) -> dict[str, object]:
    from mission.records.cloud_record import cloud_record

    nearest = [one.nearest_m for one in found.clearances if one.nearest_m is not None]
    return {
        "schema": "bladescout/replay-own/1",
        "scans": found.scans,
        "points": found.points,
        "length_s": found.length_s,
        "real_time_factor": found.speed,
        "nearest_m": {
            "min": min(nearest, default=None),
            "median": statistics.median(nearest) if nearest else None,
        },
        "rotor": cloud_record(found.whole, found.notes),
        "estimates": [
            {
                "stamp_s": one.stamp_s,
                "refusal": one.refusal_text or None,
                "stop_angle_deg": None if one.refusal else one.stop_angle_deg,
                "sigma_deg": None if one.refusal else one.sigma_deg,
            }
            for one in found.rotors
        ],
    }
