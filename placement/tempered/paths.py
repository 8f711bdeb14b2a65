"""Best paths through cameras in their order along the road, for all budgets at once.

A gain of −∞ marks an arc that no placement worth having uses. Rows of the tables count cameras:
F[l, i] is the best path of l + 1 cameras that ends with i, B[r, i] the most that at most r further
ones can add after i. To second order the same over arcs instead of cameras.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from models.geometry import FloatArray, IntArray
from placement.problem import Run
from placement.tempered.line import ArcsOut, Line

_STRIPE = 64  # cameras a thread serves at one time: their gains share cache lines


class Arcs(NamedTuple):
    """m arcs source → target, sorted by target; see `gains.add_triple_gains` for the layout."""

    source: IntArray  # (m,)
    target: IntArray  # (m,)
    into: IntArray  # (n + 1,) arcs into each camera
    out: IntArray  # (m,) the arcs again, by source
    out_of: IntArray  # (n + 1,) into `out`
    triple: IntArray  # (m + 1,) into the gains of pairs of arcs


def lay_out(line: Line) -> Arcs:
    """Lay out the arcs of a line."""
    into, source, out_of, _, place = both_ways(line.laid_out, np.int64)
    target = np.repeat(np.arange(line.candidate.size), np.diff(into))
    out = np.empty_like(place)
    out[place] = np.arange(len(place))
    follow = np.diff(out_of)[target]
    triple = np.concatenate([[0], np.cumsum(follow)]).astype(np.int64)
    return Arcs(source, target, into, out, out_of, triple)


def both_ways(
    arcs: ArcsOut, kind: type[np.signedinteger[Any]]
) -> tuple[IntArray, NDArray[Any], IntArray, NDArray[Any], NDArray[Any]]:
    """Return arcs sorted by target and by source.

    `into` (n + 1,) and the sources by target, `out_of` (n + 1,) and the targets by source, and
    where each arc by target is among those by source; arcs (m,) of the `kind` of integer.
    """
    n, m = len(arcs.out_of) - 1, len(arcs.target)
    counts = np.bincount(arcs.target, minlength=n)
    into = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    source, place = np.empty(m, dtype=kind), np.empty(m, dtype=kind)
    _fill_arcs(arcs.out_of, arcs.target, into, source, place)
    return into, source, arcs.out_of, arcs.target.astype(kind, copy=False), place


@njit(cache=True)
def _fill_arcs(out_of, target, into, source, place):  # type: ignore[no-untyped-def]
    taken = into[:-1].copy()
    for a in range(out_of.size - 1):
        for e in range(out_of[a], out_of[a + 1]):
            at = taken[target[e]]
            taken[target[e]] += 1
            source[at], place[at] = a, e


@njit(cache=True, parallel=True)
def one_more(pairs, found):  # type: ignore[no-untyped-def]
    """Return the next row of F (n,) from the one before."""
    n = found.size
    longer = np.empty(n)
    for stripe in prange((n + _STRIPE - 1) // _STRIPE):
        low = stripe * _STRIPE
        high = min(n, low + _STRIPE)
        best = np.full(high - low, -np.inf)
        for a in range(high - 1):
            value = found[a]
            if value == -np.inf:
                continue
            for b in range(max(low, a + 1), high):
                if value + pairs[a, b] > best[b - low]:
                    best[b - low] = value + pairs[a, b]
        longer[low:high] = best
    return longer


@njit(cache=True, parallel=True)
def one_before(pairs, may_end, found):  # type: ignore[no-untyped-def]
    """Return the next row of B (n,); `may_end` (n,) is 0, or −∞ where a path must go on."""
    n = may_end.size
    longer = np.empty(n)
    for a in prange(n):
        best = may_end[a]
        for b in range(a + 1, n):
            best = max(best, pairs[a, b] + found[b])
        longer[a] = best
    return longer


def tables(
    pairs: NDArray[np.float32], alone: FloatArray, may_end: FloatArray, k: int, run: Run
) -> tuple[FloatArray, FloatArray]:
    """Return F and B (k, n) to first order."""
    F, B = np.empty((k, alone.size)), np.empty((k, alone.size))
    F[0], B[0] = alone, may_end
    for level in range(1, k):
        stop_in_time(run)
        F[level] = one_more(pairs, F[level - 1])
        B[level] = one_before(pairs, may_end, B[level - 1])
    return F, B


@njit(cache=True)
def best_through(F, B):  # type: ignore[no-untyped-def]
    """Return the best path of at most k cameras (or arcs) through each (n,)."""
    k, n = F.shape
    best = np.full(n, -np.inf)
    for level in range(k):
        for i in range(n):
            best[i] = max(best[i], F[level, i] + B[k - 1 - level, i])
    return best


@njit(cache=True, parallel=True)
def arcs_above(pairs, F, B, threshold):  # type: ignore[no-untyped-def]
    """Mark the arcs (n, n) on some path of at most k cameras that reaches `threshold`."""
    k, n = F.shape
    alive = np.zeros((n, n), np.bool_)
    for a in prange(n):
        for b in range(a + 1, n):
            if pairs[a, b] == -np.inf:
                continue
            for level in range(k - 1):
                if F[level, a] + pairs[a, b] + B[k - 2 - level, b] >= threshold:
                    alive[a, b] = True
                    break
    return alive


@njit(cache=True, parallel=True)
def mark_hopeless(into, source, out, out_of, target, triple, pairs, F, B, threshold, gains):  # type: ignore[no-untyped-def]
    """Set the gains of those pairs of arcs to −∞ whose best first-order path misses `threshold`."""
    n, k = into.size - 1, F.shape[0]
    for j in prange(n):
        for a in range(into[j], into[j + 1]):
            h = source[a]
            for m in range(out_of[j], out_of[j + 1]):
                i = target[out[m]]
                need = threshold - pairs[h, j] - pairs[j, i]
                alive = False
                for level in range(k - 2):
                    if F[level, h] + B[k - 3 - level, i] >= need:
                        alive = True
                        break
                if not alive:
                    gains[triple[a] + m - out_of[j]] = -np.inf


@njit(cache=True, parallel=True)
def one_more_arc(into, out, out_of, triple, gains, found):  # type: ignore[no-untyped-def]
    """Return the next row of F (m,) over arcs."""
    longer = np.full(found.size, -np.inf)
    for j in prange(into.size - 1):
        begin = out_of[j]
        for a in range(into[j], into[j + 1]):
            value = found[a]
            if value == -np.inf:
                continue
            at = triple[a] - begin
            for o in range(begin, out_of[j + 1]):
                if value + gains[at + o] > longer[out[o]]:
                    longer[out[o]] = value + gains[at + o]
    return longer


@njit(cache=True, parallel=True)
def one_arc_before(may_end, into, out, out_of, triple, gains, found):  # type: ignore[no-untyped-def]
    """Return the next row of B (m,) over arcs; `may_end` (n,) is by camera."""
    longer = np.empty(found.size)
    for j in prange(into.size - 1):
        begin = out_of[j]
        for a in range(into[j], into[j + 1]):
            best = may_end[j]
            at = triple[a] - begin
            for o in range(begin, out_of[j + 1]):
                best = max(best, gains[at + o] + found[out[o]])
            longer[a] = best
    return longer


def arc_tables(
    arcs: Arcs,
    gains: NDArray[np.float32],
    start: FloatArray,
    may_end: FloatArray,
    k: int,
    run: Run,
) -> tuple[FloatArray, FloatArray]:
    """Return F and B (k − 1, m) to second order; `start` (m,) are the paths of two cameras."""
    F, B = np.empty((k - 1, start.size)), np.empty((k - 1, start.size))
    F[0], B[0] = start, may_end[arcs.target]
    layout = (arcs.into, arcs.out, arcs.out_of, arcs.triple, gains)
    for level in range(1, k - 1):
        stop_in_time(run)
        F[level] = one_more_arc(*layout, F[level - 1])
        B[level] = one_arc_before(may_end, *layout, B[level - 1])
    return F, B


class OutOfTimeError(Exception):
    """Time is up in the middle of a table; what is half done is of no use."""


def stop_in_time(run: Run) -> None:
    """Raise OutOfTimeError once the run's time is up."""
    if run.out_of_time():
        raise OutOfTimeError


