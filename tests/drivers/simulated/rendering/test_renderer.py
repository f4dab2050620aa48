from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from config.settings import Settings
from config.simulation import Word
from drivers.simulated.link import (
    CameraSetting,
    FaultChange,
    Finish,
    RenderProgress,
    StillDone,
    StillRequest,
    TruthState,
)
from drivers.simulated.renderer import Renderer
from drivers.simulated.rotor_frame import rotor_frame
from drivers.simulated.scanner import RawScan
from drivers.simulated.scene import Scene
from perception.geometry import camera_looking_along, quaternion_from_rotation
from perception.values import Bytes


class Scans:
    def __init__(self) -> None:
        self.wanted = True
        self.unsent_s = None
        self.got: list[RawScan] = []
        self.words: list[Word] = []

    def unsent_since_s(self):
        return self.unsent_s

    def send(self, scan: RawScan) -> None:
        self.got.append(scan)

    def set_fault(self, word: Word) -> None:
        self.words.append(word)

    def close(self) -> None:
        pass


class Frames:
    def __init__(self) -> None:
        self.got: list[tuple[float, Bytes]] = []

    def send(self, t_s: float, grey: Bytes) -> None:
        self.got.append((t_s, grey))

    def close(self) -> None:
        pass


class Bench:
    """A renderer whose messages and time the test holds in its hands."""

    def __init__(self, scene: Scene, settings: Settings, folder: Path) -> None:
        self.scene, self.scans, self.frames = scene, Scans(), Frames()
        self.renderer = Renderer(scene, settings, self.scans, self.frames, folder / "stills")
        self.sent = 0

    def fly(self, until_s: float) -> None:
        frame = rotor_frame(self.scene)
        blade = frame.blades[0]
        look = -blade.pressure_w()
        q = quaternion_from_rotation(camera_looking_along(look))
        camera = (float(q[0]), float(q[1]), float(q[2]), float(q[3]))
        while 0.02 * self.sent <= until_s + 1e-9:
            t_s = 0.02 * self.sent
            x, y, z = (float(v) for v in frame.hub_w + 20.0 * blade.axis_w - 12.0 * look)
            self.renderer.take(
                TruthState(t_s, (x, y, z), (0, 0, 0), (1, 0, 0, 0), (0, 0, 0), camera, 0.0)
            )
            self.sent += 1

    def work(self) -> list[RenderProgress | StillDone]:
        done: list[RenderProgress | StillDone] = []
        while (answers := self.renderer.step()) is not None:
            done += answers
        return done


@pytest.fixture
def bench(scene: Scene, settings: Settings, tmp_path: Path) -> Bench:
    return Bench(scene, settings, tmp_path)


def test_every_period_is_scanned_even_when_far_behind_and_late_frames_are_dropped(
    bench: Bench,
) -> None:
    bench.fly(2.0)
    progress = [answer for answer in bench.work() if isinstance(answer, RenderProgress)]
    assert [round(scan.t0_s, 3) for scan in bench.scans.got] == [
        round(0.1 * k, 3) for k in range(len(bench.scans.got))
    ]
    assert len(bench.scans.got) >= 19
    assert len(progress) == len(bench.scans.got)
    assert len(bench.frames.got) == 1
    assert bench.renderer.frames_dropped >= 18


def test_frames_come_at_the_streams_rate_when_there_is_time(bench: Bench) -> None:
    for k in range(11):
        bench.fly(0.1 * k)
        bench.work()
    times = [t_s for t_s, _ in bench.frames.got]
    assert np.diff(times) == pytest.approx(0.1)
    assert len(times) >= 10
    assert bench.frames.got[-1][1].shape == (480, 640)


def test_progress_tells_the_true_clearance(bench: Bench) -> None:
    bench.fly(0.3)
    progress = [answer for answer in bench.work() if isinstance(answer, RenderProgress)]
    assert progress[-1].clearance_m == pytest.approx(11.7, abs=0.6)
    assert bench.renderer.min_clearance_m == min(one.clearance_m for one in progress)


def test_scans_go_between_the_bands_of_a_photo(bench: Bench) -> None:
    bench.fly(0.2)
    bench.work()
    bench.renderer.take(StillRequest(0.2, 0))
    assert bench.renderer.step() == []  # its first band
    bench.fly(0.4)
    answers = bench.renderer.step()
    assert answers is not None
    assert isinstance(answers[0], RenderProgress)
    done = [answer for answer in bench.work() if isinstance(answer, StillDone)]
    assert [one.index for one in done] == [0]
    assert done[0].ok


def test_the_world_waits_for_a_photo_that_takes_long_to_draw(bench: Bench) -> None:
    bench.fly(0.2)
    bench.work()
    bench.renderer.take(StillRequest(0.2, 0))
    bench.renderer.step()  # its first band
    bench.fly(1.9)
    steps = [bench.renderer.step() for _ in range(15)]  # scans come first
    told = [one for step in steps for one in step or [] if isinstance(one, RenderProgress)]
    assert len(told) == 15
    assert max(one.t_s for one in told) == pytest.approx(0.8)
    last = [answer for answer in bench.work() if isinstance(answer, RenderProgress)][-1]
    assert last.t_s == pytest.approx(1.9, abs=0.11)


def test_a_photo_waits_until_the_world_has_come_to_its_time(bench: Bench) -> None:
    bench.fly(0.2)
    bench.renderer.take(StillRequest(0.5, 3))
    assert not [answer for answer in bench.work() if isinstance(answer, StillDone)]
    bench.fly(0.5)
    assert [answer for answer in bench.work() if isinstance(answer, StillDone)]


def test_a_setting_changes_the_stream_after_its_latency(bench: Bench, settings: Settings) -> None:
    bench.renderer.take(CameraSetting(0.3, "manual", 3.0))
    for k in range(8):
        bench.fly(0.1 * k)
        bench.work()
    means = {round(t_s, 1): float(grey.mean()) for t_s, grey in bench.frames.got}
    assert settings.simulation.camera.latency_s < 0.1
    assert means[0.5] > means[0.2] + 40
    assert abs(means[0.3] - means[0.2]) < 5


def test_faults_reach_the_device_they_name(bench: Bench) -> None:
    bench.renderer.take(FaultChange("lidar", "garbage"))
    assert bench.scans.words == ["garbage"]
    bench.renderer.take(FaultChange("stream", "off"))
    bench.fly(0.3)
    bench.work()
    assert not bench.frames.got
    bench.renderer.take(FaultChange("stream", "wrong"))
    bench.fly(0.6)
    bench.work()
    assert {int(grey.min()) for _, grey in bench.frames.got} <= {0, 255}


def test_a_sensor_that_does_not_measure_costs_no_rays_but_time_goes_on(bench: Bench) -> None:
    bench.scans.wanted = False
    bench.fly(0.5)
    progress = [answer for answer in bench.work() if isinstance(answer, RenderProgress)]
    assert len(progress) >= 4
    assert not bench.scans.got


def test_the_judgement_is_the_answer_to_the_end(bench: Bench, tmp_path: Path) -> None:
    bench.fly(0.5)
    bench.work()
    text = bench.renderer.take(Finish(str(tmp_path)))
    assert text is not None
    truth = json.loads(text)
    assert truth["stop_angle_deg"] == pytest.approx(20.0)
    assert math.isfinite(truth["min_clearance_m"])
