"""Cases about processes: real ones, a short simulated mission each."""

from __future__ import annotations

from tests.faults.fault import Fault

_ENDINGS = "tests/system/test_endings.py::"

ROWS: tuple[Fault, ...] = (
    Fault(20, "SIGTERM or SIGINT to the daemon",
          _ENDINGS + "test_a_daemon_that_is_told_to_end_is_gone_soon_with_all_its_processes"),
)  # fmt: skip
