import asyncio

import psutil
import pytest

from mission.processes.children import Child

LEAVES_WHEN_TOLD = "import sys\nsys.stdin.read()\n"
IMPORTS_STILL = "import time\ntime.sleep(60)\n"
NEVER_LEAVES = """
import pathlib, signal, sys, time
signal.signal(signal.SIGTERM, signal.SIG_IGN)
pathlib.Path(sys.argv[1], "up").touch()
time.sleep(60)
"""
DIES = "raise SystemExit(3)\n"


@pytest.fixture
def child(tmp_path, monkeypatch):
    """Return a child whose module has the given text."""
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))

    def make(text):
        (tmp_path / "a_child.py").write_text(text)
        return Child("child", "a_child", tmp_path)

    return make


async def until(true):
    async with asyncio.timeout(10):
        while not true():  # noqa: ASYNC110 - a list that fills tells nobody
            await asyncio.sleep(0.02)


async def test_a_child_that_is_told_to_leave_leaves_and_is_not_restarted(child):
    one = child(LEAVES_WHEN_TOLD)
    deaths = []
    watching = asyncio.create_task(one.keep_alive(lambda *death: deaths.append(death)))
    await until(lambda: one.process is not None)
    pid = one.process.pid
    await one.end()
    await watching
    assert not psutil.pid_exists(pid)
    assert deaths == []


async def test_a_child_that_has_just_been_started_leaves_without_being_killed(child):
    one = child(IMPORTS_STILL)
    process = await one.start()
    await one.end(patience_s=10.0)
    assert process.returncode == -15


async def test_a_child_that_does_not_leave_is_killed(child, tmp_path):
    one = child(NEVER_LEAVES)
    process = await one.start()
    await until((tmp_path / "up").exists)
    await one.end(patience_s=0.3)
    assert process.returncode == -9


async def test_a_child_that_dies_is_told_of_and_restarted(child):
    one = child(DIES)
    deaths = []
    watching = asyncio.create_task(one.keep_alive(lambda *death: deaths.append(death)))
    await until(lambda: len(deaths) == 2)
    assert deaths == [("child", 1), ("child", 2)]
    one.ending = True
    await one.end()
    watching.cancel()


async def test_one_that_never_started_needs_no_end(child):
    await child(DIES).end()
