"""Lenses against OpenCV, finite differences, and their own inverses."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest

from models.projections import (
    Projection,
    angle_limit,
    field_of_view,
    fold_angle,
    image_jacobian,
    image_radius,
    project_rays,
    ray_jacobian,
    unproject_points,
)

NONE = np.zeros(4)
MILD = np.array([0.03, -0.008, 0.002, -0.0004])
STRONG = np.array([-0.12, 0.03, -0.004, 0.0002])
DISTORTIONS = pytest.mark.parametrize("k", [NONE, MILD, STRONG], ids=["none", "mild", "strong"])
LENSES = pytest.mark.parametrize("lens", list(Projection), ids=lambda lens: lens.name.lower())


def rays_within(angle_deg: float, n: int = 400) -> np.ndarray:
    """Return rays of differing lengths, uniform in angle and direction."""
    rng = np.random.default_rng(5)
    theta, alpha = rng.uniform(0, math.radians(angle_deg), n), rng.uniform(0, 2 * math.pi, n)
    unit = np.stack(
        [np.sin(theta) * np.cos(alpha), np.sin(theta) * np.sin(alpha), np.cos(theta)], axis=1
    )
    return unit * rng.uniform(0.5, 30.0, (n, 1))


def opencv_fisheye(rays: np.ndarray, k: np.ndarray) -> np.ndarray:
    """Project with OpenCV's fisheye model at focal length 1."""
    zero = np.zeros((3, 1))
    points, _ = cv2.fisheye.projectPoints(rays.reshape(-1, 1, 3), zero, zero, np.eye(3), k)
    return points.reshape(-1, 2)


@DISTORTIONS
def test_equidistant_is_opencvs_fisheye(k: np.ndarray) -> None:
    rays = rays_within(80.0)
    ours = project_rays(Projection.EQUIDISTANT, rays, k)
    np.testing.assert_allclose(ours, opencv_fisheye(rays, k), rtol=0, atol=1e-12)


