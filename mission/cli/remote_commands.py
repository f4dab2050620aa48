"""`bladescout start | status | pause | resume | skip | stop | abort | turbines`."""

from __future__ import annotations

import re
import sys
import time
import uuid
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeVar

import typer

from mission.cli.exits import Exit, end
from mission.cli.typed import AsJson, asked_text, asked_word, blades_typed, mistyped, numbers_typed

if TYPE_CHECKING:
    from mission.remote.client import Client
    from mission.remote.messages import Reply

Opened = TypeVar("Opened")
DEFAULT_ROUTER = "tcp/127.0.0.1:7447"
#: What is typed for a request's field.
_OPTION_OF = {
    "id": "--request-id",
    "site": "TURBINE",
    "operator": "--operator",
    "blades": "--blades",
    "sides": "--sides",
    "blade_serials": "--blades",
    "nacelle_yaw_deg": "--nacelle-yaw",
    "blade_pitch_deg": "--blade-pitch",
    "launch_enu_m": "--launch",
    "rendezvous_w": "--rendezvous",
    "expires_utc_s": "--valid",
    "mission": "MISSION",
}

Vehicle = Annotated[
    str, typer.Option(help="Name of the vehicle.", envvar="BLADESCOUT_VEHICLE", show_envvar=True)
]
Router = Annotated[
    str,
    typer.Option(
        help="Where the daemon is reached: tcp/... on this computer, tls/... elsewhere.",
        envvar="BLADESCOUT_BUS__CONNECT",
        show_envvar=True,
    ),
]
Keys = Annotated[
    str,
    typer.Option(
        help="Folder of your certificate, for tls.", envvar="BLADESCOUT_BUS__KEYS", show_envvar=True
    ),
]


def connect(vehicle: str, router: str, keys: str) -> Client:
    """Return a client, or end with one sentence."""
    from mission.remote.client import Client

    if re.fullmatch(r"[A-Za-z0-9_-]{1,32}", vehicle) is None:
        end(Exit.CONFIGURATION, f"--vehicle {vehicle!r}: up to 32 letters, digits, '_' and '-'")
    return reached(router, lambda: Client(vehicle, router=router, keys=keys))


def reached(router: str, opening: Callable[[], Opened]) -> Opened:
    """Return what is opened at a router, or end with one sentence."""
    from pydantic import ValidationError

    from drivers.bus import BusUnreachable
    from drivers.bus_session import BusNotSafe
    from drivers.certificates import BadCertificate
    from mission.remote.client import NO_REPLY

    try:
        return opening()
    except ValidationError:
        end(Exit.CONFIGURATION, f"--router {router!r}: write it as tcp/HOST:PORT or tls/HOST:PORT")
    except (BusNotSafe, BadCertificate) as error:
        end(Exit.CONFIGURATION, str(error))
    except BusUnreachable:
        if router.startswith("tls/"):
            end(Exit.DEVICE, f"{router}: {NO_REPLY}")
        end(Exit.DEVICE, f"no daemon answers at {router}: is it running (bladescout serve)?")


def _show(reply: Reply, as_json: bool) -> None:
    code = Exit.DEVICE if reply.code == "no_vehicle" else Exit.REFUSED
    if as_json:
        sys.stdout.write(reply.model_dump_json() + "\n")
        if not reply.ok:
            raise typer.Exit(int(code))
        return
    if not reply.ok:
        end(code, f"{reply.text} ({reply.code})")
    typer.echo(reply.text)
    if reply.mission_dir:
        typer.echo(f"mission folder: {reply.mission_dir}")


def start(
    turbine: Annotated[
        str,
        typer.Argument(metavar="TURBINE", help="Name of the turbine, as bladescout turbines says."),
    ],
    operator: Annotated[
        str, typer.Option(help="Who starts the mission; asked for where not given.")
    ] = "",
    rotor_locked: Annotated[
        bool,
        typer.Option(
            "--rotor-locked",
            help="The operator's word: rotor braked and locked, yaw off; asked for likewise.",
        ),
    ] = False,
    blades: Annotated[
        str,
        typer.Option(
            help="Blades to fly, as A,C; or with serials, as A=LM-1,B=LM-2,C=LM-3. "
            "Without it: as configured."
        ),
    ] = "",
    sides: Annotated[
        str, typer.Option(help="Sides to fly, as PS,SS,LE,TE. Without it: as configured.")
    ] = "",
    nacelle_yaw: Annotated[
        float | None,
        typer.Option(help="Compass direction into which the rotor faces, degrees, where known."),
    ] = None,
    blade_pitch: Annotated[
        float | None,
        typer.Option(help="0 = operating, 90 = feathered, degrees, where known."),
    ] = None,
    launch: Annotated[
        str, typer.Option(help="Take-off point from the tower's base: EAST,NORTH[,UP] in metres.")
    ] = "",
    request_id: Annotated[
        str, typer.Option(help="The same id never starts a second mission.")
    ] = "",
    valid: Annotated[
        float | None, typer.Option(help="Start nothing if it arrives later than these seconds.")
    ] = None,
    airborne: Annotated[
        bool, typer.Option("--airborne", help="Take over the vehicle where it hovers.")
    ] = False,
    rendezvous: Annotated[
        str,
        typer.Option(help="Where it is handed back hovering: EAST,NORTH,UP of its home, metres."),
    ] = "",
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Only check.")] = False,
    vehicle: Vehicle = "drone-1",
    router: Router = DEFAULT_ROUTER,
    keys: Keys = "",
    as_json: AsJson = False,
) -> None:
    """Start a mission at a turbine."""
    from pydantic import ValidationError

    from mission.remote.messages import StartRequest

    chosen, serials = blades_typed(blades)
    request = {
        "id": request_id or uuid.uuid4().hex,
        "site": turbine,
        "operator": asked_text("--operator", operator, "Who starts the mission?"),
        "rotor_locked": asked_word(
            "--rotor-locked", rotor_locked, "Is the rotor braked and locked, and the yaw drive off?"
        ),
        "blades": chosen,
        "sides": tuple(side.strip().upper() for side in sides.split(",")) if sides else None,
        "blade_serials": serials,
        "nacelle_yaw_deg": nacelle_yaw,
        "blade_pitch_deg": blade_pitch,
        "launch_enu_m": numbers_typed("--launch", launch, 3),
        "airborne": airborne,
        "rendezvous_w": numbers_typed("--rendezvous", rendezvous, 3),
        "expires_utc_s": None if valid is None else time.time() + valid,
        "dry_run": dry_run,
    }
    try:
        checked = StartRequest.model_validate(request)
    except ValidationError as error:
        mistyped(error, _OPTION_OF)
    with connect(vehicle, router, keys) as client:
        _answered(client, lambda: client.send_start(checked), lambda reply: _show(reply, as_json))


