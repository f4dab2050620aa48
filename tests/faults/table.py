"""The fault table: every case of the catalogue, what is done about it, and what shows it."""

from __future__ import annotations

from tests.faults import camera, host, kills, processes, recordings, sensing, storm, vehicle
from tests.faults.fault import Fault

CASES = {
    1: "LiDAR stream stops for 2 s while tracking",
    2: "LiDAR stream stops for more than 10 s",
    3: "Scan rate falls from 10 to 4 Hz, and below",
    4: "Scans come 0.8 s late",
    5: "The same scan again and again",
    6: "A million damaged datagrams",
    7: "Packets from another source address",
    8: "30 % loss, reordering, duplicates",
    9: "Points that cannot be, too few, too many",
    10: "Fog",
    11: "Prior hub 5, 10, 15 m off",
    12: "Not a rotor, or not this one",
    13: "The rotor or the nacelle moves",
    14: "Nothing converges",
    15: "The sensing process crashes, hangs, is killed",
    16: "The autopilot falls silent",
    17: "A bad link",
    18: "The event loop is blocked for 5 s in offboard",
    19: "kill -9 while tracking",
    20: "SIGTERM and SIGINT",
    21: "All cores busy",
    22: "The pilot changes the mode, in any phase",
    23: "Offboard or arming refused, no acknowledgement",
    24: "Preflight",
    25: "GPS jumps or drifts",
    26: "The estimator resets its frame",
    27: "Wrong heading, wrong height",
    28: "Battery",
    29: "Gusts",
    30: "An obstacle ahead",
    31: "Setpoints that cannot be",
    32: "Foreign system ids",
    33: "Clock steps of an hour",
    34: "The camera rejects or clamps EV",
    35: "Bad frames",
    36: "The target is off the picture",
    37: "A step of light",
    38: "The gimbal does not answer, lags, is at its limit",
    39: "The camera is unplugged, and back",
    40: "The disk is full, read-only, slow",
    41: "Mistakes in the configuration",
    42: "Two daemons on one vehicle",
    43: "Soak, and small faults without end",
    44: "Requests that are none",
    45: "Requests of those who may not",
    46: "Many requests, an abort in any phase, a lost router",
}

FAULTS: tuple[Fault, ...] = tuple(
    sorted(
        (
            *sensing.ROWS,
            *vehicle.ROWS,
            *camera.ROWS,
            *host.ROWS,
            *processes.ROWS,
            *kills.ROWS,
            *recordings.ROWS,
            *storm.ROWS,
        ),
        key=lambda fault: fault.number,
    )
)
