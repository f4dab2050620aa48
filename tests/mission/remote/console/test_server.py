import http.client
import json
import re
from types import SimpleNamespace

import numpy as np
import pytest

from drivers.bus import Key
from drivers.codecs import encode_frame
from mission.flight.command import MissionState
from mission.remote.messages import Code
from perception.values import Frame

from .conftest import wait_until


def ask(server, method, path, body=None, **headers):
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=10)
    try:
        connection.request(method, path, body, headers)
        reply = connection.getresponse()
        return SimpleNamespace(
            code=reply.status, body=reply.read(), header=reply.getheader, headers=reply.headers
        )
    finally:
        connection.close()


def deed(server, verb, fields=None, **headers):
    headers = {"X-Bladescout-Token": server.token} | headers
    return ask(server, "POST", f"/ask/heron/{verb}", json.dumps(fields or {}), **headers)


def events(server, count):
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=10)
    try:
        connection.request("GET", "/live")
        reply = connection.getresponse()
        assert reply.getheader("Content-Type") == "text/event-stream"
        found = []
        while len(found) < count:
            line = reply.readline()
            if line.startswith(b"data: "):
                found.append(json.loads(line[6:]))
        return found
    finally:
        connection.close()


@pytest.fixture
def console(heron, serve):
    return serve(heron)


def test_the_page_and_all_it_needs_come_from_here_alone(console):
    _, server = console
    page = ask(server, "GET", "/")
    assert page.code == 200
    assert server.token in page.body.decode()
    assert "default-src 'self'" in page.header("Content-Security-Policy")
    wanted = re.findall(r'(?:src|href)="([^"]+)"', page.body.decode())
    texts = {name: ask(server, "GET", f"/{name}") for name in wanted}
    for name in re.findall(rb'from "\./([^"]+)"', texts["console.js"].body):
        texts[name.decode()] = ask(server, "GET", f"/{name.decode()}")
    assert set(texts) == {"console.css", "console.js", "drawing.js", "traces.js"}
    for text in texts.values():
        assert text.code == 200
        elsewhere = re.findall(rb"(?:https?:)?//[a-z0-9.]+\.[a-z]{2,}[^\s\"']*", text.body)
        assert [one for one in elsewhere if b"www.w3.org/2000/svg" not in one] == []


def test_states_come_ten_times_a_second_and_the_history_only_when_it_changed(console):
    board, server = console
    wait_until(lambda: board.history("heron") is not None)
    first, *others = events(server, 6)
    assert first["who"] == "local"
    (vehicle,) = first["vehicles"]
    assert vehicle["state"]["progress"]["stop_angle_deg"] == 61.38
    assert vehicle["age_s"] < 5
    photos = vehicle["history"]["photos"]
    assert [(photo["metre"], photo["kept"]) for photo in photos] == [
        (2.0, True),
        (5.0, True),
        (8.0, False),
    ]
    assert photos[0]["half_m"] == pytest.approx(1.8)
    assert vehicle["history"]["turbines"][0]["name"] == "hill-3"
    renewed = [v for told in others for v in told["vehicles"] if "history" in v]
    assert len(renewed) <= 1


def test_a_deed_reaches_the_vehicle_and_its_reply_the_page(console, heron):
    _, server = console
    reply = json.loads(deed(server, "abort").body)
    assert (reply["ok"], reply["code"]) == (True, Code.ACCEPTED)
    ((_, intent),) = heron.vehicles["heron"].intents
    assert intent.kind == "abort"
    heron.progress["heron"] = {"state": MissionState.IDLE}
    vehicle = heron.vehicles["heron"]
    wait_until(lambda: vehicle.history.state.progress.state is MissionState.IDLE)
    fields = {"site": "hill-3", "operator": "Ada", "rotor_locked": True, "blades": ["A"]}
    assert json.loads(deed(server, "start", fields | {"rotor_locked": False}).body)["code"] == (
        Code.NOT_CONFIRMED
    )
    assert json.loads(deed(server, "start", fields).body)["code"] == Code.STARTED


def test_a_page_of_another_site_can_ask_nothing(console, heron):
    _, server = console
    assert ask(server, "POST", "/ask/heron/abort", "{}").code == 403
    assert deed(server, "abort", **{"X-Bladescout-Token": "guess"}).code == 403
    assert deed(server, "abort", Host="evil.example").code == 421
    assert ask(server, "GET", "/", Host="evil.example").code == 421
    assert heron.vehicles["heron"].intents == []


@pytest.mark.parametrize(
    ("path", "body", "code"),
    [
        ("/ask/heron/abort", "nonsense", 400),
        ("/ask/heron/abort", "[1]", 400),
        ("/ask/heron", "{}", 400),
        ("/other/heron/abort", "{}", 400),
        ("/ask/heron/abort", "x" * 20_000, 413),
    ],
)
def test_what_is_no_request_is_refused(console, path, body, code):
    _, server = console
    reply = ask(server, "POST", path, body, **{"X-Bladescout-Token": server.token})
    assert reply.code == code


@pytest.mark.parametrize(
    ("vehicle", "verb"), [("heron", "explode"), ("*", "abort"), ("x", "abort")]
)
def test_a_verb_or_vehicle_that_is_not_known_goes_nowhere(console, heron, vehicle, verb):
    _, server = console
    headers = {"X-Bladescout-Token": server.token}
    reply = ask(server, "POST", f"/ask/{vehicle}/{verb}", "{}", **headers)
    assert json.loads(reply.body)["code"] == "bad_request"
    assert heron.vehicles["heron"].intents == []


def test_the_live_picture_is_fetched_over_the_bus_only_while_somebody_looks(console, heron):
    board, server = console
    assert ask(server, "GET", "/picture/heron").code == 204
    assert ask(server, "GET", "/picture/nobody").code == 204
    payload, _ = encode_frame(Frame(1.0, 1, np.full((36, 64), 90, np.uint8)))
    bus = heron.vehicles["heron"].bus

    def comes():
        bus.publish(Key.FRAME, payload)
        return ask(server, "GET", "/picture/heron").code == 200

    wait_until(comes)
    assert ask(server, "GET", "/picture/heron").body.startswith(b"\xff\xd8")
    board._memory("heron").looked_at_s = float("-inf")
    wait_until(lambda: not board._memory("heron").end_pictures)
    assert ask(server, "GET", "/picture/heron").code == 204
    assert "nobody" not in board._memories


def test_nothing_else_is_served(console):
    _, server = console
    for path in ("/favicon.ico", "/../server.py", "/console.html", "/page/console.js"):
        assert ask(server, "GET", path).code == 404


def test_five_vehicles_are_told_ten_times_a_second(fleet, serve):
    five = fleet("heron", "stork", "crane", "egret", "ibis")
    _, server = serve(five)
    told = events(server, 20)
    assert [vehicle["name"] for vehicle in told[-1]["vehicles"]] == sorted(five.vehicles)
    moments = {v["state"]["mission_s"] for one in told for v in one["vehicles"]}
    assert len(moments) >= 10
