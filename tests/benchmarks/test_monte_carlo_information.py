import numpy as np
import pytest

from benchmarks.monte_carlo_information import simulate_information
from benchmarks.synthetic_drives import CAR, ROBOT, random_drive
from models.vehicle import OdometryNoise
from placement.objectives.entropy import Entropy


@pytest.mark.parametrize("offsets", [0, 3])
@pytest.mark.parametrize("odometry", [CAR, ROBOT])
def test_simulated_information_agrees_with_the_closed_form(
    odometry: OdometryNoise, offsets: int
) -> None:
    drive = random_drive(np.random.default_rng(3), n_samples=60, offsets=offsets, odometry=odometry)
    chosen = np.array([1, 4, 8, 9, 15])
    estimate = simulate_information(drive, chosen, 4000, np.random.default_rng(0))
    closed = 0.5 * Entropy([drive]).value(chosen)
    # three standard errors: one draw in 370, and the seed is fixed
    assert abs(estimate.nats - closed) < 3.0 * estimate.standard_error
    assert estimate.standard_error < 0.03 * closed


def test_forgetting_the_offsets_is_noticed() -> None:
    drive = random_drive(np.random.default_rng(3), n_samples=60, offsets=3)
    chosen = np.array([1, 4, 8, 9, 15])
    estimate = simulate_information(drive, chosen, 4000, np.random.default_rng(0))
    white = random_drive(np.random.default_rng(3), n_samples=60, offsets=0)
    too_much = 0.5 * Entropy([white]).value(chosen)
    assert too_much > estimate.nats + 5.0 * estimate.standard_error
