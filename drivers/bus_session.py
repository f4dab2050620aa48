"""How a session on the bus is opened: end points, certificates, access, limits."""

from __future__ import annotations

import json
from pathlib import Path

import zenoh

from config.links import Bus as BusSettings
from drivers.bus_access import (
    CA_FILE,
    CERTIFICATE_FILE,
    KEY_FILE,
    ROLES_FILE,
    access_control,
    read_roles,
    size_limit,
)


class BusNotSafe(ValueError):
    """The bus may not be opened like this: others could reach it unasked, or keys are missing."""


def _session_config(mode: str, entries: dict[str, object]) -> zenoh.Config:
    config = zenoh.Config()
    common: dict[str, object] = {
        "mode": mode,
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "connect/timeout_ms": 5000,
        "connect/exit_on_failure": True,
        "transport/shared_memory/enabled": False,
        "transport/link/rx/max_message_size": 64 << 20,
        "transport/link/tx/queue/size/data": 8,
    }
    for key, value in (common | entries).items():
        config.insert_json5(key, json.dumps(value))
    return config


def router_config(settings: BusSettings) -> zenoh.Config:
    """Return the configuration of a router.

    Raises `BusNotSafe` or `drivers.bus_access.BadRoles`.
    """
    if settings.exposed and not settings.insecure:
        raise BusNotSafe(
            f"bus.listen = {settings.listen} would let anyone who reaches it start missions: "
            "keep it on 127.0.0.1 and open bus.remote = tls/0.0.0.0:7448 with bus.keys instead"
        )
    entries: dict[str, object] = {
        "listen/endpoints": [end for end in (settings.listen, settings.remote) if end],
        "connect/endpoints": [settings.uplink] if settings.uplink else [],
        "listen/exit_on_failure": True,
    }
    if settings.remote or settings.uplink:
        entries |= _tls(settings)
        roles = read_roles(Path(settings.keys))
        if not roles:
            raise BusNotSafe(
                f"{Path(settings.keys) / ROLES_FILE} is missing, so nobody might ask: name a "
                "folder that bladescout keys made for a vehicle or a router"
            )
        entries["access_control"] = access_control(roles)
        entries["low_pass_filter"] = size_limit()
    if settings.uplink:
        # The vehicle flies without the ground; it is joined whenever it is there.
        entries |= {"connect/timeout_ms": -1, "connect/exit_on_failure": False}
    return _session_config("router", entries)


def client_config(settings: BusSettings) -> zenoh.Config:
    """Return the configuration of a client; raises `BusNotSafe`."""
    entries: dict[str, object] = {
        "listen/endpoints": [],
        "connect/endpoints": [settings.endpoint],
    }
    if settings.endpoint.startswith("tls/"):
        entries |= _tls(settings)
    return _session_config("client", entries)


def _tls(settings: BusSettings) -> dict[str, object]:
    """Return both sides' certificates; raises `BusNotSafe` where one is missing."""
    folder = Path(settings.keys)
    if not settings.keys:
        raise BusNotSafe(
            "TLS needs a certificate: --keys FOLDER (bus.keys), made by bladescout keys"
        )
    files = {name: folder / name for name in (CA_FILE, CERTIFICATE_FILE, KEY_FILE)}
    for file in files.values():
        if not file.is_file():
            raise BusNotSafe(f"{file} is missing: make it with bladescout keys")
    own, key = str(files[CERTIFICATE_FILE]), str(files[KEY_FILE])
    return {
        "transport/link/tls": {
            "root_ca_certificate": str(files[CA_FILE]),
            "enable_mtls": True,
            "listen_certificate": own,
            "listen_private_key": key,
            "connect_certificate": own,
            "connect_private_key": key,
            "verify_name_on_connect": settings.verify_name,
            "close_link_on_expiration": True,
        }
    }
