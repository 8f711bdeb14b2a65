"""The filters against filterpy, a dense Schmidt filter, and filters that never were late."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter
from hypothesis import given, settings
from hypothesis import strategies as st

from models.filters import (
    BROKEN,
    GATED,
    POSE,
    UPDATED,
    forget,
    new_estimate,
    normalised_error,
    predict,
    remember,
    update,
)
from models.vehicle import OdometryNoise

NOISE = OdometryNoise(0.01, 0.05, 0.02)


@dataclass
class Ours:
    """The kernels with their arrays, as the closed loop holds them."""

    p0: np.ndarray
    slots: int = 0
    cameras: int = 0
    pose: tuple[float, float, float] = (1.0, -2.0, 0.4)
    noise: OdometryNoise = NOISE
    met: list[int] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.mean, self.covariance, self.cross, self.list = new_estimate(
            self.pose, self.p0, slots=self.slots, cameras=self.cameras, offsets=6
        )
        self.work = np.empty((len(self.mean), 4))
        self.innovation = np.zeros(3)

    @property
    def state(self) -> tuple:
        return self.mean, self.covariance, self.cross, self.list, len(self.met)

    def predict(self, odometry: np.ndarray) -> None:
        predict(*self.state, *odometry, self.noise.as_array())

    def update(self, z, white, offsets=None, camera=-1, row=0, gate=math.inf) -> int:
        if camera >= 0 and camera not in self.met:
            self.list[len(self.met)] = camera
            self.met.append(camera)
        d = np.zeros((2, 6)) if offsets is None else offsets
        return update(
            *self.state, row, camera, z[0], z[1], d, white, gate, self.work, self.innovation
        )


def random_white(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    root = rng.normal(size=(2, 2)) * 0.3
    r = root @ root.T + 0.01 * np.eye(2)
    return r, np.array([r[0, 0], r[0, 1], r[1, 1]])


def random_odometry(rng: np.random.Generator) -> np.ndarray:
    return np.array([0.8, 0.02, 0.05, 0.8]) * rng.uniform(-1.0, 1.0, 4) * [1, 1, 1, 0] + [
        0.0,
        0.0,
        0.0,
        rng.uniform(0.1, 1.0),
    ]


def random_start(rng: np.random.Generator) -> np.ndarray:
    root = rng.normal(size=(3, 3)) * [[0.3], [0.3], [0.05]]
    return root @ root.T + 1e-4 * np.eye(3)


def process(mean: np.ndarray, odometry: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The motion model written plainly: next mean, Jacobian, noise."""
    forward, left, turned, rolled = odometry
    c, s = math.cos(mean[2]), math.sin(mean[2])
    moved = mean + np.array([c * forward - s * left, s * forward + c * left, turned])
    f = np.eye(3)
    f[0, 2] = -s * forward - c * left
    f[1, 2] = c * forward - s * left
    c, s = math.cos(mean[2] + turned / 2), math.sin(mean[2] + turned / 2)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return moved, f, turn @ NOISE.covariance(rolled) @ turn.T


@given(seed=st.integers(0, 10_000))
@settings(max_examples=50, deadline=None)
def test_the_ekf_equals_filterpy(seed: int) -> None:
    rng = np.random.default_rng(seed)
    p0 = random_start(rng)
    ours = Ours(p0)
    theirs = KalmanFilter(dim_x=3, dim_z=2)
    theirs.x, theirs.P, theirs.H = np.array(ours.pose), p0.copy(), np.eye(2, 3)
    for _ in range(20):
        odometry = random_odometry(rng)
        moved, f, q = process(theirs.x, odometry)
        theirs.P = f @ theirs.P @ f.T + q
        theirs.x = moved
        ours.predict(odometry)
        z = theirs.x[:2] + rng.normal(size=2)
        r, white = random_white(rng)
        theirs.update(z, R=r)
        assert ours.update(z, white) == UPDATED
        np.testing.assert_allclose(ours.mean, theirs.x, rtol=1e-10, atol=1e-10)
        np.testing.assert_allclose(ours.covariance, theirs.P, rtol=1e-10, atol=1e-10)
        residual = theirs.y @ np.linalg.inv(theirs.S) @ theirs.y
        assert ours.innovation[2] == pytest.approx(residual, rel=1e-8)
        assert ours.innovation[:2] @ ours.innovation[:2] == pytest.approx(residual, rel=1e-8)


