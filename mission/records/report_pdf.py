"""The report as PDF: printed by a Chromium that is installed, as it prints a page for a person."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path
from tempfile import TemporaryDirectory

BROWSERS = (
    "chromium",
    "chromium-browser",
    "google-chrome",
    "google-chrome-stable",
    "chrome",
    "microsoft-edge",
)
PATIENCE_S = 300.0


class NoPdf(RuntimeError):
    """There is nothing installed that prints the report, or it failed."""


def browser() -> str | None:
    """Return the path of an installed browser that can print; None: there is none."""
    return next((found for name in BROWSERS if (found := shutil.which(name))), None)


def write_pdf(report: Path) -> Path:
    """Print an HTML report beside itself and return the PDF's path. Raises `NoPdf`."""
    program = browser()
    if program is None:
        raise NoPdf(
            "a PDF needs Chromium or Chrome: install it (apt install chromium), or open "
            f"{report} in any browser and print it to a file"
        )
    pdf = report.with_suffix(".pdf")
    part = pdf.with_suffix(".pdf.part")
    with TemporaryDirectory() as profile:
        command = [
            program,
            "--headless",
            "--disable-gpu",
            "--no-first-run",
            # The page is our own and loads nothing; in a container there is no other way.
            "--no-sandbox",
            f"--user-data-dir={profile}",
            "--no-pdf-header-footer",
            f"--print-to-pdf={part}",
            report.resolve().as_uri(),
        ]
        try:
            done = subprocess.run(command, capture_output=True, timeout=PATIENCE_S, check=False)
        except (OSError, subprocess.TimeoutExpired) as error:
            raise NoPdf(f"{program} did not print the report: {error}") from error
    if done.returncode or not part.exists():
        said = done.stderr.decode(errors="replace").strip().splitlines()
        raise NoPdf(f"{program} did not print the report: {said[-1] if said else 'no reason told'}")
    part.replace(pdf)
    return pdf
