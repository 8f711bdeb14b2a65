"""Lines and their arcs, against dense matrices."""

from __future__ import annotations

import numpy as np
import pytest

from models.geometry import BoolArray
from placement.tempered.line import Line, arcs_out
from placement.tempered.paths import both_ways, lay_out


def line_and_matrix(seed: int) -> tuple[Line, BoolArray]:
    """Return a line of mounts and required cameras, and which arcs it has, one by one."""
    rng = np.random.default_rng([3, seed])
    n = int(rng.integers(1, 15))
    group = rng.integers(-1, 4, n)
    required = rng.random(n) < (0.0, 0.1, 0.4)[seed % 3]
    alive = np.zeros((n, n), dtype=np.bool_)
    for a in range(n):
        for b in range(a + 1, n):
            one_mount = group[a] == group[b] and group[a] >= 0
            alive[a, b] = not one_mount and not required[a + 1 : b].any()
    return Line(rng.permutation(n), group, required), alive


@pytest.mark.parametrize("seed", range(12))
def test_a_line_nobody_has_looked_at_has_all_arcs_that_may_be(seed: int) -> None:
    line, alive = line_and_matrix(seed)
    assert np.array_equal(line.alive, alive)
    assert line.n_arcs == alive.sum()
    out, into = line.degrees
    assert np.array_equal(out, alive.sum(axis=1))
    assert np.array_equal(into, alive.sum(axis=0))
    assert np.array_equal(line.laid_out.source, np.nonzero(alive)[0])
    assert np.array_equal(line.laid_out.target, np.nonzero(alive)[1])
    keep = np.flatnonzero(np.random.default_rng(seed).random(len(alive)) < 0.6)
    keep = np.union1d(keep, np.flatnonzero(line.required))
    assert np.array_equal(line.subset(keep).alive, alive[np.ix_(keep, keep)])


@pytest.mark.parametrize("by_target", [False, True])
@pytest.mark.parametrize("seed", range(12))
def test_arcs_that_are_left_are_those_of_a_matrix(seed: int, by_target: bool) -> None:
    line, alive = line_and_matrix(seed)
    rng = np.random.default_rng([5, seed])
    n = len(alive)
    alive &= rng.random((n, n)) < 0.3
    source, target = np.nonzero(alive.T)[::-1] if by_target else np.nonzero(alive)
    single = rng.random(n) < 0.1
    left = line.over_arcs(source, target, single)
    keep = np.flatnonzero(alive.any(axis=0) | alive.any(axis=1) | line.required | single)
    assert np.array_equal(left.candidate, line.candidate[keep])
    assert np.array_equal(left.group, line.group[keep])
    assert np.array_equal(left.required, line.required[keep])
    alive = alive[np.ix_(keep, keep)]
    assert np.array_equal(left.alive, alive)
    assert left.n_arcs == alive.sum()
    assert np.array_equal(left.degrees[0], alive.sum(axis=1))
    assert np.array_equal(left.degrees[1], alive.sum(axis=0))
    fewer = np.arange(0, len(keep), 2)
    assert np.array_equal(left.subset(fewer).alive, alive[np.ix_(fewer, fewer)])


def test_arcs_lie_by_source_and_by_target() -> None:
    source, target = np.array([0, 0, 1, 2]), np.array([2, 3, 2, 3])
    into, by_target, out_of, by_source, place = both_ways(arcs_out(4, source, target), np.int32)
    assert into.tolist() == [0, 0, 0, 2, 4]
    assert out_of.tolist() == [0, 2, 3, 4, 4]
    assert by_target.tolist() == [0, 1, 0, 2]
    assert by_source.tolist() == [2, 3, 2, 3]
    assert place.tolist() == [0, 2, 1, 3]
    line = Line(np.arange(4), np.full(4, -1), np.zeros(4, dtype=np.bool_))
    arcs = lay_out(line.over_arcs(source, target, np.zeros(4, dtype=np.bool_)))
    assert arcs.source[arcs.out].tolist() == [0, 0, 1, 2]
    assert arcs.target[arcs.out].tolist() == [2, 3, 2, 3]