class DenseSchmidt:
    """The textbook filter on (pose, all offsets of all cameras), in full matrices.

    Zanetti and D'Souza (2013): the rows of the gain of considered states are zero, and the
    covariance follows from Joseph's form, which holds for any gain.
    """

    def __init__(self, pose: tuple[float, ...], p0: np.ndarray, cameras: int) -> None:
        n = 3 + 6 * cameras
        self.x = np.zeros(n)
        self.x[:3] = pose
        self.p = np.eye(n)
        self.p[:3, :3] = p0

    def predict(self, odometry: np.ndarray) -> None:
        moved, f, q = process(self.x[:3], odometry)
        self.x[:3] = moved
        full = np.eye(len(self.x))
        full[:3, :3] = f
        self.p = full @ self.p @ full.T
        self.p[:3, :3] += q

    def update(self, z: np.ndarray, r: np.ndarray, offsets: np.ndarray, camera: int) -> None:
        h = np.zeros((2, len(self.x)))
        h[:, :2] = np.eye(2)
        h[:, 3 + 6 * camera : 9 + 6 * camera] = offsets
        s = h @ self.p @ h.T + r
        gain = self.p @ h.T @ np.linalg.inv(s)
        gain[3:] = 0.0
        self.x = self.x + gain @ (z - h @ self.x)
        rest = np.eye(len(self.x)) - gain @ h
        self.p = rest @ self.p @ rest.T + gain @ r @ gain.T


