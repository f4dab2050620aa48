"""The field process whole, with its renderer."""

import json
import socket
import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest

from config.settings import Settings
from drivers.clock import SharedClock
from drivers.simulated.scene import draw_scene

pytestmark = pytest.mark.slow


def ports(count):
    sockets = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(count)]
    for each in sockets:
        each.bind(("127.0.0.1", 0))
    numbers = [each.getsockname()[1] for each in sockets]
    for each in sockets:
        each.close()
    return numbers


@pytest.fixture
def field(tmp_path):
    p = ports(9)
    lidar_ports = ("lidar_command", "host_command", "host_push", "host_point", "host_imu")
    settings = Settings.model_validate(
        {
            "autopilot": {
                "url": f"udpin://127.0.0.1:{p[0]}",
                "payload_url": f"udpin://127.0.0.1:{p[1]}",
            },
            "camera": {"stream_url": f"rtsp://127.0.0.1:{p[2]}/live"},
            "lidar": {
                "lidar_ip": "127.0.0.1",
                "host_ip": "127.0.0.1",
                **{f"{name}_port": p[4 + i] for i, name in enumerate(lidar_ports)},
            },
            "simulation": {
                "speed": 1.0,
                "camera": {"http_port": p[3]},
                "faults": [{"device": "gps", "word": "wrong", "at_s": 1.0, "for_s": 1.0}],
            },
            "sites": [{"name": "t1", "turbine": "nrel-5mw", "scale": 0.5}],
        }
    )
    (tmp_path / "settings.json").write_text(settings.model_dump_json())
    process = subprocess.Popen(
        [sys.executable, "-m", "drivers.simulated.field", str(tmp_path)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    yield process, tmp_path, settings
    if process.poll() is None:
        process.kill()
    process.wait()
    process.stdin.close()
    process.stdout.close()


def test_it_gets_ready_runs_in_mission_time_and_tells_the_truth_only_at_the_end(field):
    process, run_dir, settings = field
    assert json.loads(process.stdout.readline()) == {"ready": True}
    clock = SharedClock(run_dir / "clock")
    before = clock.now_s()
    time.sleep(3.0)
    assert 1.0 < clock.now_s() - before < 4.0
    assert not (run_dir / "truth.json").exists()
    secret = f"{draw_scene(settings).stop_angle_deg:.5f}"
    for name in ("told.json", "settings.json", "renderer.log"):
        assert secret not in (run_dir / name).read_text()
    mission = run_dir / "mission"
    mission.mkdir()
    process.stdin.write("not json\n")
    process.stdin.write(json.dumps({"finish": str(mission)}) + "\n")
    process.stdin.flush()
    assert json.loads(process.stdout.readline()) == {"finished": True}
    assert process.wait(20) == 0
    truth = json.loads((run_dir / "truth.json").read_text())
    assert truth["stop_angle_deg"] == pytest.approx(draw_scene(settings).stop_angle_deg, abs=0.01)
    assert truth["faults"][0]["device"] == "gps"
    assert truth["vehicle"]["landed"]


def test_the_end_of_its_input_ends_field_and_renderer(field):
    process, _, _ = field
    assert json.loads(process.stdout.readline()) == {"ready": True}
    children = psutil.Process(process.pid).children(recursive=True)
    process.stdin.close()
    assert process.wait(20) == 0
    _, alive = psutil.wait_procs(children, timeout=10)
    assert not alive


def test_a_renderer_that_dies_is_told_and_ends_the_field(field):
    process, _, _ = field
    assert json.loads(process.stdout.readline()) == {"ready": True}
    for child in psutil.Process(process.pid).children():
        child.kill()
    assert "renderer was lost" in json.loads(process.stdout.readline())["error"]
    assert process.wait(20) == 1


def test_a_bad_run_directory_is_no_endless_wait(tmp_path: Path):
    answer = subprocess.run(
        [sys.executable, "-m", "drivers.simulated.field", str(tmp_path)],
        stdin=subprocess.DEVNULL,
        capture_output=True,
        timeout=60,
        check=False,
    )
    assert answer.returncode != 0
