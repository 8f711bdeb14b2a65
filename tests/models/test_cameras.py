"""Cameras: pixel ↔ ground against OpenCV, finite differences and hand-drawn geometry."""

from __future__ import annotations

import math
from collections.abc import Callable

import cv2
import numpy as np
import pytest

from models.cameras import (
    Cameras,
    ground_jacobian,
    make_camera,
    pixel_area,
    pixel_jacobian,
)

LENSES = pytest.mark.parametrize("lens", ["pinhole", "stereographic", "equidistant"])
DISTORTIONS = pytest.mark.parametrize(
    "k", [(0.0, 0.0, 0.0, 0.0), (0.05, -0.01, 0.002, 0.0003)], ids=["straight", "distorted"]
)


def tilted(lens: str, k: tuple[float, float, float, float] = (0, 0, 0, 0), **kw: float) -> Cameras:
    """Return a camera with nothing symmetric about it."""
    return make_camera(
        x_m=3.0,
        y_m=-2.0,
        height_m=kw.get("height_m", 7.0),
        yaw_deg=kw.get("yaw_deg", 77.0),
        pitch_deg=kw.get("pitch_deg", 50.0),
        roll_deg=kw.get("roll_deg", 5.0),
        projection=lens,
        fov_deg=(70.0, 50.0),
        size_px=(2000, 1100),
        distortion=k,
    )


def pixels(n: int = 300) -> np.ndarray:
    return np.random.default_rng(2).uniform([0, 0], [2000, 1100], (n, 2))


def zeros(n: int) -> np.ndarray:
    return np.zeros(n, dtype=np.int64)


@LENSES
@DISTORTIONS
@pytest.mark.parametrize("pitch_deg", [30.0, 50.0, 90.0])
def test_ground_and_pixel_undo_each_other(lens: str, k, pitch_deg: float) -> None:
    camera, px = tilted(lens, k, pitch_deg=pitch_deg), pixels()
    xy, hits = camera.ground_from_pixel(zeros(300), px)
    assert hits.all()
    back, inside = camera.pixel_from_ground(zeros(300), xy)
    assert inside.all()
    np.testing.assert_allclose(back, px, rtol=0, atol=1e-8)


@pytest.mark.parametrize("lens", ["pinhole", "equidistant"])
@pytest.mark.parametrize("pitch_deg", [30.0, 90.0])
@pytest.mark.parametrize("yaw_deg", [0.0, 77.0, 200.0])
def test_pixels_are_opencvs(lens: str, pitch_deg: float, yaw_deg: float) -> None:
    camera = tilted(lens, pitch_deg=pitch_deg, yaw_deg=yaw_deg)
    xy, _ = camera.ground_from_pixel(zeros(300), pixels())
    # An independent pose: start looking along +x with x right = −y, y down = −z; turn about the
    # world's z by yaw, about the camera's x by −pitch (its y points down), about its z by roll.
    yaw, pitch, roll = math.radians(yaw_deg), math.radians(pitch_deg), math.radians(5.0)
    level = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    turns = np.array([[0.0, 0.0, yaw], [-pitch, 0.0, 0.0], [0.0, 0.0, roll]])
    about = [cv2.Rodrigues(turn)[0] for turn in turns]
    world_from_camera = about[0] @ level @ about[1] @ about[2]
    rotation = cv2.Rodrigues(world_from_camera.T)[0]
    shift = -world_from_camera.T @ np.array([3.0, -2.0, 7.0])
    tan = math.tan if lens == "pinhole" else float
    focal = 1000.0 / tan(math.radians(35.0)), 550.0 / tan(math.radians(25.0))
    matrix = np.array([[focal[0], 0.0, 1000.0], [0.0, focal[1], 550.0], [0.0, 0.0, 1.0]])
    world = np.column_stack([xy, np.zeros(300)]).reshape(-1, 1, 3)
    if lens == "pinhole":
        theirs, _ = cv2.projectPoints(world, rotation, shift, matrix, np.zeros(5))
    else:
        theirs, _ = cv2.fisheye.projectPoints(world, rotation, shift, matrix, np.zeros(4))
    ours, _ = camera.pixel_from_ground(zeros(300), xy)
    np.testing.assert_allclose(ours, theirs.reshape(-1, 2), rtol=0, atol=1e-8)


def test_right_down_and_roll_mean_what_they_say() -> None:
    camera = make_camera(yaw_deg=0.0, pitch_deg=45.0)
    px, _ = camera.pixel_from_ground(zeros(3), np.array([[6.0, 0.0], [6.0, -1.0], [5.0, 0.0]]))
    np.testing.assert_allclose(px[0], [1000.0, 1000.0], atol=1e-9)
    assert px[1, 0] > 1000.0  # to the right of the road is right in the image
    assert px[2, 1] > 1000.0  # nearer is lower
    rolled = make_camera(yaw_deg=0.0, pitch_deg=45.0, roll_deg=10.0)
    px, _ = rolled.pixel_from_ground(zeros(1), np.array([[6.0, -1.0]]))
    assert px[0, 1] < 1000.0  # a camera rolled clockwise sees what is on its right higher


