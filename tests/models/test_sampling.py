"""Sampling, and the calibration it shows: stated 95 % regions hold 95 % of sampled errors."""

from __future__ import annotations

import math

import numpy as np
import pytest

from models.cameras import Cameras, make_camera
from models.errors import CHI2_95, ErrorModel, error_covariance, error_radius
from models.installation import Installation
from models.sampling import Samples, sample_image, sample_vehicles

LENSES = pytest.mark.parametrize("lens", ["pinhole", "stereographic", "equidistant"])
GOOD, POOR = Installation(), Installation(0.1, 1.2, 4.0)


def coverage(camera: Cameras, samples: Samples, model: ErrorModel) -> tuple[float, int]:
    """Return the share of reports within the report limit whose 95 % region holds the truth."""
    radius = error_radius(camera, samples.reported_m, model)[0]
    use = samples.seen & (radius <= model.report_limit_m)
    r = error_covariance(camera, samples.camera, samples.reported_m, model)[use]
    e = samples.errors_m()[use]
    determinant = r[:, 0] * r[:, 2] - r[:, 1] ** 2
    distance = (
        r[:, 2] * e[:, 0] ** 2 - 2 * r[:, 1] * e[:, 0] * e[:, 1] + r[:, 0] * e[:, 1] ** 2
    ) / determinant
    limit = CHI2_95 if model.kind == "covariance" else 4.0
    return float(np.mean(distance <= limit)), int(use.sum())


@LENSES
@pytest.mark.parametrize("pitch_deg", [90.0, 70.0, 50.0, 40.0, 30.0])
@pytest.mark.parametrize("installation", [GOOD, POOR], ids=["good", "poor"])
def test_covariance_holds_95_percent(
    lens: str, pitch_deg: float, installation: Installation
) -> None:
    camera = make_camera(pitch_deg=pitch_deg, projection=lens)
    index = np.zeros(60_000, dtype=np.int64)
    samples = sample_image(camera, index, installation, np.random.default_rng(7))
    share, used = coverage(camera, samples, ErrorModel("covariance", installation))
    assert used > 30_000
    # 94–96 % is asked; 30,000 samples have a standard error of 0.13 %.
    assert 0.945 < share < 0.955


@pytest.mark.parametrize("kind", ["radius", "ellipse"])
def test_circle_and_ellipse_hold_over_99_percent(kind: str) -> None:
    camera = make_camera(pitch_deg=50.0)
    index = np.zeros(60_000, dtype=np.int64)
    samples = sample_image(camera, index, GOOD, np.random.default_rng(7))
    assert coverage(camera, samples, ErrorModel(kind))[0] > 0.99


@LENSES
@pytest.mark.parametrize("kind", ["ellipse", "covariance"])
def test_the_principal_axis_is_that_of_samples_all_around_the_compass(kind: str, lens: str) -> None:
    for yaw_deg in range(10, 360, 35):
        camera = make_camera(yaw_deg=yaw_deg, pitch_deg=40.0, projection=lens)
        aside = math.radians(yaw_deg + 15.0)  # off the camera's own axis
        car = 12.0 * np.array([[math.cos(aside), math.sin(aside)]])
        index = np.zeros(20_000, dtype=np.int64)
        samples = sample_vehicles(
            camera, index, np.repeat(car, 20_000, axis=0), GOOD, np.random.default_rng(3)
        )
        assert samples.seen.all()
        sampled = np.cov(samples.errors_m().T)
        xx, xy, yy = error_covariance(camera, index[:1], car, ErrorModel(kind))[0]
        angle = 0.5 * math.atan2(2 * xy, xx - yy)
        wanted = 0.5 * math.atan2(2 * sampled[0, 1], sampled[0, 0] - sampled[1, 1])
        off = math.degrees((angle - wanted + math.pi / 2) % math.pi - math.pi / 2)
        assert abs(off) < 2.0
        assert np.sign(xy) == np.sign(sampled[0, 1]) or abs(xy) < 0.05 * xx
        if kind == "covariance":
            scale = math.sqrt(xx * yy)
            np.testing.assert_allclose(
                [xx, xy, yy], sampled.ravel()[[0, 1, 3]], rtol=0.05, atol=0.03 * scale
            )


