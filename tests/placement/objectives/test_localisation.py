"""The localisation objective against dense oracles, differences and rules it must obey."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from placement.information import Information
from placement.objectives.base import Relaxable
from placement.objectives.localisation import Localisation

Make = Callable[..., Information]


def dense(info: Information, x: np.ndarray) -> np.ndarray:
    """Return Σ_i x_i J_it as (t, 2, 2) matrices."""
    sums = np.zeros((info.n_samples, 2, 2))
    for i in range(info.n_candidates):
        for e in range(info.indptr[i], info.indptr[i + 1]):
            block = info.blocks[e].astype(float)
            a, c, b = (block[0], 0.0, block[0]) if len(block) == 1 else block
            sums[info.indices[e]] += x[i] * np.array([[a, c], [c, b]])
    return sums


def log_det_gain(info: Information, x: np.ndarray, sigma: float, w: np.ndarray) -> float:
    """Evaluate the objective's formula by LAPACK."""
    prior = np.eye(2) / sigma**2
    after = np.linalg.slogdet(prior + dense(info, x))[1]
    return float(np.sum(w * (after - np.linalg.slogdet(prior)[1])))


def pick(n: int, selected: list[int]) -> np.ndarray:
    x = np.zeros(n)
    x[selected] = 1.0
    return x


@pytest.mark.parametrize("isotropic", [True, False])
def test_the_value_equals_a_dense_log_det(new_information: Make, isotropic: bool) -> None:
    rng = np.random.default_rng(1)
    info = new_information(rng, 12, 25, isotropic=isotropic)
    w = rng.uniform(0.0, 2.0, 25)
    f = Localisation(info, 0.7, w)
    for selected in ([], [3], [0, 5, 11], list(range(12))):
        expected = log_det_gain(info, pick(12, selected), 0.7, w)
        assert f.value(np.array(selected, dtype=np.int64)) == pytest.approx(expected, rel=1e-12)
        assert f.state(np.array(selected, dtype=np.int64)).score == pytest.approx(
            expected, rel=1e-12
        )


def test_one_camera_on_one_sample_has_its_closed_form() -> None:
    info = Information(1, np.array([0, 1]), np.array([0], np.int32), np.array([[12.0]], np.float32))
    # Two axes, each from 1/σ² = 4 to 16: 2 log 4.
    assert Localisation(info, 0.5).value(np.array([0])) == pytest.approx(2.0 * np.log(4.0))


def test_isotropic_blocks_are_worth_what_their_matrices_are(new_information: Make) -> None:
    info = new_information(np.random.default_rng(2), 8, 20)
    J = info.blocks[:, 0]
    full = Information(20, info.indptr, info.indices, np.column_stack([J, np.zeros_like(J), J]))
    one, two = Localisation(info, 0.5), Localisation(full, 0.5)
    x = np.random.default_rng(3).uniform(size=8)
    assert one.value(np.arange(5)) == pytest.approx(two.value(np.arange(5)), rel=1e-14)
    np.testing.assert_allclose(one.state().gains(), two.state().gains(), rtol=1e-14)
    np.testing.assert_allclose(one.relaxed(x)[1], two.relaxed(x)[1], rtol=1e-14)


@pytest.mark.parametrize("isotropic", [True, False])
def test_gains_are_differences_of_the_value_through_adding_and_removing(
    new_information: Make, isotropic: bool
) -> None:
    rng = np.random.default_rng(4)
    f = Localisation(
        new_information(rng, 30, 60, isotropic=isotropic), 0.5, rng.uniform(0.1, 3.0, 60)
    )
    state = f.state()
    for step in range(120):
        inside = state.selected
        if inside and (len(inside) > 12 or rng.uniform() < 0.4):
            state.remove(int(rng.choice(inside)))
        else:
            state.add(int(rng.choice(np.setdiff1d(np.arange(30), inside))))
        here = f.value(np.array(state.selected, dtype=np.int64))
        assert state.score == pytest.approx(here, rel=1e-12, abs=1e-12)
        asked = rng.choice(30, 7) if step % 3 else None
        gains = state.gains(asked)
        for i, gain in zip(range(30) if asked is None else asked, gains, strict=True):
            after = np.union1d(state.selected, [i]).astype(np.int64)
            assert gain == pytest.approx(f.value(after) - here, rel=1e-9, abs=1e-9)


