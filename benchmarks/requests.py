"""What requests cost and how soon they are answered; what the ground pays to hear many vehicles.

The daemon's half (router and desk, without the processes that fly) is a process of its own, so
that its CPU time can be told apart from the client's.
"""

from __future__ import annotations

import asyncio
import json
import multiprocessing
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from multiprocessing.synchronize import Event
from pathlib import Path

import numpy as np
import psutil
import zenoh

from benchmarks.row import Row
from config.links import Bus as BusSettings
from config.settings import Settings
from config.turbine import Site
from drivers.bus import Bus, Key
from drivers.bus_access import ALL_VERBS, ROLES_FILE, Role, read_roles, write_roles
from drivers.certificates import issue, make_authority
from drivers.free_port import free_port
from mission.flight.command import MissionState, Phase, PhotoCommand, Progress
from mission.processes.simulation import SimulationFailed
from mission.remote.client import Client
from mission.remote.desk import TOO_MANY, Desk
from mission.remote.fleet import Fleet
from mission.remote.history import MAX_EVENTS, History
from mission.remote.messages import EventMessage, PhotoTakenMessage, StateMessage

VEHICLE, PERSON = "heron", "ada"
PHOTOS = 400
PUBLISHERS, STATES_PER_S = 200, 5
FLOOD_PER_S = 10_000
#: As many as one who waits for each reply can ask, and far fewer than a flood has.
_RATE = 500.0


