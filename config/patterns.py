"""Patterns that texts must match, and what they mean in words."""

from __future__ import annotations

import re

#: As Zenoh writes them: tcp/127.0.0.1:7447; empty where there is none.
END_POINT = r"^((tcp|udp|tls|quic|ws|vsock|serial|unixsock-stream|unixpipe)/[^ ]+)?$"
TLS_END_POINT = r"^(tls/[^/ ]+:[0-9]{1,5})?$"

_IN_WORDS = {
    END_POINT: "PROTOCOL/HOST:PORT, such as tcp/127.0.0.1:7447",
    TLS_END_POINT: "tls/HOST:PORT, such as tls/192.168.1.5:7448",
}
_NAME = re.compile(r"\^\[(?P<of>[^]]+)\]\{(?P<least>\d+),(?P<most>\d+)\}\$")
_MARKS = {"A-Za-z0-9": "letters, digits", "_": "'_'", ".": "'.'", "-": "'-'"}


def in_words(pattern: str) -> str:
    """Return what a text must be to match: ``1 to 32 letters, digits, '_' and '-'``."""
    if pattern in _IN_WORDS:
        return _IN_WORDS[pattern]
    name = _NAME.fullmatch(pattern)
    if name is None:
        return f"a text that matches {pattern}"
    beside = name["of"].replace("A-Za-z0-9", "")
    *kinds, last = [words for mark, words in _MARKS.items() if mark in ("A-Za-z0-9", *beside)]
    return f"{name['least']} to {name['most']} {', '.join(kinds)} and {last}"
