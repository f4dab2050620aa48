"""A vehicle's router on this computer, for tests of the clients."""

import pytest

from config.links import Bus as BusSettings
from drivers.bus import Bus
from drivers.free_port import free_port


@pytest.fixture
def settings():
    return BusSettings(listen=f"tcp/127.0.0.1:{free_port()}")


@pytest.fixture
async def router(settings):
    with Bus.open_router(settings, "heron") as bus:
        yield bus