def test_a_long_exchange_leaves_no_rounding_behind(new_information: Make) -> None:
    rng = np.random.default_rng(5)
    # Blocks over thirty orders of magnitude: subtracting the large would wipe out the small.
    f = Localisation(new_information(rng, 20, 40, isotropic=False, spread=10.0), 0.5)
    state = f.state(np.array([2, 7, 11]))
    for i in rng.permutation(np.setdiff1d(np.arange(20), [2, 7, 11])):
        state.add(int(i))
        state.remove(int(i))
    fresh = f.state(np.array([2, 7, 11]))
    np.testing.assert_array_equal(state.sums, fresh.sums)
    np.testing.assert_array_equal(state.gains(), fresh.gains())


@pytest.mark.parametrize("isotropic", [True, False])
def test_the_value_is_monotone_with_diminishing_returns(
    new_information: Make, isotropic: bool
) -> None:
    rng = np.random.default_rng(6)
    for _ in range(50):
        f = Localisation(new_information(rng, 9, 12, isotropic=isotropic, spread=3.0), 0.5)
        order = rng.permutation(9)
        few, many = np.sort(order[:3]), np.sort(order[:6])
        slack = 1e-12 * f.value(np.arange(9))
        gains_few, gains_many = f.state(few).gains(order[6:]), f.state(many).gains(order[6:])
        assert np.all(gains_many >= 0.0)
        assert np.all(gains_few >= gains_many - slack)


@pytest.mark.parametrize("isotropic", [True, False])
def test_the_relaxation_extends_the_value_and_its_gradient_is_its_slope(
    new_information: Make, isotropic: bool
) -> None:
    rng = np.random.default_rng(7)
    info = new_information(rng, 8, 15, isotropic=isotropic)
    w = rng.uniform(0.5, 2.0, 15)
    f = Localisation(info, 0.5, w)
    assert isinstance(f, Relaxable)
    assert f.relaxed(pick(8, [1, 4]))[0] == pytest.approx(f.value(np.array([1, 4])), rel=1e-13)
    x = rng.uniform(0.2, 0.8, 8)
    score, gradient = f.relaxed(x)
    assert score == pytest.approx(log_det_gain(info, x, 0.5, w), rel=1e-12)
    h = 1e-6
    for i in range(8):
        step = h * np.eye(8)[i]
        slope = (f.relaxed(x + step)[0] - f.relaxed(x - step)[0]) / (2.0 * h)
        assert gradient[i] == pytest.approx(slope, rel=1e-6)  # central difference, O(h²)


def test_tangents_of_the_relaxation_lie_above_it(new_information: Make) -> None:
    rng = np.random.default_rng(8)
    f = Localisation(new_information(rng, 10, 20, isotropic=False, spread=2.0), 0.5)
    for _ in range(50):
        x, y = rng.uniform(size=(2, 10))
        score, gradient = f.relaxed(x)
        assert score + gradient @ (y - x) >= f.relaxed(y)[0] * (1.0 - 1e-12)


def test_entry_gains_and_slopes_sum_to_those_of_their_candidates(new_information: Make) -> None:
    rng = np.random.default_rng(9)
    f = Localisation(new_information(rng, 10, 20, isotropic=False), 0.5)
    state = f.state(np.array([3, 8]))
    rows = np.repeat(np.arange(10), np.diff(f.indptr))
    gains = np.bincount(rows, f.entry_gains(state.sums), 10)
    gains[[3, 8]] = 0.0
    np.testing.assert_allclose(gains, state.gains(), rtol=1e-13)
    slopes = np.bincount(rows, f.entry_slopes(state.sums), 10)
    np.testing.assert_allclose(slopes, f.relaxed(pick(10, [3, 8]))[1], rtol=1e-13)
    assert np.sum(f.sample_scores(state.sums)) == pytest.approx(state.score)


