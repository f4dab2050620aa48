"""A small mission as the flight and the recorder leave it: two passes, five photos."""

import dataclasses
import json
import math
from dataclasses import replace

import cv2
import numpy as np
import pytest

from config.settings import Settings
from mission.flight.command import MissionState, Phase, PhotoCommand
from mission.flight.events import Event, EventRecord, Reaction
from mission.flight.leg import Unseen
from mission.flight.observation import BladeEstimate, RotorEstimate
from mission.flight.report import MissionReport, PassReport, PhaseTime
from mission.records.files import EVENTS
from mission.records.photo_record import stored_records
from mission.records.photos import PhotoSite, store
from mission.records.summary import close_folder
from mission.remote.messages import EventMessage, FlightReport, PhotoTakenMessage

ANGLE_DEG = 61.58
HUB_W = (10.0, 24.0, 84.0)
FOOT_W = (10.0, 20.0, 0.5)


def a_rotor(stop_angle_deg=ANGLE_DEG):
    blades = tuple(
        BladeEstimate(
            name=name,
            direction_w=(math.sin(math.radians(angle)), 0.0, -math.cos(math.radians(angle))),
            pitch_deg=pitch,
        )
        for name, angle, pitch in (
            ("A", stop_angle_deg, 2.0),
            ("B", stop_angle_deg + 120, 3.0),
            ("C", stop_angle_deg + 240, None),
        )
    )
    return RotorEstimate(
        stamp_s=50.0,
        sequence=3,
        stop_angle_deg=stop_angle_deg,
        sigma_deg=0.11,
        reference="tower",
        hub_w=HUB_W,
        normal_w=(0.0, 1.0, 0.0),
        cone_deg=0.5,
        blades=blades,
        method="rotor_fit",
    )


def a_pass(side, **changes):
    values = {
        "blade": "A",
        "side": side,
        "length_m": 33.25,
        "planned_m": 33.25,
        "photographed_m": 6.5,
        "distance_mean_m": 12.34,
        "distance_rms_error_m": 0.21,
        "distance_min_m": 11.8,
        "clearance_min_m": 9.4,
        "photos": 2,
        "rejected": 1,
        "unseen": (),
        "stretches": ((0.5, 4.0), (10.0, 13.0)),
    }
    return PassReport(**(values | changes))


def a_report(state=MissionState.COMPLETED, rotor=None):
    unseen = (Unseen(0.0, 3.25, "less than the clearance to tower"),)
    back = a_pass("SS", planned_m=30.0, clearance_min_m=8.9, rejected=0, unseen=unseen)
    return MissionReport(
        state=state,
        words="landed",
        started_s=5.0,
        duration_s=430.0,
        phases=(
            PhaseTime(Phase.IDLE, 0.0, 5.0),
            PhaseTime(Phase.ASCEND, 5.0, 60.0),
            PhaseTime(Phase.TRACK, 60.0, 400.0),
            PhaseTime(Phase.RETURN, 400.0, 435.0),
        ),
        rotor=rotor,
        iterations=3,
        passes=(a_pass("PS"), back),
        events=(EventRecord(70.0, Event.SCAN_AGEING, Reaction.WARN, "LiDAR scans come late"),),
    )


def a_message(report):
    return FlightReport(
        report=report,
        site="hill-3",
        turbine="windpact-1.5",
        operator="A. Person <ap@example.org>",
        rotor_locked=True,
        started_utc="2026-03-01T10:14:00+00:00",
        tower_foot_w=FOOT_W,
        frames=900,
        frames_out_of_range=30,
        real_time_factor=2.5,
        tick_gap_ms={"p50": 50.0, "p99": 61.0, "max": 90.0},
    )


def a_jpeg(grey):
    rng = np.random.default_rng(1)
    picture = np.clip(rng.normal(grey, 6, (486, 648)), 0, 255).astype(np.uint8)
    return cv2.imencode(".jpg", picture)[1].tobytes()


