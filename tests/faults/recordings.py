"""Cases about what a mission leaves: recordings of killed processes, disks that fail in flight."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import random
import subprocess
import sys
import tempfile
import time
from functools import cache
from pathlib import Path
from unittest import mock

import psutil

from benchmarks.recording_feed import PROBE, FedRecorder
from config.settings import Settings
from drivers.bus import Bus, BusUnreachable, Key
from mission.flight.observation import RequestKind
from mission.processes.runtime import SETTINGS_FILE
from mission.processes.simulation import on_loopback
from mission.remote.messages import Intent, ReadyMessage
from mission.replay.recorded import RecordedMission
from tests.faults.fault import Fault, Seen
from tests.faults.processes import lines_since, longest_gap_s, moving
from tests.faults.rig import Rig

KILLS, SEED = 20, 8
#: What a kill may cost.
LOST_S = 1.0


def behind_s(folder, killed_ns):
    """Return how long before the kill the last message in a folder's recording was sent.

    Every message of the file is read, in order and without a hole, by the stock reader.
    """
    (path,) = folder.glob("*.mcap")
    recorded = RecordedMission(path)
    sent = [json.loads(one.payload)["at"] for one in recorded.messages({PROBE})]
    assert recorded.cut_short, "it was closed: nothing was killed"
    assert sent == sorted(sent)
    assert len(sent) > 0
    return (killed_ns - sent[-1]) * 1e-9


def seen_of(lost_s, what):
    worst = max(lost_s)
    assert worst <= LOST_S, f"the last {worst:.2f} s are lost"
    words = f"{len(lost_s)} kills of {what}: at most the last {worst:.2f} s lost; seed {SEED}"
    return Seen(len(lost_s), end="readable", figure=words)


async def _kill_recorders():
    draw, lost_s = random.Random(SEED), []
    with tempfile.TemporaryDirectory(prefix="bladescout-fault-") as name:
        async with FedRecorder(Path(name), full=False) as fed:
            for number in range(KILLS):
                folder = Path(name) / str(number)
                await fed.start(folder)
                await fed.feed(draw.uniform(1.0, 2.5))
                killed_ns = time.monotonic_ns()
                fed.kill()
                lost_s.append(behind_s(folder, killed_ns))
    return seen_of(lost_s, "the recorder")


def kill_recorders():
    return asyncio.run(_kill_recorders())


class Daemon:
    """`bladescout serve` with no vehicle anywhere; a mission is told to its recorder."""

    def __init__(self, folder):
        self.run_dir = folder / "run"
        self.run_dir.mkdir(parents=True)
        self.settings = on_loopback(Settings())
        (self.run_dir / SETTINGS_FILE).write_text(self.settings.model_dump_json())
        self.ready = set()
        command = [sys.executable, "-m", "mission.cli.main", "serve", "--runtime"]
        with (folder / "serve.log").open("wb") as log:
            self.process = subprocess.Popen(
                [*command, str(self.run_dir)], stdin=subprocess.PIPE, stdout=log, stderr=log
            )

    def bus(self):
        """Return a session once the daemon's router answers."""
        deadline = time.monotonic() + 60.0
        while True:
            try:
                return Bus.open_client(self.settings.bus, self.settings.vehicle)
            except BusUnreachable:
                assert time.monotonic() < deadline
                time.sleep(0.1)

    def take_ready(self, sample):
        ready = ReadyMessage.model_validate_json(sample.payload)
        if ready.name == "recorder":
            self.ready.add(ready.recording)

    def kill(self):
        """Kill every process of it at once; return when."""
        parent = psutil.Process(self.process.pid)
        family = [parent, *parent.children(recursive=True)]
        killed_ns = time.monotonic_ns()
        # Stopped first, all of them: no child shall see its parent go and close its files.
        for process in family:
            process.suspend()
        for process in family:
            with contextlib.suppress(psutil.NoSuchProcess):
                process.kill()
        psutil.wait_procs(family, timeout=10)
        self.process.wait()
        self.process.stdin.close()
        return killed_ns


def _kill_daemon(folder, fed_s):
    daemon = Daemon(folder)
    try:
        with daemon.bus() as bus:
            bus.subscribe(Key.READY, daemon.take_ready)
            intent = Intent(kind=RequestKind.START, id="1", site="one", mission_dir=str(folder))
            deadline = time.monotonic() + 90.0
            while str(folder) not in daemon.ready:
                if daemon.ready:
                    bus.publish(Key.RECORD, intent.model_dump_json().encode())
                assert time.monotonic() < deadline
                time.sleep(0.05)
            until = time.monotonic() + fed_s
            while time.monotonic() < until:
                bus.publish(PROBE, b'{"at": %d}' % time.monotonic_ns())
                time.sleep(0.02)
            killed_ns = daemon.kill()
    finally:
        if daemon.process.poll() is None:
            daemon.kill()
    return behind_s(folder, killed_ns)


