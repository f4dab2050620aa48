"""The vision baseline: it reads clean pictures and refuses where there is nothing to read."""

import math

import cv2
import numpy as np
import pytest

from perception.baselines.stokkeland import estimate_stop_angle
from perception.baselines.vision_angle import VisionAngle, VisionRefusal, VisionRefusalCode
from perception.geometry import pinhole_matrix, stop_angle_difference_deg
from perception.values import Bytes

HUB = (330.0, 215.0)


def picture(
    angle_deg: float, roll_rad: float = 0.0, blades: int = 3, tower: bool = True, scale: float = 1.0
) -> Bytes:
    """Draw three tapering blades and a tower on sky over land, seen by a rolled camera."""
    grey = np.full((480, 640), 190, np.uint8)
    grey[240:] = 80
    if tower:
        x, y = HUB
        corners = [(x - 18, y), (x + 18, y), (x + 21, 480), (x - 21, 480)]
        cv2.fillConvexPoly(grey, np.array(corners, np.int32), 140)
    for k in range(blades):
        a = math.radians(angle_deg + 120 * k)
        along, across = np.array([math.sin(a), math.cos(a)]), np.array([math.cos(a), -math.sin(a)])
        hub = np.array(HUB)
        tip = hub + 600 * along
        outline = [hub + 17 * across, tip + 3 * across, tip - 3 * across, hub - 17 * across]
        cv2.fillConvexPoly(grey, np.round(outline).astype(np.int32), 235)
    cv2.circle(grey, (int(HUB[0]), int(HUB[1])), 24, 225, -1)
    # A camera turned clockwise sees the world turned counter-clockwise.
    turn = cv2.getRotationMatrix2D((320.0, 240.0), math.degrees(roll_rad), 1.0)
    grey = cv2.warpAffine(grey, turn, (640, 480), borderMode=cv2.BORDER_REPLICATE)
    size = (round(640 * scale), round(480 * scale))
    return np.asarray(cv2.GaussianBlur(cv2.resize(grey, size), (3, 3), 0), np.uint8)


def answer(grey: Bytes, roll_rad: float = 0.0) -> VisionAngle | VisionRefusal:
    return estimate_stop_angle(grey, roll_rad, pinhole_matrix(490.0, grey.shape[1], grey.shape[0]))


@pytest.mark.parametrize("angle_deg", [20.0, 40.0, 55.0, 65.0, 80.0, 100.0])
def test_a_clean_picture_is_read_within_two_degrees(angle_deg: float) -> None:
    found = answer(picture(angle_deg))
    assert isinstance(found, VisionAngle)
    assert abs(stop_angle_difference_deg(found.stop_angle_deg, angle_deg)) < 2.0
    assert float(np.linalg.norm(found.hub_px - np.array(HUB))) < 25.0


@pytest.mark.parametrize("roll_deg", [-4.0, 3.0])
def test_the_reported_roll_is_undone(roll_deg: float) -> None:
    roll_rad = math.radians(roll_deg)
    found = answer(picture(45.0, roll_rad), roll_rad)
    assert isinstance(found, VisionAngle)
    assert abs(stop_angle_difference_deg(found.stop_angle_deg, 45.0)) < 2.0


def test_a_larger_picture_is_read_alike() -> None:
    found = answer(picture(45.0, scale=2.0))
    assert isinstance(found, VisionAngle)
    assert abs(stop_angle_difference_deg(found.stop_angle_deg, 45.0)) < 2.0


def test_a_rotor_whose_tower_is_not_seen_is_still_read() -> None:
    found = answer(picture(45.0, tower=False))
    assert isinstance(found, VisionAngle)
    assert abs(stop_angle_difference_deg(found.stop_angle_deg, 45.0)) < 3.0


def test_an_empty_picture_is_refused() -> None:
    refusal = answer(np.full((480, 640), 128, np.uint8))
    assert isinstance(refusal, VisionRefusal)
    assert refusal.code is VisionRefusalCode.NO_LINES


def test_a_tower_without_blades_is_refused() -> None:
    assert isinstance(answer(picture(45.0, blades=0)), VisionRefusal)


def test_noise_alone_is_refused() -> None:
    noise = np.random.default_rng(5).integers(0, 255, (480, 640)).astype(np.uint8)
    assert isinstance(answer(cv2.GaussianBlur(noise, (9, 9), 0)), VisionRefusal)
