"""Figures of the daemon for Prometheus, on loopback: ``http://127.0.0.1:9478/metrics``."""

from __future__ import annotations

import logging
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Self

from prometheus_client import CollectorRegistry, start_http_server
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.registry import Collector

from mission.flight.command import MissionState, Phase
from mission.remote.history import History

log = logging.getLogger(__name__)

PREFIX = "bladescout"


class Figures(Collector):
    """Reads the newest state when it is asked for; nothing is computed in between."""

    def __init__(self, history: History, missions_dir: Path, vehicle: str) -> None:
        self._history = history
        self._missions_dir = missions_dir
        self._vehicle = vehicle
        self.deaths: dict[str, int] = {}
        """Times that each process was started again."""
        self.requests: dict[str, int] = {}
        """Replies by their code."""

    def count(self, code: str) -> None:
        """Count a reply."""
        self.requests[code] = self.requests.get(code, 0) + 1

    def collect(self) -> Iterator[Metric]:
        """Yield every figure; one that is not known is left out."""
        yield from self._gauges()
        yield from self._mission()
        for name, words, label, counts in (
            ("process_deaths", "Times that a process ended by itself.", "process", self.deaths),
            ("requests", "Requests by the code of their reply.", "code", self.requests),
        ):
            family = CounterMetricFamily(f"{PREFIX}_{name}", words, labels=("vehicle", label))
            for value, count in dict(counts).items():
                family.add_metric((self._vehicle, value), count)
            yield family

    def _gauges(self) -> Iterator[Metric]:
        state, age_s = self._history.state, self._history.state_age_s()
        free, health = _free_bytes(self._missions_dir), self._history.sensing
        rows: list[tuple[str, str, float | None]] = [
            ("state_age_seconds", "Time since the control loop was last heard.", age_s),
            ("disk_free_bytes", "Free space where missions are kept.", free),
            (
                "dropped_messages",
                "Sensor messages dropped.",
                None if health is None else health.dropped,
            ),
            (
                "lidar_online",
                "1 while the LiDAR delivers.",
                None if health is None else health.lidar_online,
            ),
            (
                "camera_online",
                "1 while the live picture comes.",
                None if health is None else health.camera_online,
            ),
        ]
        if state is not None:
            p = state.progress
            rows += [
                ("loop_lag_seconds", "Latest tick of the last second.", _ms(state.loop_lag_ms)),
                (
                    "setpoint_gap_seconds",
                    "Longest gap between setpoints in the last second.",
                    _ms(state.setpoint_gap_ms),
                ),
                ("lidar_age_seconds", "Age of the newest scan.", state.lidar_age_s),
                ("battery_ratio", "Charge left, 0 to 1.", state.battery),
                ("exposure_ev", "Exposure of the camera, EV.", state.ev),
                ("exposure_grey", "Mean grey of the blade, 0 to 255.", state.grey),
                ("clearance_meters", "Nearest surface from the airframe.", p.clearance_m),
                ("distance_meters", "Distance to the blade.", p.distance_m),
                ("stop_angle_degrees", "Stop angle of the rotor.", p.stop_angle_deg),
                ("coverage_ratio", "Share of the planned metres photographed.", p.coverage),
                ("photos", "Photos of this mission.", p.photos),
                ("autopilot_connected", "1 while the autopilot is heard.", state.link_ok),
            ]
        for name, words, value in rows:
            if value is not None:
                gauge = GaugeMetricFamily(f"{PREFIX}_{name}", words, labels=("vehicle",))
                gauge.add_metric((self._vehicle,), float(value))
                yield gauge

    def _mission(self) -> Iterator[Metric]:
        state = self._history.state
        if state is None:
            return
        p = state.progress
        for label, all_values, current in (
            ("phase", Phase, p.phase),
            ("state", MissionState, p.state),
        ):
            gauge = GaugeMetricFamily(
                f"{PREFIX}_mission_{label}",
                f"1 for the {label} it is in.",
                labels=("vehicle", label),
            )
            for value in all_values:
                gauge.add_metric((self._vehicle, str(value)), float(value == current))
            yield gauge


class MetricsServer:
    """Serves the figures on loopback; a context manager. A port that is taken is said, once."""

    def __init__(self, figures: Figures, port: int) -> None:
        self._figures = figures
        self._port = port
        self._stop: Callable[[], None] = _nothing

    def __enter__(self) -> Self:
        if not self._port:
            return self
        registry = CollectorRegistry()
        registry.register(self._figures)
        try:
            server, thread = start_http_server(self._port, addr="127.0.0.1", registry=registry)
        except OSError as error:
            log.warning("no metrics: port %d of 127.0.0.1: %s", self._port, error)
            return self

        def stop() -> None:
            server.shutdown()
            server.server_close()
            thread.join()

        self._stop = stop
        return self

    def __exit__(self, *_: object) -> None:
        self._stop()


def _nothing() -> None:
    """There is no server to stop."""


def _ms(value: float | None) -> float | None:
    return None if value is None else value / 1e3


def _free_bytes(folder: Path) -> float | None:
    while not folder.exists() and folder != folder.parent:
        folder = folder.parent
    try:
        return float(shutil.disk_usage(folder).free)
    except OSError:
        return None
