"""The renderer process: LiDAR rays, live frames, photos; apart from the world and its autopilot.

``python -m drivers.simulated.renderer RUN_DIR``. RUN_DIR holds ``settings.json``, ``clock``,
``authkey`` and the world's socket ``renderer.sock``. Scans come first and are never left out;
photos are drawn in bands between them; live frames take what time is left, skipped when late.
"""

from __future__ import annotations

import logging
import math
import os
import signal
import sys
from collections import deque
from collections.abc import Iterator
from multiprocessing.connection import Client, Connection
from pathlib import Path

import numpy as np
from pydantic import TypeAdapter

from config.settings import Settings
from config.simulation import Word
from drivers.clock import SharedClock
from drivers.simulated.camera_model import ExposureControl
from drivers.simulated.judge import judgement
from drivers.simulated.light import Sky
from drivers.simulated.link import (
    CameraSetting,
    FaultChange,
    Finish,
    Judgement,
    RenderProgress,
    StillDone,
    StillRequest,
    TruthState,
)
from drivers.simulated.live_stream import LiveStream
from drivers.simulated.outlets import open_outlets
from drivers.simulated.picture import Picture
from drivers.simulated.raycaster import Raycaster
from drivers.simulated.scanner import Scanner
from drivers.simulated.scene import Scene, draw_scene
from drivers.simulated.sinks import FrameSink, ScanSink
from drivers.simulated.stills import LATE_S, StillCamera, StillServer
from drivers.simulated.texture import draw_defects
from drivers.simulated.truth_history import TruthHistory
from perception.geometry import rotation_from_quaternion
from perception.values import CameraPose

log = logging.getLogger(__name__)

SCAN_S = 0.1
#: A camera has stored a photo so soon; the world waits for one that takes much longer to draw.
_STILL_S = 0.6
_WORD: TypeAdapter[Word] = TypeAdapter(Word)
_NICE = 10
_IDLE_S = 0.004
_CHORD_STATIONS = 50


