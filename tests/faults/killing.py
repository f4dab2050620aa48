"""The daemon killed at random moments of short simulated missions; `resume` completes each.

``python -m tests.faults.killing --kills 10 --seed 1``: every process of the daemon gets SIGKILL at
once; the vehicle is left hovering by its autopilot. A new daemon is started, takes it over where
it hovers (``--way air``) or from the ground after the pilot has brought it home (``--way pilot``),
and flies what is missing. Ends with 1 where a mission was not completed, a photo was lost or one
was taken twice.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import math
import random
import shutil
import signal
import sys
import tempfile
import time
from functools import partial
from pathlib import Path

import psutil

from mission.flight.command import MissionState
from mission.processes.runtime import CLOCK_FILE
from mission.processes.simulation import TERMINAL, Daemon
from mission.remote.client import NoReply
from tests.faults.rig import Rig

KILLS_A_MISSION = 3
#: So many more flights are begun where one ended unfinished, and not by our hand.
MORE = 3
#: Mission seconds after a flight was asked for, between which the daemon is killed.
FROM_S, TO_S = 12.0, 150.0
#: Two kept photos taken from places nearer than this, looking the same way, are one photo twice.
SAME_PLACE_M, SAME_SIGHT = 0.8, math.cos(math.radians(4.0))


class Killed(Rig):
    """A rig whose daemon is killed and started again."""

    def __enter__(self):
        super().__enter__()
        self.lives, self.died = 1, 0
        return self

    def kill(self):
        """Kill every process of the daemon at once; the field lives on."""
        daemon = psutil.Process(self.daemon.pid)
        family = [daemon, *daemon.children(recursive=True)]
        for process in family:
            with contextlib.suppress(psutil.NoSuchProcess):
                process.send_signal(signal.SIGKILL)
        psutil.wait_procs(family, timeout=10)
        self.client.close()

    def relaunch(self):
        """Start another daemon over the same missions, and watch it."""
        self.lives += 1
        folder = self.folder / f"serve-{self.lives}"
        folder.mkdir()
        self.daemon = Daemon(self.told, folder, self.world_dir / CLOCK_FILE)
        self._stack.callback(self.daemon.close)
        self.client = self._stack.enter_context(self.daemon.client(self.told))
        watcher = self.watcher
        watcher.state = watcher.recorded = None
        self.client.watch(watcher.take_state, watcher.take_event, watcher.take_recorded)

    def resume(self, **how):
        """Ask for the next flight until the daemon takes it."""

        def taken():
            try:
                reply = self.client.resume(operator="Bea", rotor_locked=True, **how)
            except NoReply:
                return False
            return reply.ok

        self.until(taken, 120.0, every_s=0.5)

    def fly_on(self, *, air):
        """Begin the next flight, from where the vehicle hovers or from the ground."""
        self.died += any(event.name == "flight_died" for event in self.events)
        self.events.clear()
        self.watcher.recorded = None
        airborne = air and self.newest()["armed"]
        if not airborne:
            self.world.swap_battery()
        self.resume(airborne=airborne)

    def until_killed(self, after_s, flight):
        """Wait so many mission seconds of a flight; return whether it is still under way."""
        begun_s = self.now_s()
        deadline = time.monotonic() + 1500.0
        while self.now_s() - begun_s < after_s:
            assert time.monotonic() < deadline, "the simulated world does not get on"
            if self.ended(flight):
                return False
            time.sleep(0.1)
        return not self.ended(flight)

    def ended(self, flight):
        """Return whether a flight has told its end, and its folder is complete."""
        state = self.watcher.state
        over = (
            state is not None
            and state.progress.flight == flight
            and state.progress.state in TERMINAL
        )
        # A flight process that died, and not by our hand, leaves a mission that nobody ends.
        died = any(event.name == "flight_died" for event in self.events)
        return died or (over and self.watcher.recorded is not None)

    def brought_home(self):
        """Let the pilot bring the vehicle home, and fit a charged battery."""
        if self.newest()["armed"]:
            self.world.pilot_returns()
        self.until(lambda: not self.newest()["armed"], 900.0, every_s=0.5)
        self.world.swap_battery()


def fly(folder, seed, kills, way, draw):
    """Fly one mission, killed so many times; return what became of it."""
    told = {"seed": seed, "kills": [], "more": 0}
    sides = ("inspection.blades=A,B", "inspection.sides=PS,SS")
    with Killed(folder, *sides, "simulation.sensors=bus", speed="auto", seed=seed) as rig:
        rig.start()
        flight = 1
        while True:
            after_s = draw.uniform(FROM_S, TO_S)
            if len(told["kills"]) == kills or not rig.until_killed(after_s, flight):
                rig.until(partial(rig.ended, flight), 1500.0)
                break
            progress = rig.watcher.state.progress
            rig.kill()
            told["kills"].append(
                {"flight": flight, "after_s": round(after_s, 1), "phase": str(progress.phase),
                 "words": progress.words, "photos": progress.photos}
            )  # fmt: skip
            if way == "pilot":
                rig.brought_home()
            rig.relaunch()
            rig.fly_on(air=way == "air")
            flight += 1
        while rig.watcher.state.progress.state != MissionState.COMPLETED and told["more"] < MORE:
            # As an operator would: the autopilot of a starved simulator leaves offboard by itself.
            told["more"] += 1
            rig.fly_on(air=True)
            flight += 1
            rig.until(partial(rig.ended, flight), 1500.0)
        state = rig.watcher.state.progress
        told |= {"state": str(state.state), "words": state.words, "flights": flight}
        told["died"] = rig.died
        truth = rig.finish()
        told["clearance_m"] = round(truth["min_clearance_m"], 2)
        if (rig.mission_dir / "mission.json").exists():
            told |= photos_of(rig.mission_dir)
        if told["state"] != MissionState.COMPLETED:
            told["last"] = last_words(rig.mission_dir)
    return told


def last_words(folder, count=15):
    """Return the end of a mission's event log: what a flight that did not complete met."""
    lines = (folder / "events.jsonl").read_text().splitlines()[-count:]
    return [
        f"{event['mission_s']:.1f} {event['name']}: {event['text']}"
        for event in map(json.loads, lines)
    ]


