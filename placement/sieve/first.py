"""First-order paths at the price that bounds them best: what a sieve begins with."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from models.geometry import FloatArray, IntArray
from placement.sieve.neighbours import Neighbours, neighbours_of
from placement.sieve.opening import Opening, gains_along
from placement.sieve.prices import seek_price
from placement.tempered import paths
from placement.tempered.bound import Tempered
from placement.tempered.line import ArcsOut, Line

PRICES = 16  # tried at most
PRICED_TO = 1e-4  # of the bound
MANY = 3000  # cameras: arcs of more are not all laid out to begin with
THINNED = 3000  # of those, for a first price
SWEEPS = 4  # over a long line, for a better one,
ROUGHLY = 0.05  # to this share of the gap to the score to beat


@dataclass(slots=True)
class FirstOrder:
    """The first order of a tempered bound at its best price, and the arcs that this leaves.

    Arcs that no placement above `beat` uses may be left out; on a single drive, budget ≥ 2. Where
    more than `most` are left of a long line nobody has looked at, there is a bound and no more.
    """

    first: Tempered
    beat: float
    most: int = 60_000_000
    price: float = field(init=False, default=0.0)
    least: float = field(init=False, default=math.inf)
    into: FloatArray = field(init=False)  # (n,) the best path that ends with each camera
    beyond: FloatArray = field(init=False)  # (n,) and what may follow it
    gain: NDArray[np.float32] = field(init=False)  # (m,) of each arc, by source
    near: Neighbours = field(init=False)
    too_many: bool = field(init=False, default=False)

    def __post_init__(self) -> None:
        """Find the price and lay out what is left."""
        arcs = self._opened()
        if arcs is None:
            self.too_many = True
            return
        first = self.first
        self._find_price(
            lambda price: into_each(arcs, self.gain, first.alone, price),
            lambda least: PRICED_TO * abs(least),
            PRICES,
        )
        self.beyond = beyond_each(arcs, self.gain, first.ends, self.price)
        kept = arcs_worth(
            arcs, self.gain, self.into, self.beyond, self.price, self.need(self.price)
        )
        (d,) = first.drives
        self.gain = self.gain[kept]
        self.near = neighbours_of(arcs.only(kept), d.narrow)

    def _find_price(
        self,
        paths_into: Callable[[float], tuple[FloatArray, IntArray]],
        enough: Callable[[float], float],
        most: int,
    ) -> None:
        """Try up to `most` prices; `paths_into` says the best path into each camera at one."""
        first, budget = self.first, self.first.budget
        none = 0.0 if not first.line.required.any() else -np.inf

        def evaluate(price: float) -> tuple[float, int]:
            paths.stop_in_time(first.run)
            into, cameras = paths_into(price)
            total = into + first.ends
            best = int(np.argmax(total))
            bound = float(np.maximum(none, total[best])) + budget * price
            if self.least == math.inf or bound < self.least:
                self.price, self.into = price, into
                self.least = bound if bound < math.inf else math.inf  # not where it is no number
            return bound, int(cameras[best]) if total[best] > none else 0

        guess = self.price or float(np.max(first.alone, initial=0.0)) / budget
        seek_price(evaluate, budget, guess, enough, lambda n: n < most)

    def _opened(self) -> ArcsOut | None:
        """Return arcs that may be worth it, and set their gains; None if there are too many."""
        first = self.first
        line, n = first.line, first.line.candidate.size
        if line.arcs is not None or n <= MANY:
            arcs = line.laid_out
            self.gain = gains_along(first, arcs)
            return arcs
        step = -(-n // THINNED)
        kept = np.arange(n)
        thin = line.subset(kept[(kept % step == 0) | line.required])
        thin = replace(thin, arcs=thin.laid_out)
        self.price = FirstOrder(replace(first, line=thin), -np.inf).price
        opening, floor = Opening(first), first.threshold(self.beat)

        def enough(least: float) -> float:
            return ROUGHLY * max(least - floor, 0.0) if np.isfinite(floor) else 1e-9

        self._find_price(opening.into_each, enough, SWEEPS)
        found = opening.arcs_worth(self.into, self.price, self.need(self.price), self.most)
        if found is None:
            return None
        arcs, self.gain = found
        return arcs

    @property
    def kept(self) -> ArcsOut:
        """Return the arcs that are left, where they are not too many."""
        return ArcsOut(self.near.out_of, self.near.target)

    @property
    def arcs(self) -> int:
        """Return how many arcs are left; more than `most` where they are too many."""
        return self.most + 1 if self.too_many else len(self.near.target)

    @property
    def losses(self) -> int:
        """Return how many losses there are to keep one by one."""
        return 0 if self.too_many else int(self.near.row_at[-1])

    def need(self, price: float) -> float:
        """Return what a path must come to at a price, to be above `beat`."""
        return self.first.threshold(self.beat) - self.first.budget * price

    def beyond_at(self, price: float) -> FloatArray:
        """Return the most that may follow each camera (n,) at another price, along arcs left."""
        found: FloatArray = beyond_each(self.kept, self.gain, self.first.ends, price)
        return found

    def left(self) -> Line:
        """Return the line over the arcs that are left."""
        line = self.first.line
        return line if self.too_many else replace(line, arcs=self.kept)

    def bound(self) -> float:
        """Return an upper bound on all placements of the line, but those not above `beat`."""
        return float(self.first.as_bound(np.array([self.least]))[0])


@njit(cache=True)
def into_each(arcs, gain, alone, price):  # type: ignore[no-untyped-def]
    """Return the best first-order path that ends with each camera (n,), and its cameras (n,)."""
    n = alone.size
    value, cameras = alone - price, np.ones(n, np.int64)
    before = np.full(n, -1)
    for a in range(n):
        if before[a] >= 0:
            cameras[a] = cameras[before[a]] + 1
        now = value[a] - price
        if now == -np.inf:
            continue
        for e in range(arcs.out_of[a], arcs.out_of[a + 1]):
            b = arcs.target[e]
            if now + gain[e] > value[b]:
                value[b], before[b] = now + gain[e], a
    return value, cameras


@njit(cache=True)
def beyond_each(arcs, gain, may_end, price):  # type: ignore[no-untyped-def]
    """Return the most that paths on from each camera add (n,), at a price."""
    found = may_end.copy()
    for a in range(found.size - 1, -1, -1):
        for e in range(arcs.out_of[a], arcs.out_of[a + 1]):
            found[a] = max(found[a], gain[e] - price + found[arcs.target[e]])
    return found


@njit(cache=True, parallel=True)
def arcs_worth(arcs, gain, into, beyond, price, need):  # type: ignore[no-untyped-def]
    """Mark the arcs (m,) on paths that come to `need` at a price."""
    found = np.zeros(gain.size, np.uint8)
    for a in prange(into.size):
        for e in range(arcs.out_of[a], arcs.out_of[a + 1]):
            found[e] = into[a] + gain[e] - price + beyond[arcs.target[e]] >= need
    return found.view(np.bool_)