def kill_daemons():
    draw, lost_s = random.Random(SEED), []
    for _ in range(KILLS):
        with tempfile.TemporaryDirectory(prefix="bladescout-fault-") as name:
            lost_s.append(_kill_daemon(Path(name), draw.uniform(1.0, 2.5)))
    return seen_of(lost_s, "the whole daemon")


#: Loaded by every Python process of the rig; only the recorder's disk is touched. The word in the
#: file says how the disk fails at the moment; a line is added for every call that it spoiled.
_BAD_DISK = """
import errno, io, os, sys, time
if "mission.processes.recorder" in sys.orig_argv:
    word_file, spoiled = {word!r}, {spoiled!r}
    really = {{"write": os.write, "fsync": os.fsync, "open": os.open, "io": io.open}}
    def fails():
        try:
            with really["io"](word_file) as file:
                word = file.read().strip()
        except OSError:
            return ""
        if word:
            fd = really["open"](spoiled, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600)
            really["write"](fd, (word + "\\n").encode())
            os.close(fd)
        return word
    def refuse(word):
        if word in ("full", "read-only"):
            number = errno.ENOSPC if word == "full" else errno.EROFS
            raise OSError(number, os.strerror(number))
    def write(fd, data):
        refuse(fails())
        return really["write"](fd, data)
    def fsync(fd):
        word = fails()
        refuse(word)
        if word == "slow":
            time.sleep(3.0)
        return really["fsync"](fd)
    def opened(path, mode="r", *rest, **named):
        if set(mode) & set("wax"):
            refuse(fails())
        return really["io"](path, mode, *rest, **named)
    os.write, os.fsync, io.open = write, fsync, opened
"""


@cache
def one_flight_on_a_bad_disk():
    """One whole mission whose disk is full, then read-only, then slow; what came of each."""
    with tempfile.TemporaryDirectory(prefix="bladescout-fault-") as name:
        folder = Path(name)
        word, spoiled, code = folder / "word", folder / "spoiled", folder / "code"
        code.mkdir()
        text = _BAD_DISK.format(word=str(word), spoiled=str(spoiled))
        (code / "sitecustomize.py").write_text(text)
        found = {}
        with (
            mock.patch.dict(os.environ, {"PYTHONPATH": str(code)}),
            Rig(folder / "rig", "tracking.overlap=0.6") as rig,
        ):
            rig.start().phase("approach")
            moving(rig)
            rig.phase("track")
            gaps_s = {"before": longest_gap_s(lines_since(rig, rig.now_s() - 20.0))}
            for how in ("full", "read-only", "slow"):
                begun_s = rig.now_s()
                word.write_text(how)
                time.sleep(12.0)
                gaps_s[how] = longest_gap_s(lines_since(rig, begun_s))
            word.write_text("")
            state = str(rig.over(600.0))
            rig.until(lambda: rig.watcher.recorded is not None, 120.0)
            calls = spoiled.read_text().split()
            mission = json.loads((rig.mission_dir / "mission.json").read_text())
            page = (rig.mission_dir / "report.html").read_text()
        for sentence in mission["lost"]:
            assert sentence.split(":")[0] in page, f"not named in the report: {sentence}"
        for how in ("full", "read-only", "slow"):
            words = (
                f"setpoint gap at most {1e3 * gaps_s[how]:.0f} ms (before: "
                f"{1e3 * gaps_s['before']:.0f} ms); {len(mission['lost'])} sentences in the "
                f"report say what is missing"
            )
            assert gaps_s[how] <= 0.25, words
            found[how] = Seen(calls.count(how), rig.names(), end=state, figure=words)
        return found


ROWS: tuple[Fault, ...] = (
    Fault(19, "kill -9 of the recorder, at 20 random moments", kill_recorders, "", None,
          "readable", slow=True),
    Fault(19, "kill -9 of every process of the daemon, at 20 random moments", kill_daemons, "",
          None, "readable", slow=True),
    Fault(40, "less and less room on the disk",
          "tests/mission/processes/test_recorder.py"
          "::test_what_finds_no_room_is_left_out_in_order_and_named_in_the_report"),
    Fault(40, "the disk is full for 12 s of a pass",
          lambda: one_flight_on_a_bad_disk()["full"], "", None, "completed ended_safely",
          slow=True),
    Fault(40, "the disk is read-only for 12 s of a pass",
          lambda: one_flight_on_a_bad_disk()["read-only"], "", None, "completed ended_safely",
          slow=True),
    Fault(40, "every fsync takes 3 s, for 12 s of a pass",
          lambda: one_flight_on_a_bad_disk()["slow"], "", None, "completed ended_safely",
          slow=True),
)  # fmt: skip
