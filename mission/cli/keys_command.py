"""`bladescout keys`: a site's authority, and certificates for vehicles and people."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mission.cli.exits import Exit, end

if TYPE_CHECKING:
    from drivers.bus_access import Role

Names = Annotated[list[str] | None, typer.Option(help="NAME; may be given again.")]
Places = Annotated[
    list[str] | None,
    typer.Option(help="NAME=HOST, the address at which it is reached; may be given again."),
]


def keys(
    folder: Annotated[
        Path, typer.Argument(metavar="FOLDER", help="Where the keys are kept, on the ground.")
    ],
    vehicle: Places = None,
    router: Places = None,
    operator: Names = None,
    pilot: Names = None,
    viewer: Names = None,
    remove: Names = None,
    renew: Annotated[bool, typer.Option(help="Replace certificates that are there.")] = False,
) -> None:
    """Make certificates: FOLDER/NAME holds what NAME needs, FOLDER/ca.key stays where it is.

    An operator may do everything; a pilot-in-command may watch, hold, stop and abort; a viewer
    may watch. What is there already is kept.

    The vehicles' folders get the newest list of who may do what: copy them again after every
    change.
    """
    from drivers.bus_access import BadRoles, Role
    from drivers.certificates import BadCertificate

    wanted: dict[str, tuple[Role, tuple[str, ...]]] = {}
    for role, entries in (
        (Role.VEHICLE, vehicle),
        (Role.ROUTER, router),
        (Role.OPERATOR, operator),
        (Role.PILOT, pilot),
        (Role.VIEWER, viewer),
    ):
        for entry in entries or []:
            name, _, host = entry.partition("=")
            if name in wanted:
                end(Exit.CONFIGURATION, f"{name!r} is given twice: one name, one role")
            wanted[name] = role, (host,) if host else ()
    try:
        _make(folder, wanted, set(remove or []), renew=renew)
    except (BadRoles, BadCertificate) as error:
        end(Exit.CONFIGURATION, str(error))
    except OSError as error:
        end(Exit.CONFIGURATION, f"{folder} cannot be written: {error.strerror or error}")


def _check_changes(
    folder: Path,
    roles: Mapping[str, Role],
    wanted: Mapping[str, tuple[Role, tuple[str, ...]]],
    removed: set[str],
) -> None:
    """Refuse to remove whom nobody knows, and to make a person of a machine or the reverse.

    Raises `drivers.bus_access.BadRoles`.
    """
    from drivers.bus_access import BadRoles, Role

    unknown = sorted(removed - set(roles))
    if unknown:
        known = ", ".join(roles) or "nobody"
        raise BadRoles(f"--remove {unknown[0]}: not in {folder} (there: {known})")
    machines = (Role.VEHICLE, Role.ROUTER)
    for name, (role, _) in wanted.items():
        before = roles.get(name, role)
        if before != role and (before in machines or role in machines):
            raise BadRoles(f"{name!r} is a {before} already: choose another name for the {role}")


def _make(
    folder: Path,
    wanted: dict[str, tuple[Role, tuple[str, ...]]],
    removed: set[str],
    *,
    renew: bool,
) -> None:
    from drivers.bus_access import (
        CA_FILE,
        CERTIFICATE_FILE,
        ROLES_FILE,
        Role,
        check_name,
        read_roles,
        write_roles,
    )
    from drivers.certificates import check_host, issue, make_authority

    for name, (_, hosts) in wanted.items():
        check_name(name)
        for host in hosts:
            check_host(host)
    roles = read_roles(folder)
    _check_changes(folder, roles, wanted, removed)
    if not (folder / CA_FILE).is_file():
        make_authority(folder, "bladescout site")
        typer.echo(f"{folder / CA_FILE}: the site's authority; its key never leaves this folder")
    for name, (role, hosts) in wanted.items():
        if roles.get(name, role) != role:
            typer.echo(f"{name}: {role} from now on, {roles[name]} before")
        there = (folder / name / CERTIFICATE_FILE).is_file()
        if not there or renew or hosts:
            issue(folder, folder / name, name, hosts)
            typer.echo(f"{folder / name}: {name}, {role}")
            if role in (Role.VEHICLE, Role.ROUTER) and not hosts:
                typer.echo(f"{name} has no address: write {name}=HOST, so that it can be reached")
        roles[name] = role
    for name in removed:
        if roles.pop(name, None) is not None:
            typer.echo(f"{name} may do nothing any more, once the vehicles have the new list")
    write_roles(folder / ROLES_FILE, roles)
    for name, role in roles.items():
        if role in (Role.VEHICLE, Role.ROUTER):
            write_roles(folder / name / ROLES_FILE, roles)
            typer.echo(f"copy {folder / name} to {name}, and name it there as bus.keys")