def trace_path(pairs: NDArray[np.float32], F: FloatArray, may_end: FloatArray) -> IntArray:
    """Return a best path of at most k cameras by first-order gains."""
    ends = F + may_end
    level, at = np.unravel_index(int(np.argmax(ends)), ends.shape)
    if ends[level, at] == -np.inf:
        return np.empty(0, dtype=np.int64)
    path = [int(at)]
    for row in range(int(level) - 1, -1, -1):
        path.append(int(np.argmax(F[row, : path[-1]] + pairs[: path[-1], path[-1]])))
    return np.array(path[::-1], dtype=np.int64)


def trace_arcs(
    arcs: Arcs, gains: NDArray[np.float32], F: FloatArray, may_end: FloatArray
) -> IntArray:
    """Return a best path of two to k cameras by second-order gains."""
    ends = F + may_end[arcs.target]
    level, at = np.unravel_index(int(np.argmax(ends)), ends.shape)
    if ends[level, at] == -np.inf:
        return np.empty(0, dtype=np.int64)
    arc = int(at)
    path = [int(arcs.target[arc]), int(arcs.source[arc])]
    for row in range(int(level) - 1, -1, -1):
        j = path[-1]
        into = np.arange(arcs.into[j], arcs.into[j + 1])
        place = int(np.flatnonzero(arcs.out[arcs.out_of[j] : arcs.out_of[j + 1]] == arc)[0])
        arc = int(into[np.argmax(F[row, into] + gains[arcs.triple[into] + place])])
        path.append(int(arcs.source[arc]))
    return np.array(path[::-1], dtype=np.int64)