def keep_photos(folder, settings):
    greys = {"PS": (135, 140, 20), "SS": (130, 128)}
    records = []
    for side, values in greys.items():
        for index, grey in enumerate(values):
            taken = PhotoTakenMessage(
                command=PhotoCommand(len(records) + 1, "A", side, 2.5 + 8.5 * index, 12.0),
                url="http://camera/1.jpg",
                index=len(records),
                stamp_s=100.0 + 10 * len(records),
                utc=f"2026-03-01T10:20:{10 + len(records)}.500Z",
                position_w=(10.0, 8.0, 80.0),
                quaternion_wb=(1.0, 0.0, 0.0, 0.0),
                gimbal_yaw_rad=0.0,
                gimbal_pitch_rad=0.1,
                foot_w=(10.0, 20.0, 80.0),
                distance_m=12.0,
                ev=0.33,
                shutter_s=1 / 2000,
                latitude_deg=54.0,
                longitude_deg=6.5,
                altitude_m=100.0,
            )
            record = store(a_jpeg(grey), taken, PhotoSite("hill-3"), settings, folder).record
            kept = grey > 100
            reason = "" if kept else "the blade is too dark"
            records.append(record.model_copy(update={"kept": kept, "reason": reason}))
    return records


def write_events(folder):
    events = [
        EventMessage(mission_s=5.0, name="request", severity="none", text="start by A. Person"),
        *(
            EventMessage(mission_s=t, name="x", severity="warn", text="LiDAR scans come late")
            for t in (70.0, 80.0, 145.0)
        ),
        EventMessage(mission_s=146.0, name="x", severity="hold", text="holding", cleared=False),
        EventMessage(mission_s=147.0, name="x", severity="hold", text="holding", cleared=True),
    ]
    lines = "".join(event.model_dump_json() + "\n" for event in events)
    # The last line was cut short, as a power cut leaves it.
    (folder / EVENTS).write_text(lines + '{"mission_s": 14')


@pytest.fixture
def mission_dir(tmp_path):
    """A mission folder of a completed flight, closed as the recorder closes it."""
    settings = Settings()
    folder = tmp_path / "20260301T101400Z-hill-3"
    folder.mkdir()
    write_events(folder)
    records = keep_photos(folder, settings)
    close_folder(folder, a_message(a_report(rotor=a_rotor())), records, [], settings)
    return folder


@pytest.fixture
def skin_dir(tmp_path):
    """The same, of a flight that knew the blade's pitch: its coverage is of the skin."""
    folder = tmp_path / "20260301T101400Z-hill-3"
    folder.mkdir()
    write_events(folder)
    report = a_report(rotor=a_rotor())
    passes = tuple(dataclasses.replace(one, coverage=0.5) for one in report.passes)
    report = dataclasses.replace(report, passes=passes)
    close_folder(folder, a_message(report), [], [], Settings())
    return folder


@pytest.fixture
def refused_dir(tmp_path):
    """A mission folder of a flight that never left the ground."""
    folder = tmp_path / "20260301T101400Z-refused"
    folder.mkdir()
    report = replace(
        a_report(MissionState.REFUSED),
        words="the battery is at 20 %",
        phases=(PhaseTime(Phase.IDLE, 0.0, 5.0),),
        passes=(),
        events=(),
    )
    close_folder(folder, a_message(report), [], ["photo 3 was never delivered"], Settings())
    return folder


@pytest.fixture
def mission_json(mission_dir):
    return json.loads((mission_dir / "mission.json").read_text())


@pytest.fixture
def truth():
    """What a field says of such a flight."""
    return {
        "stop_angle_deg": 61.4,
        "hub_m": [0.0, 4.0, 83.2],
        "normal": [0.0, 1.0, 0.0],
        "pitch_deg": {"A": 2.5, "B": 2.5, "C": 2.5},
        "min_clearance_m": 8.61,
        "coverage": {"A": {"PS": 0.173, "SS": 0.21, "LE": 0.0, "TE": 0.0}},
        "stills": 5,
        "stills_kept": 4,
        "stills_out_of_range": 0,
        "stills_blurred": 1,
        "wind": {"mean_mps": 4.0, "from_deg": 210.0, "max_mps": 5.5},
        "vehicle": {"collisions": 0, "touchdown_mps": 0.5, "landing_error_m": 0.2},
        "timing": {
            "setpoint_gap_ms": {"p50": 50.0, "p99": 63.0, "max": 111.0},
            "setpoint_gap_wall_ms": {"p50": 20.0, "p99": 40.0, "max": 60.0},
        },
    }


@pytest.fixture
def a_record(mission_dir):
    """Return the record of the mission's first photo."""
    return stored_records(mission_dir)[0]
