"""`bladescout live`: the bus of one vehicle, for Foxglove and Lichtblick as it comes."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Annotated

import typer

from mission.cli.exits import Exit, end
from mission.cli.remote_commands import DEFAULT_ROUTER, Keys, Router, Vehicle, reached

if TYPE_CHECKING:
    from mission.records.live_view import Log
    from mission.records.recording import ChannelSchema


def live(
    router: Router = DEFAULT_ROUTER,
    keys: Keys = "",
    vehicle: Vehicle = "drone-1",
    port: Annotated[
        int, typer.Option(min=0, max=65535, help="Port of this computer, for the viewer.")
    ] = 8765,
) -> None:
    """Serve everything that is recorded to viewers of this computer, until Ctrl-C.

    Open a Foxglove WebSocket connection with the layout docs/foxglove-layout.json.
    """
    try:
        import foxglove
    except ImportError:
        end(Exit.CONFIGURATION, "live needs foxglove-sdk: pip install 'foxglove-sdk>=0.16'")
    from config.settings import Settings
    from drivers.bus import Bus
    from mission.records.live_view import LiveView
    from mission.remote.client import bus_settings, probe

    def open_channel(topic: str, told: ChannelSchema) -> Log:
        schema = foxglove.Schema(name=told.name, encoding=told.encoding, data=told.data)
        channel = foxglove.Channel(topic, schema=schema, message_encoding=told.message_encoding)
        return lambda data: channel.log(data)

    view = LiveView(Settings(vehicle=vehicle), open_channel)

    def opened() -> Bus:
        settings = bus_settings(router, keys)
        probe(settings.endpoint)
        return Bus.open_client(settings, vehicle)

    with reached(router, opened) as bus:
        try:
            server = foxglove.start_server(
                name=f"bladescout {vehicle}", host="127.0.0.1", port=port
            )
        except RuntimeError as error:
            words = str(error).removeprefix("FoxgloveError: ")
            end(Exit.DEVICE, f"port {port} of this computer: {words}; choose another with --port")
        bus.subscribe("**", lambda sample: view.take(sample, time.time_ns()))
        typer.echo(f"ws://127.0.0.1:{server.port} (Ctrl-C ends it)")
        try:
            while True:
                time.sleep(3600)
        except KeyboardInterrupt:
            server.stop()
