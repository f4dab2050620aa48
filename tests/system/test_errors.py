"""What goes wrong is told in one sentence and by the exit code, never by a traceback."""

import json
import socket
import time

import pytest

CONFIGURATION, REFUSED, DEVICE = 2, 3, 5


def test_a_file_that_is_not_toml_is_told_with_its_line(bladescout, tmp_path):
    (tmp_path / "bad.toml").write_text("vehicle = 'heron'\n[guard\n")
    run = bladescout("simulate", "bad.toml", "--json").wait(20)
    assert run.code == CONFIGURATION
    assert json.loads(run.stdout) == {
        "ok": False,
        "exit_code": CONFIGURATION,
        "error": run.sentence,
    }
    assert "bad.toml" in run.sentence
    assert "line 2" in run.sentence


@pytest.mark.parametrize(
    "words",
    [("status",), ("abort",), ("start", "one", "--operator", "Ada", "--rotor-locked"), ("watch",)],
)
def test_a_request_with_no_daemon_says_so_at_once(bladescout, free_port, words):
    router = f"tcp/127.0.0.1:{free_port()}"
    begun = time.monotonic()
    run = bladescout(*words, "--router", router).wait(20)
    assert time.monotonic() - begun < 10
    assert run.code == DEVICE
    assert router in run.sentence
    assert "bladescout serve" in run.sentence


def test_a_port_that_is_taken_ends_serve_with_a_sentence(bladescout):
    with socket.create_server(("127.0.0.1", 0)) as other:
        listen = f"tcp/127.0.0.1:{other.getsockname()[1]}"
        run = bladescout("serve", "--set", f"bus.listen={listen}").wait(20)
    assert run.code == DEVICE
    assert listen in run.sentence


def test_a_daemon_without_a_vehicle_refuses_and_explains(daemon, bladescout, wait_for):
    begun = time.monotonic()
    server = daemon()
    assert wait_for(server.words, 30)
    first_state_s = time.monotonic() - begun
    assert wait_for(lambda: "no vehicle" in server.words(), 30)
    # 5 s where the machine is free; other work on it is allowed for.
    assert first_state_s < 20
    ask = ("--operator", "Ada", "--rotor-locked", "--router", server.router)

    known = bladescout("start", "one", *ask)
    unknown = bladescout("start", "two", *ask)
    idle = bladescout("abort", "--router", server.router)
    shown = bladescout("status", "--router", server.router)
    as_json = bladescout("status", "--json", "--router", server.router)
    strange = bladescout("start", "a/b", *ask)
    for run in (known, unknown, idle, shown, as_json, strange):
        run.wait(30)

    assert known.code == DEVICE
    assert "no vehicle with system id 1 answered" in known.sentence
    assert unknown.code == REFUSED
    assert "'two'" in unknown.sentence
    assert "known: one" in unknown.sentence
    assert idle.code == REFUSED
    assert "no mission is running" in idle.sentence
    assert shown.code == 0
    assert "no vehicle" in shown.stdout
    assert json.loads(as_json.stdout)["state"]["link_ok"] is False
    assert strange.code == CONFIGURATION
    assert "a/b" in strange.sentence


@pytest.mark.slow
def test_another_simulator_that_does_not_answer_is_told_in_bounded_time(
    bladescout, free_port, tmp_path, processes_left
):
    url = f"udpin://127.0.0.1:{free_port(socket.SOCK_DGRAM)}"
    quick = ("--set", "autopilot.connect_timeout_s=3", "--keep", tmp_path / "run")
    run = bladescout("simulate", "demo", "--autopilot", url, "--json", *quick).wait(90)
    assert run.code == DEVICE
    assert json.loads(run.stdout)["exit_code"] == DEVICE
    assert url in run.sentence
    assert "no heartbeat" in run.sentence
    assert processes_left() == []
