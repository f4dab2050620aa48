"""Over real TLS: who may do what, and what the others are told."""

import asyncio
import time
from concurrent.futures import ThreadPoolExecutor

import pytest
import zenoh

from config.links import Bus as BusSettings
from config.settings import Settings
from config.turbine import Site
from drivers.bus import Bus, BusUnreachable, Key
from drivers.bus_access import ALL_VERBS, ROLES_FILE, Role, read_roles, write_roles
from drivers.bus_session import BusNotSafe
from drivers.certificates import issue, make_authority
from drivers.free_port import free_port
from mission.flight.command import MissionState, Phase, Progress
from mission.remote.client import Client, NoReply, bus_settings
from mission.remote.desk import TOO_MANY, Desk
from mission.remote.fleet import Fleet
from mission.remote.history import History
from mission.remote.messages import Code, StateMessage

ROLES = {
    "heron": Role.VEHICLE,
    "ground": Role.ROUTER,
    "eve": Role.VIEWER,
    "ada": Role.OPERATOR,
    "pia": Role.PILOT,
}


@pytest.fixture(scope="module")
def keys(tmp_path_factory):
    """A site's keys; `gone` has no role any more, `mallory` comes from another authority."""
    folder = tmp_path_factory.mktemp("keys")
    make_authority(folder, "site")
    for name in (*ROLES, "gone"):
        issue(folder, folder / name, name)
    make_authority(folder / "elsewhere", "elsewhere")
    issue(folder / "elsewhere", folder / "mallory", "ada")
    (folder / "mallory" / "ca.pem").write_bytes((folder / "ca.pem").read_bytes())
    for name in ("heron", "ground"):
        write_roles(folder / name / ROLES_FILE, ROLES)
    return folder


def state_of(vehicle, state=MissionState.IDLE):
    return StateMessage(
        vehicle=vehicle,
        mission_dir="",
        site="one",
        mission_s=1.0,
        factor=1.0,
        progress=Progress(Phase.IDLE, state, "words"),
    )


class Vehicle:
    """A vehicle's router and desk, without the processes that fly."""

    def __init__(self, keys, folder, name="heron", **bus):
        self.settings = Settings(
            vehicle=name,
            missions_dir=str(folder / "missions"),
            sites=(Site(name="one", turbine="windpact-1.5"),),
            bus=BusSettings(listen=f"tcp/127.0.0.1:{free_port()}", keys=str(keys / name), **bus),
        )
        self.history = History()
        self.intents, self.told = [], []
        self.bus = Bus.open_router(self.settings.bus, name)
        self.history.listen(self.bus)
        self.bus.subscribe(Key.STATE, self.history.take)
        self.bus.announce()
        desk = Desk(
            self.settings,
            self.history,
            self.intents.append,
            self.told.append,
            read_roles(keys / name),
        )
        self.bus.answer_requests(
            ALL_VERBS, desk.answer, per_s=self.settings.bus.requests_per_s, too_many=TOO_MANY
        )
        self.publish(MissionState.IDLE)

    def publish(self, state):
        message = state_of(self.settings.vehicle, state)
        self.bus.publish(Key.STATE, message.model_dump_json().encode())


@pytest.fixture
async def heron(keys, tmp_path):
    vehicle = Vehicle(keys, tmp_path, remote=f"tls/127.0.0.1:{free_port()}")
    await asyncio.sleep(0.1)
    yield vehicle
    vehicle.bus.close()


async def asked(heron, keys, who, ask):
    """Return what one request of one person gets."""

    def run():
        with Client("heron", router=heron.settings.bus.remote, keys=keys / who) as client:
            return ask(client)

    return await asyncio.to_thread(run)


def start(client):
    return client.start("one", operator="A. Person", rotor_locked=True)


async def test_an_operator_starts_a_mission_over_tls(heron, keys):
    assert (await asked(heron, keys, "ada", start)).code == Code.STARTED
    assert len(heron.intents) == 1
    assert heron.told[0].text == "ada asked to start: accepted"


async def test_a_viewer_sees_but_cannot_start(heron, keys):
    assert (await asked(heron, keys, "eve", Client.status)).code == Code.OK
    with pytest.raises(NoReply, match="not running, or not authorised"):
        await asked(heron, keys, "eve", start)
    with pytest.raises(NoReply):
        await asked(heron, keys, "eve", Client.abort)
    assert heron.intents == []


async def test_a_pilot_in_command_cannot_start_but_can_abort(heron, keys):
    heron.publish(MissionState.RUNNING)
    await asyncio.sleep(0.1)
    with pytest.raises(NoReply):
        await asked(heron, keys, "pia", start)
    assert (await asked(heron, keys, "pia", Client.abort)).code == Code.ACCEPTED
    assert [intent.kind for intent in heron.intents] == ["abort"]


async def test_a_certificate_without_a_role_gets_nothing(heron, keys):
    with pytest.raises(NoReply):
        await asked(heron, keys, "gone", Client.status)


async def test_a_certificate_of_another_authority_is_not_let_in(heron, keys):
    with pytest.raises(BusUnreachable):
        await asked(heron, keys, "mallory", Client.status)


async def test_nobody_asks_in_the_name_of_another(heron, keys):
    def as_ada(client):
        client._who = "ada"
        return start(client)

    def as_local(client):
        client._who = "local"
        return start(client)

    for disguise in (as_ada, as_local):
        with pytest.raises(NoReply):
            await asked(heron, keys, "eve", disguise)
    assert heron.intents == []


