"""A recorded mission as a replay reads it: its messages in the order they came, and its settings.

A recording that was cut short (a killed recorder, a full disk) is read up to where it ends.
"""

from __future__ import annotations

import json
import struct
import tomllib
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from zlib import error as ZlibError  # noqa: N812 - an exception's name

from mcap.exceptions import McapError
from mcap.records import Channel, McapRecord, Message, Metadata
from mcap.stream_reader import StreamReader
from pydantic import ValidationError

from config.errors import ConfigError
from config.presets import load_turbine
from config.recorded import recorded_settings
from config.settings import Settings
from config.turbine import Turbine
from drivers.bus import Key
from mission.flight.observation import RequestKind
from mission.records.files import CONFIG, RECORDING
from mission.records.recording import METADATA
from mission.remote.messages import Intent


class NotARecording(ValueError):
    """There is no recording that can be replayed."""


@dataclass(frozen=True, slots=True)
class Recorded:
    """One message of the recording."""

    key: str
    payload: bytes
    sequence: int
    """As the sensor counted, for scans and pictures; else of its channel."""
    mission_s: float


@dataclass(frozen=True, slots=True)
class Mission:
    """What the mission was flown with."""

    settings: Settings
    turbine: Turbine
    intent: Intent
    version: str
    """Of the program that flew it; empty: not told."""
    code: str
    """Digest of the code that flew it (`code_digest`); empty: not told."""
    gone: tuple[str, ...] = ()
    """Settings of then that this version no longer has."""


_MAGIC = b"\x89MCAP0\r\n"


class RecordedMission:
    """The recording of one mission: a folder that a mission left, or its MCAP file."""

    def __init__(self, place: Path) -> None:
        self.path = place / RECORDING if place.is_dir() else place
        if not self.path.is_file():
            raise NotARecording(f"{place} holds no {RECORDING}")
        with self.path.open("rb") as file:
            if file.read(len(_MAGIC)) != _MAGIC:
                raise NotARecording(f"{self.path} is no MCAP file: its first bytes are others")
        self.cut_short = False
        """Found while reading: the file ends without its summary."""

    def messages(self, keys: Collection[str] = ()) -> Iterator[Recorded]:
        """Yield the messages of the given keys (all, if none is given), in the order they came."""
        channels: dict[int, str] = {}
        by_log_time = bool(self._described)
        for record in self._records():
            if isinstance(record, Channel):
                channels[record.id] = record.topic.removeprefix("/")
            elif isinstance(record, Message):
                key = channels[record.channel_id]
                if keys and key not in keys:
                    continue
                # Recordings without a description have mission time as publish time.
                stamp_ns = record.log_time if by_log_time else record.publish_time
                yield Recorded(key, record.data, record.sequence, stamp_ns * 1e-9)

    def _records(self) -> Iterator[McapRecord]:
        with self.path.open("rb") as file:
            try:
                yield from StreamReader(file).records
            except (McapError, EOFError, struct.error, ZlibError, ValueError):
                # Whatever the torn end looks like to the reader: what came before is whole.
                self.cut_short = True

    @cached_property
    def _described(self) -> dict[str, str]:
        for record in self._records():
            if isinstance(record, Metadata) and record.name == METADATA:
                return dict(record.metadata)
            if isinstance(record, Message):
                break
        return {}

    @cached_property
    def mission(self) -> Mission:
        """What the mission was flown with. Raises `NotARecording`."""
        intent = self._intent()
        settings, gone = self._settings()
        described = self._described
        try:
            if "turbine" in described:
                turbine = Turbine.model_validate_json(described["turbine"])
            else:
                site = next(site for site in settings.sites if site.name == intent.site)
                turbine = load_turbine(site.turbine, site.scale)
        except (ValidationError, ConfigError, StopIteration) as error:
            raise NotARecording(f"{self.path}: the turbine is not known: {error}") from error
        version, code = described.get("version", ""), described.get("code", "")
        return Mission(settings, turbine, intent, version, code, gone)

    def _intent(self) -> Intent:
        for message in self.messages({Key.INTENT}):
            intent = Intent.model_validate_json(message.payload)
            if intent.kind is RequestKind.START:
                return intent
        raise NotARecording(f"{self.path}: no mission was started in it")

    def _settings(self) -> tuple[Settings, tuple[str, ...]]:
        try:
            if "settings" in self._described:
                return recorded_settings(json.loads(self._described["settings"]))
            config = self.path.parent / CONFIG
            return recorded_settings(tomllib.loads(config.read_text()))
        except (OSError, ValueError) as error:
            raise NotARecording(f"{self.path}: its settings cannot be read: {error}") from error
