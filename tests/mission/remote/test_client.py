import asyncio
import logging
import threading
import time

import pytest
from typer.testing import CliRunner

from config.links import Bus as BusSettings
from drivers.bus import BusUnreachable, Key
from mission.cli.exits import Exit
from mission.cli.main import app
from mission.flight.command import MissionState, Phase, Progress
from mission.remote.client import Client, NoReply
from mission.remote.messages import EventMessage, Reply, StartRequest, StateMessage


@pytest.mark.parametrize("address", ["127.0.0.1:{port}", "[::1]:{port}", "127.0.0.1:99999"])
def test_where_nobody_listens_the_client_says_so_at_once(settings, address):
    port = settings.listen.rpartition(":")[2]
    endpoint = f"tcp/{address.format(port=port)}"
    begun = time.monotonic()
    with pytest.raises(BusUnreachable) as told:
        Client("heron", BusSettings(connect=endpoint))
    assert endpoint in str(told.value)
    assert time.monotonic() - begun < 1.0


async def test_a_request_is_answered(router, settings):
    asked = []

    def answer(ask):
        asked.append(StartRequest.model_validate_json(ask.payload))
        return Reply(ok=True, code="started", text="mission started").model_dump_json().encode()

    router.answer_requests(("start",), answer, per_s=20, too_many=b"")

    def start():
        with Client("heron", settings) as client:
            return client.start("one", operator="Ada", rotor_locked=True, sides=("LE",))

    reply = await asyncio.to_thread(start)
    assert reply.code == "started"
    assert asked[0].sides == ("LE",)
    assert asked[0].blades is None


async def test_a_daemon_of_another_name_gives_no_reply(router, settings):
    router.answer_requests(("status",), lambda _: b"", per_s=20, too_many=b"")

    def status():
        with Client("stork", settings) as client:
            return client.status()

    with pytest.raises(NoReply):
        await asyncio.to_thread(status)


async def test_who_asks_for_a_vehicle_that_is_not_there_is_told_which_are(router, settings):
    router.answer_requests(("status",), lambda _: b"", per_s=20, too_many=b"")
    router.announce()
    words = ["status", "--vehicle", "hero", "--router", settings.endpoint]
    result = await asyncio.to_thread(CliRunner().invoke, app, words)
    assert result.exit_code == Exit.DEVICE
    assert "hero: no reply" in result.stderr
    assert "--vehicle: heron" in result.stderr


async def test_a_console_whose_port_is_taken_says_so_and_ends(router, settings):
    taken = settings.endpoint.rpartition(":")[2]
    words = ["console", "--port", taken, "--router", settings.endpoint]
    result = await asyncio.to_thread(CliRunner().invoke, app, words)
    assert result.exit_code == Exit.DEVICE
    assert f"port {taken}" in result.stderr
    assert "--port" in result.stderr
    assert [one.name for one in threading.enumerate() if one.name == "console"] == []


async def test_states_and_events_are_heard_and_what_cannot_be_read_is_left_out(
    router, settings, caplog
):
    states, events = [], []
    client = await asyncio.to_thread(Client, "heron", settings)
    await asyncio.to_thread(client.watch, states.append, events.append)
    state = StateMessage(
        vehicle="heron",
        mission_dir="",
        site="one",
        mission_s=1.0,
        factor=1.0,
        progress=Progress(Phase.TRACK, MissionState.RUNNING, "words"),
    )
    event = EventMessage(mission_s=1.0, name="x", severity="warn", text="x")
    caplog.set_level(logging.WARNING)
    async with asyncio.timeout(5):
        while not (states and events):
            router.publish(Key.STATE, b'{"version": 2, "news": true}')
            router.publish(Key.STATE, state.model_dump_json().encode())
            router.publish(Key.EVENT, event.model_dump_json().encode())
            await asyncio.sleep(0.05)
    await asyncio.to_thread(client.close)
    assert states[0] == state
    assert events[0] == event
    assert "was not understood" in caplog.text
