"""Error models: formulas by hand, an independent NumPy twin, and a table of expectations."""

from __future__ import annotations

import math

import numpy as np
import pytest

from models.cameras import Cameras, make_camera
from models.errors import (
    CHI2_95,
    FORMS,
    ErrorModel,
    covariance_components,
    error_components,
    error_covariance,
    error_radius,
    measurement_covariance,
    persistent_variances,
    split_covariance,
)
from models.installation import Installation

LENSES = pytest.mark.parametrize("lens", ["pinhole", "stereographic", "equidistant"])
EVERY_FORM = pytest.mark.parametrize("kind", FORMS)


def camera_at(lens: str = "pinhole", yaw_deg: float = 20.0, pitch_deg: float = 50.0) -> Cameras:
    return make_camera(
        x_m=3.0, y_m=-2.0, yaw_deg=yaw_deg, pitch_deg=pitch_deg, projection=lens,
        fov_deg=(70.0, 50.0), size_px=(2000, 1100),
    )  # fmt: skip


def ground(camera: Cameras, n: int = 200) -> np.ndarray:
    pixels = np.random.default_rng(4).uniform([0, 0], [2000, 1100], (n, 2))
    return camera.ground_from_pixel(np.zeros(n, dtype=np.int64), pixels)[0]


def zeros(n: int) -> np.ndarray:
    return np.zeros(n, dtype=np.int64)


def matrices(blocks: np.ndarray) -> np.ndarray:
    return blocks[:, [0, 1, 1, 2]].reshape(-1, 2, 2)


def numeric_ground_jacobian(camera: Cameras, xy: np.ndarray) -> np.ndarray:
    """Return ∂(x, y)/∂(u, v) by central differences, (n, 2, 2)."""
    n = len(xy)
    pixel, _ = camera.pixel_from_ground(zeros(n), xy)
    step = 1e-3
    columns = [
        (
            camera.ground_from_pixel(zeros(n), pixel + shift)[0]
            - camera.ground_from_pixel(zeros(n), pixel - shift)[0]
        )
        / (2 * step)
        for shift in step * np.eye(2)
    ]
    return np.stack(columns, axis=2)


def twin_radius(camera: Cameras, xy: np.ndarray, installation: Installation) -> np.ndarray:
    """Return DESIGN's r, written with the arctangent of the text and a numeric pixel area."""
    h, e_pos = float(camera.height_m[0]), installation.position_95_m
    d = np.hypot(xy[:, 0] - camera.x_m[0], xy[:, 1] - camera.y_m[0])
    e_ori = math.radians(installation.orientation_95_deg)
    orientation = h * np.tan(np.arctan(d / h) + e_ori) - d
    area = np.abs(np.linalg.det(numeric_ground_jacobian(camera, xy)))
    pixel = np.sqrt(2.0 * area)
    return e_pos + e_pos * d / h + orientation + installation.algorithm_95_px * pixel


@LENSES
def test_radius_is_the_text(lens: str) -> None:
    camera = camera_at(lens)
    xy = ground(camera)
    model = ErrorModel("radius", Installation(0.05, 0.7, 5.0))
    expected = twin_radius(camera, xy, model.installation)
    np.testing.assert_allclose(error_radius(camera, xy, model)[0], expected, rtol=1e-6)
    blocks = error_covariance(camera, zeros(len(xy)), xy, model)
    np.testing.assert_allclose(blocks[:, 0], (0.5 * expected) ** 2, rtol=1e-6)
    np.testing.assert_array_equal(blocks[:, 0], blocks[:, 2])
    assert not blocks[:, 1].any()


def test_radius_of_a_pinhole_straight_down_by_hand() -> None:
    camera = make_camera(pitch_deg=90.0, fov_deg=(60.0, 60.0), size_px=(2000, 2000))
    pixel = math.sqrt(2.0) * 6.0 * math.tan(math.radians(30.0)) / 1000.0
    expected = 0.03 + 6.0 * math.tan(math.radians(0.5)) + 4.0 * pixel
    r = error_radius(camera, np.zeros((1, 2)), ErrorModel("radius"))
    assert r[0, 0] == pytest.approx(expected, rel=1e-12)


