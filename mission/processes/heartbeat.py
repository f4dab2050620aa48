"""Systemd's watchdog, fed by the supervisor only while control ticks arrive."""

from __future__ import annotations

import asyncio

from drivers.systemd import Systemd
from mission.remote.history import History

#: Flight tells its state at least twice a second from its tick; after this long it has stalled.
TICKS_WITHIN_S = 2.0
PERIOD_S = 1.0


async def feed_watchdog(history: History, systemd: Systemd) -> None:
    """Say ready at the first tick, and alive as long as ticks arrive; until cancelled."""
    if not systemd.listens:
        return
    said_ready = False
    period_s = min(PERIOD_S, (systemd.watchdog_s or 2 * PERIOD_S) / 2)
    try:
        while True:
            state = history.state
            if state is not None and history.state_age_s() < TICKS_WITHIN_S:
                words = f"{state.progress.phase}: {state.progress.words}"
                if not said_ready:
                    systemd.ready(words)
                    said_ready = True
                systemd.alive(words)
            await asyncio.sleep(period_s)
    finally:
        systemd.stopping()
