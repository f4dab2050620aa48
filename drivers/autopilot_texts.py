"""What the autopilot says in words (STATUSTEXT), long sentences put together."""

from __future__ import annotations

from dataclasses import dataclass

_KEPT = 50


@dataclass(frozen=True, slots=True)
class StatusText:
    """A sentence of the autopilot."""

    stamp_s: float
    severity: int
    """MAV_SEVERITY: 0 emergency to 7 debug."""
    text: str


class StatusTexts:
    """The newest sentences; replaced whole, so that a reader in another thread sees no half."""

    def __init__(self) -> None:
        self.newest: tuple[StatusText, ...] = ()
        """Oldest first."""
        self._number = 0

    def take(self, stamp_s: float, severity: int, words: str, part: tuple[int, int]) -> None:
        """Keep a sentence, or the next part of one.

        ``part``: the sentence's number (0: it is whole) and the part's place in it, from 0.
        """
        number, place = part
        earlier = self.newest
        if number and place and number == self._number and earlier:
            # What is longer than fifty characters comes in parts.
            words, earlier = earlier[-1].text + words, earlier[:-1]
        self._number = number
        # PX4 ends with a tab what it tells as an event too.
        text = StatusText(stamp_s, severity, words.rstrip("\t"))
        self.newest = (*earlier[1 - _KEPT :], text)
