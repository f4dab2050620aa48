"""The vendor's own compiled SDK2 finds, configures and reads the simulated sensor.

It runs in a process of its own, which ends without tidying up: the SDK's threads outlive it.
"""

import importlib.util
import json
import socket
import subprocess
import sys
import threading

import numpy as np
import pytest

from config.sensors import Lidar
from drivers.clock import MonotonicClock
from drivers.simulated.mid360 import Mid360Twin

HOST, LIDAR = "127.0.0.1", "127.0.0.2"
PORTS = (56000, 56101, 56201, 56301, 56401)
CHILD = """
import json, os, sys, time
import livox_sdk

points, imu, first = [0], [0], []

def on_info(handle, device_type):
    livox_sdk.SetLivoxLidarWorkMode(handle, 1)
    livox_sdk.EnableLivoxLidarImuData(handle)
    first.append(device_type)

def on_points(packet):
    points[0] += 1
    if points[0] == 1:
        first.append([packet.dot_num, packet.time_interval, bytes(packet.get_pts_data()).hex()])

def on_imu(packet):
    imu[0] += 1

livox_sdk.SetLivoxLidarInfoChangeCallback(on_info)
livox_sdk.LivoxLidarSdkInit(sys.argv[1])
livox_sdk.SetLivoxLidarPointCloudCallBack(on_points)
livox_sdk.SetLivoxLidarImuDataCallback(on_imu)
end = time.monotonic() + 15
while time.monotonic() < end and (points[0] < 1000 or imu[0] < 50):
    time.sleep(0.05)
with open(sys.argv[2], "w") as file:
    json.dump({"points": points[0], "imu": imu[0], "first": first}, file, default=int)
os._exit(0)
"""


def missing():
    if importlib.util.find_spec("livox_sdk") is None:
        return "py-livox2 has no wheel here"
    if sys.platform != "linux":
        return "needs 127.0.0.2"
    for port in PORTS:
        with socket.socket(type=socket.SOCK_DGRAM) as sock:
            try:
                sock.bind((HOST, port))
            except OSError:
                return f"the SDK's fixed port {port} is taken"
    return ""


def write_configuration(path):
    kinds = ("cmd_data", "push_msg", "point_data", "imu_data", "log_data")
    lidar = {f"{kind}_port": 56100 + 100 * at for at, kind in enumerate(kinds)}
    host = {f"{kind}_port": 56101 + 100 * at for at, kind in enumerate(kinds)}
    path.write_text(
        json.dumps(
            {
                "master_sdk": True,
                "lidar_log_enable": False,
                "lidar_log_cache_size_MB": 0,
                "lidar_log_path": "./",
                "MID360": {
                    "lidar_net_info": lidar,
                    "host_net_info": [{"host_ip": HOST, "lidar_ip": [LIDAR], **host}],
                },
            }
        )
    )


def render(twin, clock, stop):
    t_ns, count = round(clock.now_s() * 1e9), 5000
    while not stop.wait(0.005):
        while t_ns * 1e-9 < clock.now_s():
            twin.send_points(
                t_ns,
                np.tile(np.float32([1.0, -2.0, 0.5]), (count, 1)),
                np.full(count, 100, np.uint8),
                np.zeros(count, np.uint8),
                np.ones(count, bool),
            )
            t_ns += count * 5000


def test_the_vendors_sdk_takes_the_simulated_sensor_for_a_real_one(tmp_path):
    if reason := missing():
        pytest.skip(reason)
    write_configuration(tmp_path / "sdk.json")
    clock, stop = MonotonicClock(), threading.Event()
    with Mid360Twin(Lidar(lidar_ip=LIDAR, host_ip=HOST), clock, spin_up_s=0.2) as twin:
        thread = threading.Thread(target=render, args=(twin, clock, stop))
        thread.start()
        try:
            subprocess.run(
                [sys.executable, "-c", CHILD, tmp_path / "sdk.json", tmp_path / "result.json"],
                cwd=tmp_path,
                check=True,
                timeout=30,
                capture_output=True,
            )
        finally:
            stop.set()
            thread.join()
    result = json.loads((tmp_path / "result.json").read_text())
    assert result["points"] >= 1000
    assert result["imu"] >= 50
    device_type, (points, interval, data) = result["first"]
    assert device_type == 9
    assert (points, interval) == (96, 4750)
    assert data == "e803000030f8fffff40100006400" * 96