def photos_of(folder):
    """Return how many photos a folder holds, how many it lost, and which were taken twice."""
    mission = json.loads((folder / "mission.json").read_text())
    records = [json.loads(path.read_text()) for path in folder.glob("photos/*/*/*.json")]
    kept = [one for one in records if one["kept"]]
    numbers = [one["photo_id"] for one in records]
    missing = [one["file"] for one in records if not (folder / one["file"]).is_file()]
    lone = [
        path.name for path in folder.glob("photos/*/*/*.jpg")
        if not path.with_suffix(".json").is_file()
    ]  # fmt: skip
    begun_s = [flight["begun_s"] for flight in mission["flights"]]
    twice = [
        (a["file"], b["file"])
        for n, a in enumerate(kept)
        for b in kept[:n]
        if flight_of(a, begun_s) != flight_of(b, begun_s) and same(a, b)
    ]
    # What showed too little of the skin, or of it in a wrong light, is flown again on purpose.
    again = gaps_of(folder)
    return {
        "kept": len(kept),
        "coverage": round(mission["coverage"], 3),
        "lost": len(mission["lost"]) + len(missing) + len(lone),
        "again": again,
        "twice": max(0, len(twice) - again) + len(numbers) - len(set(numbers)),
        "which": twice,
        "pending": len(list(folder.glob("pending/*"))),
    }


def gaps_of(folder):
    """Return how many photos the flights told that they take again, as gaps."""
    events = map(json.loads, (folder / "events.jsonl").read_text().splitlines())
    return sum(int(event["text"].split()[0]) for event in events if event["name"] == "gaps")


def flight_of(record, begun_s):
    """Return in which flight a photo was taken: the world's clock goes on through all."""
    return sum(record["mission_s"] >= begin for begin in begun_s if begin is not None)


def same(a, b):
    """Return whether two photos show the same of the same side, from the same place."""
    if (a["blade"], a["side"]) != (b["blade"], b["side"]):
        return False
    apart = math.dist(a["position_w"], b["position_w"])
    cosine = sum(x * y for x, y in zip(sight_of(a), sight_of(b), strict=True))
    return apart < SAME_PLACE_M and cosine > SAME_SIGHT


def sight_of(record):
    """Return the unit direction (east, north, up) of a photo's optical axis."""
    yaw, pitch = (math.radians(record[f"gimbal_{name}_deg"]) for name in ("yaw", "pitch"))
    return math.cos(pitch) * math.sin(yaw), math.cos(pitch) * math.cos(yaw), math.sin(pitch)


def main() -> int:
    """Kill, resume, count."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=10)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--way", choices=("air", "pilot"), default="air")
    parser.add_argument("--keep", type=Path, help="folder that a bad mission's files are put in")
    options = parser.parse_args()
    draw, done, results = random.Random(options.seed), 0, []
    while done < options.kills:
        wanted = min(KILLS_A_MISSION, options.kills - done)
        seed = options.seed + len(results)
        with tempfile.TemporaryDirectory(prefix="bladescout-kill-") as name:
            result = fly(Path(name), seed, wanted, options.way, draw)
            if options.keep and not good(result):
                shutil.copytree(name, options.keep / str(seed), symlinks=True)
        done += len(result["kills"])
        results.append(result)
        sys.stdout.write(json.dumps(result) + "\n")
        sys.stdout.flush()
    completed = sum(good(one) for one in results)
    sys.stdout.write(
        f"seed {options.seed}: {done} kills in {len(results)} missions, {completed} completed "
        f"with no photo lost and none twice; {sum(one['more'] for one in results)} flights more "
        "than were killed\n"
    )
    return 0 if completed == len(results) else 1


def good(result):
    """Return whether a mission was completed with nothing lost and nothing flown twice."""
    completed = result["state"] == MissionState.COMPLETED and "lost" in result
    return completed and not result["lost"] + result["twice"] + result["died"]


if __name__ == "__main__":
    sys.exit(main())
