"""Missions one after the other: many in memory, some on the wire; goes on where it was left.

``python -m tests.faults.soak --memory 1000 --wire 100``: what is done is kept in a file, so that
an interrupted soak goes on. Ends with 1 where anything grew, or a mission did not end in order.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from pathlib import Path

import psutil

from tests.faults.rig import Rig
from tests.faults.soaking import soak_in_memory

KEPT = Path(".soak.json")
BATCH = 10
#: Of all processes of a mission, from one mission to the next.
GROWTH_BYTES = 30_000_000


def one_on_the_wire(number: int) -> dict[str, object]:
    """Fly a short mission in real processes; return how it ended and what it held at the end."""
    with tempfile.TemporaryDirectory(prefix="bladescout-soak-") as name:
        with Rig(Path(name), speed=2.5, seed=number + 1) as rig:
            state = rig.start().over(900.0)
            family = [psutil.Process(rig.daemon._process.pid)]
            family += family[0].children(recursive=True)
            held = {
                "memory": sum(process.memory_info().rss for process in family),
                "files": sum(process.num_fds() for process in family),
                "threads": sum(process.num_threads() for process in family),
            }
        left = [p.pid for p in psutil.wait_procs(family, timeout=10)[1]]
    return {"state": str(state), "left": left, **held}


def main() -> int:
    """Soak."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--memory", type=int, default=20)
    parser.add_argument("--wire", type=int, default=2)
    options = parser.parse_args()
    done = json.loads(KEPT.read_text()) if KEPT.exists() else {"memory": 0, "wire": []}
    while done["memory"] < options.memory:
        seen = soak_in_memory(min(BATCH, options.memory - done["memory"]))
        done["memory"] += seen.disturbed
        KEPT.write_text(json.dumps(done))
        sys.stdout.write(f"in memory, {done['memory']} of {options.memory}: {seen.figure}\n")
        sys.stdout.flush()
    while len(done["wire"]) < options.wire:
        result = one_on_the_wire(len(done["wire"]))
        done["wire"].append(result)
        KEPT.write_text(json.dumps(done))
        sys.stdout.write(f"on the wire, {len(done['wire'])} of {options.wire}: {result}\n")
        sys.stdout.flush()
    wire = done["wire"]
    bad = [r for r in wire if r["left"] or r["state"] not in {"completed", "ended_safely"}]
    grown = [
        wire[-1][kind] - wire[0][kind] > (GROWTH_BYTES if kind == "memory" else 2)
        for kind in ("memory", "files", "threads")
        if len(wire) > 1
    ]
    KEPT.unlink()
    sys.stdout.write(f"{len(bad)} missions did not end in order; grown: {any(grown)}\n")
    return 1 if bad or any(grown) else 0


if __name__ == "__main__":
    sys.exit(main())
