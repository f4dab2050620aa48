"""`bladescout report`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mission.cli import photo_commands
from mission.cli.exits import Exit, end
from mission.cli.typed import mission_typed


def report(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="A mission folder.")],
    pdf: Annotated[
        bool, typer.Option("--pdf", help="Print it to report.pdf, too (needs Chromium).")
    ] = False,
    findings: Annotated[
        Path | None, typer.Option(help="Findings to put on the blade map: CSV or COCO JSON.")
    ] = None,
    against: Annotated[
        Path | None,
        typer.Option(help="An older mission's folder: comparison.html of both visits."),
    ] = None,
    overrides: Annotated[
        list[str] | None,
        typer.Option("--set", help="What is told since the flight: report.weather='4 m/s, dry'."),
    ] = None,
) -> None:
    """Render a mission's report again: report.html, one page that needs nothing else."""
    from config.errors import ConfigError
    from mission.records.comparison import NotComparable, write_comparison
    from mission.records.findings import BadFindings, read_findings
    from mission.records.report import BadTemplate, NotAMission, write_report
    from mission.records.report_facts import BadLogo
    from mission.records.report_pdf import NoPdf, write_pdf

    for place in (folder, against):
        if place is not None:
            mission_typed(place)
    try:
        told = _told(overrides or [])
        found = [] if findings is None else read_findings(findings, folder)
        pages = [write_report(folder, found, told)]
        if against is not None:
            pages.append(write_comparison(folder, against))
    except (NotAMission, NotComparable, BadFindings, BadTemplate, BadLogo, ConfigError) as error:
        end(Exit.CONFIGURATION, str(error))
    try:
        pages += [write_pdf(page) for page in pages] if pdf else []
    except NoPdf as error:
        end(Exit.FAILED, str(error))
    for page in pages:
        typer.echo(f"report: {page}")


def _told(overrides: list[str]) -> dict[str, object]:
    """Return the fields of the report's settings that were given. Raises `ConfigError`."""
    from config.errors import ConfigError
    from config.sources import load_settings

    for text in overrides:
        if not text.startswith("report."):
            raise ConfigError(f"--set {text}: of a finished mission only report.* can be set")
    given = load_settings([], overrides, {}).report
    return given.model_dump(include=given.model_fields_set)


def mount(app: typer.Typer) -> None:
    """Add the commands about finished missions to the command line."""
    app.command()(report)
    photo_commands.mount(app)
