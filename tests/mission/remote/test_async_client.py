import asyncio

import pytest

from drivers.bus import Key
from mission.flight.command import MissionState, Phase, Progress
from mission.remote.async_client import AsyncClient
from mission.remote.client import NoReply
from mission.remote.messages import EventMessage, Reply, StartRequest, StateMessage


def yes(ask):
    return Reply(ok=True, code="ok", text=f"{ask.verb} of {ask.who}").model_dump_json().encode()


async def test_requests_are_awaited_beside_each_other(router, settings):
    router.answer_requests(("status", "abort", "start"), yes, per_s=20, too_many=b"")
    async with AsyncClient("heron", settings) as drone:
        replies = await asyncio.gather(
            drone.status(), drone.abort(), drone.start("one", operator="Ada", rotor_locked=True)
        )
    assert [reply.text for reply in replies] == [
        "status of local",
        "abort of local",
        "start of local",
    ]


async def test_every_part_of_a_start_arrives(router, settings):
    heard = []

    def take(ask):
        heard.append(StartRequest.model_validate_json(ask.payload))
        return yes(ask)

    router.answer_requests(("start",), take, per_s=20, too_many=b"")
    async with AsyncClient("heron", settings) as drone:
        await drone.start(
            "one",
            operator="Ada",
            rotor_locked=True,
            request_id="r1",
            blades=("B",),
            sides=("LE",),
            blade_serials={"B": "LM-2"},
            nacelle_yaw_deg=270.0,
            blade_pitch_deg=88.0,
            launch_enu_m=(1.0, 2.0, 3.0),
            valid_s=60.0,
            dry_run=True,
            airborne=True,
            rendezvous_w=(4.0, 5.0, 6.0),
        )
    (request,) = heard
    assert request.expires_utc_s is not None
    assert request.model_dump(exclude={"expires_utc_s"}) == {
        "version": 1,
        "id": "r1",
        "site": "one",
        "operator": "Ada",
        "rotor_locked": True,
        "blades": ("B",),
        "sides": ("LE",),
        "blade_serials": {"B": "LM-2"},
        "nacelle_yaw_deg": 270.0,
        "blade_pitch_deg": 88.0,
        "launch_enu_m": (1.0, 2.0, 3.0),
        "dry_run": True,
        "airborne": True,
        "rendezvous_w": (4.0, 5.0, 6.0),
    }


async def test_states_and_events_are_iterated(router, settings):
    state = StateMessage(
        vehicle="heron",
        mission_dir="",
        site="one",
        mission_s=1.0,
        factor=1.0,
        progress=Progress(Phase.TRACK, MissionState.RUNNING, "words"),
    )
    event = EventMessage(mission_s=1.0, name="x", severity="warn", text="x")

    async def publish():
        while True:
            router.publish(Key.STATE, state.model_dump_json().encode())
            router.publish(Key.EVENT, event.model_dump_json().encode())
            await asyncio.sleep(0.02)

    publisher = asyncio.create_task(publish())
    async with asyncio.timeout(10), AsyncClient("heron", settings) as drone:
        assert await anext(drone.states()) == state
        assert await anext(drone.events()) == event
    publisher.cancel()


async def test_nobody_there_gives_no_reply(router, settings):
    async with AsyncClient("stork", settings) as drone:
        with pytest.raises(NoReply):
            await drone.status()


async def test_a_client_that_was_not_opened_says_so():
    with pytest.raises(RuntimeError, match="async with"):
        await AsyncClient("heron").status()
