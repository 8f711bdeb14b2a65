"""What cameras share through a state, as an inner product, against determinants of matrices."""

from __future__ import annotations

import numpy as np
import pytest

from models.geometry import FloatArray
from placement.sieve.shared import MARGIN, TERMS, put_left, put_right, raise_by, worth_of
from placement.sieve.told import congruent, lower_factor, root_of_psd
from placement.tempered.crossings import ROW


def packed(m: FloatArray) -> tuple[float, ...]:
    return m[0, 0], m[0, 1], m[0, 2], m[1, 1], m[1, 2], m[2, 2]


def share(rng: np.random.Generator) -> FloatArray:
    """Return a matrix between 0 and I, often near one of them along some axis."""
    q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    found: FloatArray = (q * rng.choice([rng.uniform(0.0, 1.0), 1e-9, 1.0 - 1e-7], 3)) @ q.T
    return found


def test_an_inner_product_is_the_determinant_to_rounding() -> None:
    rng = np.random.default_rng(73)
    row, column = np.empty(TERMS, np.float32), np.empty((TERMS, 1), np.float32)
    for _ in range(3000):
        e, k, weight = share(rng), share(rng), float(rng.uniform(0.0, 1.0))
        put_left(packed(e), weight, row)
        put_right(packed(k), 1.0, column[:, 0])
        best = np.zeros(1, np.float32)
        raise_by(row, column, 1, best)
        want = weight * np.linalg.det(np.eye(3) - e @ k)
        assert want <= best[0] * (1.0 + 1e-7)
        assert best[0] <= want + 2.5 * MARGIN * weight
        # the other way round
        row_of_k, column_of_e = np.empty(TERMS, np.float32), np.empty((TERMS, 1), np.float32)
        put_right(packed(k), weight, row_of_k)
        put_left(packed(e), 1.0, column_of_e[:, 0])
        best[:] = 0.0
        raise_by(row_of_k, column_of_e, 1, best)
        assert want <= best[0] * (1.0 + 1e-7)
        assert best[0] <= want + 2.5 * MARGIN * weight


def test_a_product_counts_from_the_top_and_as_often_as_the_drive() -> None:
    assert worth_of(0.5, 7.0, 2.0) == pytest.approx(7.0 + 2.0 * np.log(0.5), abs=1e-4)
    assert worth_of(0.5, 7.0, 2.0) > 7.0 + 2.0 * np.log(0.5)
    assert worth_of(0.0, 7.0, 2.0) == -np.inf


def test_small_matrices_are_those_of_numpy() -> None:
    rng = np.random.default_rng(79)
    for _ in range(50):
        a, d = rng.normal(size=(3, 3)), rng.normal(size=(3, 3))
        d = d @ d.T
        out = np.empty((3, 3))
        congruent(a, packed(d), out)
        assert out == pytest.approx(a @ d @ a.T)
        low = d.copy()
        assert lower_factor(low, tuple(np.diag(low)))
        assert low == pytest.approx(np.linalg.cholesky(d))
    flat = np.outer([1.0, 2.0, 3.0], [1.0, 2.0, 3.0])
    assert not lower_factor(flat, (1.0, 4.0, 9.0))
    assert not lower_factor(np.eye(3), (1.0, 1e12, 1.0))  # all that a difference left


@pytest.mark.parametrize("rank", [0, 1, 2, 3])
def test_a_root_tells_no_more_than_the_information(rank: int) -> None:
    rng = np.random.default_rng([83, rank])
    for _ in range(50):
        a = rng.normal(size=(3, rank)) * 10.0 ** rng.uniform(-3, 3)
        m = a @ a.T if rank else np.zeros((3, 3))
        row, n = np.zeros(ROW), np.empty((3, 3))
        row[9:15] = packed(m)
        root_of_psd(row, n)
        scale = max(float(np.trace(m)), 1e-300)
        assert np.linalg.eigvalsh(m - n @ n.T)[0] >= -1e-10 * scale
        if rank == 3:
            assert n @ n.T == pytest.approx(m, abs=1e-6 * scale)
