"""The recording: everything on the bus in one MCAP file, readable by the stock tools.

Log times are mission time, as the stamps inside scans, pictures and transforms are, so that a
viewer has one timeline; publish times are UTC. Beside what went over the bus stand channels made
for viewers (`scene.py`), and as metadata all that a replay needs: settings, turbine, version.
"""

from __future__ import annotations

import json
import math
import struct
import time
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import IO, cast

from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from google.protobuf.message import Message
from mcap.writer import CompressionType, Writer
from mcap_protobuf.schema import build_file_descriptor_set
from pydantic import BaseModel, TypeAdapter

from config.settings import Settings
from config.turbine import Turbine
from drivers.bus import Key
from mission.flight.command import SensingTask
from mission.flight.observation import (
    BladeTrack,
    ClearanceState,
    ExposureState,
    HubPrior,
    RotorEstimate,
)
from mission.records.code_digest import code_digest
from mission.records.scene import SceneView
from mission.records.spool import Spool
from mission.remote.messages import (
    EventMessage,
    FlightReport,
    Intent,
    PhotoResultMessage,
    PhotoTakenMessage,
    ReadyMessage,
    SensingHealth,
    StateMessage,
    TakenMessage,
    TickRecord,
    VehicleMessage,
)
from mission.remote.plan_message import PlanMessage

CHUNK_BYTES = 256 * 1024
#: A chunk is closed and handed to the kernel at least so often: what a kill may cost.
CHUNK_S = 0.3
METADATA = "bladescout"
_SEQUENCE = struct.Struct("<QI")

SENSOR_CHANNELS: Mapping[str, type[Message]] = {
    Key.SCAN: PointCloud,
    Key.OCCUPANCY: PointCloud,
    Key.FRAME: CompressedImage,
}
JSON_CHANNELS: Mapping[str, type] = {
    Key.STATE: StateMessage,
    Key.EVENT: EventMessage,
    Key.VEHICLE: VehicleMessage,
    Key.COMMAND: TickRecord,
    Key.SENSING: SensingHealth,
    Key.READY: ReadyMessage,
    Key.TAKEN: TakenMessage,
    Key.INTENT: Intent,
    Key.PLAN: PlanMessage,
    Key.PHOTO: PhotoTakenMessage,
    Key.PHOTO_RESULT: PhotoResultMessage,
    Key.REPORT: FlightReport,
    Key.TASK: SensingTask,
    Key.CLEARANCE: ClearanceState,
    Key.HUB_PRIOR: HubPrior,
    Key.ROTOR: RotorEstimate,
    Key.BLADE: BladeTrack,
    Key.EXPOSURE: ExposureState,
}


