"""`bladescout start | status | pause | resume | skip | stop | abort | watch`."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from typing import Annotated

import typer
from rich.console import Console

from config.links import Bus as BusSettings
from drivers.bus import BusUnreachable
from mission.cli.exits import EXIT_OF_STATE, Exit, end
from mission.cli.progress import LiveProgress
from mission.processes.simulation import TERMINAL
from mission.remote.client import Client, NoReply
from mission.remote.messages import Reply, StateMessage

Vehicle = Annotated[str, typer.Option(help="Name of the vehicle.")]
Router = Annotated[str, typer.Option(help="End point of the daemon's bus.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print the reply as JSON.")]
DEFAULT_ROUTER = BusSettings().listen


def _connect(vehicle: str, router: str) -> Client:
    try:
        return Client(vehicle, BusSettings(listen=router))
    except BusUnreachable as error:
        end(Exit.DEVICE, f"{error}. Is the daemon running (bladescout serve)?")


def _show(reply: Reply, as_json: bool) -> None:
    if as_json:
        sys.stdout.write(reply.model_dump_json() + "\n")
    elif reply.ok:
        Console().print(reply.text, highlight=False)
    if not reply.ok:
        if as_json:
            raise typer.Exit(int(Exit.REFUSED))
        end(Exit.REFUSED, f"{reply.text} ({reply.code})")


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
            lambda: client.start(turbine, operator=operator, rotor_locked=rotor_locked), as_json
        )


def _answered(ask: Callable[[], Reply], as_json: bool) -> None:
    try:
        _show(ask(), as_json)
    except NoReply as error:
        end(Exit.DEVICE, str(error))


def _plain(name: str, words: str) -> Callable[..., None]:
    def command(
        vehicle: Vehicle = "drone-1", router: Router = DEFAULT_ROUTER, as_json: AsJson = False
    ) -> None:
        with _connect(vehicle, router) as client:
            _answered(getattr(client, name), as_json)

    command.__doc__ = words
    return command


def watch(vehicle: Vehicle = "drone-1", router: Router = DEFAULT_ROUTER) -> None:
    """Show the mission live until it ends."""
    ended: list[StateMessage] = []
    with (
        _connect(vehicle, router) as client,
        LiveProgress(Console(), f"bladescout - {vehicle}") as progress,
    ):

        def on_state(state: StateMessage) -> None:
            progress.on_state(state)
            if state.progress.state in TERMINAL:
                ended.append(state)

        client.watch(on_state, progress.on_event)
        while not ended:
            time.sleep(0.1)
    raise typer.Exit(int(EXIT_OF_STATE.get(ended[0].progress.state, Exit.FAILED)))


def mount(app: typer.Typer) -> None:
    """Add the remote commands to the command line."""
    app.command()(start)
    for name, words in (
        ("status", "Show how the mission stands."),
        ("pause", "Hold where the vehicle is."),
        ("resume", "Go on after a pause."),
        ("skip", "Leave out the rest of the pass that is flown."),
        ("stop", "Hold and hand the vehicle to the pilot."),
        ("abort", "Hold at once, leave the rotor, return."),
    ):
        app.command(name)(_plain(name, words))
    app.command()(watch)
