"""What the autopilot really did, line by line: for rehearsals that judge time.

A line of JSON each 20 ms of wall time, in mission seconds and the field's world (ENU, metres).
"""

from __future__ import annotations

import asyncio
import json
import time
from pathlib import Path

from drivers.simulated.world import World

_EVERY_S = 0.02


async def trace(world: World, file: Path) -> None:
    """Write lines until cancelled."""
    with file.open("w", encoding="utf-8") as out:
        while True:
            out.write(json.dumps(_line(world)) + "\n")
            out.flush()
            await asyncio.sleep(_EVERY_S)


def _line(world: World) -> dict[str, object]:
    aircraft = world.aircraft
    return {
        "mission_s": round(world.now_s, 4),
        "wall_ns": time.monotonic_ns(),
        "position_w": aircraft.body.position_w,
        "velocity_w": aircraft.body.velocity_w,
        "mode": aircraft.commander.mode.name,
        "intention": aircraft.commander.intention.name,
        "armed": aircraft.commander.armed,
        "setpoints": world.timing.count,
        "setpoint_s": world.timing.last_s,
    }