class Recording:
    """An open MCAP file. Not thread-safe: the recorder writes from one thread.

    A disk that fails raises nothing: `lost` says what it cost.
    """

    def __init__(
        self, path: Path, settings: Settings | None = None, turbine: Turbine | None = None
    ) -> None:
        self._spool = Spool(path)
        # The writer asks of a stream what a spool has: write, tell and flush.
        stream = cast("IO[bytes]", self._spool)
        self._writer = Writer(stream, chunk_size=CHUNK_BYTES, compression=CompressionType.ZSTD)
        self._writer.start(profile="", library=f"bladescout {version('bladescout')}")
        self._channels: dict[str, int] = {}
        self._counts: dict[str, int] = {}
        self._flushed_s = time.monotonic()
        self._last_ns = 0
        self._ended_ns: int | None = None
        self._fault = ""
        self._scene = None if settings is None else SceneView(settings)
        if settings is not None:
            self._describe(settings, turbine)

    def _describe(self, settings: Settings, turbine: Turbine | None) -> None:
        described = {
            "version": version("bladescout"),
            "code": code_digest(),
            "settings": settings.model_dump_json(),
        }
        if turbine is not None:
            described["turbine"] = turbine.model_dump_json()
        self._writer.add_metadata(METADATA, described)
        self._spool.flush()

    def add(
        self,
        key: str,
        payload: bytes,
        mission_ns: int,
        *,
        attachment: bytes | None = None,
        utc_ns: int | None = None,
    ) -> None:
        """Append one message of the bus and what viewers are shown of it.

        ``mission_ns``: mission time at which it came; ``utc_ns``: the same in UTC (None: now);
        ``attachment``: as sent beside scans and pictures, it holds their sequence.
        """
        utc_ns = time.time_ns() if utc_ns is None else utc_ns
        count = self._counts[key] = self._counts.get(key, 0) + 1
        sequence = count
        if attachment is not None and len(attachment) == _SEQUENCE.size:
            sequence = _SEQUENCE.unpack(attachment)[0] & 0xFFFFFFFF
        self._put(key, payload, mission_ns, utc_ns, sequence)
        if self._scene is not None:
            for topic, message in self._scene.of(key, payload, mission_ns):
                self._put(topic, message.SerializeToString(), mission_ns, utc_ns, count, message)
        self._flush_when_due(mission_ns)

    def _put(
        self,
        topic: str,
        payload: bytes,
        mission_ns: int,
        utc_ns: int,
        sequence: int,
        message: Message | None = None,
    ) -> None:
        channel = self._channels.get(topic)
        if channel is None:
            channel = self._channels[topic] = self._register(topic, message)
        self._writer.add_message(
            channel_id=channel,
            log_time=mission_ns,
            publish_time=utc_ns,
            sequence=sequence,
            data=payload,
        )

    def _flush_when_due(self, mission_ns: int) -> None:
        now_s = time.monotonic()
        if now_s - self._flushed_s >= CHUNK_S:
            self._flushed_s = now_s
            self._writer.flush()
            self._fault = self._spool.fault or self._fault
        if self._spool.ended and self._ended_ns is None:
            self._ended_ns = self._last_ns
        self._last_ns = mission_ns

    def _register(self, topic: str, message: Message | None) -> int:
        told = schema_of(topic, message)
        schema = self._writer.register_schema(
            name=told.name, encoding=told.encoding, data=told.data
        )
        channel = self._writer.register_channel(f"/{topic}", told.message_encoding, schema)
        return int(channel)

    def lost(self) -> tuple[str, ...]:
        """Return what the recording lacks, in words; empty: nothing."""
        if self._spool.ended:
            after_s = (self._last_ns if self._ended_ns is None else self._ended_ns) * 1e-9
            return (f"the recording ends at mission second {after_s:.0f}: {self._fault}",)
        return ()

    def close(self) -> None:
        """Write the summary and close the file."""
        self._writer.finish()
        self._spool.close()
        self._fault = self._spool.fault or self._fault


@dataclass(frozen=True, slots=True)
class ChannelSchema:
    """What a reader is told of a channel."""

    name: str
    encoding: str
    """Of the schema."""
    data: bytes
    message_encoding: str


def schema_of(topic: str, message: Message | None = None) -> ChannelSchema:
    """Return the schema of a key of the bus, or of what viewers are shown beside (``message``)."""
    kind = SENSOR_CHANNELS.get(topic) if message is None else type(message)
    if kind is not None:
        data = build_file_descriptor_set(kind).SerializeToString()
        return ChannelSchema(kind.DESCRIPTOR.full_name, "protobuf", data, "protobuf")
    name = f"bladescout.{topic.replace('/', '.')}"
    return ChannelSchema(
        name, "jsonschema", json.dumps(_json_schema(topic), allow_nan=False).encode(), "json"
    )


def _json_schema(topic: str) -> dict[str, object]:
    kind = JSON_CHANNELS.get(topic)
    if kind is None:
        return {"type": "object"}
    if issubclass(kind, BaseModel):
        return _without_infinity(kind.model_json_schema())
    return _without_infinity(TypeAdapter(kind).json_schema())


def _without_infinity(schema: dict[str, object]) -> dict[str, object]:
    """Leave out what is no JSON: viewers do not read a channel whose schema they cannot parse."""
    found: dict[str, object] = {}
    for key, value in schema.items():
        if isinstance(value, dict):
            found[key] = _without_infinity(value)
        elif not (isinstance(value, float) and not math.isfinite(value)):
            found[key] = value
    return found
