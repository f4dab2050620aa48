"""The client for asyncio: the same requests, awaited; states and events as asynchronous iterators.

::

    async with AsyncClient("drone-1") as drone:
        await drone.start("hill-3", operator="A. Person", rotor_locked=True)
        async for state in drone.states():
            print(state.progress.words)
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Mapping
from pathlib import Path
from types import TracebackType
from typing import Self, TypeVar

from config.inspection import BladeName, Side
from config.links import Bus as BusSettings
from mission.flight.observation import Vec3
from mission.remote.client import Client
from mission.remote.messages import EventMessage, Reply, StateMessage, TurbineInfo

Item = TypeVar("Item")
#: A reader that does not keep up loses the oldest.
MAX_WAITING = 256


class AsyncClient:
    """A client of one vehicle's daemon for asyncio; see `mission.remote.client.Client`."""

    def __init__(
        self,
        vehicle: str = "drone-1",
        bus: BusSettings | None = None,
        *,
        router: str = "",
        keys: str | Path = "",
    ) -> None:
        """Keep what `__aenter__` connects to."""
        self._connect = lambda: Client(vehicle, bus, router=router, keys=keys)
        self._client: Client | None = None
        self._states: set[asyncio.Queue[StateMessage]] = set()
        self._events: set[asyncio.Queue[EventMessage]] = set()

    async def __aenter__(self) -> Self:
        """Connect; raises as `Client` does."""
        loop = asyncio.get_running_loop()
        # Connected in a thread: no loop runs there, so it calls back on the bus's own thread.
        self._client = client = await asyncio.to_thread(self._connect)

        def pass_on(queues: set[asyncio.Queue[Item]]) -> Callable[[Item], None]:
            def take(item: Item) -> None:
                if not loop.is_closed():
                    loop.call_soon_threadsafe(_put_all, queues, item)

            return take

        await asyncio.to_thread(client.watch, pass_on(self._states), pass_on(self._events))
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Leave the bus."""
        if self._client is not None:
            await asyncio.to_thread(self._client.close)

    async def start(
        self,
        site: str,
        *,
        operator: str,
        rotor_locked: bool,
        request_id: str | None = None,
        blades: tuple[BladeName, ...] | None = None,
        sides: tuple[Side, ...] | None = None,
        blade_serials: Mapping[BladeName, str] | None = None,
        nacelle_yaw_deg: float | None = None,
        blade_pitch_deg: float | None = None,
        launch_enu_m: Vec3 | None = None,
        valid_s: float | None = None,
        dry_run: bool = False,
    ) -> Reply:
        """Start a mission; see `Client.start`."""
        return await asyncio.to_thread(
            self._open.start,
            site,
            operator=operator,
            rotor_locked=rotor_locked,
            request_id=request_id,
            blades=blades,
            sides=sides,
            blade_serials=blade_serials,
            nacelle_yaw_deg=nacelle_yaw_deg,
            blade_pitch_deg=blade_pitch_deg,
            launch_enu_m=launch_enu_m,
            valid_s=valid_s,
            dry_run=dry_run,
        )

    async def status(self) -> Reply:
        """Return how the mission stands."""
        return await asyncio.to_thread(self._open.status)

    async def turbines(self) -> tuple[TurbineInfo, ...]:
        """Return the turbines that a mission may be started for."""
        return await asyncio.to_thread(self._open.turbines)

    async def history(self) -> Reply:
        """Return what has happened so far: state, events, photos, rotor."""
        return await asyncio.to_thread(self._open.history)

    async def pause(self) -> Reply:
        """Hold where the vehicle is; `resume` goes on."""
        return await asyncio.to_thread(self._open.pause)

    async def resume(self) -> Reply:
        """Go on after a pause."""
        return await asyncio.to_thread(self._open.resume)

    async def skip(self) -> Reply:
        """Leave out the rest of the pass that is flown."""
        return await asyncio.to_thread(self._open.skip)

    async def stop(self) -> Reply:
        """Hold and hand the vehicle to the pilot."""
        return await asyncio.to_thread(self._open.stop)

    async def abort(self) -> Reply:
        """Hold at once, leave the rotor, return."""
        return await asyncio.to_thread(self._open.abort)

    async def states(self) -> AsyncIterator[StateMessage]:
        """Yield every state from now on."""
        async for state in _items(self._states):
            yield state

    async def events(self) -> AsyncIterator[EventMessage]:
        """Yield every event from now on."""
        async for event in _items(self._events):
            yield event

    @property
    def _open(self) -> Client:
        if self._client is None:
            raise RuntimeError("use it as: async with AsyncClient(...) as drone")
        return self._client


async def _items(queues: set[asyncio.Queue[Item]]) -> AsyncIterator[Item]:
    queue: asyncio.Queue[Item] = asyncio.Queue(MAX_WAITING)
    queues.add(queue)
    try:
        while True:
            yield await queue.get()
    finally:
        queues.discard(queue)


def _put_all(queues: set[asyncio.Queue[Item]], item: Item) -> None:
    for queue in queues:
        if queue.full():
            queue.get_nowait()
        queue.put_nowait(item)
