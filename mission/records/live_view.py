"""What a recording would hold, as it comes: for viewers that are connected live."""

from __future__ import annotations

from collections.abc import Callable

from google.protobuf.message import Message

from config.settings import Settings
from drivers.bus import Sample
from mission.records.recording import ChannelSchema, schema_of
from mission.records.scene import SceneView

#: Requests and replies are not shown.
_NOT_SHOWN = ("rpc/", "alive")

Log = Callable[[bytes], None]


class LiveView:
    """Hands samples of the bus, and the scene made of them, to a viewer's channels."""

    def __init__(self, settings: Settings, open_channel: Callable[[str, ChannelSchema], Log]):
        """``open_channel``: asked once for each topic; returns what logs a message on it."""
        self._scene = SceneView(settings)
        self._open_channel = open_channel
        self._channels: dict[str, Log] = {}

    def take(self, sample: Sample, now_ns: int) -> None:
        """Show one sample; ``now_ns``: the time of what has no stamp of its own."""
        if sample.key.startswith(_NOT_SHOWN):
            return
        self._channel(sample.key)(sample.payload)
        for topic, message in self._scene.of(sample.key, sample.payload, now_ns):
            self._channel(topic, message)(message.SerializeToString())

    def _channel(self, topic: str, message: Message | None = None) -> Log:
        log = self._channels.get(topic)
        if log is None:
            told = schema_of(topic, message)
            log = self._channels[topic] = self._open_channel(f"/{topic}", told)
        return log