@LENSES
def test_ellipse_is_the_circles_area_along_the_line_of_sight(lens: str) -> None:
    for yaw_deg in range(0, 360, 30):
        camera = camera_at(lens, float(yaw_deg))
        xy = ground(camera, 40)
        circle = error_covariance(camera, zeros(40), xy, ErrorModel("radius"))
        blocks = matrices(error_covariance(camera, zeros(40), xy, ErrorModel("ellipse")))
        np.testing.assert_allclose(np.linalg.det(blocks), circle[:, 0] ** 2, rtol=1e-11)
        sight = xy - [3.0, -2.0]
        sight /= np.linalg.norm(sight, axis=1, keepdims=True)
        values, vectors = np.linalg.eigh(blocks)
        stretched = values[:, 1] > 1.02 * values[:, 0]
        cosine = np.abs(np.sum(vectors[:, :, 1] * sight, axis=1))
        np.testing.assert_allclose(cosine[stretched], 1.0, atol=1e-12)
        assert stretched.mean() > 0.5
        # The ratio of the axes is that of the pixel's ground extents along and across.
        jacobian = numeric_ground_jacobian(camera, xy)
        aside = np.column_stack([-sight[:, 1], sight[:, 0]])
        along, across = (
            np.linalg.norm(np.einsum("nij,ni->nj", jacobian, v), axis=1) for v in (sight, aside)
        )
        expected = np.maximum(1.0, along / across)
        np.testing.assert_allclose(np.sqrt(values[:, 1] / values[:, 0]), expected, rtol=1e-5)


@LENSES
def test_covariance_is_the_sum_over_offsets_and_pixels(lens: str) -> None:
    camera = camera_at(lens)
    xy = ground(camera)
    installation = Installation(0.05, 0.7, 5.0)
    # Twin: line of sight and its normal, formulas of the module text, numeric pixel Jacobian.
    sight = xy - [3.0, -2.0]
    d = np.linalg.norm(sight, axis=1)
    e = sight / d[:, None]
    a = np.column_stack([-e[:, 1], e[:, 0]])
    h, pos, ori = 6.0, 0.025, 0.5 * math.radians(0.7)
    along = pos**2 * (1 + d**2 / h**2) + ori**2 * (d**2 + h**2) ** 2 / h**2
    across = pos**2 + ori**2 * (d**2 + h**2)
    twin = np.einsum("n,ni,nj->nij", along, e, e) + np.einsum("n,ni,nj->nij", across, a, a)
    g = numeric_ground_jacobian(camera, xy)
    white = (2.5**2 + 1.0 / 12.0) * g @ g.transpose(0, 2, 1)
    model = ErrorModel("covariance", installation)
    whole = matrices(error_covariance(camera, zeros(len(xy)), xy, model))
    np.testing.assert_allclose(whole, twin + white, rtol=1e-6, atol=1e-12)
    w, b = split_covariance(camera, zeros(len(xy)), xy, model)
    np.testing.assert_allclose(matrices(w), white, rtol=1e-6, atol=1e-12)
    np.testing.assert_allclose(b @ b.transpose(0, 2, 1), twin, rtol=1e-12, atol=1e-15)
    parts = covariance_components(camera, zeros(len(xy)), xy, installation).sum(axis=1)
    np.testing.assert_allclose(matrices(parts), whole, rtol=1e-12, atol=1e-15)


def test_the_default_installation_gives_19_cm_at_15_m() -> None:
    along, _ = persistent_variances(6.0, 225.0, 0.0, (0.5 * math.radians(0.5)) ** 2)
    assert math.sqrt(along) == pytest.approx(0.19, abs=0.001)


@EVERY_FORM
def test_components_add_up(kind: str) -> None:
    camera = camera_at()
    xy = ground(camera)
    for algorithm in (0.4, 4.0):
        model = ErrorModel(kind, Installation(0.05, 0.7, algorithm))
        parts = error_components(camera, zeros(len(xy)), xy, model)
        radius = error_radius(camera, xy, model)[0]
        assert parts.shape == (len(xy), 5)
        if kind != "covariance":
            np.testing.assert_allclose(parts.sum(axis=1), radius, rtol=1e-12)
        assert (parts >= 0.0).all()
        assert (parts <= radius[:, None]).all()


