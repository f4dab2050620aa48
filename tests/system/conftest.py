"""Real processes of the product: started as a user starts them, found again by their run folder."""

import contextlib
import json
import os
import signal
import socket
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import psutil
import pytest

from config.links import Bus as BusSettings
from drivers.bus import BusUnreachable
from drivers.free_port import free_port
from mission.remote.client import Client, NoReply

ROOT = Path(__file__).parents[2]
COMMAND = (sys.executable, "-m", "mission.cli.main")


def wait_for(true, within_s, every_s=0.05):
    """Return whether something became true in time."""
    deadline = time.monotonic() + within_s
    while not true():
        if time.monotonic() > deadline:
            return False
        time.sleep(every_s)
    return True


def processes_naming(folder):
    """Return the live processes that have the folder in their arguments."""
    found = []
    for process in psutil.process_iter():
        with contextlib.suppress(psutil.Error):
            if process.status() != psutil.STATUS_ZOMBIE and str(folder) in " ".join(
                process.cmdline()
            ):
                found.append(process)
    return found


@dataclass
class Run:
    """A process that is running, or has ended, with what it printed."""

    process: subprocess.Popen
    out: Path
    err: Path

    @property
    def code(self):
        return self.process.returncode

    @property
    def stdout(self):
        return self.out.read_text()

    @property
    def stderr(self):
        return self.err.read_text()

    @property
    def sentence(self):
        """The one sentence on standard error, after making sure that it is one."""
        lines = self.stderr.strip().splitlines()
        assert len(lines) == 1, self.stderr
        assert lines[0].startswith("error: ")
        return lines[0].removeprefix("error: ")

    def wait(self, within_s):
        self.process.wait(timeout=within_s)
        return self

    def family(self):
        """Return the process and all below it."""
        parent = psutil.Process(self.process.pid)
        return [parent, *parent.children(recursive=True)]

    def interrupt_group(self):
        """Do what Ctrl-C in a terminal does."""
        os.killpg(self.process.pid, signal.SIGINT)


@pytest.fixture(name="free_port")
def _free_port():
    return free_port


@pytest.fixture(name="wait_for")
def _wait_for():
    return wait_for


@pytest.fixture
def processes_left(tmp_path):
    """Find the processes that have the test's folder in their arguments."""
    return lambda: processes_naming(tmp_path)


@contextlib.contextmanager
def launcher(folder):
    """Start commands in a folder, each in a process group of its own; none outlives the block."""
    runs = []

    def start(*words):
        number = len(runs)
        out, err = folder / f"out{number}.txt", folder / f"err{number}.txt"
        environment = os.environ | {"COLUMNS": "100", "PYTHONPATH": str(ROOT)}
        with out.open("wb") as out_file, err.open("wb") as err_file:
            process = subprocess.Popen(
                [*COMMAND, *(str(word) for word in words)],
                stdin=subprocess.DEVNULL,
                stdout=out_file,
                stderr=err_file,
                cwd=folder,
                env=environment,
                start_new_session=True,
            )
        runs.append(Run(process, out, err))
        return runs[-1]

    try:
        yield start
    finally:
        for run in runs:
            family = [] if run.process.poll() is not None else run.family()
            for process in [*family, *processes_naming(folder)]:
                with contextlib.suppress(psutil.Error):
                    process.kill()
            run.process.wait()


@pytest.fixture
def bladescout(tmp_path):
    """Start a command as a user does."""
    with launcher(tmp_path) as start:
        yield start


@dataclass(frozen=True)
class Flown:
    """A simulated mission that is over."""

    run: Run
    folder: Path
    run_dir: Path
    left: list

    @property
    def mission(self):
        return json.loads(self.run.stdout)


@pytest.fixture(scope="session")
def fly(tmp_path_factory):
    """Simulate a mission to its end, as a user does."""

    def simulate(*words, within_s=500):
        folder = tmp_path_factory.mktemp("flown")
        own = ("--out", folder / "missions", "--keep", folder / "run", "--json")
        with launcher(folder) as start:
            run = start("simulate", "demo", *own, *words).wait(within_s)
            left = processes_naming(folder)
        return Flown(run, next((folder / "missions").iterdir()), folder / "run", left)

    return simulate


@dataclass
class Daemon:
    run: Run
    router: str

    def words(self):
        """Return how the mission stands, in words; empty until flight has spoken."""
        try:
            with Client(bus=BusSettings(listen=self.router)) as client:
                reply = client.status()
        except (BusUnreachable, NoReply):
            assert self.run.process.poll() is None, self.run.stderr
            return ""
        return reply.text if reply.state is not None else ""


@pytest.fixture
def daemon(bladescout, tmp_path):
    """Start `bladescout serve` with one turbine on free ports, with no vehicle anywhere."""

    def start(*words):
        router = f"tcp/127.0.0.1:{free_port()}"
        settings = {
            "bus.listen": router,
            "autopilot.url": f"udpin://127.0.0.1:{free_port(socket.SOCK_DGRAM)}",
            "autopilot.connect_timeout_s": 2,
            "camera.stream_url": f"rtsp://127.0.0.1:{free_port()}/live",
            "missions_dir": tmp_path / "missions",
            "sites.0.name": "one",
            "sites.0.turbine": "windpact-1.5",
        }
        for kind in ("host_command", "host_push", "host_point", "host_imu"):
            settings[f"lidar.{kind}_port"] = free_port(socket.SOCK_DGRAM)
        settings["lidar.host_ip"] = settings["lidar.lidar_ip"] = "127.0.0.1"
        pairs = [word for key, value in settings.items() for word in ("--set", f"{key}={value}")]
        return Daemon(bladescout("serve", *pairs, *words), router)

    return start
