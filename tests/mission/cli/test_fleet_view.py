"""The table of all vehicles: readable on a terminal of 80 columns, whole on a wide one."""

import io
import time

import pytest
from rich.console import Console

from mission.cli.fleet_view import FleetTable
from mission.flight.command import MissionState, Phase, Progress
from mission.remote.fleet import LOST_S, Sighting
from mission.remote.messages import StateMessage


def sighting(name, age_s=0.0):
    progress = Progress(
        phase=Phase.APPROACH,
        state=MissionState.COMPLETED,
        words="along the blade",
        blade="A",
        side="PS",
        clearance_m=10.2,
        stop_angle_deg=61.4,
        coverage=0.4,
    )
    state = StateMessage(
        vehicle=name,
        mission_dir="missions/x",
        site="hill-3",
        mission_s=120.0,
        factor=1.0,
        progress=progress,
        position_w=(0.0, 0.0, 80.0),
        battery=0.8,
        lidar_age_s=0.1,
        ev=0.0,
        grey=140.0,
        link_ok=True,
    )
    return Sighting(state, time.monotonic() - age_s)


def shown(vehicles, width):
    console = Console(width=width, file=io.StringIO())
    console.print(FleetTable(vehicles))
    return console.file.getvalue()


@pytest.mark.parametrize("width", [80, 140])
def test_nothing_that_matters_is_cut_short(width):
    text = shown({"heron": sighting("heron"), "stork": sighting("stork", LOST_S + 4)}, width)
    assert "…" not in text
    assert max(map(len, text.splitlines())) <= width
    row = next(line for line in text.splitlines() if "heron" in line)
    for words in ("hill-3", "completed", "approach", "10.2 m", "80%", "40%", "0.0 s"):
        assert words in row
    assert ("61.4 deg" in row) is (width > 100)
    assert "7.0 s" in text


def test_where_nobody_was_heard_it_says_so():
    assert "no vehicle was heard" in shown({}, 80)