@EVERY_FORM
def test_radius_is_the_longest_semi_axis(kind: str) -> None:
    camera = camera_at()
    xy = ground(camera)
    blocks = matrices(error_covariance(camera, zeros(len(xy)), xy, ErrorModel(kind)))
    factor = CHI2_95 if kind == "covariance" else 4.0
    expected = np.sqrt(factor * np.linalg.eigvalsh(blocks)[:, 1])
    radius = error_radius(camera, xy, ErrorModel(kind))[0]
    np.testing.assert_allclose(radius, expected, rtol=1e-10)


@EVERY_FORM
def test_radius_is_infinite_outside_the_image(kind: str) -> None:
    camera = camera_at()
    behind = np.array([[3.0 - 20.0, -2.0 - 20.0]])
    assert np.isinf(error_radius(camera, behind, ErrorModel(kind))).all()


@EVERY_FORM
def test_straight_below_the_camera_nothing_is_singular(kind: str) -> None:
    row = make_camera(pitch_deg=90.0).table()[0]
    p = ErrorModel(kind).parameters()
    at = measurement_covariance(row, 0.0, 0.0, p)
    near = measurement_covariance(row, 1e-7, -1e-7, p)
    assert np.isfinite(at).all()
    np.testing.assert_allclose(at, near, rtol=1e-6, atol=1e-9)


@EVERY_FORM
@LENSES
def test_rotating_and_shifting_the_scene_changes_nothing(kind: str, lens: str) -> None:
    camera = camera_at(lens)
    xy = ground(camera, 50)
    radius = error_radius(camera, xy, ErrorModel(kind))
    turn, shift = math.radians(123.4), np.array([1e5, -2e5])
    rotation = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
    place = rotation @ [3.0, -2.0] + shift
    moved = make_camera(
        x_m=place[0], y_m=place[1], yaw_deg=20.0 + 123.4, pitch_deg=50.0, projection=lens,
        fov_deg=(70.0, 50.0), size_px=(2000, 1100),
    )  # fmt: skip
    there = error_radius(moved, xy @ rotation.T + shift, ErrorModel(kind))
    np.testing.assert_allclose(there, radius, rtol=1e-9)


@EVERY_FORM
def test_a_better_installation_has_a_smaller_error(kind: str) -> None:
    camera = camera_at()
    xy = ground(camera, 50)
    worse = error_radius(camera, xy, ErrorModel(kind, Installation(0.03, 0.5, 4.0)))
    for better in (Installation(0.02, 0.5, 4.0), Installation(0.03, 0.4, 4.0),
                   Installation(0.03, 0.5, 3.0)):  # fmt: skip
        assert (error_radius(camera, xy, ErrorModel(kind, better)) < worse).all()


def test_only_a_persistent_covariance_splits() -> None:
    camera = camera_at()
    xy = ground(camera, 5)
    assert ErrorModel("covariance").splits
    for model in (ErrorModel("radius"), ErrorModel("ellipse"),
                  ErrorModel("covariance", persistent=False)):  # fmt: skip
        assert not model.splits
        white, offsets = split_covariance(camera, zeros(5), xy, model)
        np.testing.assert_array_equal(white, error_covariance(camera, zeros(5), xy, model))
        assert not offsets.any()
    assert ErrorModel("radius").isotropic


@pytest.mark.parametrize(
    ("arguments", "match"),
    [
        ({"kind": "circle"}, r"errors\.model must be one of radius, ellipse, covariance, got 'ci"),
        ({"report_limit_m": 0.0}, r"errors\.report_limit_m must be positive, got 0"),
        ({"report_limit_m": math.nan}, r"errors\.report_limit_m must be positive, got nan"),
        (
            {"kind": "radius", "installation": Installation(0.0, 0.0, 0.0)},
            r"errors\.position_95_m must be positive where everything else is 0",
        ),
    ],
)
def test_impossible_models_are_one_line(arguments: dict[str, object], match: str) -> None:
    with pytest.raises(ValueError, match=match):
        ErrorModel(**arguments)  # type: ignore[arg-type]


def test_an_orientation_error_beyond_the_horizon_is_infinite() -> None:
    row = make_camera(pitch_deg=10.0).table()[0]
    p = ErrorModel("radius", Installation(0.03, 5.0, 4.0)).parameters()
    assert math.isinf(measurement_covariance(row, 80.0, 0.0, p)[3])
