"""Cases 40 to 46: the computer, files, configuration, requests from afar."""

from __future__ import annotations

import asyncio
import dataclasses
import os
import shutil
import tempfile
import time
from pathlib import Path
from unittest import mock

from config.settings import Settings
from drivers.bus import Sample
from drivers.bus_access import ALL_VERBS
from drivers.clock import MonotonicClock
from mission.flight.command import MissionState, Phase
from mission.flight.observation import RequestKind
from mission.processes.recorder import Recorder
from mission.processes.runtime import Runtime
from mission.remote.messages import EventMessage, Intent
from tests.faults.fault import Fault, Seen
from tests.faults.fuzz_targets import TARGETS
from tests.faults.fuzzing import fuzz
from tests.faults.rehearsal import FLYING, distance_m, flight_in, stops
from tests.faults.soaking import soak_in_memory
from tests.faults.vehicle import preflight


class _BusOfPaper:
    def publish(self, *_, **__):
        """Say nothing to anyone."""


def disk_full():
    """The recording goes to a device on which nothing finds room."""
    return asyncio.run(_disk_full())


async def _disk_full():
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "recording.mcap").symlink_to("/dev/full")
        recorder = Recorder(Runtime(Settings(), MonotonicClock(), folder), _BusOfPaper())
        intent = Intent(kind=RequestKind.START, id="a", site="one", mission_dir=str(folder))
        event = EventMessage(mission_s=1.0, name="pass", severity="none", text="A PS")
        recorder._take(Sample("mission/intent", intent.model_dump_json().encode(), None))
        longest_s = 0.0
        for _ in range(400):
            begun_s = time.perf_counter()
            recorder._take(Sample("sensor/lidar/scan", os.urandom(16_000), None))
            longest_s = max(longest_s, time.perf_counter() - begun_s)
        recorder._take(Sample("mission/event", event.model_dump_json().encode(), None))
        await recorder._looking_back
        recorder._writer.shutdown(wait=True)
        recorder._fetchers.shutdown()
        spool = recorder._open.recording._spool
        waiting, why = len(spool._waiting), spool.fault
        kept = (folder / "events.jsonl").read_text()
    assert "A PS" in kept, "the event log has room of its own and was not written"
    words = f"{waiting / 1e6:.1f} MB wait in memory ({why}); {longest_s * 1e3:.1f} ms a message"
    return Seen(waiting, frozenset({"disk"} if why else ()), end="running", figure=words)


def too_little_space():
    usage = shutil.disk_usage("/")._replace(free=1 << 20)
    missions = Path(__file__).parent
    with mock.patch("shutil.disk_usage", return_value=usage):
        failed = [i for i in preflight(missions) if not i.passed]
    assert [i.name for i in failed] == ["disk"]
    assert str(missions) in failed[0].mend
    # A figure is read on other machines.
    words = failed[0].mend.replace(str(missions), "the missions folder")
    return Seen(1, frozenset({"preflight"}), end="refused", figure=words)


def fuzzed_requests(count):
    """Ask each verb with bytes that are nearly right, and time the answers."""
    (requests,) = (target for target in TARGETS if target.name == "requests")
    took_s = []

    def timed(data):
        begun_s = time.process_time()
        requests.parse(data)
        took_s.append(time.process_time() - begun_s)

    fuzz(dataclasses.replace(requests, parse=timed), inputs=count // len(ALL_VERBS), seed=44)
    asked = len(took_s) * len(ALL_VERBS)
    longest_ms = 1e3 * max(took_s) / len(ALL_VERBS)
    assert longest_ms < 50
    words = f"{asked} requests, none handed over; the slowest took {longest_ms:.1f} ms of processor"
    return Seen(asked, end="refused", figure=words)


def abort_in_each_phase():
    worst, phases, least = 0.0, 0, 1e9
    for phase in FLYING:
        if phase in (Phase.RETURN, Phase.STAND_OFF):
            continue
        flight = flight_in(phase)
        flown = flight.run(limit_s=0.5)
        flight.ask(RequestKind.ABORT)
        begun_s, took_s = flight.now_s, None
        for _ in range(20):
            command = flight.one_tick(flown).command
            if took_s is None and (stops(command) or command.action is not None):
                took_s = flight.now_s - begun_s
        after = flight.run(400.0)
        assert flight.machine.state is MissionState.ENDED_SAFELY
        assert not flight.armed
        worst, phases = max(worst, took_s), phases + 1
        least = min(least, after.min_clearance_m, distance_m(flight))
    words = f"{phases} phases, each ended on the ground"
    return Seen(phases, frozenset({"request"}), worst, "ended_safely", clearance_m=least,
                figure=words)  # fmt: skip


_CONFIG = "tests/config/test_sources.py::"
_DESK = "tests/mission/remote/test_desk.py::"
_ALLOWED = "tests/mission/remote/test_authorisation.py::"
_LIMITS_40 = "a write that takes 3 s holds up the recorder, and with it the verdicts on photos"
_LIMITS_46 = (
    "a site's router that is lost in flight changes nothing: the mission is flown to its end, and "
    "the pilot alone can end it sooner; the daemon's own router ends with the daemon (case 19)"
)

ROWS = (
    Fault(40, "no room is left on the disk", disk_full, "disk", None, "running",
          lacking=_LIMITS_40),
    Fault(40, "too little room before the start", too_little_space, "preflight", None, "refused"),
    Fault(41, "500 damaged files",
          _CONFIG + "test_five_hundred_damaged_files_are_loaded_or_refused_in_words"),
    Fault(41, "damaged options and variables",
          _CONFIG + "test_damaged_options_and_variables_are_taken_or_refused_in_words"),
    Fault(42, "a second daemon on the same port",
          "tests/system/test_errors.py::test_a_port_that_is_taken_ends_serve_with_a_sentence"),
    Fault(42, "a second daemon on the same vehicle",
          "tests/drivers/test_autopilot.py"
          "::test_a_taken_port_is_noticed_before_the_other_loses_its_link"),
    Fault(43, "3 whole missions one after the other, in memory", lambda: soak_in_memory(3), "",
          None, "flat"),
    Fault(43, "1 000 whole missions one after the other, in memory",
          lambda: soak_in_memory(1000), "", None, "flat", slow=True),
    Fault(44, "bytes that are no request",
          _DESK + "test_bytes_that_are_no_request_get_an_error_reply"),
    Fault(44, "2 000 fuzzed requests", lambda: fuzzed_requests(2_000), "", None, "refused"),
    Fault(44, "100 000 fuzzed requests", lambda: fuzzed_requests(100_000), "", None, "refused",
          slow=True),
    Fault(44, "requests that cannot be",
          _DESK + "test_a_request_that_cannot_be_is_refused_with_a_stable_code"),
    Fault(45, "a viewer asks for a start", _ALLOWED + "test_a_viewer_sees_but_cannot_start"),
    Fault(45, "no certificate", _ALLOWED + "test_without_a_certificate_nobody_is_let_in"),
    Fault(45, "a certificate of another authority",
          _ALLOWED + "test_a_certificate_of_another_authority_is_not_let_in"),
    Fault(45, "who may not start may abort",
          _ALLOWED + "test_a_pilot_in_command_cannot_start_but_can_abort"),
    Fault(46, "a hundred starts at once", _DESK + "test_a_hundred_starts_give_one_mission",
          lacking=_LIMITS_46),
    Fault(46, "a flood of requests",
          _ALLOWED + "test_a_flood_of_one_client_is_answered_and_delays_no_abort"),
    Fault(46, "an abort in each phase", abort_in_each_phase, "request", 0.2, "ended_safely"),
)  # fmt: skip
