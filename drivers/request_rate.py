"""How often each client may ask: a token bucket a client."""

from __future__ import annotations

from collections import OrderedDict

MAX_CLIENTS = 256


class RequestRate:
    """Allows each client ``per_s`` requests a second, after a burst of as many.

    Memory is bounded: of more than `MAX_CLIENTS` clients the one that was silent longest is
    forgotten, and would find its bucket full again.
    """

    def __init__(self, per_s: float) -> None:
        self._per_s = per_s
        self._buckets: OrderedDict[str, tuple[float, float]] = OrderedDict()

    def allows(self, client: str, now_s: float) -> bool:
        """Take a token of the client's bucket; False when it is empty. ``now_s``: monotonic."""
        full = max(1.0, self._per_s)
        tokens, at_s = self._buckets.pop(client, (full, now_s))
        tokens = min(full, tokens + (now_s - at_s) * self._per_s)
        allowed = tokens >= 1.0
        self._buckets[client] = (tokens - 1.0 if allowed else tokens, now_s)
        if len(self._buckets) > MAX_CLIENTS:
            self._buckets.popitem(last=False)
        return allowed
