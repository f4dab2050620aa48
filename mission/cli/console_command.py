"""`bladescout console`: a page on the ground for all vehicles of a router."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Annotated

import typer

from mission.cli.exits import Exit, end
from mission.cli.remote_commands import DEFAULT_ROUTER, Keys, Router, reached

if TYPE_CHECKING:
    from mission.remote.console.board import Board
    from mission.remote.console.server import ConsoleServer


def console(
    router: Router = DEFAULT_ROUTER,
    keys: Keys = "",
    port: Annotated[
        int, typer.Option(min=0, max=65535, help="Port of this computer; 0 takes a free one.")
    ] = 8480,
    open_: Annotated[bool, typer.Option("--open/--no-open", help="Open a browser.")] = False,
) -> None:
    """Serve the console on this computer until Ctrl-C: states, map, rotor, picture, requests."""
    from mission.remote.client import bus_settings
    from mission.remote.console.board import Board

    with (
        reached(router, lambda: Board(bus_settings(router, keys))) as board,
        _served(board, port) as server,
    ):
        typer.echo(f"the console is at {server.url} (Ctrl-C ends it)")
        if open_:
            typer.launch(server.url)
        try:
            while True:
                time.sleep(3600)
        except KeyboardInterrupt:
            return


def _served(board: Board, port: int) -> ConsoleServer:
    from mission.remote.console.server import ConsoleServer

    try:
        return ConsoleServer(board, port)
    except OSError as error:
        end(
            Exit.DEVICE,
            f"port {port} of this computer: {error.strerror or error}; choose another with --port",
        )