def test_offsets_have_the_stated_deviations() -> None:
    camera, index = make_camera(), np.zeros(50_000, dtype=np.int64)
    samples = sample_image(camera, index, POOR, np.random.default_rng(1))
    np.testing.assert_allclose(samples.offsets.std(axis=0), POOR.sigmas(), rtol=0.02)
    correlation = np.corrcoef(samples.offsets.T) - np.eye(6)
    assert np.abs(correlation).max() < 0.02


def test_without_any_error_only_rounding_is_left() -> None:
    camera, index = make_camera(size_px=(200, 200)), np.zeros(1000, dtype=np.int64)
    samples = sample_image(camera, index, Installation(0, 0, 0), np.random.default_rng(1))
    at, _ = camera.pixel_from_ground(index, samples.truth_m)
    assert (np.abs(at - samples.pixel) <= 0.5 + 1e-9).all()
    assert (samples.pixel % 1.0 == 0.5).all()
    back, _ = camera.ground_from_pixel(index, samples.pixel)
    np.testing.assert_allclose(samples.reported_m, back, atol=1e-12)


def test_the_algorithm_error_is_half_its_95_percent_figure_in_pixels() -> None:
    camera, index = make_camera(), np.zeros(50_000, dtype=np.int64)
    samples = sample_image(camera, index, Installation(0, 0, 8.0), np.random.default_rng(1))
    at, _ = camera.pixel_from_ground(index, samples.truth_m)
    np.testing.assert_allclose((samples.pixel - at).std(axis=0), 4.0, rtol=0.02)


def test_the_same_seed_gives_the_same_samples_and_arrays_are_read_only() -> None:
    camera, index = make_camera(), np.zeros(100, dtype=np.int64)
    first, again, other = (
        sample_image(camera, index, GOOD, np.random.default_rng(seed)) for seed in (5, 5, 6)
    )
    np.testing.assert_array_equal(first.reported_m, again.reported_m)
    assert (first.reported_m != other.reported_m).any()
    with pytest.raises(ValueError, match="read-only"):
        first.offsets[0, 0] = 1.0


def test_a_share_of_the_image_is_kept_to() -> None:
    camera, index = make_camera(), np.zeros(1000, dtype=np.int64)
    samples = sample_image(
        camera, index, Installation(0, 0, 0), np.random.default_rng(1),
        share=(0.25, 0.5, 0.5, 0.75),
    )  # fmt: skip
    assert (samples.pixel >= [500, 1000]).all()
    assert (samples.pixel <= [1000, 1500]).all()


def test_cars_outside_the_image_and_above_the_horizon_are_not_seen() -> None:
    camera, index = make_camera(pitch_deg=10.0), np.zeros(2000, dtype=np.int64)
    samples = sample_image(camera, index, GOOD, np.random.default_rng(1))
    # The horizon lies at tan 10° of tan 30° above the middle.
    below = 0.5 + 0.5 * math.tan(math.radians(10)) / math.tan(math.radians(30))
    assert samples.seen.mean() == pytest.approx(below, abs=0.03)
    behind = np.repeat([[-20.0, 0.0]], 10, axis=0)
    assert not sample_vehicles(
        camera, index[:10], behind, GOOD, np.random.default_rng(1)
    ).seen.any()


def test_as_many_cars_as_cameras_are_wanted() -> None:
    with pytest.raises(ValueError, match="xy_m must have one point for each of 3, got 2"):
        sample_vehicles(
            make_camera(), np.zeros(3, dtype=np.int64), np.zeros((2, 2)), GOOD,
            np.random.default_rng(1),
        )  # fmt: skip
