"""`bladescout start | status | pause | resume | skip | stop | abort | watch`."""

from __future__ import annotations

import re
import sys
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Annotated

import typer

from mission.cli.exits import Exit, end, exit_of

if TYPE_CHECKING:
    from mission.remote.client import Client
    from mission.remote.messages import Reply, StateMessage

DEFAULT_ROUTER = "tcp/127.0.0.1:7447"
#: A daemon tells its state five times a second; after this long it is taken for gone.
SILENCE_S = 10.0

Vehicle = Annotated[str, typer.Option(help="Name of the vehicle.")]
Router = Annotated[str, typer.Option(help="End point of the daemon's bus.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print the reply as JSON.")]


def _connect(vehicle: str, router: str) -> Client:
    from config.links import Bus as BusSettings
    from drivers.bus import BusUnreachable
    from mission.remote.client import Client

    if re.fullmatch(r"[A-Za-z0-9_-]{1,32}", vehicle) is None:
        end(Exit.CONFIGURATION, f"--vehicle {vehicle!r}: up to 32 letters, digits, '_' and '-'")
    try:
        return Client(vehicle, BusSettings(listen=router))
    except BusUnreachable:
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
    turbine: Annotated[str, typer.Argument(help="Name of the turbine, as configured.")],
    operator: Annotated[str, typer.Option(help="Who starts the mission.", prompt=True)],
    rotor_locked: Annotated[
        bool,
        typer.Option(
            "--rotor-locked",
            help="The operator's word: rotor braked and locked, yaw off.",
            prompt="Is the rotor braked and locked, and the yaw drive off?",
        ),
    ],
    vehicle: Vehicle = "drone-1",
    router: Router = DEFAULT_ROUTER,
    as_json: AsJson = False,
) -> None:
    """Start a mission at a turbine."""
    with _connect(vehicle, router) as client:
        _answered(
            lambda: client.start(turbine, operator=operator, rotor_locked=rotor_locked),
            lambda reply: _show(reply, as_json),
        )


def _answered(ask: Callable[[], Reply], show: Callable[[Reply], None]) -> None:
    from pydantic import ValidationError

    from mission.remote.client import NoReply

    try:
        reply = ask()
    except NoReply as error:
        end(Exit.DEVICE, str(error))
    except ValidationError as error:
        fault = error.errors()[0]
        where = ".".join(str(part) for part in fault["loc"])
        end(Exit.CONFIGURATION, f"{where} {fault['input']!r}: {fault['msg']}")
    show(reply)


def _plain(name: str, words: str) -> Callable[..., None]:
    def command(
        vehicle: Vehicle = "drone-1", router: Router = DEFAULT_ROUTER, as_json: AsJson = False
    ) -> None:
        with _connect(vehicle, router) as client:
            _answered(getattr(client, name), lambda reply: _show(reply, as_json))

    command.__doc__ = words
    return command


def status(
    vehicle: Vehicle = "drone-1", router: Router = DEFAULT_ROUTER, as_json: AsJson = False
) -> None:
    """Show how the mission stands."""

    def show(reply: Reply) -> None:
        if as_json or not reply.ok or reply.state is None:
            _show(reply, as_json)
            return
        from rich.console import Console

        from mission.cli.progress import status_table

        Console().print(status_table(reply.state))

    with _connect(vehicle, router) as client:
        _answered(client.status, show)


def watch(vehicle: Vehicle = "drone-1", router: Router = DEFAULT_ROUTER) -> None:
    """Show the mission live until it ends."""
    from rich.console import Console

    from mission.cli.progress import LiveProgress
    from mission.processes.simulation import TERMINAL

    ended: list[StateMessage] = []
    heard = [time.monotonic()]
    with (
        _connect(vehicle, router) as client,
        LiveProgress(Console(), f"bladescout - {vehicle}") as progress,
    ):

        def on_state(state: StateMessage) -> None:
            heard[0] = time.monotonic()
            progress.on_state(state)
            if state.progress.state in TERMINAL:
                ended.append(state)

        client.watch(on_state, progress.on_event)
        while not ended and time.monotonic() - heard[0] < SILENCE_S:
            time.sleep(0.1)
    if not ended:
        end(Exit.DEVICE, f"nothing was heard from {vehicle} for {SILENCE_S:.0f} s")
    last = ended[0].progress
    typer.echo(f"{last.state}: {last.words}")
    raise typer.Exit(int(exit_of(last.state)))


def mount(app: typer.Typer) -> None:
    """Add the remote commands to the command line."""
    app.command()(start)
    app.command()(status)
    for name, words in (
        ("pause", "Hold where the vehicle is."),
        ("resume", "Go on after a pause."),
        ("skip", "Leave out the rest of the pass that is flown."),
        ("stop", "Hold and hand the vehicle to the pilot."),
        ("abort", "Hold at once, leave the rotor, return."),
    ):
        app.command(name)(_plain(name, words))
    app.command()(watch)
