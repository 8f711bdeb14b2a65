"""Candidates in their order along the road, and the arcs between them that are still possible."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from models.geometry import BoolArray, FloatArray, IntArray
from placement.constraints import Constraints
from placement.objectives.entropy import Entropy
from placement.tempered.pieces import pieces_of


class ArcsOut(NamedTuple):
    """m arcs between n cameras, sorted by source and then by target."""

    out_of: IntArray  # (n + 1,) arcs out of each camera
    target: NDArray[np.int32]  # (m,)

    def only(self, kept: BoolArray) -> ArcsOut:
        """Return the arcs that `kept` (m,) marks."""
        before = np.concatenate([[0], np.cumsum(kept)])
        return ArcsOut(before[self.out_of].astype(np.int64), self.target[kept])

    @property
    def source(self) -> NDArray[np.int32]:
        """Return the source of each arc (m,)."""
        n = len(self.out_of) - 1
        return np.repeat(np.arange(n, dtype=np.int32), np.diff(self.out_of))


@dataclass(frozen=True, slots=True)
class Line:
    """Candidates in order along the road: original number, group, and whether required; (n,) each.

    `arcs` are those still possible; None where nobody has looked: then all that `may_follow`.
    """

    candidate: IntArray
    group: IntArray
    required: BoolArray
    arcs: ArcsOut | None = None

    def subset(self, keep: IntArray) -> Line:
        """Return the line over the positions `keep`, in their order."""
        arcs = None if self.arcs is None else _between(self.arcs, keep)
        return Line(self.candidate[keep], self.group[keep], self.required[keep], arcs)

    def over_arcs(self, source: NDArray[Any], target: NDArray[Any], single: BoolArray) -> Line:
        """Return the line over arcs `source` → `target`, and cameras that may be alone, (n,)."""
        n = self.candidate.size
        kept = self.required | single
        kept[source] = kept[target] = True
        whole = Line(self.candidate, self.group, self.required, arcs_out(n, source, target))
        return whole.subset(np.flatnonzero(kept))

    @property
    def stop(self) -> IntArray:
        """Return the position (n,) from which on nobody may follow: past a required candidate."""
        n = self.candidate.size
        required = np.flatnonzero(self.required)
        following = np.searchsorted(required, np.arange(n), side="right")
        stops: IntArray = np.concatenate([required + 1, [n]])[following].astype(np.int64)
        return stops

    @property
    def alive(self) -> BoolArray:
        """Mark the arcs in a matrix (n, n): a before b."""
        n = self.candidate.size
        found = np.zeros((n, n), dtype=np.bool_)
        if self.arcs is None:
            _mark_all(self.group, self.stop, found)
        else:
            found[self.arcs.source, self.arcs.target] = True
        return found

    @property
    def laid_out(self) -> ArcsOut:
        """Return the arcs, all of them where nobody has looked."""
        if self.arcs is not None:
            return self.arcs
        return arcs_out(self.candidate.size, *np.nonzero(self.alive))

    @property
    def degrees(self) -> tuple[IntArray, IntArray]:
        """Return how many arcs lead out of each camera and into it, (n,) each."""
        n = self.candidate.size
        if self.arcs is None:
            out, into = np.zeros(n, np.int64), np.zeros(n, np.int64)
            _count_all(self.group, self.stop, out)
            _count_before(self.group, self.stop, into)
            return out, into
        return np.diff(self.arcs.out_of), np.bincount(self.arcs.target, minlength=n)

    @property
    def n_arcs(self) -> int:
        """Return how many arcs there are."""
        if self.arcs is not None:
            return len(self.arcs.target)
        n = self.candidate.size
        out = np.zeros(n, np.int64)
        _count_all(self.group, self.stop, out)
        return int(out.sum())

    @property
    def may_start(self) -> BoolArray:
        """Mark the positions that no required candidate precedes."""
        before: BoolArray = np.cumsum(self.required) - self.required == 0
        return before

    @property
    def may_end(self) -> BoolArray:
        """Mark the positions that no required candidate follows."""
        after: BoolArray = np.cumsum(self.required[::-1])[::-1] - self.required == 0
        return after

    @property
    def ends(self) -> FloatArray:
        """Return 0 for each position (n,) where a path may end, −∞ where not."""
        return np.where(self.may_end, 0.0, -np.inf)


def make_line(objective: Entropy, constraints: Constraints, candidates: IntArray) -> Line:
    """Order `candidates` by the middle sample that they see on the first drive, in one piece."""
    info = pieces_of(objective.drives[0])[0].information
    first, stop = info.indptr[candidates], info.indptr[candidates + 1]
    middle = np.zeros(candidates.size)
    seeing = stop > first
    middle[seeing] = info.indices[(first[seeing] + stop[seeing]) // 2]
    ordered = candidates[np.lexsort((candidates, middle))]
    return Line(ordered, constraints.group[ordered], np.isin(ordered, constraints.required))


def arcs_out(n: int, source: NDArray[Any], target: NDArray[Any]) -> ArcsOut:
    """Lay out the arcs `source` → `target` (m,) between n cameras, given by source or by target."""
    counts = np.bincount(source, minlength=n)
    if np.any(np.diff(source) < 0):
        target = target[np.argsort(source, kind="stable")]
    out_of = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    return ArcsOut(out_of, target.astype(np.int32))


def _between(arcs: ArcsOut, keep: IntArray) -> ArcsOut:
    """Return the arcs between the positions `keep`, numbered by them."""
    n = len(arcs.out_of) - 1
    number = np.full(n, -1, dtype=np.int32)
    number[keep] = np.arange(len(keep))
    left = arcs.only((number[arcs.source] >= 0) & (number[arcs.target] >= 0))
    out_of = np.append(left.out_of[keep], len(left.target))
    return ArcsOut(out_of, number[left.target])


@njit(cache=True, inline="always")
def may_follow(group, stop, a, b):  # type: ignore[no-untyped-def]
    """Say whether b > a may follow: not of one group, no required candidate in between."""
    return b < stop[a] and (group[a] < 0 or group[a] != group[b])


@njit(cache=True, parallel=True)
def _mark_all(group, stop, found):  # type: ignore[no-untyped-def]
    for a in prange(group.size):
        for b in range(a + 1, stop[a]):
            found[a, b] = may_follow(group, stop, a, b)


@njit(cache=True, parallel=True)
def _count_all(group, stop, out):  # type: ignore[no-untyped-def]
    for a in prange(group.size):
        found = 0
        for b in range(a + 1, stop[a]):
            found += 1 if may_follow(group, stop, a, b) else 0
        out[a] = found


@njit(cache=True, parallel=True)
def _count_before(group, stop, into):  # type: ignore[no-untyped-def]
    for b in prange(group.size):
        found = 0
        for a in range(b):
            found += 1 if may_follow(group, stop, a, b) else 0
        into[b] = found
