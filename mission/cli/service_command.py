"""`bladescout install-service`: the daemon as a systemd service of the companion computer."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mission.cli.exits import Exit, end

if TYPE_CHECKING:
    from config.settings import Settings

STATE = Path("/var/lib/bladescout")
UNIT = Path("/etc/systemd/system/bladescout.service")
SYSCTL = Path("/etc/sysctl.d/90-bladescout.conf")
CONFIG = Path("/etc/bladescout/bladescout.toml")
_USER = re.compile(r"[a-z_][a-z0-9_-]{0,31}")


@dataclass(frozen=True, slots=True)
class Plan:
    """Files to write, and commands to run before and after."""

    before: tuple[tuple[str, ...], ...]
    files: tuple[tuple[Path, str, int], ...]
    """Path, text, mode."""
    after: tuple[tuple[str, ...], ...]


def install_service(
    config: Annotated[Path, typer.Option("--config", help="Settings of this drone.")],
    user: Annotated[str, typer.Option(help="System user that the daemon runs as.")] = "bladescout",
    root: Annotated[
        Path | None, typer.Option(help="Write the files below this folder and run nothing.")
    ] = None,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Only show; so, too, when not run as root.")
    ] = False,
) -> None:
    """Install and start the daemon as a systemd service: unit, settings, user, receive buffers."""
    from config.sources import ConfigError, load_settings

    if _USER.fullmatch(user) is None:
        end(Exit.CONFIGURATION, f"--user {user!r}: must be the name of a system user")
    try:
        settings = load_settings([config], environment={})
        text = config.read_text()
    except (ConfigError, OSError) as error:
        end(Exit.CONFIGURATION, str(error))
    plan = make_plan(settings, text, user)
    if root is not None:
        for path, content, mode in plan.files:
            _write(root / path.relative_to("/"), content, mode)
            typer.echo(f"wrote {root / path.relative_to('/')}")
        return
    if dry_run or os.geteuid() != 0:
        _show(plan)
        if not dry_run:
            typer.echo("# nothing was done: run it again as root (sudo) to do this", err=True)
        return
    _carry_out(plan)


def make_plan(settings: Settings, text: str, user: str) -> Plan:
    """Return what an installation consists of; ``text``: the settings file as it was given."""
    unit = (files("mission.cli") / "service" / "bladescout.service").read_text()
    sysctl = (files("mission.cli") / "service" / "90-bladescout.conf").read_text()
    command = Path(sys.executable).parent / "bladescout"
    in_home = command.is_relative_to("/home") or command.is_relative_to("/root")
    missions = STATE / settings.missions_dir
    for name, value in {
        "COMMAND": str(command),
        "CONFIG": str(CONFIG),
        "USER": user,
        # A folder that is missing is no reason not to start: the daemon says so better.
        "WRITES": f"-{missions}",
        "PROTECT_HOME": "read-only" if in_home else "yes",
    }.items():
        unit = unit.replace(f"@{name}@", value)
    create = ("useradd", "--system", "--home-dir", str(STATE), "--shell", "/usr/sbin/nologin")
    before = () if _exists(user) else ((*create, user),)
    after: list[tuple[str, ...]] = [("chgrp", "-R", user, str(CONFIG.parent))]
    if settings.bus.keys:
        after += [
            ("chgrp", "-R", user, settings.bus.keys),
            ("chmod", "-R", "u=rwX,g=rX,o=", settings.bus.keys),
        ]
    after += [
        ("sysctl", "--quiet", "--load", str(SYSCTL)),
        ("systemctl", "daemon-reload"),
        ("systemctl", "enable", "--now", UNIT.name),
    ]
    return Plan(
        before, ((UNIT, unit, 0o644), (SYSCTL, sysctl, 0o644), (CONFIG, text, 0o640)), tuple(after)
    )


def _exists(user: str) -> bool:
    import pwd

    try:
        pwd.getpwnam(user)
    except KeyError:
        return False
    return True


def _show(plan: Plan) -> None:
    for command in plan.before:
        typer.echo(f"$ {' '.join(command)}")
    for path, content, mode in plan.files:
        typer.echo(f"# --- {path} (mode {mode:o})")
        typer.echo(content.rstrip())
    for command in plan.after:
        typer.echo(f"$ {' '.join(command)}")


def _carry_out(plan: Plan) -> None:
    for command in plan.before:
        _run(command)
    for path, content, mode in plan.files:
        _write(path, content, mode)
        typer.echo(f"wrote {path}")
    for command in plan.after:
        _run(command)
    typer.echo(f"{UNIT.stem} runs; its log: journalctl --unit {UNIT.stem} --follow")


def _write(path: Path, content: str, mode: int) -> None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(content)
        path.chmod(mode)
    except OSError as error:
        end(Exit.FAILED, f"{path} cannot be written: {error.strerror or error}")


def _run(command: tuple[str, ...]) -> None:
    typer.echo(f"$ {' '.join(command)}")
    try:
        subprocess.run(command, check=True)
    except (OSError, subprocess.CalledProcessError) as error:
        end(Exit.FAILED, f"{command[0]}: {error}")
