import math
from types import SimpleNamespace

import pytest

from drivers.autopilot_announcer import Health, Level
from mission.flight.command import MissionState, Phase, PhotoCommand, Progress
from mission.flight.events import EventRecord, Reaction
from mission.flight.observation import ClearanceState, Observation
from mission.processes import flight_announcements
from mission.processes.flight_announcements import Announcements, health_of
from mission.processes.preflight import WORKERS
from mission.remote.messages import PhotoTakenMessage, SensingHealth


class Heard:
    def __init__(self):
        self.beats, self.texts, self.photos = [], [], []

    def heartbeat(self, health):
        self.beats.append(health)

    def say(self, level, text):
        self.texts.append((level, text))

    def photo(self, place):
        self.photos.append(place)


def inputs(**changes):
    health = {"lidar_online": True, "camera_online": True} | changes
    ready = health.pop("ready", set(WORKERS))
    sensing = SensingHealth(mission_s=10.0, scans=1, frames=1, **health)
    return SimpleNamespace(ready=ready, sensing=sensing)


def observed(scan_s=9.9, alive=True):
    clearance = ClearanceState(scan_s, 1, 12.0, None)
    return Observation(now_s=10.0, tick=1, clearance=clearance, sensing_alive=alive)


IDLE = Progress(Phase.IDLE, MissionState.IDLE, "ready")
TRACK = Progress(Phase.TRACK, MissionState.RUNNING, "along", blade="A", side="PS")


@pytest.mark.parametrize(
    ("progress", "observation", "known", "health"),
    [
        (IDLE, observed(), inputs(), Health.STANDBY),
        (TRACK, observed(), inputs(), Health.ACTIVE),
        (IDLE, observed(), inputs(ready=set()), Health.BOOT),
        (TRACK, observed(scan_s=8.5), inputs(), Health.CRITICAL),
        (TRACK, observed(alive=False), inputs(), Health.CRITICAL),
        (IDLE, observed(), inputs(lidar_online=False), Health.CRITICAL),
        (IDLE, observed(), inputs(camera_online=False), Health.CRITICAL),
        (IDLE, Observation(now_s=10.0, tick=1), inputs(), Health.CRITICAL),
    ],
)
def test_the_heartbeat_says_what_works(progress, observation, known, health):
    assert health_of(progress, observation, known, 10.0) is health


def test_a_heartbeat_a_second_whatever_the_tick(monkeypatch):
    now_s = [100.0]
    monkeypatch.setattr(flight_announcements.time, "monotonic", lambda: now_s[0])
    heard = Heard()
    announcements = Announcements(heard, photos=True)
    for _ in range(60):
        announcements.tick(IDLE, observed(), inputs())
        now_s[0] += 0.05
    assert len(heard.beats) == 3


def test_each_phase_is_told_once_with_what_it_does():
    heard = Heard()
    announcements = Announcements(heard, photos=True)
    over = Progress(Phase.LANDED, MissionState.COMPLETED, "all photographed")
    for progress in (IDLE, IDLE, TRACK, TRACK, over, over):
        announcements.tick(progress, observed(), inputs())
    assert [text for _, text in heard.texts] == [
        "bladescout: track A PS: along",
        "bladescout: completed: all photographed",
    ]


def test_what_makes_the_flight_hold_or_leave_is_told_with_its_weight():
    heard = Heard()
    announcements = Announcements(heard, photos=True)
    announcements.events(
        tuple(
            EventRecord(1.0, "x", severity, severity.name)
            for severity in (Reaction.NONE, Reaction.WARN, Reaction.HOLD, Reaction.RETURN)
        )
    )
    assert heard.texts == [
        (Level.WARNING, "bladescout: HOLD"),
        (Level.CRITICAL, "bladescout: RETURN"),
    ]


def taken(**changes):
    return PhotoTakenMessage(
        **{
            "command": PhotoCommand(1, "A", "PS", 3.0, 12.0),
            "url": "http://camera/1.jpg",
            "index": 4,
            "stamp_s": 2.5,
            "utc": "2026-01-01T00:00:00.000Z",
            "position_w": (1.0, 2.0, 30.0),
            "quaternion_wb": (1, 0, 0, 0),
            "gimbal_yaw_rad": 0.0,
            "gimbal_pitch_rad": 0.0,
            "latitude_deg": 47.0,
            "longitude_deg": 8.0,
            "altitude_m": 500.0,
        }
        | changes
    )


def test_a_photo_is_told_where_its_place_is_known():
    heard = Heard()
    announcements = Announcements(heard, photos=True)
    announcements.photo(taken())
    announcements.photo(taken(latitude_deg=None))
    (place,) = heard.photos
    assert (place.index, place.boot_ms, place.height_m) == (4, 2500, 30.0)
    assert place.utc_us == 1767225600 * 10**6
    # It looks east: a quarter turn from north about the axis that points down.
    assert place.quaternion == pytest.approx((math.sqrt(0.5), 0, 0, math.sqrt(0.5)))


def test_a_camera_on_the_same_link_tells_of_its_photos_itself():
    heard = Heard()
    Announcements(heard, photos=False).photo(taken())
    assert heard.photos == []
