"""The dissertation's cheap score against its own definition: a sum over the image's pixels."""

from __future__ import annotations

import numpy as np
import pytest

from models.cameras import Cameras, make_camera
from models.errors import ErrorModel, error_radius
from models.roads import Piece, road_from_pieces
from placement.information import Information, compute_information
from placement.objectives.kalman_gain import kalman_gain

LENGTH_M = 60.0
POINTS = road_from_pieces([Piece(LENGTH_M)]).sample(0.02)
ERRORS = ErrorModel("radius", report_limit_m=50.0)


def stand(fov_deg: float, projection: str = "pinhole") -> Cameras:
    """Stand 4 m beside the middle of a straight, 6 m high, looking across and down."""
    return make_camera(
        x_m=30.0,
        y_m=-4.0,
        yaw_deg=80.0,
        pitch_deg=50.0,
        fov_deg=(fov_deg, fov_deg),
        size_px=(400, 400),
        projection=projection,
    )


def seen(camera: Cameras) -> Information:
    return compute_information(camera, POINTS, ERRORS, 150.0)


def sum_over_pixels(camera: Cameras) -> float:
    """Evaluate the definition, for cars within 0.1 m of the centre line."""
    half = 0.1
    u, v = np.meshgrid(np.arange(400) + 0.5, np.arange(400) + 0.5)
    pixels = np.column_stack([u.ravel(), v.ravel()])
    ground, hits = camera.ground_from_pixel(np.zeros(len(pixels), np.int64), pixels)
    x, y = ground.T
    with np.errstate(invalid="ignore"):
        on_road = hits & (np.abs(y) <= half) & (x >= 0.0) & (x <= LENGTH_M)
    r = error_radius(camera, ground[on_road], ERRORS)[0]
    density = 1.0 / (LENGTH_M * 2.0 * half)
    return float(np.sum(density / (1.0 + (r / 3.0) ** 2)))


@pytest.mark.parametrize(("fov_deg", "projection"), [(30.0, "pinhole"), (80.0, "equidistant")])
def test_the_score_is_the_sum_over_the_image_of_cars_and_accuracy(
    fov_deg: float, projection: str
) -> None:
    camera = stand(fov_deg, projection)
    # 1 %: pixels of centimetres, and a strip of road of a fifth of a metre.
    assert kalman_gain(camera, POINTS, seen(camera))[0] == pytest.approx(
        sum_over_pixels(camera), rel=1e-2
    )


def test_the_score_prefers_a_narrow_field_of_view_as_the_dissertation_found() -> None:
    narrow, wide = stand(20.0), stand(80.0)
    assert kalman_gain(narrow, POINTS, seen(narrow)) > kalman_gain(wide, POINTS, seen(wide))


def test_a_block_counts_by_its_worst_direction_and_an_unseen_road_for_nothing() -> None:
    camera = stand(60.0)
    one = np.zeros(1, dtype=np.int32)
    n = len(POINTS)
    single = Information(n, np.array([0, 1]), one + 1500, np.array([[4.0]], np.float32))
    # Rotated by 30°, eigenvalues 4 and 100.
    c, s = np.cos(np.pi / 6), np.sin(np.pi / 6)
    J = np.array([[c, -s], [s, c]]) @ np.diag([4.0, 100.0]) @ np.array([[c, s], [-s, c]])
    block = np.array([[J[0, 0], J[0, 1], J[1, 1]]], np.float32)
    full = Information(n, np.array([0, 1]), one + 1500, block)
    blind = Information(n, np.array([0, 0]), np.empty(0, np.int32), np.empty((0, 1), np.float32))
    assert kalman_gain(camera, POINTS, full) == pytest.approx(
        kalman_gain(camera, POINTS, single), rel=1e-5
    )
    assert kalman_gain(camera, POINTS, blind) == 0.0