@LENSES
@DISTORTIONS
@pytest.mark.parametrize("pitch_deg", [30.0, 50.0, 90.0])
def test_ground_jacobian_is_the_finite_difference(lens: str, k, pitch_deg: float) -> None:
    camera, px, step = tilted(lens, k, pitch_deg=pitch_deg), pixels(100), 1e-4
    px[0] = [1000.0, 550.0]  # the axis itself
    row = camera.table()[0]
    xy, _ = camera.ground_from_pixel(zeros(100), px)
    for axis in range(2):
        shift = step * np.eye(2)[axis]
        ahead, _ = camera.ground_from_pixel(zeros(100), px + shift)
        behind, _ = camera.ground_from_pixel(zeros(100), px - shift)
        numeric = (ahead - behind) / (2 * step)
        for n, (x, y) in enumerate(xy):
            ours = np.array(ground_jacobian(row, x - 3.0, y + 2.0)).reshape(2, 2)[:, axis]
            np.testing.assert_allclose(ours, numeric[n], rtol=1e-6, atol=1e-9)


@LENSES
@DISTORTIONS
def test_pixel_jacobian_is_the_finite_difference(lens: str, k) -> None:
    camera, step = tilted(lens, k), 1e-5
    row = camera.table()[0]
    xy, _ = camera.ground_from_pixel(zeros(50), pixels(50))
    for axis in range(2):
        shift = step * np.eye(2)[axis]
        ahead, _ = camera.pixel_from_ground(zeros(50), xy + shift)
        behind, _ = camera.pixel_from_ground(zeros(50), xy - shift)
        numeric = (ahead - behind) / (2 * step)
        for n, (x, y) in enumerate(xy):
            ours = np.array(pixel_jacobian(row, x - 3.0, y + 2.0)).reshape(2, 2)[:, axis]
            np.testing.assert_allclose(ours, numeric[n], rtol=1e-6, atol=1e-4)


@LENSES
@DISTORTIONS
def test_pixel_area_is_that_of_the_four_corners(lens: str, k) -> None:
    camera, px = tilted(lens, k), pixels(100)
    row = camera.table()[0]
    xy, _ = camera.ground_from_pixel(zeros(100), px)
    corners = [
        camera.ground_from_pixel(zeros(100), px + 0.05 * np.array(c))[0]
        for c in ([1, 1], [1, -1], [-1, -1], [-1, 1])
    ]
    diagonal, other = corners[2] - corners[0], corners[3] - corners[1]
    area = 0.5 * np.abs(diagonal[:, 0] * other[:, 1] - diagonal[:, 1] * other[:, 0]) / 0.1**2
    ours = [pixel_area(row, x - 3.0, y + 2.0) for x, y in xy]
    np.testing.assert_allclose(ours, area, rtol=1e-5)


def test_a_horizon_inside_the_image_is_no_error() -> None:
    camera = make_camera(pitch_deg=10.0)
    xy, hits = camera.ground_from_pixel(zeros(2), np.array([[1000.0, 0.0], [1000.0, 1999.0]]))
    assert hits.tolist() == [False, True]
    assert np.isnan(xy[0]).all()
    _, inside = camera.pixel_from_ground(zeros(1), np.array([[-20.0, 0.0]]))
    assert not inside[0]


def test_the_middle_of_each_edge_is_half_the_field_of_view_off_the_axis() -> None:
    for lens in ("pinhole", "stereographic", "equidistant"):
        camera = make_camera(
            pitch_deg=90.0, projection=lens, fov_deg=(70.0, 40.0), distortion=(0.1, 0.0, 0.0, 0.0)
        )
        edge = np.array([[2000.0, 1000.0], [1000.0, 0.0]])
        xy, _ = camera.ground_from_pixel(zeros(2), edge)
        expected = 6.0 * np.tan(np.radians([35.0, 20.0]))
        np.testing.assert_allclose(np.linalg.norm(xy, axis=1), expected, rtol=1e-12)
        # Pitch 90: the upper edge lies towards the yaw, the right edge to the right of it.
        np.testing.assert_allclose(xy[1], [expected[1], 0.0], atol=1e-12)
        np.testing.assert_allclose(xy[0], [0.0, -expected[0]], atol=1e-12)


