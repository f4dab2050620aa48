"""What recording and reporting cost: a recorder's share of a core, and the page of 300 photos."""

from __future__ import annotations

import asyncio
import re
import shutil
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import psutil

from benchmarks.recording_feed import FedRecorder
from benchmarks.report_mission import write_mission
from benchmarks.row import Row
from mission.records.files import LINK
from mission.records.report import write_report
from mission.replay.recorded import RecordedMission

_SETTLE_S = 4.0


def measure(seconds: float, photos: int) -> Iterator[Row]:
    """Yield every figure; ``seconds``: how long the recorder is fed, by the wall clock."""
    yield from asyncio.run(_recorder(seconds))
    yield from _report(photos)


async def _recorder(seconds: float) -> list[Row]:
    with tempfile.TemporaryDirectory(prefix="bladescout-bench-") as name:
        folder = Path(name) / "mission"
        async with FedRecorder(Path(name)) as fed:
            process = await fed.start(folder)
            await fed.feed(_SETTLE_S)
            before, begun_s = _cpu_s(process), time.monotonic()
            await fed.feed(seconds)
            share = (_cpu_s(process) - before) / (time.monotonic() - begun_s)
            memory = process.memory_info().rss / 1e6
        sizes = [path.stat().st_size for path in (folder / LINK, *folder.glob("*.mcap"))]
        scans = sum(1 for one in RecordedMission(folder).messages({"sensor/lidar/scan"}))
    fed_s = _SETTLE_S + seconds
    return [
        Row("recorder fed 200 k points a second: share of a core", 100 * share, "%", 10.0),
        Row("scans of it in the recording", 100 * scans / (10 * fed_s), "%"),
        Row("written", sum(sizes) / fed_s / 1e6, "MB/s"),
        Row("memory", memory, "MB"),
    ]


def _cpu_s(process: psutil.Process) -> float:
    times = process.cpu_times()
    return float(times.user + times.system)


def _report(photos: int) -> list[Row]:
    folder = Path(tempfile.mkdtemp(prefix="bladescout-bench-"))
    try:
        write_mission(folder, photos)
        begun_s = time.process_time()
        page = write_report(folder)
        took_s = time.process_time() - begun_s
        text = page.read_text()
    finally:
        shutil.rmtree(folder)
    weight = len(text.encode()) / 1e6
    shown = len(re.findall(r'src="data:image/jpeg', text))
    return [
        Row(f"report of {shown} photos of 20 megapixels: weight", weight, "MB", 15.0),
        Row("the same: rendered in, CPU", took_s, "s"),
        Row("the same: assets from elsewhere", float(len(assets(text))), "", 0.0),
    ]


def assets(page: str) -> list[str]:
    """Return what a page loads from outside itself: sources, style sheets, fonts, scripts."""
    loaded = re.findall(r"<(?:script|link|iframe|object|embed)\b[^>]*>", page)
    loaded += [src for src in re.findall(r'\bsrc(?:set)?="([^"]*)"', page) if src[:5] != "data:"]
    loaded += re.findall(r"@import[^;]*;", page)
    loaded += [url for url in re.findall(r"url\(([^)]*)\)", page) if url[:1] != "#"]
    return loaded
