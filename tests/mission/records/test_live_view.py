import pytest

from config.settings import Settings
from drivers.bus import Key, Sample
from mission.flight.observation import FlightMode, Vehicle
from mission.records.live_view import LiveView
from mission.remote.messages import EventMessage, VehicleMessage


def samples():
    vehicle = Vehicle(
        1.0, (3.0, -4.0, 50.0), (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0), 0.0, FlightMode.OFFBOARD,
        1.0, True, True, False, 1.0,
    )  # fmt: skip
    event = EventMessage(mission_s=2.0, name="phase", severity="warn", text="late")
    yield Sample(Key.VEHICLE, VehicleMessage(vehicle=vehicle).model_dump_json().encode(), None)
    yield Sample(Key.EVENT, event.model_dump_json().encode(), None)
    yield Sample(Key.VEHICLE, b"{broken", None)
    yield Sample("rpc/start", b"{}", None)


def test_a_viewer_is_given_what_is_recorded_each_topic_opened_once():
    opened, logged = {}, []

    def open_channel(topic, told):
        assert topic not in opened
        opened[topic] = told.name
        return lambda data: logged.append((topic, data))

    view = LiveView(Settings(), open_channel)
    for sample in samples():
        view.take(sample, 1_000_000_000)
    assert opened == {
        "/vehicle/state": "bladescout.vehicle.state",
        "/view/transforms": "foxglove.FrameTransforms",
        "/view/pose": "foxglove.PoseInFrame",
        "/mission/event": "bladescout.mission.event",
        "/view/log": "foxglove.Log",
    }
    assert [topic for topic, _ in logged].count("/vehicle/state") == 2


def test_the_sdk_takes_the_channels_and_serves_them():
    foxglove = pytest.importorskip("foxglove", reason="the extra `live` is not installed")

    def open_channel(topic, told):
        schema = foxglove.Schema(name=told.name, encoding=told.encoding, data=told.data)
        return foxglove.Channel(topic, schema=schema, message_encoding=told.message_encoding).log

    server = foxglove.start_server(host="127.0.0.1", port=0)
    try:
        view = LiveView(Settings(), open_channel)
        for sample in samples():
            view.take(sample, 1_000_000_000)
        assert server.port > 0
    finally:
        server.stop()