def test_exact_ties_on_the_border_are_inside_wherever_the_scene_lies() -> None:
    rng = np.random.default_rng(0)
    for _ in range(50):
        yaw, x, y = rng.uniform(-180, 180), *rng.uniform(-1e3, 1e3, 2)
        camera = make_camera(x_m=x, y_m=y, yaw_deg=yaw, fov_deg=(90.0, 60.0), pitch_deg=35.0)
        # On a pinhole's side edge the ground points lie on the line through |right| = forward.
        direction = math.radians(yaw)
        ahead = rng.uniform(4.0, 40.0)
        aside = math.cos(math.radians(35)) * ahead + math.sin(math.radians(35)) * 6.0
        point = [
            x + ahead * math.cos(direction) + aside * math.sin(direction),
            y + ahead * math.sin(direction) - aside * math.cos(direction),
        ]
        _, inside = camera.pixel_from_ground(zeros(1), np.array([point]))
        assert inside[0]


def refused(match: str, **changes: object) -> None:
    with pytest.raises(ValueError, match=match) as caught:
        make_camera(**changes)  # type: ignore[arg-type]
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("changes", "match"),
    [
        ({"pitch_deg": 135.0}, r"camera\.pitch_deg\[0\] must lie in \(0, 90\], got 135"),
        ({"pitch_deg": 0.0}, r"camera\.pitch_deg\[0\]"),
        ({"pitch_deg": math.nan}, r"camera\.pitch_rad\[0\] must be finite"),
        ({"fov_deg": (180.0, 60.0)}, r"camera\.hfov_deg\[0\] must lie in \(0, 180\) for a pinhole"),
        ({"fov_deg": (60.0, 0.0)}, r"camera\.vfov_deg\[0\]"),
        ({"fov_deg": (360.0, 60.0), "projection": "stereographic"}, r"\(0, 360\) for a stereogr"),
        ({"fov_deg": (361.0, 60.0), "projection": "equidistant"}, r"\(0, 360\] for a equidistant"),
        ({"size_px": (0, 100)}, r"camera\.width_px\[0\] must lie in \[1, 100000\], got 0"),
        ({"size_px": (100, 10**9)}, r"camera\.height_px\[0\]"),
        ({"height_m": 0.0}, r"camera\.height_m\[0\] must lie in \(0, 100\], got 0"),
        ({"height_m": 100.5}, r"camera\.height_m\[0\]"),
        ({"x_m": math.inf}, r"camera\.x_m\[0\] must be finite"),
        ({"projection": "fisheye"}, r"camera\.projection must be one of pinhole"),
    ],
)
def test_an_impossible_camera_is_one_line(changes: dict[str, object], match: str) -> None:
    refused(match, **changes)


@LENSES
def test_distortion_that_folds_the_image_is_refused(lens: str) -> None:
    # θ − 0.5 θ³ turns at 46.8°: beyond the edges of 80°, but not beyond its corners.
    folding = (-0.5, 0.0, 0.0, 0.0)
    refused("must not fold the image", projection=lens, fov_deg=(80.0, 80.0), distortion=folding)
    refused("must not fold the image", projection=lens, fov_deg=(89.0, 10.0), distortion=folding)
    fine = make_camera(projection=lens, fov_deg=(50.0, 40.0), distortion=folding)
    # A ray beyond the fold lands on the image again; the camera must not claim to see it.
    behind_fold = np.array([[6.0 * math.tan(math.radians(45 + 40)), 0.0]])
    _, inside = fine.pixel_from_ground(zeros(1), behind_fold)
    assert not inside[0]


def test_wide_pinholes_are_warned_about() -> None:
    with pytest.warns(UserWarning, match="pinhole 100 degrees wide"):
        camera = make_camera(fov_deg=(100.0, 60.0))
    assert len(camera.subset([0])) == 1  # and only once: warnings are errors here


def test_fields_of_wrong_length_are_refused(pair: Callable[[], Cameras]) -> None:
    cameras = pair()
    with pytest.raises(ValueError, match=r"camera\.pitch_rad must have shape \(2,\), got \(1,\)"):
        Cameras(
            **{
                name: getattr(cameras, name) if name != "pitch_rad" else np.array([0.5])
                for name in Cameras.__dataclass_fields__
            }
        )


@pytest.fixture
def pair() -> Callable[[], Cameras]:
    return lambda: tilted("pinhole").subset([0, 0])


def test_arrays_are_read_only(pair: Callable[[], Cameras]) -> None:
    with pytest.raises(ValueError, match="read-only"):
        pair().x_m[0] = 1.0


def test_subset_keeps_order(pair: Callable[[], Cameras]) -> None:
    cameras = pair()
    assert len(cameras.subset(np.array([1, 0, 1]))) == 3
    assert len(cameras.subset(np.array([False, False]))) == 0
