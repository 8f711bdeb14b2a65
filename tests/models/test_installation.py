"""Installations: the offsets' Jacobian against cameras that really are displaced."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest

from models.cameras import N_COLUMNS, Cameras, ground_from_pixel, make_camera, pixel_from_ground
from models.installation import (
    LEFT,
    PITCH,
    ROLL,
    UP,
    YAW,
    Installation,
    displace_camera,
    offset_jacobian,
)

LENSES = pytest.mark.parametrize("lens", ["pinhole", "stereographic", "equidistant"])


def camera_at(lens: str, pitch_deg: float = 50.0, yaw_deg: float = 77.0) -> Cameras:
    return make_camera(
        x_m=3.0, y_m=-2.0, yaw_deg=yaw_deg, pitch_deg=pitch_deg, roll_deg=5.0, projection=lens
    )


def reported_error(row: np.ndarray, x: float, y: float, offsets: np.ndarray) -> np.ndarray:
    """Return what a camera displaced by `offsets` reports of a car at (x, y), minus the truth."""
    actual = np.empty(N_COLUMNS)
    displace_camera(row, offsets, actual)
    u, v, _ = pixel_from_ground(actual, x, y)
    back = ground_from_pixel(row, u, v)
    return np.array([back[0] - x, back[1] - y])


@LENSES
@pytest.mark.parametrize("pitch_deg", [30.0, 50.0, 90.0])
@pytest.mark.parametrize("yaw_deg", [0.0, 77.0, 220.0])
def test_offset_jacobian_is_the_finite_difference(
    lens: str, pitch_deg: float, yaw_deg: float
) -> None:
    camera = camera_at(lens, pitch_deg, yaw_deg)
    row, step = camera.table()[0], 1e-6
    pixels = np.random.default_rng(1).uniform(300.0, 1900.0, (10, 2))
    for x, y in camera.ground_from_pixel(np.zeros(10, dtype=np.int64), pixels)[0]:
        ours = np.empty((2, 6))
        offset_jacobian(row, x - 3.0, y + 2.0, ours)
        for j in range(6):
            ahead = reported_error(row, x, y, step * np.eye(6)[j])
            behind = reported_error(row, x, y, -step * np.eye(6)[j])
            np.testing.assert_allclose(ours[:, j], (ahead - behind) / (2 * step), atol=1e-6)


def test_signs_follow_the_words() -> None:
    """A camera that really stands higher, left, or tilted down misplaces cars as one expects."""
    row = make_camera(pitch_deg=45.0).table()[0]  # looks along +x, left is +y
    jacobian = np.empty((2, 6))
    offset_jacobian(row, 6.0, 0.0, jacobian)
    assert jacobian[0, UP] < 0.0  # higher than thought: cars are farther than reported
    assert jacobian[1, LEFT] == pytest.approx(-1.0)
    assert jacobian[0, PITCH] > 0.0  # really looks down more: reported too far
    assert jacobian[1, YAW] < 0.0  # really turned left: reported too far right
    assert jacobian[1, ROLL] < 0.0


def test_displacing_turns_the_axes_by_the_rotation_vector() -> None:
    row = camera_at("pinhole").table()[0]
    offsets = np.array([0.1, -0.2, 0.3, 0.4, -0.5, 0.6])
    actual = np.empty(N_COLUMNS)
    displace_camera(row, offsets, actual)
    yaw = math.radians(77.0)
    world_from_mount = cv2.Rodrigues(np.array([0.0, 0.0, yaw]))[0]
    turn = cv2.Rodrigues(world_from_mount @ offsets[3:])[0]
    shift = world_from_mount @ offsets[:3]
    np.testing.assert_allclose(actual[:3], row[:3] + shift, atol=1e-14)
    for axis in (3, 6, 9):
        np.testing.assert_allclose(actual[axis : axis + 3], turn @ row[axis : axis + 3], atol=1e-14)
    np.testing.assert_array_equal(actual[12:], row[12:])


def test_no_offset_changes_nothing() -> None:
    row, actual = camera_at("pinhole").table()[0], np.empty(N_COLUMNS)
    displace_camera(row, np.zeros(6), actual)
    np.testing.assert_array_equal(actual, row)


def test_95_percent_figures_are_two_standard_deviations() -> None:
    installation = Installation(0.03, 0.5, 4.0)
    expected = [0.015] * 3 + [math.pi / 720] * 3
    np.testing.assert_allclose(installation.sigmas(), expected, rtol=1e-15)
    assert installation.algorithm_sigma_px == 2.0


@pytest.mark.parametrize(
    ("figures", "match"),
    [
        ((-0.01, 0.5, 4.0), r"errors\.position_95_m must lie in \[0, 10\], got -0\.01"),
        ((0.03, 46.0, 4.0), r"errors\.orientation_95_deg must lie in \[0, 45\], got 46"),
        ((0.03, math.nan, 4.0), r"errors\.orientation_95_deg must lie in \[0, 45\], got nan"),
        ((0.03, 0.5, 1e6), r"errors\.algorithm_95_px"),
    ],
)
def test_impossible_figures_are_one_line(figures: tuple[float, ...], match: str) -> None:
    with pytest.raises(ValueError, match=match):
        Installation(*figures)
