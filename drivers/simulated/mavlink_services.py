"""Small MAVLink services of the mock autopilot: geofence upload, and 'no files here'."""

from __future__ import annotations

from drivers.simulated.mavlink_wire import Message, made

_FENCE = 1
_ACCEPTED, _UNSUPPORTED, _WRONG_SEQUENCE = 0, 3, 13
_NAK, _FILE_NOT_FOUND = 129, 10


class FenceStore:
    """The mission protocol, for fences (and empty lists of everything else)."""

    def __init__(self) -> None:
        self._items: dict[int, list[Message]] = {}
        self._expected = 0
        self._arriving: list[Message] = []
        self._kind = _FENCE

    def count(self, kind: int = _FENCE) -> int:
        """Return how many items of a kind are stored."""
        return len(self._items.get(kind, []))

    def handle(self, message: Message) -> list[Message]:
        """Return the replies to one MISSION_* message."""
        system, component = message.get_srcSystem(), message.get_srcComponent()
        kind = int(getattr(message, "mission_type", 0))
        name = message.get_type()
        if name == "MISSION_COUNT":
            self._expected, self._kind = int(getattr(message, "count", 0)), kind
            self._arriving = []
            return [self._next(system, component)]
        if name == "MISSION_ITEM_INT":
            if int(getattr(message, "seq", -1)) == len(self._arriving):
                self._arriving.append(message)
            return [self._next(system, component)]
        if name == "MISSION_CLEAR_ALL":
            self._items.pop(kind, None)
            return [made("mission_ack", system, component, _ACCEPTED, kind)]
        if name == "MISSION_REQUEST_LIST":
            count = self.count(kind)
            return [made("mission_count", system, component, count, kind)]
        if name == "MISSION_REQUEST_INT":
            return [self._stored(system, component, kind, int(getattr(message, "seq", -1)))]
        return []

    def _next(self, system: int, component: int) -> Message:
        have, kind = len(self._arriving), self._kind
        if have < self._expected:
            return made("mission_request_int", system, component, have, kind)
        self._items[kind] = self._arriving
        return made("mission_ack", system, component, _ACCEPTED, kind)

    def _stored(self, system: int, component: int, kind: int, sequence: int) -> Message:
        items = self._items.get(kind, [])
        if not 0 <= sequence < len(items):
            return made("mission_ack", system, component, _WRONG_SEQUENCE, kind)
        names: tuple[str, ...] = (
            "frame",
            "command",
            "current",
            "autocontinue",
            "param1",
            "param2",
            "param3",
        )
        names += ("param4", "x", "y", "z")
        values = [getattr(items[sequence], name) for name in names]
        return made("mission_item_int", system, component, sequence, *values, kind)


def refuse_file_transfer(message: Message) -> Message:
    """Return the NAK of MAVLink FTP: nothing is stored here."""
    asked = bytes(getattr(message, "payload", b"")) + bytes(12)
    sequence = int.from_bytes(asked[:2], "little") + 1
    payload = bytearray(251)
    payload[0:2] = (sequence & 0xFFFF).to_bytes(2, "little")
    payload[2] = asked[2]
    payload[3], payload[4], payload[5] = _NAK, 1, asked[3]
    payload[12] = _FILE_NOT_FOUND
    return made(
        "file_transfer_protocol", 0, message.get_srcSystem(), message.get_srcComponent(), payload
    )