def _answered(client: Client, ask: Callable[[], Reply], show: Callable[[Reply], None]) -> None:
    from pydantic import ValidationError

    from mission.remote.client import NoReply

    try:
        reply = ask()
    except NoReply as error:
        end(Exit.DEVICE, f"{client.vehicle}: {error}{_others(client)}")
    except ValidationError as error:
        mistyped(error, _OPTION_OF)
    show(reply)


def _others(client: Client) -> str:
    """Return which vehicles are there, where the one that was asked is not."""
    there = client.vehicles()
    if not there or client.vehicle in there:
        return ""
    return f" (--vehicle: {', '.join(there)})"


def _plain(name: str, words: str) -> Callable[..., None]:
    def command(
        vehicle: Vehicle = "drone-1",
        router: Router = DEFAULT_ROUTER,
        keys: Keys = "",
        as_json: AsJson = False,
    ) -> None:
        with connect(vehicle, router, keys) as client:
            _answered(client, getattr(client, name), lambda reply: _show(reply, as_json))

    command.__doc__ = words
    return command


def resume(
    mission: Annotated[
        str,
        typer.Argument(
            metavar="MISSION", help="Folder of the mission to go on with; else the newest."
        ),
    ] = "",
    operator: Annotated[str, typer.Option(help="Who resumes a mission that had ended.")] = "",
    rotor_locked: Annotated[
        bool,
        typer.Option(
            "--rotor-locked", help="The operator's word: rotor still braked and locked, yaw off."
        ),
    ] = False,
    airborne: Annotated[
        bool, typer.Option("--airborne", help="Take over the vehicle where it hovers.")
    ] = False,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Only check.")] = False,
    vehicle: Vehicle = "drone-1",
    router: Router = DEFAULT_ROUTER,
    keys: Keys = "",
    as_json: AsJson = False,
) -> None:
    """Go on after a pause; or fly what is missing of a mission that ended unfinished."""
    name = Path(mission).name
    with connect(vehicle, router, keys) as client:
        _answered(
            client,
            lambda: client.resume(
                name,
                operator=operator,
                rotor_locked=rotor_locked,
                airborne=airborne,
                dry_run=dry_run,
            ),
            lambda reply: _show(reply, as_json),
        )


def turbines(
    vehicle: Vehicle = "drone-1",
    router: Router = DEFAULT_ROUTER,
    keys: Keys = "",
    as_json: AsJson = False,
) -> None:
    """List the turbines that a mission may be started for."""

    def show(reply: Reply) -> None:
        if as_json or not reply.ok:
            _show(reply, as_json)
            return
        for one in reply.turbines:
            east, north, _ = one.tower_enu_m
            typer.echo(
                f"{one.name}: {one.turbine}, hub {one.hub_height_m:.0f} m, rotor "
                f"{one.rotor_diameter_m:.0f} m, tower {east:.0f} m east and {north:.0f} m north "
                "of take-off"
            )

    with connect(vehicle, router, keys) as client:
        _answered(client, client.turbines_reply, show)


def status(
    vehicle: Vehicle = "drone-1",
    router: Router = DEFAULT_ROUTER,
    keys: Keys = "",
    as_json: AsJson = False,
) -> None:
    """Show how the mission stands."""

    def show(reply: Reply) -> None:
        if as_json or not reply.ok or reply.state is None:
            _show(reply, as_json)
            return
        from rich.console import Console

        from mission.cli.progress import status_table

        Console().print(status_table(reply.state))

    with connect(vehicle, router, keys) as client:
        _answered(client, client.status, show)


def mount(app: typer.Typer) -> None:
    """Add the remote commands to the command line."""
    app.command()(start)
    app.command()(status)
    app.command()(resume)
    app.command()(turbines)
    for name, words in (
        ("pause", "Hold where the vehicle is."),
        ("skip", "Leave out the rest of the pass that is flown."),
        ("stop", "Hold and hand the vehicle to the pilot."),
        ("abort", "Hold at once, leave the rotor, return."),
    ):
        app.command(name)(_plain(name, words))
