"""Odometry noise as densities, and what the vehicle can turn."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from models.vehicle import PROFILES, OdometryNoise, Vehicle, check_turnable, from_alphas

ALPHAS = (1e-4, 1.5e-4, 1.5e-4, 1e-4)


def step_covariance(alphas: tuple[float, ...], d: float) -> np.ndarray:
    """Covariance of one straight rot-trans-rot step by its Jacobian at rot1 = rot2 = 0."""
    _, turn, go, _ = alphas
    # (along, across, heading) against (rot1, trans, rot2)
    jacobian = np.array([[0.0, 1.0, 0.0], [d, 0.0, 0.0], [1.0, 0.0, 1.0]])
    sigma = np.array([turn * d, go * d, turn * d])
    return jacobian @ np.diag(sigma**2) @ jacobian.T


@given(d=st.floats(0.01, 10.0))
def test_alphas_give_the_covariance_of_their_own_step(d: float) -> None:
    noise = from_alphas(ALPHAS, d)
    np.testing.assert_allclose(noise.covariance(d), step_covariance(ALPHAS, d), rtol=1e-12)


@given(
    d=st.floats(0.01, 5.0),
    n=st.integers(1, 12),
    q=st.floats(1e-5, 0.1),
    a=st.floats(1e-5, 0.1),
    c=st.floats(1e-5, 0.1),
)
def test_many_short_steps_have_the_covariance_of_one_long_step(
    d: float, n: int, q: float, a: float, c: float
) -> None:
    noise = OdometryNoise(q, a, c)
    step = d / n
    forward = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, step], [0.0, 0.0, 1.0]])
    covariance = np.zeros((3, 3))
    for _ in range(n):
        covariance = forward @ covariance @ forward.T + noise.covariance(step)
    np.testing.assert_allclose(covariance, noise.covariance(d), rtol=1e-9)


def test_the_dissertation_s_alphas_are_about_a_thousandth_of_the_distance() -> None:
    noise = PROFILES["dissertation"]
    assert noise.along_m_per_sqrt_m == pytest.approx(1.5e-4 * math.sqrt(0.8))
    assert noise.heading_rad_per_sqrt_m == pytest.approx(1.5e-4 * math.sqrt(1.6))


@pytest.mark.parametrize(
    ("alphas", "step"),
    [((1, 2, 3), 0.8), ((1, 2, 3, -1), 0.8), ((1, 2, 3, math.nan), 0.8), ((1, 2, 3, 4), 0.0)],
)
def test_bad_alphas_are_refused(alphas: tuple[float, ...], step: float) -> None:
    with pytest.raises(ValueError, match=r"odometry\.(alphas|step_m) must be"):
        from_alphas(alphas, step)


def test_a_negative_density_is_refused() -> None:
    with pytest.raises(ValueError, match=r"odometry\.along_m_per_sqrt_m must be finite"):
        OdometryNoise(0.1, -0.1, 0.1)


def test_the_turning_radius_is_that_of_the_centre() -> None:
    car = Vehicle(wheelbase_m=2.7, centre_to_rear_m=1.35, steering_limit_rad=0.6)
    rear = 2.7 / math.tan(0.6)
    assert car.turning_radius_m == pytest.approx(math.sqrt(rear**2 + 1.35**2))


def test_a_road_too_tight_is_refused_with_the_place() -> None:
    s = np.array([0.0, 10.0, 20.0])
    with pytest.raises(ValueError, match=r"got 4\.00 m at s = 10\.0 m"):
        check_turnable(Vehicle(), s, np.array([0.0, -0.25, 0.1]))
    check_turnable(Vehicle(), s, np.array([0.0, -0.2, 0.1]))


@pytest.mark.parametrize(
    "change",
    [
        {"wheelbase_m": 0.0},
        {"steering_limit_rad": 2.0},
        {"centre_to_rear_m": 3.0},
        {"braking_limit_mps2": math.nan},
    ],
)
def test_an_impossible_vehicle_is_refused(change: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=r"vehicle\.\w+ must"):
        Vehicle(**change)
