"""What the processes of a daemon cost: CPU time by process and by thread, and memory."""

from __future__ import annotations

import contextlib
import os
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import psutil

_TICK_S = 1.0 / os.sysconf("SC_CLK_TCK")


@dataclass(frozen=True, slots=True)
class Usage:
    """Counters at one moment; seconds of CPU by (process, thread)."""

    at_s: float
    cpu_s: dict[tuple[str, str], float]

    @classmethod
    def now(cls, root: psutil.Process, at_s: float) -> Usage:
        """Read the counters of a process and all below it; ``at_s``: mission time."""
        counts: defaultdict[tuple[str, str], float] = defaultdict(float)
        for name, process in _family(root):
            for thread, cpu_s in _threads(process.pid):
                counts[name, thread] += cpu_s
        return cls(at_s, dict(counts))

    def since(self, before: Usage) -> Shares:
        """Return what was used since an earlier moment."""
        span_s = self.at_s - before.at_s
        used = {
            key: (cpu_s - before.cpu_s.get(key, 0.0)) / span_s * 100
            for key, cpu_s in self.cpu_s.items()
        }
        return Shares(span_s, used)


@dataclass(frozen=True, slots=True)
class Shares:
    """Per cent of a core by (process, thread): CPU seconds by mission seconds."""

    span_s: float
    percent: dict[tuple[str, str], float]

    @property
    def total(self) -> float:
        """All processes together."""
        return sum(self.percent.values())

    def by_process(self) -> dict[str, float]:
        """Return a share for each process."""
        shares: defaultdict[str, float] = defaultdict(float)
        for (process, _), value in self.percent.items():
            shares[process] += value
        return dict(shares)

    def by_thread(self, least: float) -> Iterator[tuple[str, str, float]]:
        """Yield process, thread and share of all that used as much, the largest first."""
        for (process, thread), value in sorted(self.percent.items(), key=lambda kv: -kv[1]):
            if value >= least:
                yield process, thread, value


def memory_mb(root: psutil.Process) -> dict[str, float]:
    """Return each process's proportional share of memory (what it shares is divided), MB."""
    found: defaultdict[str, float] = defaultdict(float)
    for name, process in _family(root):
        with contextlib.suppress(psutil.Error):
            found[name] += process.memory_full_info().pss * 1e-6
    return dict(found)


def _family(root: psutil.Process) -> Iterator[tuple[str, psutil.Process]]:
    for process in (root, *root.children(recursive=True)):
        with contextlib.suppress(psutil.Error):
            yield _name(process), process


def _name(process: psutil.Process) -> str:
    words = process.cmdline()
    module = words[words.index("-m") + 1] if "-m" in words else (words or [process.name()])[-1]
    return "supervisor" if module.endswith("main") else module.rpartition(".")[2]


def _threads(pid: int) -> Iterator[tuple[str, float]]:
    """Yield name and CPU seconds of each living thread; numbers at the end of names left out."""
    with contextlib.suppress(OSError):
        for task in Path(f"/proc/{pid}/task").iterdir():
            with contextlib.suppress(OSError):
                text = (task / "stat").read_text()
                name, _, rest = text.partition("(")[2].rpartition(")")
                user, system = rest.split()[11:13]
                yield name.rstrip("0123456789-_ "), (int(user) + int(system)) * _TICK_S
