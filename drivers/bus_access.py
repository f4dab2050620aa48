"""Who may do what on the bus: roles, and Zenoh's access control made from them.

A client asks on ``rpc/<verb>/<name>``, and the router lets a certificate ask only below its own
common name: so a request's key tells who asks, and nobody can ask in another's name. What is not
allowed here is dropped by the router before any of our code sees it.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping, Sequence
from enum import StrEnum
from pathlib import Path

import tomli_w

ROLES_FILE = "roles.toml"
CA_FILE, CERTIFICATE_FILE, KEY_FILE = "ca.pem", "cert.pem", "key.pem"
#: Who asks over loopback, where there are no certificates.
LOCAL = "local"
MAX_REMOTE_REQUEST_BYTES = 1 << 20
NAME = re.compile(r"[A-Za-z0-9_-]{1,32}")


class Role(StrEnum):
    """What the holder of a certificate may do."""

    VIEWER = "viewer"
    OPERATOR = "operator"
    PILOT = "pilot-in-command"
    VEHICLE = "vehicle"
    """A vehicle's own daemon, which joins a site's router."""
    ROUTER = "router"
    """A site's router, which carries the requests of those whom it has let in itself."""


#: What is only told, and changes nothing.
QUERIES = ("status", "turbines", "history")
#: Ending a flight is open to more people than beginning one.
VERBS: Mapping[Role, tuple[str, ...]] = {
    Role.VIEWER: QUERIES,
    Role.PILOT: (*QUERIES, "pause", "stop", "abort"),
    Role.OPERATOR: (*QUERIES, "start", "pause", "resume", "skip", "stop", "abort"),
}
ALL_VERBS = VERBS[Role.OPERATOR]
#: What is published to people; intents, ticks and scans stay on the vehicle.
SHOWN = (
    "mission/state",
    "mission/event",
    "mission/photo",
    "mission/photo_result",
    "mission/recorded",
    "perception/rotor",
    "perception/clearance",
    "perception/exposure",
    "perception/metering",
    "sensor/camera/frame",
    "vehicle/state",
)
Flow = tuple[Sequence[str], Sequence[str], Sequence[str]]
"""Directions seen from the router, kinds of message, and keys."""
_IN, _OUT, _BOTH = ("ingress",), ("egress",), ("ingress", "egress")
_ALL_MESSAGES = (
    "put",
    "delete",
    "query",
    "reply",
    "declare_subscriber",
    "declare_queryable",
    "liveliness_token",
    "liveliness_query",
    "declare_liveliness_subscriber",
)


def request_key(verb: str, who: str) -> str:
    """Return the key below a vehicle's on which ``who`` asks for ``verb``."""
    return f"rpc/{verb}" if who == LOCAL else f"rpc/{verb}/{who}"


class BadRoles(ValueError):
    """The file of roles cannot be used."""


def read_roles(keys: Path) -> dict[str, Role]:
    """Return the role of each certificate name; no file, no rights. Raises `BadRoles`."""
    path = keys / ROLES_FILE
    try:
        table = tomllib.loads(path.read_text()).get("roles", {})
    except FileNotFoundError:
        return {}
    except OSError as error:
        raise BadRoles(f"{path} cannot be read: {error.strerror or error}") from error
    except ValueError as error:
        raise BadRoles(f"{path}: not valid TOML: {error}") from error
    roles: dict[str, Role] = {}
    for name, role in table.items():
        check_name(name)
        if role not in set(Role):
            known = ", ".join(Role)
            raise BadRoles(f"{path}: {name} = {role!r}: a role is one of {known}")
        roles[name] = Role(role)
    return roles


def check_name(name: str) -> None:
    """Raise `BadRoles` where a name could not stand in a key of the bus."""
    if NAME.fullmatch(name) is None or name == LOCAL:
        raise BadRoles(f"{name!r} is not a name: 1 to 32 letters, digits, '_' and '-'")


