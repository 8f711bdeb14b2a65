"""First-order paths at the price that bounds them best: what a sieve begins with."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numba import njit, prange

from models.geometry import FloatArray
from placement.sieve.neighbours import Neighbours, neighbours_of
from placement.sieve.prices import seek_price
from placement.tempered import paths, states
from placement.tempered.bound import Tempered

PRICES = 16  # tried at most
PRICED_TO = 1e-4  # of the bound


@dataclass(slots=True)
class FirstOrder:
    """The first order of a tempered bound at its best price, and the arcs that this leaves.

    Arcs that no placement above `beat` uses may be left out; on a single drive, budget ≥ 2.
    """

    first: Tempered
    beat: float
    price: float = field(init=False, default=0.0)
    least: float = field(init=False, default=math.inf)
    into: FloatArray = field(init=False)  # (n,) the best path that ends with each camera
    beyond: FloatArray = field(init=False)  # (n,) and what may follow it
    near: Neighbours = field(init=False)

    def __post_init__(self) -> None:
        """Find the price and lay out what is left."""
        first = self.first
        budget = first.budget

        def evaluate(price: float) -> tuple[float, int]:
            paths.stop_in_time(first.run)
            into, cameras = into_each(first.pairs, first.alone, price)
            total = into + first.ends
            best = int(np.argmax(total))
            none = 0.0 if not first.line.required.any() else -np.inf
            bound = max(none, float(total[best])) + budget * price
            if bound < self.least:
                self.least, self.price, self.into = bound, price, into
            return bound, int(cameras[best]) if total[best] > none else 0

        guess = float(np.max(first.alone, initial=0.0)) / budget
        seek_price(
            evaluate, budget, guess, lambda least: PRICED_TO * abs(least), lambda n: n < PRICES
        )
        self.beyond = states.priced_beyond(first.pairs, first.ends, self.price)
        alive = arcs_worth(
            first.pairs, first.line.alive, self.into, self.beyond, self.price,
            self.need(self.price),
        )  # fmt: skip
        (d,) = first.drives
        self.near = neighbours_of(alive, d.narrow)

    @property
    def arcs(self) -> int:
        """Return how many arcs are left."""
        return len(self.near.target)

    @property
    def losses(self) -> int:
        """Return how many losses there are to keep one by one."""
        return int(self.near.row_at[-1])

    def need(self, price: float) -> float:
        """Return what a path must come to at a price, to be above `beat`."""
        return self.first.threshold(self.beat) - self.first.budget * price

    def bound(self) -> float:
        """Return an upper bound on the score of every placement of the line."""
        return float(self.first.as_bound(np.array([self.least]))[0])


@njit(cache=True)
def into_each(pairs, alone, price):  # type: ignore[no-untyped-def]
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
        for b in range(a + 1, n):
            if now + pairs[a, b] > value[b]:
                value[b], before[b] = now + pairs[a, b], a
    return value, cameras


@njit(cache=True, parallel=True)
def arcs_worth(pairs, alive, into, beyond, price, need):  # type: ignore[no-untyped-def]
    """Mark the arcs (n, n) of `alive` on paths that come to `need` at a price."""
    n = into.size
    found = np.zeros((n, n), np.bool_)
    for a in prange(n):
        for b in range(a + 1, n):
            worth = into[a] + pairs[a, b] - price + beyond[b]
            found[a, b] = alive[a, b] and worth >= need
    return found