def open_session(endpoint, tls):
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("connect/endpoints", f'["{endpoint}"]')
    config.insert_json5("connect/timeout_ms", "1500")
    config.insert_json5("transport/link/tls/root_ca_certificate", f'"{tls}"')
    return zenoh.open(config)


async def test_without_a_certificate_nobody_is_let_in(heron, keys):
    remote = heron.settings.bus.remote
    with pytest.raises(zenoh.ZError):
        await asyncio.to_thread(open_session, remote, keys / "ca.pem")
    plain = remote.replace("tls/", "tcp/")
    with pytest.raises(zenoh.ZError):
        await asyncio.to_thread(open_session, plain, keys / "ca.pem")


async def test_nobody_outside_can_speak_as_the_vehicle_or_hear_its_intents(heron, keys):
    heard, private = [], []
    heron.bus.subscribe(Key.INTENT, heard.append)
    heron.bus.subscribe(Key.STATE, heard.append)

    def intrude():
        settings = bus_settings(heron.settings.bus.remote, keys / "ada")
        with Bus.open_client(settings, "heron") as bus:
            bus.subscribe(Key.INTENT, private.append)
            bus.subscribe("**", private.append)
            time.sleep(0.2)
            bus.publish(Key.INTENT, b"{}")
            bus.publish(Key.STATE, b"{}")
            time.sleep(0.3)

    task = asyncio.create_task(asyncio.to_thread(intrude))
    await asyncio.sleep(0.3)
    heron.bus.publish(Key.INTENT, b"secret")
    await task
    assert [sample.payload for sample in heard] == [b"secret"]
    # It hears itself; of what the vehicle said, nothing.
    assert {sample.payload for sample in private} <= {b"{}"}


async def test_a_viewer_hears_states_and_sees_who_is_alive(heron, keys):
    def look():
        with Fleet(bus_settings(heron.settings.bus.remote, keys / "eve")) as fleet:
            deadline = time.monotonic() + 5
            while not fleet.vehicles() and time.monotonic() < deadline:
                time.sleep(0.02)
            return fleet.vehicles(), fleet.bus.alive()

    task = asyncio.create_task(asyncio.to_thread(look))
    while not task.done():
        heron.publish(MissionState.IDLE)
        await asyncio.sleep(0.05)
    seen, alive = await task
    assert seen["heron"].state == state_of("heron")
    assert alive == ("heron",)


async def test_a_flood_of_one_client_is_answered_and_delays_no_abort(heron, keys):
    heron.publish(MissionState.RUNNING)
    await asyncio.sleep(0.1)

    def flood(client):
        codes = [client.status().code for _ in range(60)]
        return codes, client.abort().code

    codes, abort = await asked(heron, keys, "ada", flood)
    assert codes[:20] == [Code.OK] * 20
    assert Code.TOO_MANY_REQUESTS in codes
    assert abort == Code.ACCEPTED
    assert (await asked(heron, keys, "eve", Client.status)).code == Code.OK


async def test_a_request_that_is_too_large_is_refused_and_a_huge_one_dropped(heron, keys):
    def large(client):
        short = client._bus.request("rpc/start/ada", b"x" * 70_000)
        return short, client._bus.request("rpc/start/ada", b"x" * (2 << 20), timeout_s=1.0)

    refused, huge = await asked(heron, keys, "ada", large)
    assert Code.TOO_LARGE.encode() in refused
    assert huge is None


async def test_of_a_hundred_starts_at_once_one_becomes_a_mission(heron):
    settings = heron.settings.bus

    def one_start(_):
        with Client("heron", settings) as client:
            return start(client).code

    def all_of_them():
        with ThreadPoolExecutor(25) as pool:
            return list(pool.map(one_start, range(100)))

    codes = await asyncio.to_thread(all_of_them)
    assert sorted(codes) == [Code.BUSY] * 99 + [Code.STARTED]
    assert len(heron.intents) == 1


async def test_through_a_sites_router_the_same_people_may_do_the_same(keys, tmp_path):
    end = f"tls/127.0.0.1:{free_port()}"
    here = f"tcp/127.0.0.1:{free_port()}"
    ground = BusSettings(listen=here, remote=end, keys=str(keys / "ground"))
    with Bus.open_router(ground, "ground"):
        vehicle = Vehicle(keys, tmp_path, uplink=end)
        try:
            for _ in range(100):
                vehicle.publish(MissionState.IDLE)
                await asyncio.sleep(0.05)
                try:
                    reply = await asked_at(end, keys, "eve", Client.status)
                except NoReply:
                    continue
                break
            assert reply.state.vehicle == "heron"
            with pytest.raises(NoReply):
                await asked_at(end, keys, "eve", start)
            assert (await asked_at(end, keys, "ada", start)).code == Code.STARTED
            assert vehicle.told[-1].text == "ada asked to start: accepted"
        finally:
            vehicle.bus.close()


async def asked_at(end, keys, who, ask):
    def run():
        with Client("heron", router=end, keys=keys / who) as client:
            return ask(client)

    return await asyncio.to_thread(run)


def test_a_router_is_not_opened_to_others_without_certificates():
    for settings, words in (
        (BusSettings(listen="tcp/0.0.0.0:7447"), "bus.remote"),
        (BusSettings(listen="tcp/[::]:7447"), "bus.remote"),
        (BusSettings(remote="tls/0.0.0.0:7448"), "bus.keys"),
        (BusSettings(remote="tls/0.0.0.0:7448", keys="/nowhere"), "bladescout keys"),
    ):
        with pytest.raises(BusNotSafe, match=words):
            Bus.open_router(settings, "heron")
