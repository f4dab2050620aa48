import asyncio
import json

import pytest

from benchmarks.recording import assets
from benchmarks.recording_feed import PROBE, FedRecorder
from benchmarks.report_mission import write_mission
from mission.records.report import write_report
from mission.replay.recorded import RecordedMission

MB = 1e6


async def fed(folder):
    async with FedRecorder(folder) as recorder:
        process = await recorder.start(folder / "mission")
        await recorder.feed(1.5)
        return process


def test_a_recorder_in_its_own_process_records_what_it_is_fed_and_is_gone_after(tmp_path):
    process = asyncio.run(fed(tmp_path))
    assert not process.is_running()
    keys = {message.key for message in RecordedMission(tmp_path / "mission").messages()}
    assert {PROBE, "sensor/lidar/scan", "view/transforms", "mission/command"} <= keys
    assert (tmp_path / "mission" / "link.tlog").stat().st_size > 1000


def test_a_page_of_noise_keeps_to_its_bytes_for_each_photo_and_loads_nothing(tmp_path):
    write_mission(tmp_path, 12)
    page = write_report(tmp_path)
    text = page.read_text()
    assert text.count('src="data:image/jpeg') == 12
    assert assets(text) == []
    # 300 of them below 15 MB, with half a megabyte for all else.
    assert page.stat().st_size < 0.5 * MB + 12 * 14.5 * MB / 300
    assert json.loads((tmp_path / "mission.json").read_text())["photos"]["kept"] == 12


@pytest.mark.parametrize(
    "tag",
    [
        '<link rel="stylesheet" href="x.css">',
        '<img alt="" src="https://elsewhere/x.png">',
        "<style>@import 'x.css';</style>",
        "<style>p { background: url(x.png); }</style>",
        '<script src="x.js"></script>',
    ],
)
def test_what_a_page_loads_from_elsewhere_is_found(tag):
    assert assets(f"<html>{tag}</html>")