def measure(count: int) -> Iterator[Row]:
    """Yield the figures; ``count``: requests of each kind."""
    with tempfile.TemporaryDirectory() as folder, _daemon(Path(folder)) as (settings, process):
        remote = BusSettings(connect=settings.remote, keys=str(Path(folder) / PERSON))
        for name, bus in (("loopback", settings), ("mTLS", remote)):
            with Client(VEHICLE, bus) as client:
                yield from _answers(f"status, {name}", client.status, count, process)
                yield from _answers(f"history, {name}", client.history, count // 4, process)
        yield from _flood(settings, count, process)
        yield from _many(settings, count)


def _answers(
    name: str, ask: Callable[[], object], count: int, process: psutil.Process
) -> Iterator[Row]:
    ask()
    took_ms = []
    before_s = _cpu_s(process)
    for _ in range(count):
        begun = time.perf_counter()
        ask()
        took_ms.append((time.perf_counter() - begun) * 1e3)
    cpu_ms = (_cpu_s(process) - before_s) / count * 1e3
    yield Row(f"{name}: reply p50", float(np.percentile(took_ms, 50)), "ms")
    yield Row(f"{name}: reply p99", float(np.percentile(took_ms, 99)), "ms", 50.0)
    yield Row(f"{name}: daemon's CPU time a request", cpu_ms, "ms")


def _flood(settings: BusSettings, count: int, process: psutil.Process) -> Iterator[Row]:
    """Ask without waiting, in one name, far beyond the rate; an abort comes in between."""
    request = json.dumps({"id": "x"})
    answered = [0]

    def take(_: zenoh.Reply) -> None:
        answered[0] += 1

    with (
        Bus.open_client(settings.model_copy(update={"connect": settings.listen}), VEHICLE) as bus,
        Client(VEHICLE, settings) as other,
    ):
        session, key = bus.session, f"bladescout/{VEHICLE}/rpc/status"
        before_s, begun = _cpu_s(process), time.perf_counter()
        abort_ms = 0.0
        for number in range(10 * count):
            session.get(key, take, payload=request, attachment=b"flood", timeout=10.0)
            if number == 5 * count:
                abort_begun = time.perf_counter()
                other.abort()
                abort_ms = (time.perf_counter() - abort_begun) * 1e3
        while answered[0] < 10 * count and time.perf_counter() - begun < 60:
            time.sleep(0.01)
        wall_s, cpu_s = time.perf_counter() - begun, _cpu_s(process) - before_s
    each_us = cpu_s / answered[0] * 1e6
    yield Row("flood of one client: answered", answered[0] / wall_s, "/s")
    yield Row("flood: daemon's CPU time a request", each_us, "us")
    yield Row(f"flood: share of a core at {FLOOD_PER_S} /s", each_us * FLOOD_PER_S / 1e4, "%")
    yield Row("abort in the middle of it: reply", abort_ms, "ms", 300.0)


def _many(settings: BusSettings, count: int) -> Iterator[Row]:
    """Hear many vehicles at once; sending is counted apart."""
    payload = _state("x").model_dump_json().encode()
    rounds = max(2, count // 100)
    with (
        Fleet(BusSettings(connect=settings.listen)) as fleet,
        Bus.open_client(settings.model_copy(update={"connect": settings.listen}), "x") as sender,
    ):
        time.sleep(0.3)
        own = psutil.Process()
        before_s, sending_s = _cpu_s(own), 0.0
        for _ in range(rounds):
            begun_s = time.thread_time()
            for number in range(PUBLISHERS):
                sender.session.put(f"bladescout/v{number}/{Key.STATE}", payload)
            sending_s += time.thread_time() - begun_s
            time.sleep(1 / STATES_PER_S)
        time.sleep(0.5)
        heard = sum(name.startswith("v") for name in fleet.vehicles())
        cpu_s = _cpu_s(own) - before_s - sending_s
    share = cpu_s / (rounds * PUBLISHERS) * PUBLISHERS * STATES_PER_S * 100
    yield Row(f"{PUBLISHERS} vehicles: heard", float(heard), "", float(PUBLISHERS))
    yield Row(
        f"{PUBLISHERS} vehicles at {STATES_PER_S} /s: share of a core on the ground", share, "%"
    )


def _state(vehicle: str) -> StateMessage:
    return StateMessage(
        vehicle=vehicle,
        mission_dir="/missions/one",
        site="one",
        mission_s=1.0,
        factor=1.0,
        progress=Progress(Phase.TRACK, MissionState.RUNNING, "along A, pressure side"),
    )


def _cpu_s(process: psutil.Process) -> float:
    times = process.cpu_times()
    return float(times.user + times.system)


@contextmanager
def _daemon(folder: Path) -> Iterator[tuple[BusSettings, psutil.Process]]:
    make_authority(folder, "bench")
    for name in (VEHICLE, PERSON):
        issue(folder, folder / name, name)
    roles = {VEHICLE: Role.VEHICLE, PERSON: Role.OPERATOR}
    write_roles(folder / VEHICLE / ROLES_FILE, roles)
    settings = BusSettings(
        listen=f"tcp/127.0.0.1:{free_port()}",
        remote=f"tls/127.0.0.1:{free_port()}",
        keys=str(folder / VEHICLE),
    )
    spawn = multiprocessing.get_context("spawn")
    ready, over = spawn.Event(), spawn.Event()
    process = spawn.Process(target=_serve, args=(settings, ready, over), daemon=True)
    process.start()
    try:
        if not ready.wait(60):
            raise SimulationFailed("the daemon's half did not come up")
        yield settings, psutil.Process(process.pid)
    finally:
        over.set()
        process.join(10)


def _serve(bus_settings: BusSettings, ready: Event, over: Event) -> None:
    asyncio.run(_answer(bus_settings, ready, over))


async def _answer(bus_settings: BusSettings, ready: Event, over: Event) -> None:
    settings = Settings(
        vehicle=VEHICLE, bus=bus_settings, sites=(Site(name="one", turbine="windpact-1.5"),)
    )
    history = History()
    roles = read_roles(Path(bus_settings.keys))
    desk = Desk(settings, history, lambda _: None, lambda _: None, roles)
    with Bus.open_router(bus_settings, VEHICLE) as bus:
        history.listen(bus)
        bus.subscribe(Key.STATE, history.take)
        bus.answer_requests(ALL_VERBS, desk.answer, per_s=_RATE, too_many=TOO_MANY)
        _tell_much(bus)
        await asyncio.sleep(1.0)
        ready.set()
        while not over.is_set():
            bus.publish(Key.STATE, _state(VEHICLE).model_dump_json().encode())
            await asyncio.sleep(1 / STATES_PER_S)


def _tell_much(bus: Bus) -> None:
    """Publish as much history as a long mission has."""
    event = EventMessage(mission_s=1.0, name="x", severity="info", text="pass 7 of 12: B LE")
    for _ in range(MAX_EVENTS):
        bus.publish(Key.EVENT, event.model_dump_json().encode())
    for number in range(PHOTOS):
        taken = PhotoTakenMessage(
            command=PhotoCommand(number, "A", "PS", 3.0, 12.0),
            url="",
            index=number,
            stamp_s=1.0,
            utc="",
            position_w=(0.0, 0.0, 0.0),
            quaternion_wb=(1.0, 0.0, 0.0, 0.0),
            gimbal_yaw_rad=0.0,
            gimbal_pitch_rad=0.0,
        )
        bus.publish(Key.PHOTO, taken.model_dump_json().encode())
