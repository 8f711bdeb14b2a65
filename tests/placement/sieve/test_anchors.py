"""What members of a class pay is enough, whatever follows; and no more than it must be."""

from __future__ import annotations

import numpy as np
import pytest

from models.geometry import FloatArray
from placement.sieve.anchors import choose_anchors, eigenvalues


def packed(m: FloatArray) -> FloatArray:
    return np.array([m[0, 0], m[0, 1], m[0, 2], m[1, 1], m[1, 2], m[2, 2]])


def information(rng: np.random.Generator, spread: float) -> FloatArray:
    a = rng.normal(size=(3, 3)) * 10.0 ** rng.uniform(-spread, spread, 3)
    return a @ a.T + 1e-6 * np.eye(3)


def gain(told: FloatArray, more: FloatArray) -> float:
    return float(np.linalg.slogdet(np.eye(3) + np.linalg.solve(told, more))[1])


@pytest.mark.parametrize("spread", [0.3, 2.0])
def test_a_member_pays_for_the_most_its_class_can_know_more(spread: float) -> None:
    rng = np.random.default_rng([43, int(10 * spread)])
    for _ in range(40):
        n, most = int(rng.integers(1, 12)), int(rng.integers(1, 5))
        told = [information(rng, spread) for _ in range(n)]
        value = rng.normal(size=n)
        chosen, group, extra = np.full(most, -1), np.empty(n, np.int64), np.empty(n)
        found = choose_anchors(
            np.array([packed(t) for t in told]), value, 1.0, 5.0, most, chosen, group, extra
        )
        assert 1 <= found <= most
        assert chosen[0] == np.argmax(value)
        assert np.all(group < found)
        assert np.all(extra[chosen[:found]] <= 1e-5)
        for i in np.flatnonzero(group >= 0):
            anchor = told[chosen[group[i]]]
            worst = -np.inf
            for scale in (1e-4, 1.0, 1e4):
                for _ in range(4):
                    more = scale * information(rng, spread)
                    worst = max(worst, gain(told[i], more) - gain(anchor, more))
            assert extra[i] >= worst - 1e-6
            if i in chosen[:found]:
                continue
            # all that follows tells of what the anchor knows better alone, and nearly for certain
            root = np.linalg.cholesky(told[i])
            inverse = np.linalg.inv(root)
            values, vectors = np.linalg.eigh(inverse @ anchor @ inverse.T)
            better = root @ vectors[:, values > 1.0]
            more = 1e3 * (better * values[values > 1.0]) @ better.T
            worst = gain(told[i], more) - gain(anchor, more)
            assert extra[i] >= worst - 1e-3
            assert extra[i] == pytest.approx(worst, rel=0.05, abs=0.05)


def test_all_are_anchors_where_there_is_room_and_only_who_matters_where_not() -> None:
    rng = np.random.default_rng(47)
    told = np.array([packed(information(rng, 1.0)) for _ in range(6)])
    chosen, group, extra = np.full(8, -1), np.empty(6, np.int64), np.empty(6)
    value = np.array([0.0, -1.0, -2.0, -3.0, -4.0, -1e6])
    assert choose_anchors(told, value, 1.0, 1e9, 8, chosen, group, extra) == 6
    assert sorted(chosen[:6]) == list(range(6))
    assert not extra.any()
    # whoever is far behind is told apart no further, and pays
    found = choose_anchors(told, value, 1.0, 0.0, 8, chosen, group, extra)
    assert 5 not in chosen[:found]
    assert group[5] >= 0
    assert choose_anchors(told[:0], value[:0], 1.0, 0.0, 8, chosen, group[:0], extra[:0]) == 0


def test_eigenvalues_are_those_of_lapack() -> None:
    rng = np.random.default_rng(53)
    for _ in range(200):
        m = information(rng, 1.5)
        assert sorted(eigenvalues(m)) == pytest.approx(
            np.linalg.eigvalsh(m), rel=1e-9, abs=3e-8 * np.trace(m)
        )
    assert eigenvalues(2.0 * np.eye(3)) == (2.0, 2.0, 2.0)