def test_a_candidate_that_sees_nothing_gains_exactly_nothing() -> None:
    blocks = np.array([[5.0], [0.0]], np.float32)
    info = Information(2, np.array([0, 1, 2, 2]), np.array([0, 1], np.int32), blocks)
    f = Localisation(info, 0.5)
    np.testing.assert_array_equal(f.state(np.array([0])).gains(), [0.0, 0.0, 0.0])
    assert f.value(np.array([1, 2])) == 0.0


def test_singular_blocks_rounded_to_float32_still_give_a_finite_value() -> None:
    rng = np.random.default_rng(10)
    v = 1e4 * rng.normal(size=(200, 2))
    blocks = np.column_stack([v[:, 0] ** 2, v[:, 0] * v[:, 1], v[:, 1] ** 2]).astype(np.float32)
    info = Information(200, np.arange(0, 201, 10), np.arange(200, dtype=np.int32), blocks)
    f = Localisation(info, 0.5)
    c2 = f.blocks[:, 1].astype(float) ** 2
    assert np.all(c2 <= f.blocks[:, 0].astype(float) * f.blocks[:, 2])
    # Three float32 roundings and one step inwards: at most five half-units in the last place.
    assert np.all(np.abs(f.blocks - blocks) <= 4e-7 * np.abs(blocks))
    state = f.state(np.arange(20))
    assert np.isfinite(state.score)
    assert state.score == pytest.approx(f.value(np.arange(20)), rel=1e-9)


@pytest.mark.parametrize(
    ("blocks", "kwargs", "message"),
    [
        ([[1.0, 2.0, 1.0]], {}, r"blocks\[0\] must be positive semidefinite"),
        ([[-1.0]], {}, "diagonals of at least 0"),
        ([[np.nan]], {}, "must be finite"),
        ([[1.0, 2.0]], {}, "1 or 3 columns"),
        ([[1.0]], {"prior_sigma_m": 0.0}, "prior_sigma_m must be positive, got 0"),
        ([[1.0]], {"prior_sigma_m": np.nan}, "prior_sigma_m must be positive, got nan"),
        ([[1.0]], {"weights": [1.0]}, r"weights must have shape \(2,\)"),
        ([[1.0]], {"weights": [1.0, -1.0]}, "weights must be finite and at least 0, got -1"),
    ],
)
def test_bad_input_is_refused_by_name(blocks: list, kwargs: dict, message: str) -> None:
    info = Information(2, np.array([0, 1]), np.array([1], np.int32), np.array(blocks, np.float32))
    with pytest.raises(ValueError, match=message):
        Localisation(info, **{"prior_sigma_m": 0.5, **kwargs})


@pytest.mark.parametrize(
    ("indptr", "indices", "message"),
    [([0, 2], [1], "indptr must rise"), ([0, 1], [2], r"indices must lie in 0…1")],
)
def test_rows_that_lead_outside_are_refused(indptr: list, indices: list, message: str) -> None:
    info = Information(
        2, np.array(indptr), np.array(indices, np.int32), np.ones((1, 1), np.float32)
    )
    with pytest.raises(ValueError, match=message):
        Localisation(info, 0.5)


def test_a_state_refuses_strangers_repetitions_and_absentees(new_information: Make) -> None:
    f = Localisation(new_information(np.random.default_rng(11), 4, 10), 0.5)
    state = f.state(np.array([1]))
    with pytest.raises(ValueError, match="candidate 1 is already selected"):
        state.add(1)
    with pytest.raises(ValueError, match="candidate 2 is not selected"):
        state.remove(2)
    with pytest.raises(ValueError, match="candidate must lie in 0…3, got 4"):
        state.add(4)
    with pytest.raises(ValueError, match="selected twice"):
        f.value(np.array([1, 1]))
