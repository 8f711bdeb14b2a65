"""The driver: Stanley's law, the speed wished for, the pedal."""

from __future__ import annotations

import math

import numpy as np
import pytest

from models.control import Control, SpeedPolicy, pedal, stanley

GAINS = Control().as_array()


def test_stanley_is_the_published_law() -> None:
    assert stanley(0.1, 0.0, 10.0, GAINS) == pytest.approx(0.1)
    left_of_the_road = stanley(0.0, 0.5, 10.0, GAINS)
    assert left_of_the_road == pytest.approx(-math.atan(0.95 * 0.5 / 10.5))


def test_a_straight_is_driven_at_the_set_speed_and_a_bend_at_half_over_its_curvature() -> None:
    policy = SpeedPolicy(speed_mps=20.0)
    np.testing.assert_allclose(policy.along(np.zeros(100), 1.0, False), 20.0)
    np.testing.assert_allclose(policy.along(np.full(100, -0.05), 1.0, True), 10.0)


def test_the_car_brakes_before_a_bend_and_accelerates_after_it() -> None:
    curvature = np.zeros(300)
    curvature[150:200] = 0.05
    speed = SpeedPolicy(look_ahead_m=40.0).along(curvature, 1.0, False)
    assert speed[100] == pytest.approx(20.0)
    assert speed[130] == pytest.approx(0.5 * (20.0 + 10.0))
    np.testing.assert_allclose(speed[150:200], 10.0)
    assert speed[200] == pytest.approx(20.0)


def test_a_closed_road_looks_ahead_over_its_start() -> None:
    curvature = np.zeros(101)
    curvature[:11] = curvature[100] = 0.05
    speed = SpeedPolicy(look_ahead_m=20.0).along(curvature, 1.0, True)
    assert speed[95] < 20.0
    assert speed[0] == pytest.approx(10.0)


def test_cornering_can_be_bounded() -> None:
    speed = SpeedPolicy(lateral_limit_mps2=4.0).along(np.full(10, 0.025), 1.0, True)
    np.testing.assert_allclose(speed, math.sqrt(4.0 / 0.025))


def test_the_pedal_is_a_pid() -> None:
    kp, ki, kd = GAINS[2:]
    acceleration, integral, error = pedal(18.0, 20.0, 0.5, 1.5, 0.04, GAINS)
    assert error == pytest.approx(2.0)
    assert integral == pytest.approx(0.5 + 2.0 * 0.04)
    assert acceleration == pytest.approx(kp * 2.0 + ki * integral + kd * 0.5 / 0.04)


def test_the_integral_does_not_wind_up() -> None:
    integral = 0.0
    for _ in range(10_000):
        _, integral, _ = pedal(0.0, 20.0, integral, 20.0, 0.04, GAINS)
    assert integral == 2.0


@pytest.mark.parametrize("name", ["speed_mps", "bend_rate_hz", "look_ahead_m"])
@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf])
def test_an_impossible_speed_policy_is_refused(name: str, value: float) -> None:
    with pytest.raises(ValueError, match=f"speed.{name} must be finite and above 0"):
        SpeedPolicy(**{name: value})
