"""However a command ends, no process of it stays behind."""

import os
import signal
import time

import psutil
import pytest


@pytest.fixture
def up(daemon, wait_for):
    """Start a daemon and wait until all its processes are up."""
    server = daemon()
    assert wait_for(server.words, 30)
    assert wait_for(lambda: len(server.run.family()) >= 6, 30)
    return server


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_daemon_that_is_told_to_end_is_gone_soon_with_all_its_processes(up, number):
    family = up.run.family()
    begun = time.monotonic()
    up.run.process.send_signal(number)
    up.run.wait(15)
    # 5 s where the machine is free; other work on it is allowed for.
    assert time.monotonic() - begun < 5 + 5 * busy()
    assert up.run.code == 0
    assert "Traceback" not in up.run.stderr
    assert psutil.wait_procs(family, timeout=1)[1] == []


def busy():
    return min(1.0, os.getloadavg()[0] / (2 * (os.cpu_count() or 1)))


def test_a_daemon_that_is_killed_leaves_no_children(up):
    family = up.run.family()
    up.run.process.kill()
    up.run.wait(5)
    assert psutil.wait_procs(family, timeout=15)[1] == []


@pytest.mark.slow
@pytest.mark.parametrize("way", ["ctrl-c", "kill"])
def test_a_simulation_that_is_broken_off_leaves_nothing(
    bladescout, tmp_path, wait_for, processes_left, way
):
    run = bladescout("simulate", "demo", "--keep", tmp_path / "run", "--out", tmp_path / "out")
    # In the air, or nearly: all the processes of field and daemon are there.
    assert wait_for(lambda: len(run.family()) >= 9, 90), run.stderr
    family = run.family()
    if way == "ctrl-c":
        run.interrupt_group()
    else:
        run.process.kill()
    run.wait(40)
    assert psutil.wait_procs(family, timeout=20)[1] == []
    assert processes_left() == []
    if way == "ctrl-c":
        assert run.code == 4
        assert "interrupted" in run.sentence
