"""A coverage-guided fuzzer for everything that parses outside bytes, on demand.

``python -m tests.faults.fuzzing --seconds 60 [--only NAME] [--seed N]``: inputs that reach a new
place of the product's code are kept and mutated further. Ends at the first error that a target may
not raise, and prints the input.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

import numpy as np

from tests.faults.fault import Seen
from tests.faults.fuzz_targets import TARGETS, Target

OURS = ("/drivers/", "/mission/", "/config/")
INTERESTING = (b"\x00", b"\xff", b"\x7f", b"NaN", b"1e999", b"-1", b"{}", b"[", b'"', b"\n", b"..")
KEPT = 400
MOST_BYTES = 4096


class Coverage:
    """Places of the product's own code that were reached: (code, line)."""

    def __init__(self) -> None:
        self.places: set[tuple[CodeType, int]] = set()
        self.new = False

    def _line(self, frame: FrameType, event: str, _: Any) -> Any:
        if event == "line":
            place = (frame.f_code, frame.f_lineno)
            if place not in self.places:
                self.places.add(place)
                self.new = True
        return self._line

    def call(self, frame: FrameType, _event: str, _arg: Any) -> Any:
        return self._line if any(part in frame.f_code.co_filename for part in OURS) else None


def mutated(data: bytes, corpus: list[bytes], rng: np.random.Generator) -> bytes:
    """Return the input after a few random changes."""
    out = bytearray(data)
    for _ in range(int(rng.integers(1, 5))):
        kind, at = int(rng.integers(6)), int(rng.integers(len(out) + 1))
        if kind == 0 and out:
            out[at % len(out)] ^= 1 << int(rng.integers(8))
        elif kind == 1:
            out[at:at] = rng.bytes(int(rng.integers(1, 9)))
        elif kind == 2:
            del out[at : at + int(rng.integers(1, 17))]
        elif kind == 3:
            out[at:at] = INTERESTING[int(rng.integers(len(INTERESTING)))]
        elif kind == 4:
            other = corpus[int(rng.integers(len(corpus)))]
            out[at:] = other[int(rng.integers(len(other) + 1)) :]
        elif out:
            out[at % len(out)] = int(rng.integers(256))
    return bytes(out[:MOST_BYTES])


def fuzz(target: Target, *, seconds: float = 0.0, inputs: int = 0, seed: int = 0) -> Seen:
    """Fuzz one target for a time, or for so many inputs. Raises what the target may not raise."""
    rng, coverage = np.random.default_rng([seed, len(target.name)]), Coverage()
    corpus, tried, refused = target.seeds(), 0, 0
    waiting, deadline = list(corpus), time.monotonic() + seconds
    while waiting or tried < inputs or time.monotonic() < deadline:
        data = waiting.pop() if waiting else corpus[int(rng.integers(len(corpus)))]
        data = data if tried < len(target.seeds()) else mutated(data, corpus, rng)
        tried, coverage.new = tried + 1, False
        before = sys.gettrace()
        sys.settrace(coverage.call)
        try:
            target.parse(data)
        except target.raises:
            refused += 1
        except Exception as error:
            error.add_note(f"{target.name}: {data!r}")
            raise
        finally:
            sys.settrace(before)
        if coverage.new and len(corpus) < KEPT:
            corpus.append(data)
    words = (
        f"{target.name}: {tried} inputs, {len(coverage.places)} lines reached, {refused} refused"
    )
    return Seen(tried, end="parsed", figure=words)


def main() -> int:
    """Fuzz every target, or one."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--only", default="")
    parser.add_argument("--seed", type=int, default=int(time.time()))
    options = parser.parse_args()
    sys.stdout.write(f"seed {options.seed}\n")
    for target in TARGETS:
        if options.only in target.name:
            seen = fuzz(target, seconds=options.seconds, seed=options.seed)
            sys.stdout.write(f"{seen.figure}\n")
            sys.stdout.flush()
    return 0


if __name__ == "__main__":
    assert Path("pyproject.toml").exists(), "run it from the repository's root"
    sys.exit(main())
