"""The console's page over HTTP, on loopback: one page, live states, pictures, requests.

Nothing is served to other computers. A page of another site that a browser here has open cannot
ask in our name either: every request must name this address, and a deed must carry the token that
only our own page holds.
"""

from __future__ import annotations

import json
import logging
import secrets
import threading
from functools import partial
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files
from typing import Self, cast

from pydantic import ValidationError

from mission.remote.console.board import Board

log = logging.getLogger(__name__)

UPDATES_PER_S = 10
MAX_BODY_BYTES = 16 * 1024
_PAGE = {
    "/": ("console.html", "text/html; charset=utf-8"),
    "/console.css": ("console.css", "text/css; charset=utf-8"),
    **{
        f"/{name}": (name, "text/javascript; charset=utf-8")
        for name in ("console.js", "drawing.js", "traces.js")
    },
}
_HEADERS = {
    "Cache-Control": "no-store",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Content-Security-Policy": "default-src 'self'; img-src 'self' blob:; frame-ancestors 'none'",
}


class ConsoleServer:
    """Serves the console at ``url`` until closed; a context manager."""

    def __init__(self, board: Board, port: int) -> None:
        """Listen on 127.0.0.1; port 0 takes a free one. Raises `OSError` where it is taken."""
        self._closing = threading.Event()
        self.token = secrets.token_urlsafe(24)
        self._http = ThreadingHTTPServer(
            ("127.0.0.1", port), partial(_Handler, board, self.token, self._closing)
        )
        self._http.daemon_threads = True
        self.port = int(self._http.server_address[1])
        self.url = f"http://127.0.0.1:{self.port}/"
        self._thread = threading.Thread(target=self._http.serve_forever, name="http", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._closing.set()
        self._http.shutdown()
        self._http.server_close()
        self._thread.join()


class _Handler(BaseHTTPRequestHandler):
    """One request of the page."""

    protocol_version = "HTTP/1.1"
    server_version = "bladescout"
    sys_version = ""
    timeout = 30

    def __init__(
        self,
        board: Board,
        token: str,
        closing: threading.Event,
        *request: object,
    ) -> None:
        self._board, self._token, self._closing = board, token, closing
        super().__init__(*request)  # type: ignore[arg-type] # as the server hands them over

    def do_GET(self) -> None:
        """Answer with the page, the live stream or a picture."""
        if not self._from_here():
            return
        path = self.path.partition("?")[0]
        if path in _PAGE:
            name, kind = _PAGE[path]
            text = (files("mission.remote.console") / "page" / name).read_bytes()
            self._reply(HTTPStatus.OK, text.replace(b"{{token}}", self._token.encode()), kind)
        elif path == "/live":
            self._stream()
        elif path.startswith("/picture/"):
            picture = self._board.picture(path.removeprefix("/picture/"))
            code = HTTPStatus.OK if picture else HTTPStatus.NO_CONTENT
            self._reply(code, picture, "image/jpeg")
        else:
            self._reply(HTTPStatus.NOT_FOUND, b"not here", "text/plain")

    def do_POST(self) -> None:
        """Carry out ``/ask/<vehicle>/<verb>`` and answer with its reply."""
        length = self.headers.get("Content-Length", "")
        if not length.isdecimal() or int(length) > MAX_BODY_BYTES:
            self.close_connection = True
            self._reply(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, b"too large", "text/plain")
            return
        body = self.rfile.read(int(length))
        if not self._from_here():
            return
        if not secrets.compare_digest(self.headers.get("X-Bladescout-Token", ""), self._token):
            self._reply(HTTPStatus.FORBIDDEN, b"reload the page", "text/plain")
            return
        _, *words = self.path.split("/")
        fields = _fields_of(body)
        if len(words) != 3 or words[0] != "ask" or fields is None:
            self._reply(HTTPStatus.BAD_REQUEST, b"ask /ask/VEHICLE/VERB", "text/plain")
            return
        try:
            reply = self._board.ask(words[1], words[2], fields)
        except ValidationError:
            log.warning("the reply of %s was not understood", words[1])
            self._reply(HTTPStatus.BAD_GATEWAY, b"not understood", "text/plain")
            return
        self._reply(HTTPStatus.OK, reply.model_dump_json().encode(), "application/json")

    def _from_here(self) -> bool:
        """Refuse what was meant for another name: a page elsewhere that resolves to us."""
        port = cast("ThreadingHTTPServer", self.server).server_port
        if self.headers.get("Host") in (f"127.0.0.1:{port}", f"localhost:{port}"):
            return True
        self._reply(HTTPStatus.MISDIRECTED_REQUEST, b"not this host", "text/plain")
        return False

    def _stream(self) -> None:
        """Send events: all vehicles ten times a second, a history when it was renewed."""
        self.send_response(HTTPStatus.OK)
        self.send_header("Content-Type", "text/event-stream")
        for name, value in _HEADERS.items():
            self.send_header(name, value)
        self.send_header("Connection", "close")
        self.end_headers()
        self.close_connection = True
        sent: dict[str, object] = {}
        try:
            while not self._closing.wait(1 / UPDATES_PER_S):
                vehicles = self._board.live()
                for vehicle in vehicles:
                    name = str(vehicle["name"])
                    if sent.get(name) != vehicle["version"]:
                        sent[name] = vehicle["version"]
                        vehicle["history"] = self._board.history(name)
                told = {"who": self._board.who, "vehicles": vehicles}
                self.wfile.write(b"data: " + json.dumps(told).encode() + b"\n\n")
        except OSError:
            return  # the page was closed

    def _reply(self, code: HTTPStatus, body: bytes, kind: str) -> None:
        self.send_response(code)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(body)))
        for name, value in _HEADERS.items():
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, format: str, *values: object) -> None:  # noqa: A002 - named by the base
        """Say nothing of single requests."""


def _fields_of(body: bytes) -> dict[str, object] | None:
    try:
        fields = json.loads(body or b"{}")
    except (ValueError, RecursionError):
        return None
    return fields if isinstance(fields, dict) else None
