import socket
import urllib.request

from prometheus_client.parser import text_string_to_metric_families

from drivers.free_port import free_port
from mission.flight.command import MissionState, Phase, Progress
from mission.processes.metrics import Figures, MetricsServer
from mission.remote.history import History
from mission.remote.messages import StateMessage


def read(figures):
    port = free_port()
    with (
        MetricsServer(figures, port),
        urllib.request.urlopen(f"http://127.0.0.1:{port}/metrics", timeout=5) as reply,
    ):
        text = reply.read().decode()
    return {
        (
            sample.name,
            *(v for k, v in sorted(sample.labels.items()) if k != "vehicle"),
        ): sample.value
        for family in text_string_to_metric_families(text)
        for sample in family.samples
    }


def test_every_figure_of_the_newest_state_can_be_read(tmp_path):
    history = History()
    history.state = StateMessage(
        vehicle="heron",
        mission_dir="",
        site="",
        mission_s=1.0,
        factor=1.0,
        progress=Progress(Phase.TRACK, MissionState.RUNNING, "", clearance_m=9.5, photos=7),
        battery=0.8,
        lidar_age_s=0.12,
        ev=-0.3,
        loop_lag_ms=4.0,
        setpoint_gap_ms=52.0,
    )
    figures = Figures(history, tmp_path / "not" / "yet", "heron")
    figures.count("busy")
    figures.deaths["sensing"] = 2
    found = read(figures)
    for name, value in {
        "loop_lag_seconds": 0.004,
        "setpoint_gap_seconds": 0.052,
        "lidar_age_seconds": 0.12,
        "exposure_ev": -0.3,
        "battery_ratio": 0.8,
        "clearance_meters": 9.5,
        "photos": 7,
        "autopilot_connected": 1,
    }.items():
        assert found[(f"bladescout_{name}",)] == value
    assert found["bladescout_disk_free_bytes",] > 0
    assert found["bladescout_mission_phase", "track"] == 1
    assert found["bladescout_mission_phase", "idle"] == 0
    assert found["bladescout_requests_total", "busy"] == 1
    assert found["bladescout_process_deaths_total", "sensing"] == 2


def test_before_the_first_state_there_is_only_what_is_known(tmp_path):
    found = read(Figures(History(), tmp_path, "heron"))
    assert ("bladescout_battery_ratio",) not in found
    assert found["bladescout_state_age_seconds",] == float("inf")


def test_a_port_that_is_taken_is_said_and_disturbs_nothing(tmp_path, caplog):
    figures = Figures(History(), tmp_path, "heron")
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        with MetricsServer(figures, taken.getsockname()[1]):
            assert "no metrics" in caplog.text


def test_figures_can_be_switched_off(tmp_path):
    with MetricsServer(Figures(History(), tmp_path, "heron"), 0) as server:
        assert server is not None
