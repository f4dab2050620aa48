import io

import pytest
from rich.console import Console

from mission.cli.progress import LiveProgress, status_table
from mission.cli.summary import print_summary
from mission.flight.command import MissionState, Phase, Progress
from mission.remote.messages import EventMessage, StateMessage


def state(words="flying along blade A PS", phase=Phase.TRACK, **changes):
    progress = Progress(
        phase,
        MissionState.RUNNING,
        words,
        pass_index=3,
        pass_count=12,
        blade="A",
        side="PS",
        metre=12.34,
        distance_m=12.02,
        clearance_m=10.4,
        stop_angle_deg=61.38,
        sigma_deg=0.11,
        photos=123,
        coverage=0.54,
    )
    values = {
        "vehicle": "drone-1",
        "mission_dir": "missions/20260101T000000Z-demo",
        "site": "demo",
        "mission_s": 1234.5,
        "factor": 2.1,
        "progress": progress,
        "position_w": (1.0, 2.0, 86.3),
        "battery": 0.92,
        "ev": 1.0,
        "grey": 143.0,
    }
    return StateMessage.model_validate(values | changes)


def screen(width, *, terminal):
    return Console(file=io.StringIO(), width=width, height=24, force_terminal=terminal)


@pytest.mark.parametrize("width", [60, 80, 132])
def test_the_panel_fits_its_terminal(width):
    console = screen(width, terminal=True)
    progress = LiveProgress(console, "bladescout - demo")
    console.print(progress._panel(state(words="a long story of what is being done " * 4)))
    lines = Console(file=io.StringIO(), width=width).render_lines(progress._panel(state()))
    assert len(lines) == 8
    shown = "".join(segment.text for line in lines for segment in line)
    assert "61.38 deg" in shown
    assert "track" in shown
    if width >= 80:
        for words in ("metre 12.3", "(3/12)", "54%", "92%", "grey 143  EV +1.00", "factor 2.1"):
            assert words in shown


def test_where_nothing_is_known_a_dash_is_shown():
    empty = state(position_w=None, battery=None, ev=None, grey=None, progress=bare())
    console = screen(80, terminal=False)
    console.print(LiveProgress(console, "x")._panel(empty))
    console.print(status_table(empty))
    assert "None" not in console.file.getvalue()
    assert "- m" not in console.file.getvalue()


def bare():
    return Progress(Phase.IDLE, MissionState.IDLE, "ready")


def test_away_from_a_terminal_a_line_is_printed_at_each_change_of_phase():
    console = screen(80, terminal=False)
    with LiveProgress(console, "x") as progress:
        for phase in (Phase.ASCEND, Phase.ASCEND, Phase.TRACK):
            progress.on_state(state(phase=phase))
    lines = console.file.getvalue().splitlines()
    assert len(lines) == 3
    assert lines[0] == "x: waiting for a state ..."
    assert "ascend" in lines[1]
    assert "height 86 m" in lines[2]
    assert "battery 92%" in lines[2]


def test_events_that_matter_are_printed_and_a_silent_one_prints_nothing():
    warning = EventMessage(mission_s=3.0, name="scan_slow", severity="warn", text="scans are slow")
    note = EventMessage(mission_s=3.0, name="note", severity="info", text="all is well")
    for silent, wanted in ((False, "    3.0 s  warn      scans are slow\n"), (True, "")):
        console = screen(80, terminal=False)
        with LiveProgress(console, "x", silent=silent) as progress:
            for event in (warning, note):
                progress.on_event(event)
            if silent:
                progress.on_state(state())
        assert console.file.getvalue().removeprefix("x: waiting for a state ...\n") == wanted


def test_the_closing_table_fits_80_columns_and_says_why_a_mission_ended(tmp_path):
    passes = [
        {
            "blade": "A",
            "side": "PS",
            "planned_m": 133.2,
            "coverage": 1.0,
            "distance_m": {"mean": 12.01, "rms_error": 0.14},
            "clearance_m": {"min": 10.9},
            "photos": 105,
        }
    ]
    mission = {
        "state": "ended_safely",
        "words": "the battery is low",
        "duration_s": 292.0,
        "rotor": {"stop_angle_deg": 61.38, "sigma_deg": 0.11},
        "passes": passes,
        "photos": {"kept": 105},
        "timing": {"setpoint_gap_ms": {"p99": 79.0}, "real_time_factor": 1.3},
        "truth": {"stop_angle_deg": 61.42, "min_clearance_m": 9.3},
        "errors": {"stop_angle_deg": -0.04},
    }
    console = screen(80, terminal=False)
    print_summary(console, mission, tmp_path)
    shown = console.file.getvalue()
    assert "…" not in shown
    assert "of the side's skin" in shown
    row = next(line for line in shown.splitlines() if "133.2" in line)
    assert row.split() == ["A", "PS", "133.2", "100%", "12.01", "0.14", "10.9", "105"]
    for words in ("ended_safely", "the battery is low", "4.9 simulated minutes", "error -0.04 deg"):
        assert words in shown


def test_a_mission_that_never_flew_has_a_closing_table_too(tmp_path):
    console = screen(80, terminal=False)
    print_summary(console, {"state": "refused", "words": "no [GPS] fix", "passes": []}, tmp_path)
    assert "no [GPS] fix" in console.file.getvalue()
    assert "None" not in console.file.getvalue()


@pytest.mark.parametrize(("told", "shown"), [({}, "86.3 m"), ({"height_m": 70.25}, "70.2 m")])
def test_the_height_is_above_the_take_off_where_that_is_told(told, shown):
    console = screen(80, terminal=False)
    console.print(status_table(state(**told)))
    assert shown in console.file.getvalue()
