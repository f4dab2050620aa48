"""`bladescout locate`, `verify` and `export`: what is done with a finished mission's photos."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mission.cli.exits import Exit, end
from mission.cli.typed import AsJson, mission_typed

if TYPE_CHECKING:
    from mission.records.locate import Located, Place


def locate(
    photo: Annotated[
        Path,
        typer.Argument(metavar="PHOTO", help="A photo in a mission folder, its .json beside it."),
    ],
    x: Annotated[float, typer.Argument(metavar="X", help="Pixels from the left edge.")],
    y: Annotated[float, typer.Argument(metavar="Y", help="Pixels from the upper edge.")],
    to: Annotated[
        tuple[float, float] | None,
        typer.Option("--to", metavar="X2 Y2", help="Measure the length to this pixel, too."),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Say what a pixel of a photo shows: metre, place on the chord, skin or sky; millimetres."""
    from mission.records.locate import OutsidePicture, locate
    from mission.records.photo_record import NotARecord

    try:
        found = locate(photo, (x, y), to)
    except (NotARecord, OutsidePicture) as error:
        end(Exit.CONFIGURATION, str(error))
    if as_json:
        typer.echo(json.dumps(found.as_json()))
        return
    for line in _words(found):
        typer.echo(line)


def _words(found: Located) -> list[str]:
    serial = f" ({found.serial})" if found.serial else ""
    lines = [f"turbine {found.turbine}, blade {found.blade}{serial}, side {found.side}"]
    lines += _place(found.place)
    if found.to is not None:
        lines += [f"to {found.to.x_px:g} {found.to.y_px:g}:", *_place(found.to)]
        flat = " (across the line of sight: an end misses the blade)" if found.flat else ""
        lines.append(f"length {found.length_mm:.0f} mm{flat}")
    return lines


def _place(place: Place) -> list[str]:
    if place.shows != "blade":
        doubt = ", within what is known of it" if place.uncertain else ""
        return [f"  sky or background, {place.beside_px:.0f} px beside the blade{doubt}"]
    sigma = "" if place.metre_sigma_m is None else f" +- {place.metre_sigma_m:.2f}"
    near = f", near the {place.near}" if place.near else ""
    chord = f"{place.from_leading_m:.2f} +- {place.chord_sigma_m:.2f} m"
    lines = [
        f"  metre {place.metre:.2f}{sigma} m from the root, {place.face} skin{near}",
        f"  {chord} from the leading edge, {place.chord_share:.0%} of the chord",
        f"  {place.mm_per_px:.2f} mm a pixel, seen {place.incidence_deg:.0f} deg off straight on",
    ]
    if place.uncertain:
        lines.append("  so near to the outline that it may be background")
    return lines


def verify(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="A mission folder.")],
    as_json: AsJson = False,
) -> None:
    """Check a mission's files against their SHA-256 sums."""
    from mission.records.verify import NoManifest, check_manifest

    try:
        found = check_manifest(mission_typed(folder))
    except NoManifest as error:
        end(Exit.CONFIGURATION, str(error))
    if as_json:
        typer.echo(json.dumps(found.as_json()))
    else:
        for name in found.changed:
            typer.echo(f"changed: {name}")
        for name in found.missing:
            typer.echo(f"missing: {name}")
        for name in found.unlisted:
            typer.echo(f"not in the manifest: {name}")
        typer.echo(f"{found.good} files as they were stored")
    if found.changed or found.missing:
        raise typer.Exit(int(Exit.FAILED))


def export(
    mission: Annotated[Path, typer.Argument(metavar="DIR", help="A mission folder.")],
    to: Annotated[Path, typer.Option("--to", help="A new or empty folder.")],
    rejected: Annotated[
        bool, typer.Option("--rejected", help="Copy photos that were not kept, too.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Copy a mission's photos, sorted, with an index and camera poses for COLMAP and Metashape.

    Those that were changed since they were stored (SHA-256) are copied too, and named.
    """
    from mission.records.export import CannotExport, export

    try:
        done = export(mission_typed(mission), to, rejected=rejected)
    except CannotExport as error:
        end(Exit.CONFIGURATION, str(error))
    if as_json:
        typer.echo(json.dumps(done.as_json()))
        return
    typer.echo(f"{done.photos} photos, {done.poses} with camera poses: {done.folder}")
    typer.echo(done.words)
    if done.doubts:
        typer.echo(done.doubts)


def mount(app: typer.Typer) -> None:
    """Add the commands about photos to the command line."""
    app.command()(locate)
    app.command()(verify)
    app.command()(export)