def test_pinhole_is_opencvs_pinhole() -> None:
    rays = rays_within(80.0)
    zero = np.zeros((3, 1))
    theirs, _ = cv2.projectPoints(rays.reshape(-1, 1, 3), zero, zero, np.eye(3), np.zeros(5))
    ours = project_rays(Projection.PINHOLE, rays, NONE)
    np.testing.assert_allclose(ours, theirs.reshape(-1, 2), rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("k", [MILD, STRONG], ids=["mild", "strong"])
def test_distorted_pinhole_is_opencvs_fisheye_angle_then_opencvs_pinhole(k: np.ndarray) -> None:
    rays = rays_within(60.0)
    bent = opencv_fisheye(rays, k)  # θ_d in the direction of the ray
    angle = np.linalg.norm(bent, axis=1, keepdims=True)
    bent_rays = np.hstack([np.sin(angle) * bent / angle, np.cos(angle)])
    zero = np.zeros((3, 1))
    theirs, _ = cv2.projectPoints(bent_rays.reshape(-1, 1, 3), zero, zero, np.eye(3), np.zeros(5))
    ours = project_rays(Projection.PINHOLE, rays, k)
    np.testing.assert_allclose(ours, theirs.reshape(-1, 2), rtol=1e-12, atol=1e-12)


def test_stereographic_is_the_sphere_seen_from_its_far_pole() -> None:
    """Project the unit sphere from the pole behind the camera onto the plane that touches it."""
    rays = rays_within(170.0)
    unit = rays / np.linalg.norm(rays, axis=1, keepdims=True)
    expected = 2.0 * unit[:, :2] / (1.0 + unit[:, 2:])
    ours = project_rays(Projection.STEREOGRAPHIC, rays, NONE)
    np.testing.assert_allclose(ours, expected, rtol=1e-11, atol=1e-13)


@LENSES
@DISTORTIONS
def test_unprojecting_returns_the_ray(lens: Projection, k: np.ndarray) -> None:
    rays = rays_within(75.0)
    back = unproject_points(lens, project_rays(lens, rays, k), k)
    unit = rays / np.linalg.norm(rays, axis=1, keepdims=True)
    np.testing.assert_allclose(back, unit, rtol=0, atol=1e-13)


@LENSES
@DISTORTIONS
def test_image_jacobian_is_the_finite_difference(lens: Projection, k: np.ndarray) -> None:
    rays = np.vstack([rays_within(75.0, 60), [0.0, 0.0, 2.0], [1e-9, -2e-9, 1.0]])
    step = 1e-6
    for ray in rays:
        ours = np.array(image_jacobian(int(lens), *ray, *k)).reshape(2, 3)
        moved = np.vstack([ray + step * np.eye(3), ray - step * np.eye(3)])
        points = project_rays(lens, moved, k)
        numeric = ((points[:3] - points[3:]) / (2 * step)).T
        np.testing.assert_allclose(ours, numeric, rtol=2e-7, atol=1e-8)


@LENSES
@DISTORTIONS
def test_ray_jacobian_is_the_finite_difference(lens: Projection, k: np.ndarray) -> None:
    step = 1e-6
    for ray in rays_within(75.0, 60):
        ours = np.array(ray_jacobian(int(lens), *ray, *k)).reshape(3, 2)
        point = project_rays(lens, ray[None], k)[0]
        moved = np.vstack([point + step * np.eye(2), point - step * np.eye(2)])
        back = unproject_points(lens, moved, k)
        numeric = ((back[:2] - back[2:]) / (2 * step)).T
        np.testing.assert_allclose(ours, numeric, rtol=2e-7, atol=1e-8)


@LENSES
def test_rays_the_lens_cannot_see_are_nan(lens: Projection) -> None:
    behind = np.array([[0.0, 0.0, -1.0]])
    assert np.isnan(project_rays(lens, behind, NONE)).all()
    if lens == Projection.PINHOLE:
        assert np.isnan(project_rays(lens, np.array([[1.0, 0.0, -0.1]]), NONE)).all()
        assert np.isnan(project_rays(lens, np.array([[1.0, 0.0, 0.1]]), 5 * np.abs(MILD))).all()


def test_points_beyond_the_last_angle_are_nan() -> None:
    beyond = np.array([[3.2, 0.0]])
    assert np.isnan(unproject_points(Projection.EQUIDISTANT, beyond, NONE)).all()


def test_fold_angle_is_where_the_distorted_angle_turns() -> None:
    k = np.array([-0.2, 0.0, 0.0, 0.0])  # θ − 0.2 θ³ turns at 1/sqrt(0.6)
    assert fold_angle(k) == pytest.approx(1.0 / math.sqrt(0.6), rel=1e-12)
    assert fold_angle(NONE) == math.inf
    assert fold_angle(np.array([0.1, 0.1, 0.1, 0.1])) == math.inf


def test_angle_limit_is_the_first_of_fold_and_projections_end() -> None:
    assert angle_limit(Projection.PINHOLE, NONE) == pytest.approx(math.pi / 2)
    assert angle_limit(Projection.EQUIDISTANT, NONE) == pytest.approx(math.pi)
    fold = np.array([-0.2, 0.0, 0.0, 0.0])
    for lens in Projection:
        assert angle_limit(lens, fold) == pytest.approx(1.0 / math.sqrt(0.6), rel=1e-12)
    stretch = np.array([0.5, 0.0, 0.0, 0.0])  # θ (1 + θ²/2) = π/2 at 1.1406…
    limit = angle_limit(Projection.PINHOLE, stretch)
    assert limit * (1 + 0.5 * limit**2) == pytest.approx(math.pi / 2, rel=1e-12)


@LENSES
@DISTORTIONS
def test_field_of_view_undoes_the_focal_length(lens: Projection, k: np.ndarray) -> None:
    fov = math.radians(70.0)
    focal = 1000.0 / image_radius(lens, 0.5 * fov, k)
    assert field_of_view(lens, focal, 2000.0, k) == pytest.approx(fov, rel=1e-12)


def test_field_of_view_names_a_focal_length_that_is_too_short() -> None:
    with pytest.raises(ValueError, match=r"camera\.focal_px must be large enough for 2000 px"):
        field_of_view(Projection.EQUIDISTANT, 100.0, 2000.0, NONE)


def test_parse_names_the_projections_there_are() -> None:
    assert Projection.parse("stereographic") is Projection.STEREOGRAPHIC
    with pytest.raises(ValueError, match="pinhole, stereographic, equidistant, got 'fisheye'"):
        Projection.parse("fisheye")
