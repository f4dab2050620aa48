"""`bladescout watch`: a mission live, or every vehicle's."""

from __future__ import annotations

import contextlib
import time
from typing import TYPE_CHECKING, Annotated

import typer

from mission.cli.exits import Exit, end, exit_of
from mission.cli.remote_commands import DEFAULT_ROUTER, Keys, Router, Vehicle, connect

if TYPE_CHECKING:
    from mission.remote.messages import StateMessage

#: A daemon tells its state at least twice a second; after this long it is taken for gone.
SILENCE_S = 10.0
#: Who comes late is shown what happened last.
EARLIER_EVENTS = 20


def watch(
    vehicle: Vehicle = "drone-1",
    router: Router = DEFAULT_ROUTER,
    keys: Keys = "",
    every: Annotated[
        bool, typer.Option("--all", help="Every vehicle of the router, until Ctrl-C.")
    ] = False,
) -> None:
    """Show the mission live until it ends."""
    if every:
        from mission.cli.fleet_view import watch_all

        watch_all(router, keys)
        return
    from rich.console import Console

    from mission.cli.progress import LiveProgress
    from mission.flight.command import TERMINAL
    from mission.remote.client import NoReply

    ended: list[StateMessage] = []
    heard = [time.monotonic()]
    with (
        connect(vehicle, router, keys) as client,
        LiveProgress(Console(), f"bladescout - {vehicle}") as progress,
    ):

        def on_state(state: StateMessage) -> None:
            heard[0] = time.monotonic()
            progress.on_state(state)
            if state.progress.state in TERMINAL:
                ended.append(state)

        client.watch(on_state, progress.on_event)
        with contextlib.suppress(NoReply):
            for event in client.history().events[-EARLIER_EVENTS:]:
                progress.on_event(event)
        while not ended and time.monotonic() - heard[0] < SILENCE_S:
            time.sleep(0.1)
    if not ended:
        end(Exit.DEVICE, f"nothing was heard from {vehicle} for {SILENCE_S:.0f} s")
    last = ended[0].progress
    typer.echo(f"{last.state}: {last.words}")
    raise typer.Exit(int(exit_of(last.state)))
