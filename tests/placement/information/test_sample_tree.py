"""The tree of circles never loses a sample that may be seen."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from placement.information.sample_tree import LEAF, build_tree, find_leaves

NO_PLANES = np.empty((0, 3))


def leaves_near(x: np.ndarray, y: np.ndarray, at: tuple[float, float], far: float) -> list[int]:
    tree = build_tree(x, y, np.zeros(len(x)))
    stack, leaves = np.empty(72, np.int64), np.empty(tree.first_leaf, np.int64)
    n = find_leaves(tree.circles, tree.first_leaf, NO_PLANES, *at, far, stack, leaves)
    return leaves[:n].tolist()


@pytest.mark.parametrize("n", [1, 15, 16, 17, 33, 257])
def test_every_leaf_is_listed_in_order_when_the_range_is_wide(n: int) -> None:
    s = np.arange(n, dtype=np.float64)
    assert leaves_near(s, 0 * s, (0.0, 5.0), 1e6) == list(range(-(-n // LEAF)))


def test_nothing_is_listed_out_of_range() -> None:
    s = np.arange(100.0)
    assert leaves_near(s, 0 * s, (0.0, float(LEAF)), 4.9) == []


@settings(deadline=None, max_examples=60)
@given(
    seed=st.integers(0, 10_000),
    n=st.integers(1, 300),
    far=st.floats(0.1, 60.0),
    shift=st.sampled_from([0.0, 1e5]),
)
def test_a_sample_within_range_lies_in_a_listed_leaf(
    seed: int, n: int, far: float, shift: float
) -> None:
    rng = np.random.default_rng(seed)
    x, y = shift + np.cumsum(rng.normal(size=(2, n)), axis=1)
    at = (float(x[n // 2]) + 3.0, float(y[n // 2]))
    near = np.flatnonzero(np.hypot(x - at[0], y - at[1]) <= far)
    assert set((near // LEAF).tolist()) <= set(leaves_near(x, y, at, far))


def test_half_planes_cut_off_what_lies_behind_them() -> None:
    s = np.arange(10.0 * LEAF)
    tree = build_tree(s, 0 * s, 0 * s)
    stack, leaves = np.empty(72, np.int64), np.empty(tree.first_leaf, np.int64)
    ahead = np.array([[-1.0, 0.0, 0.0]])  # −dx ≤ 0
    n = find_leaves(tree.circles, tree.first_leaf, ahead, 5.0 * LEAF, 0.0, 1e6, stack, leaves)
    assert leaves[:n].tolist() == [5, 6, 7, 8, 9]