def write_roles(path: Path, roles: Mapping[str, Role]) -> None:
    """Write the file that `read_roles` reads."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(tomli_w.dumps({"roles": {name: str(role) for name, role in roles.items()}}))


def access_control(roles: Mapping[str, Role]) -> dict[str, object]:
    """Return Zenoh's `access_control`: nothing is allowed that is not named here.

    Connections without TLS are this computer's own processes (see `config.links.Bus.listen`).
    """
    access = _Access()
    access.grant("here", {"link_protocols": ["tcp"]}, ((_BOTH, _ALL_MESSAGES, ("**",)),))
    for name, role in roles.items():
        if role is Role.VEHICLE:
            flows = _flows_of_vehicle(f"bladescout/{name}")
        elif role is Role.ROUTER:
            flows = _flows_of_person([f"bladescout/*/rpc/{verb}/*" for verb in ALL_VERBS])
        else:
            flows = _flows_of_person([f"bladescout/*/rpc/{verb}/{name}" for verb in VERBS[role]])
        who = {"link_protocols": ["tls"], "cert_common_names": [name]}
        access.grant(f"certificate {name}", who, flows)
    return access.table()


def size_limit() -> list[dict[str, object]]:
    """Return Zenoh's `low_pass_filter`: larger requests from afar are dropped."""
    return [
        {
            "id": "remote requests",
            "link_protocols": ["tls"],
            "flows": list(_IN),
            "messages": ["query"],
            "key_exprs": ["**"],
            "size_limit": MAX_REMOTE_REQUEST_BYTES,
        }
    ]


def _flows_of_person(requests: Sequence[str]) -> tuple[Flow, ...]:
    """Return what may come from, and go to, someone who watches and asks."""
    shown = [f"bladescout/*/{key}" for key in SHOWN]
    alive = ["bladescout/*/alive"]
    return (
        (_IN, ("declare_subscriber",), shown),
        (_OUT, ("put",), shown),
        (_IN, ("liveliness_query", "declare_liveliness_subscriber"), alive),
        (_OUT, ("liveliness_token",), alive),
        (_IN, ("query",), requests),
        (_OUT, ("reply", "declare_queryable"), [*requests, "bladescout/*/rpc/**"]),
    )


def _flows_of_vehicle(prefix: str) -> tuple[Flow, ...]:
    """Return what a site's router takes from a vehicle below its own name, and passes on to it."""
    shown = [f"{prefix}/{key}" for key in SHOWN]
    anyone = [f"bladescout/*/{key}" for key in SHOWN]
    alive, requests = [f"{prefix}/alive"], [f"{prefix}/rpc/**"]
    return (
        (_IN, ("put",), shown),
        (_OUT, ("declare_subscriber",), [*shown, *anyone]),
        (_IN, ("liveliness_token",), alive),
        (
            _OUT,
            ("liveliness_query", "declare_liveliness_subscriber"),
            [*alive, "bladescout/*/alive"],
        ),
        (_IN, ("reply", "declare_queryable"), requests),
        (_OUT, ("query",), requests),
    )


class _Access:
    """Rules, subjects and policies as they grow."""

    def __init__(self) -> None:
        self._rules: list[dict[str, object]] = []
        self._subjects: list[dict[str, object]] = []
        self._policies: list[dict[str, object]] = []

    def grant(self, subject: str, who: Mapping[str, object], flows: Sequence[Flow]) -> None:
        """Let a subject exchange these messages."""
        names = [f"{subject} {number}" for number in range(len(flows))]
        for name, (directions, messages, keys) in zip(names, flows, strict=True):
            self._rules.append(
                {
                    "id": name,
                    "permission": "allow",
                    "flows": list(directions),
                    "messages": list(messages),
                    "key_exprs": list(keys),
                }
            )
        self._subjects.append({"id": subject, **who})
        self._policies.append({"rules": names, "subjects": [subject]})

    def table(self) -> dict[str, object]:
        """Return the whole, as Zenoh reads it."""
        return {
            "enabled": True,
            "default_permission": "deny",
            "rules": self._rules,
            "subjects": self._subjects,
            "policies": self._policies,
        }