class Renderer:
    """Everything that is drawn of one scene; fed with messages, worked in small steps."""

    def __init__(
        self, scene: Scene, settings: Settings, scans: ScanSink, frames: FrameSink, folder: Path
    ) -> None:
        self._scene, self._settings, self._scans = scene, settings, scans
        simulation = settings.simulation
        self._caster = Raycaster(scene, settings)
        self._history = TruthHistory()
        self._scanner = Scanner(
            self._caster,
            self._history,
            settings.lidar,
            simulation.seed,
            simulation.weather.fog_extinction_per_m,
        )
        self._control = ExposureControl(simulation.camera)
        sky, blade = Sky(simulation.weather, simulation.seed), scene.turbine.blade
        chord = np.interp(np.linspace(0, 1, _CHORD_STATIONS), blade.span, blade.chord_m)
        length = scene.turbine.blade_length_m
        picture = Picture(
            self._caster,
            settings.camera,
            draw_defects(length, chord.astype(np.float32), simulation.seed),
            length,
        )
        self._live = LiveStream(picture, sky, self._control, settings, frames)
        self._stills = StillCamera(picture, sky, self._control, settings, folder)
        self._requests: deque[StillRequest] = deque()
        self._drawing: Iterator[StillDone | None] | None = None
        self._drawn_s = math.nan
        self._late: deque[StillDone] = deque()
        self._next_scan_s = self._next_frame_s = math.nan
        self.min_clearance_m = math.inf
        self._clearance_m = math.inf
        self._told_s = math.inf
        self.frames_dropped = 0

    def warm_up(self) -> None:
        """Compile and build everything that the first scan and the first frame would wait for."""
        eye = np.array([[0.0, 0.0, 2000.0]], np.float32)
        self._caster.clearance_m(eye, 0.0)
        state = TruthState(0.0, (0, 0, 2000.0), (0, 0, 0), (1, 0, 0, 0), (0, 0, 0), (1, 0, 0, 0), 0)
        history = TruthHistory()
        history.add(state)
        Scanner(self._caster, history, self._settings.lidar, 0).scan(0.0, 0.01)
        pose = CameraPose(0.0, np.array([0.0, -60.0, 40.0]), np.eye(3))
        self._live.warm_up(pose)
        self._stills.warm_up(pose)

    def take(self, message: object) -> str | None:
        """Take a message of the world; the answer to `Finish` is the judgement's text."""
        if isinstance(message, TruthState):
            self._take_state(message)
        elif isinstance(message, CameraSetting):
            self._control.set(message)
        elif isinstance(message, StillRequest):
            self._requests.append(message)
        elif isinstance(message, FaultChange):
            self._take_fault(message)
        elif isinstance(message, Finish):
            return self._judge(Path(message.mission_dir))
        return None

    def step(self) -> list[RenderProgress | StillDone] | None:
        """Do the most urgent piece of work that is due; None when nothing is."""
        newest = self._history.newest_s
        if newest >= self._next_scan_s + SCAN_S:
            return [self._scan()]
        if self._late and self._late[0].t_s + LATE_S <= newest:
            return [self._late.popleft()]
        if self._drawing is not None or (self._requests and self._requests[0].t_s <= newest):
            return self._draw_still()
        if newest >= self._next_frame_s:
            self._show_frame(newest)
            return []
        return self._sent_meanwhile()

    def _take_state(self, state: TruthState) -> None:
        if math.isnan(self._next_scan_s):
            self._next_scan_s = self._next_frame_s = state.t_s
        self._history.add(state)

    def _take_fault(self, change: FaultChange) -> None:
        if change.device == "lidar":
            self._scans.set_fault(_WORD.validate_python(change.word))
        elif change.device == "stream":
            self._live.fault = change.word
        elif change.device == "camera":
            # An unplugged camera has no stream either.
            self._stills.fault = change.word
            self._live.fault = change.word

    def _scan(self) -> RenderProgress:
        t0_s = max(self._next_scan_s, self._history.oldest_s)
        end_s = t0_s + SCAN_S
        if self._scans.wanted:
            self._scans.send(self._scanner.scan(t0_s, SCAN_S))
        self._next_scan_s = end_s
        states = self._history.between(t0_s, end_s)
        places = np.array([state.position_w for state in states], np.float32).reshape(-1, 3)
        clearance = (
            float(self._caster.clearance_m(places, end_s).min()) if len(places) else math.inf
        )
        self.min_clearance_m = min(self.min_clearance_m, clearance)
        self._clearance_m = clearance
        self._told_s = self._done_s()
        return RenderProgress(self._told_s, clearance)

    def _done_s(self) -> float:
        """Return until when all is out: scans when their packets left, stills soon after theirs."""
        unsent_s = self._scans.unsent_since_s()
        ends = [self._next_scan_s]
        if unsent_s is not None:
            ends.append(unsent_s + SCAN_S)
        if self._requests:
            ends.append(self._requests[0].t_s + _STILL_S)
        if self._drawing is not None:
            ends.append(self._drawn_s + _STILL_S)
        return min(ends)

    def _sent_meanwhile(self) -> list[RenderProgress | StillDone] | None:
        """Tell a waiting world that the packets it waited for have left."""
        done_s = self._done_s()
        if not done_s > self._told_s:
            return None
        self._told_s = done_s
        return [RenderProgress(done_s, self._clearance_m)]

    def _draw_still(self) -> list[RenderProgress | StillDone]:
        if self._drawing is None:
            request = self._requests.popleft()
            self._drawn_s = request.t_s
            states = self._history.between(request.t_s - 0.05, request.t_s + 0.05)
            state = states[len(states) // 2] if states else self._history.newest()
            self._drawing = self._stills.take(request, self._pose(request.t_s), state)
        done = next(self._drawing)
        if done is None:
            return []
        self._drawing = None
        if self._stills.fault in ("slow", "delayed"):
            self._late.append(done)
            return []
        return [done]

    def _show_frame(self, newest_s: float) -> None:
        period = 1.0 / self._settings.simulation.camera.stream_fps
        behind = math.floor((newest_s - self._next_frame_s) / period)
        self.frames_dropped += behind
        t_s = self._next_frame_s + behind * period
        self._next_frame_s = t_s + period
        self._live.show(t_s, self._pose(t_s))

    def _pose(self, t_s: float) -> CameraPose:
        positions, quaternions = self._history.body(np.array([t_s]))
        offset = rotation_from_quaternion(quaternions[0]) @ np.asarray(
            self._settings.camera.offset_m
        )
        rotation = rotation_from_quaternion(self._history.camera(t_s))
        return CameraPose(t_s, positions[0].astype(float) + offset, rotation)

    def _judge(self, mission_dir: Path) -> str:
        return judgement(
            self._scene,
            self._settings,
            self._caster,
            self._stills.truths,
            self.min_clearance_m,
            self._history.newest_s if math.isfinite(self._history.newest_s) else 0.0,
            mission_dir,
        )


def serve(renderer: Renderer, connection: Connection) -> None:
    """Work until the mission has been judged or the world is gone."""
    while True:
        waiting = connection.poll(0.0)
        while waiting:
            text = renderer.take(connection.recv())
            if text is not None:
                connection.send(Judgement(text))
                return
            waiting = connection.poll(0.0)
        answers = renderer.step()
        if answers is None:
            connection.poll(_IDLE_S)
            continue
        for answer in answers:
            connection.send(answer)


def main(run_dir: Path) -> None:
    """Run the process: connect to the world, draw, judge, leave."""
    os.setpriority(os.PRIO_PROCESS, 0, _NICE)
    # The sensor's sender must get its turn beside the casting, thousands of times a second.
    sys.setswitchinterval(0.0005)
    # The world ends this process through the link; a terminal's Ctrl-C reaches all at once.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    settings = Settings.model_validate_json((run_dir / "settings.json").read_text("utf-8"))
    clock = SharedClock(run_dir / "clock")
    folder = run_dir / "stills"
    with open_outlets(settings, clock) as (scans, frames):
        renderer = Renderer(draw_scene(settings), settings, scans, frames, folder)
        renderer.warm_up()
        server = StillServer(folder, settings.simulation.camera.http_port)
        key = (run_dir / "authkey").read_bytes()
        try:
            with Client(str(run_dir / "renderer.sock"), "AF_UNIX", authkey=key) as connection:
                serve(renderer, connection)
        except (EOFError, ConnectionError):
            log.info("the world is gone")
        finally:
            server.close()


if __name__ == "__main__":
    logging.basicConfig(level=logging.INFO, format="renderer: %(message)s")
    main(Path(sys.argv[1]))
