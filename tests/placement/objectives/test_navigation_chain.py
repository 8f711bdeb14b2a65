import numpy as np
import pytest
from scipy.integrate import solve_ivp

from benchmarks.synthetic_drives import CAR, ROBOT, Samples, random_drive
from models.vehicle import OdometryNoise
from placement.information import Information
from placement.objectives.navigation_chain import Drive, chain_steps
from placement.objectives.windows.filter import empty_messages, filter_forward


def arc_samples(n: int, length_m: float, curvature: float) -> Samples:
    s = np.linspace(0.0, length_m, n)
    return Samples(s, np.asarray(curvature * s))


def last_covariance(samples: Samples, odometry: OdometryNoise) -> np.ndarray:
    steps = chain_steps(samples, odometry)
    p0 = np.array([0.01, 0.0, 0.0, 0.04, 0.0, 1e-4])
    before, after, logs = empty_messages(len(samples.s_m))
    filter_forward(steps, p0, np.zeros((len(samples.s_m), 3)), before, after, logs)
    return after[-1]


@pytest.mark.parametrize("curvature", [0.0, 0.02, -0.05, 1e-9])
def test_halving_the_spacing_does_not_change_the_covariance(curvature: float) -> None:
    coarse = last_covariance(arc_samples(11, 40.0, curvature), ROBOT)
    fine = last_covariance(arc_samples(21, 40.0, curvature), ROBOT)
    np.testing.assert_allclose(coarse, fine, rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize("curvature", [0.0, 0.05, -0.1])
def test_one_step_equals_the_integrated_differential_equation(curvature: float) -> None:
    # dP/ds = A P + P Aᵀ + diag(q²), with the road frame turning under the error at κ
    a = np.array([[0.0, curvature, 0.0], [-curvature, 0.0, 1.0], [0.0, 0.0, 0.0]])
    q = np.diag([0.02**2, 0.005**2, ROBOT.heading_rad_per_sqrt_m**2])
    p0 = np.diag([0.01, 0.04, 1e-4])

    def slope(_: float, p: np.ndarray) -> np.ndarray:
        m = p.reshape(3, 3)
        return (a @ m + m @ a.T + q).ravel()

    want = solve_ivp(slope, (0.0, 12.0), p0.ravel(), rtol=1e-12, atol=1e-16).y[:, -1]
    got = last_covariance(arc_samples(2, 12.0, curvature), ROBOT)
    np.testing.assert_allclose(got, want.reshape(3, 3)[np.triu_indices(3)], rtol=1e-9, atol=1e-13)


def test_a_straight_step_has_the_closed_form_of_the_odometry_noise() -> None:
    steps = chain_steps(arc_samples(2, 7.0, 0.0), CAR)
    q = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])
    np.testing.assert_allclose(steps[1, 4:][q], CAR.covariance(7.0), rtol=1e-13, atol=1e-20)


def test_a_heading_that_wraps_at_pi_is_no_turn() -> None:
    s = np.array([0.0, 1.0])
    across = Samples(s, np.array([np.pi - 1e-3, -np.pi + 1e-3]))
    plain = Samples(s, np.array([0.0, 2e-3]))
    np.testing.assert_allclose(chain_steps(across, CAR), chain_steps(plain, CAR), atol=1e-15)


def test_arc_lengths_that_do_not_increase_are_refused() -> None:
    with pytest.raises(ValueError, match=r"points\.s_m must increase, got 1\.0 after 1\.0"):
        chain_steps(Samples(np.array([0.0, 1.0, 1.0]), np.zeros(3)), CAR)


@pytest.mark.parametrize("sigma", [(0.1, 0.1), (0.1, -0.1, 0.0), (0.1, 0.1, np.nan)])
def test_impossible_initial_uncertainty_is_refused(sigma: tuple[float, ...]) -> None:
    drive = random_drive(np.random.default_rng(0))
    with pytest.raises(ValueError, match=r"vehicle\.initial_sigma must be three finite"):
        Drive(drive.points, drive.information, CAR, np.array(sigma))


def test_information_over_other_samples_is_refused() -> None:
    drive = random_drive(np.random.default_rng(0), n_samples=30)
    with pytest.raises(ValueError, match="information covers 30 samples, the drive 2"):
        Drive(arc_samples(2, 1.0, 0.0), drive.information, CAR, np.zeros(3))


def test_offsets_without_white_information_are_refused() -> None:
    info = random_drive(np.random.default_rng(0), offsets=2).information
    bare = Information(info.n_samples, info.indptr, info.indices, info.blocks, offsets=info.offsets)
    with pytest.raises(ValueError, match=r"information\.offsets needs information\.white"):
        Drive(arc_samples(30, 9.0, 0.0), bare, CAR, np.zeros(3))


def test_a_negative_weight_is_refused() -> None:
    drive = random_drive(np.random.default_rng(0))
    with pytest.raises(ValueError, match=r"drive\.weight must be finite and at least 0, got -1"):
        Drive(drive.points, drive.information, CAR, np.zeros(3), weight=-1.0)
