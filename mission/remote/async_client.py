"""The client for asyncio: the same requests, awaited; states and events as asynchronous iterators.

::

    async with AsyncClient("drone-1") as drone:
        await drone.start("hill-3", operator="A. Person", rotor_locked=True)
        async for state in drone.states():
            print(state.progress.words)
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Coroutine
from functools import wraps
from pathlib import Path
from typing import Concatenate, ParamSpec, Self, TypeVar

from config.links import Bus as BusSettings
from mission.remote.client import Client
from mission.remote.messages import EventMessage, StateMessage

Asked = ParamSpec("Asked")
Answer = TypeVar("Answer")
Item = TypeVar("Item")
#: A reader that does not keep up loses the oldest.
MAX_WAITING = 256


def _awaited(
    ask: Callable[Concatenate[Client, Asked], Answer],
) -> Callable[Concatenate[AsyncClient, Asked], Coroutine[None, None, Answer]]:
    """Return a request of `Client` as a method that is awaited: it waits in a thread."""

    @wraps(ask)
    async def awaited(self: AsyncClient, /, *args: Asked.args, **kwargs: Asked.kwargs) -> Answer:
        return await asyncio.to_thread(ask, self._open, *args, **kwargs)

    return awaited


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

    async def __aexit__(self, *_: object) -> None:
        """Leave the bus."""
        if self._client is not None:
            await asyncio.to_thread(self._client.close)

    start = _awaited(Client.start)
    send_start = _awaited(Client.send_start)
    status = _awaited(Client.status)
    turbines = _awaited(Client.turbines)
    history = _awaited(Client.history)
    pause = _awaited(Client.pause)
    resume = _awaited(Client.resume)
    skip = _awaited(Client.skip)
    stop = _awaited(Client.stop)
    abort = _awaited(Client.abort)

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