@given(seed=st.integers(0, 10_000))
@settings(max_examples=30, deadline=None)
def test_the_schmidt_filter_equals_a_dense_one(seed: int) -> None:
    rng = np.random.default_rng(seed)
    p0 = random_start(rng)
    ours, dense = Ours(p0, cameras=4), DenseSchmidt((1.0, -2.0, 0.4), p0, 4)
    for _ in range(25):
        odometry = random_odometry(rng)
        ours.predict(odometry)
        dense.predict(odometry)
        for camera in rng.permutation(4)[: rng.integers(0, 3)]:
            r, white = random_white(rng)
            offsets = rng.normal(size=(2, 6)) * 0.2
            z = dense.x[:2] + rng.normal(size=2)
            ours.update(z, white, offsets, int(camera))
            dense.update(z, r, offsets, int(camera))
        np.testing.assert_allclose(ours.mean, dense.x[:3], rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(ours.covariance, dense.p[:3, :3], rtol=1e-8, atol=1e-11)
        for camera in range(4):
            block = dense.p[:3, 3 + 6 * camera : 9 + 6 * camera]
            np.testing.assert_allclose(ours.cross[camera], block, rtol=1e-8, atol=1e-10)


def test_the_schmidt_filter_equals_stone_soup_s_where_that_is_installed() -> None:
    pytest.importorskip("stonesoup")
    from stonesoup.models.measurement.linear import LinearGaussian
    from stonesoup.types.detection import Detection
    from stonesoup.types.hypothesis import SingleHypothesis
    from stonesoup.types.prediction import GaussianStatePrediction
    from stonesoup.types.state import StateVector
    from stonesoup.updater.kalman import SchmidtKalmanUpdater

    rng = np.random.default_rng(5)
    p0 = random_start(rng)
    ours, dense = Ours(p0, cameras=2), DenseSchmidt((1.0, -2.0, 0.4), p0, 2)
    for step in range(12):
        odometry = random_odometry(rng)
        ours.predict(odometry)
        dense.predict(odometry)
        camera = step % 2
        r, white = random_white(rng)
        offsets = rng.normal(size=(2, 6)) * 0.2
        z = dense.x[:2] + rng.normal(size=2)

        class Offset(LinearGaussian):
            def matrix(self, **_: object) -> np.ndarray:
                h = np.zeros((2, 15))
                h[:, :2] = np.eye(2)
                h[:, 3 + 6 * camera : 9 + 6 * camera] = offsets  # noqa: B023
                return h

        model = Offset(ndim_state=15, mapping=(0, 1), noise_covar=r)
        updater = SchmidtKalmanUpdater(model, consider=np.arange(15) >= 3)
        prior = GaussianStatePrediction(StateVector(dense.x), dense.p)
        detection = Detection(StateVector(z), measurement_model=model)
        theirs = updater.update(SingleHypothesis(prior, detection))
        dense.update(z, r, offsets, camera)
        ours.update(z, white, offsets, camera)
        mean = np.asarray(theirs.state_vector, dtype=float).ravel()[:3]
        np.testing.assert_allclose(ours.mean, mean, rtol=1e-8, atol=1e-8)
        np.testing.assert_allclose(ours.covariance, theirs.covar[:3, :3], rtol=1e-8, atol=1e-8)


@pytest.mark.parametrize("considered", [False, True])
def test_a_late_measurement_does_what_it_would_have_done_in_time(considered: bool) -> None:
    """One measurement, taken at a step and processed three steps later.

    In between the car turns on the spot under noise that has no direction: then nothing is
    linearised about an estimate that lacks the measurement, and both must agree to rounding.
    """
    rng = np.random.default_rng(3)
    p0 = random_start(rng)
    late, prompt = Ours(p0, slots=2, cameras=2), Ours(p0, cameras=2)
    late.noise = prompt.noise = OdometryNoise(0.0, 0.05, 0.05)
    first, offsets = rng.normal(size=(2, 6)) * 0.2, rng.normal(size=(2, 6)) * 0.2
    _, white = random_white(rng)
    camera = 0 if considered else -1
    odometry = np.array([0.0, 0.0, 0.1, 0.5])  # turns on the spot with noise: F = identity
    for ours in (late, prompt):
        ours.predict(np.array([0.8, 0.0, 0.1, 0.8]))
        ours.update(np.array([1.5, -1.5]), white, first, camera)
    remember(*late.state, 1)
    prompt.update(np.array([2.0, -1.9]), white, offsets, camera)
    for _ in range(3):
        late.predict(odometry)
        prompt.predict(odometry)
    late.update(np.array([2.0, -1.9]), white, offsets, camera, row=POSE + 2)
    forget(*late.state, 1)
    np.testing.assert_array_equal(late.covariance[POSE:], 0.0)
    np.testing.assert_allclose(late.mean[:3], prompt.mean, rtol=1e-12)
    np.testing.assert_allclose(late.covariance[:3, :3], prompt.covariance, rtol=1e-10, atol=1e-15)


@given(seed=st.integers(0, 10_000))
@settings(max_examples=30, deadline=None)
def test_late_measurements_equal_a_linear_filter_on_the_whole_history(seed: int) -> None:
    """Against a batch: all positions of a drive and all offsets in one Gaussian vector.

    Linear in the errors once the linearisation points are ours, so the Schmidt recursion with
    clones must equal dense algebra on the stacked states, where lateness is just a row.
    """
    rng = np.random.default_rng(seed)
    p0 = random_start(rng)
    ours = Ours(p0, slots=2, cameras=2)
    # dense: [pose, clone 0, clone 1, offsets of 2 cameras]
    n = 3 + 4 + 12
    x, p = np.zeros(n), np.zeros((n, n))
    x[:3], p[:3, :3] = ours.pose, p0
    p[7:, 7:] = np.eye(12)
    under_way: list[int] = []
    for step in range(30):
        odometry = random_odometry(rng)
        moved, f, q = process(x[:3], odometry)
        ours.predict(odometry)
        full = np.eye(n)
        full[:3, :3] = f
        x[:3] = moved
        p = full @ p @ full.T
        p[:3, :3] += q
        if step % 2 == 0 and len(under_way) < 2:
            slot = next(i for i in (0, 1) if i not in under_way)
            copy = np.eye(n)
            copy[3 + 2 * slot : 5 + 2 * slot] = 0.0
            copy[3 + 2 * slot, 0] = copy[4 + 2 * slot, 1] = 1.0
            x, p = copy @ x, copy @ p @ copy.T
            remember(*ours.state, slot)
            under_way.append(slot)
        elif under_way:
            slot = under_way.pop(0)
            camera = int(rng.integers(2))
            r, white = random_white(rng)
            offsets = rng.normal(size=(2, 6)) * 0.2
            h = np.zeros((2, n))
            h[:, 3 + 2 * slot : 5 + 2 * slot] = np.eye(2)
            h[:, 7 + 6 * camera : 13 + 6 * camera] = offsets
            z = x[3 + 2 * slot : 5 + 2 * slot] + rng.normal(size=2)
            gain = p @ h.T @ np.linalg.inv(h @ p @ h.T + r)
            gain[7:] = 0.0
            rest = np.eye(n) - gain @ h
            x = x + gain @ (z - h @ x)
            p = rest @ p @ rest.T + gain @ r @ gain.T
            ours.update(z, white, offsets, camera, row=POSE + 2 * slot)
        np.testing.assert_allclose(ours.mean[:3], x[:3], rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(ours.covariance[:3, :3], p[:3, :3], rtol=1e-8, atol=1e-11)


def test_a_camera_that_leaves_for_good_takes_nothing_along() -> None:
    rng = np.random.default_rng(8)
    p0 = random_start(rng)
    stays, leaves = Ours(p0, cameras=2), Ours(p0, cameras=2)
    _, white = random_white(rng)
    first, second = rng.normal(size=(2, 2, 6))
    for ours in (stays, leaves):
        ours.update(np.array([1.1, -2.1]), white, first, 0)
    leaves.met.clear()
    leaves.cross[:] = 0.0
    for ours in (stays, leaves):
        for _ in range(3):
            ours.predict(np.array([0.8, 0.0, 0.02, 0.8]))
            ours.update(np.array([1.9, -1.7]), white, second, 1)
    np.testing.assert_allclose(stays.covariance, leaves.covariance, rtol=1e-14)
    np.testing.assert_allclose(stays.mean, leaves.mean, rtol=1e-14)


def test_repeating_one_camera_does_not_average_its_offset_out() -> None:
    offsets = np.zeros((2, 6))
    offsets[0, 0] = offsets[1, 1] = 0.19
    white = np.array([1e-4, 0.0, 1e-4])
    schmidt, ekf = Ours(np.eye(3), cameras=1), Ours(np.eye(3))
    for _ in range(1000):
        schmidt.update(np.zeros(2), white, offsets, 0)
        ekf.update(np.zeros(2), white + np.array([0.19**2, 0.0, 0.19**2]))
    assert math.sqrt(schmidt.covariance[0, 0]) == pytest.approx(0.19, rel=0.05)
    assert math.sqrt(ekf.covariance[0, 0]) < 0.01


def test_the_gate_rejects_and_leaves_the_estimate_alone() -> None:
    ours = Ours(np.eye(3))
    before = ours.mean.copy()
    white = np.array([1.0, 0.0, 1.0])
    # S = 2 I, so a metre's distance √2·3 lies at 9
    z = before[:2] + np.array([math.sqrt(18.0), 0.0])
    assert ours.update(z, white, gate=8.9) == GATED
    np.testing.assert_array_equal(ours.mean, before)
    assert ours.update(z, white, gate=9.1) == UPDATED


@pytest.mark.parametrize("bad", [-1.0, math.nan, math.inf])
def test_a_covariance_that_is_not_positive_is_said(bad: float) -> None:
    ours = Ours(np.zeros((3, 3)))
    assert ours.update(np.zeros(2), np.array([bad, 0.0, 1.0])) == BROKEN


@given(seed=st.integers(0, 10_000))
@settings(deadline=None)
def test_the_normalised_error_is_the_quadratic_form(seed: int) -> None:
    rng = np.random.default_rng(seed)
    p = random_start(rng)
    e = rng.normal(size=3)
    assert normalised_error(p, *e) == pytest.approx(e @ np.linalg.solve(p, e), rel=1e-6)


def test_the_normalised_error_of_a_singular_covariance_is_minus_one() -> None:
    assert normalised_error(np.zeros((3, 3)), 1.0, 0.0, 0.0) == -1.0
    assert normalised_error(np.diag([1.0, 1.0, 0.0]), 1.0, 0.0, 0.0) == -1.0
