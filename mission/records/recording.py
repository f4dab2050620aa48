"""The recording: everything on the bus in one MCAP file, readable by the stock tools."""

from __future__ import annotations

import json
import time
from collections.abc import Mapping
from pathlib import Path

from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from mcap.writer import CompressionType, Writer
from mcap_protobuf.schema import build_file_descriptor_set
from pydantic import BaseModel

from drivers.bus import Key
from mission.remote.messages import (
    EventMessage,
    SensingHealth,
    StateMessage,
    TickRecord,
    VehicleMessage,
)

CHUNK_BYTES = 256 * 1024
_PROTOBUF: Mapping[str, type[PointCloud | CompressedImage]] = {
    Key.SCAN: PointCloud,
    Key.OCCUPANCY: PointCloud,
    Key.FRAME: CompressedImage,
}
_MODELS: Mapping[str, type[BaseModel]] = {
    Key.STATE: StateMessage,
    Key.EVENT: EventMessage,
    Key.VEHICLE: VehicleMessage,
    Key.COMMAND: TickRecord,
    Key.SENSING: SensingHealth,
}


class Recording:
    """An open MCAP file. Not thread-safe: the recorder writes from one thread."""

    def __init__(self, path: Path) -> None:
        self._file = path.open("wb")
        self._writer = Writer(self._file, chunk_size=CHUNK_BYTES, compression=CompressionType.ZSTD)
        self._writer.start(profile="", library="bladescout")
        self._channels: dict[str, int] = {}
        self._counts: dict[str, int] = {}

    def add(self, key: str, payload: bytes, mission_ns: int | None = None) -> None:
        """Append one message; its log time is UTC, its publish time mission time."""
        channel = self._channels.get(key)
        if channel is None:
            channel = self._channels[key] = self._register(key)
        now_ns = time.time_ns()
        count = self._counts[key] = self._counts.get(key, 0) + 1
        self._writer.add_message(
            channel_id=channel,
            log_time=now_ns,
            publish_time=now_ns if mission_ns is None else mission_ns,
            sequence=count,
            data=payload,
        )

    def _register(self, key: str) -> int:
        if key in _PROTOBUF:
            kind = _PROTOBUF[key]
            schema = self._writer.register_schema(
                name=kind.DESCRIPTOR.full_name,
                encoding="protobuf",
                data=build_file_descriptor_set(kind).SerializeToString(),
            )
            return int(self._writer.register_channel(f"/{key}", "protobuf", schema))
        model = _MODELS.get(key)
        described = {"type": "object"} if model is None else model.model_json_schema()
        schema = self._writer.register_schema(
            name=f"bladescout.{key.replace('/', '.')}",
            encoding="jsonschema",
            data=json.dumps(described).encode(),
        )
        return int(self._writer.register_channel(f"/{key}", "json", schema))

    def close(self) -> None:
        """Write the summary and close the file."""
        self._writer.finish()
        self._file.close()
