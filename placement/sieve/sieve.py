"""The second order over millions of arcs: a sieve that leaves few to what comes after it.

`SecondOrder` keeps a gain for every pair of arcs and filters windows that meet together; on a line
of ten thousand cameras there are 10¹⁰ pairs. Here a gain is that given the camera before, less the
loss to the one before that (`placement.sieve.losses`), and cameras are not counted but cost a price
μ ≥ 0: max over paths of any length of (gains − μ) + k μ bounds those of at most k cameras, for any
μ (`placement.sieve.priced`). The best μ is where the best path has k.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from models.geometry import FloatArray, IntArray
from placement.sieve import priced
from placement.sieve.features import RANK, features_of, pairs_that_meet
from placement.sieve.first import FirstOrder
from placement.sieve.losses import Known, fill_losses
from placement.sieve.neighbours import Neighbours
from placement.sieve.prices import seek_price
from placement.sieve.told import Told, nothing_told
from placement.tempered import paths
from placement.tempered.bound import Tempered
from placement.tempered.line import Line

NODES = 32  # cameras between two looks at the clock
PRICES = 8  # tried at most
PRICED_TO = 0.02  # of the gap to the score to beat: nearer to the best price is not worth a pass
CHEAPER = 0.85  # the first price, of that of the first order


@dataclass(slots=True)
class Sieve:
    """The bound over the arcs of a line that are alive, on a single drive; budget ≥ 2.

    What is part of no placement above the score to beat may be left out of it. `reserve_s` seconds
    of what is left stay for passes over paths.
    """

    order: FirstOrder
    reserve_s: float = 0.0
    told: Told = field(init=False)
    losses: NDArray[np.uint16] = field(init=False)
    price: float = field(init=False)
    values: FloatArray = field(init=False)  # (m,) the best path that ends with each arc
    behind: FloatArray = field(init=False)  # (m,) and what may follow it
    least: float = field(init=False)
    # (n,) the most that follows each camera that an arc has led to, at the price
    beyond: FloatArray = field(init=False)

    def __post_init__(self) -> None:
        """Compute all losses and find the price that bounds best."""
        first, near, order = self.first, self.near, self.order
        line, run = first.line, first.run
        (d,) = first.drives
        known = Known(order.price, order.into, order.beyond, order.need(order.price))
        n, m = line.candidate.size, order.arcs
        self.told, self.losses = nothing_told(n, m), np.zeros(order.losses, dtype=np.uint16)
        features = features_of(d.process, d.narrow, RANK)
        paths.stop_in_time(run)
        meeting = pairs_that_meet(d.narrow, features)
        # losses left at 0 where time runs short are those of the first order
        for begin in range(0, n, NODES):
            if run.remaining() < self.reserve_s + 1.0:
                break
            paths.stop_in_time(run)
            fill_losses(
                d.process, d.narrow, d.rows, line.group, d.weight, order.gain, near,
                features, meeting, known, np.arange(begin, min(begin + NODES, n)), self.told,
                self.losses,
            )  # fmt: skip
        self._find_price()
        self.behind = np.full(m, -np.inf)
        priced.backward(
            order.gain, first.ends, near, self.told, self.losses, self.weight, self.price,
            order.beyond_at(self.price), order.need(self.price),
            self.values, self.behind,
        )  # fmt: skip
        self.beyond = first.ends.copy()
        np.maximum.at(self.beyond, near.target, self.behind)

    @property
    def first(self) -> Tempered:
        """Return the first order that this improves on."""
        return self.order.first

    @property
    def weight(self) -> float:
        """Return how often the drive's gains count; where they count for nothing, next to that."""
        return max(self.first.drives[0].weight, 1e-9)

    @property
    def near(self) -> Neighbours:
        """Return the arcs and who is near to whom."""
        return self.order.near

    def _find_price(self) -> None:
        budget, run = self.first.budget, self.first.run
        floor, self.least = self.first.threshold(self.order.beat), np.inf
        took = 0.0

        def evaluate(price: float) -> tuple[float, int]:
            nonlocal took
            paths.stop_in_time(run)
            started = time.monotonic()
            values = self._forward(price)
            bound = self._worth(values, price) + budget * price
            if bound < self.least:
                self.least, self.price, self.values = bound, price, values
            length = len(self._trace(values, price))
            took = time.monotonic() - started
            return bound, length

        def enough(least: float) -> float:
            return PRICED_TO * max(least - floor, 0.0) if np.isfinite(floor) else 1e-9

        def may_go_on(tried: int) -> bool:
            return tried < PRICES and run.remaining() > 2.0 * took + 1.0

        seek_price(evaluate, budget, CHEAPER * self.order.price, enough, may_go_on)

    def _forward(self, price: float) -> FloatArray:
        """Return the values of all arcs at a price."""
        first = self.first
        values = np.full(len(self.near.target), -np.inf)
        priced.forward(
            self.order.gain, first.alone, self.near, self.told, self.losses, self.weight,
            price, self.order.beyond_at(price), self.order.need(price),
            values,
        )  # fmt: skip
        return values

    def _worth(self, values: FloatArray, price: float) -> float:
        ends = self.first.ends
        none = 0.0 if not self.first.line.required.any() else -np.inf
        one = float(np.max(self.first.alone - price + ends, initial=-np.inf))
        more = float(np.max(values + ends[self.near.target], initial=-np.inf))
        return float(np.max([none, one, more]))  # no number, if any is none

    def bound(self) -> float:
        """Return an upper bound on all placements of the line, but those not above `beat`."""
        return float(self.first.as_bound(np.array([self.least]))[0])

    def path(self) -> IntArray:
        """Return the candidates of a best path."""
        return self.first.line.candidate[self._trace(self.values, self.price)]

    def _trace(self, values: FloatArray, price: float) -> IntArray:
        """Return the positions of a best path by `values` at a price."""
        first, near = self.first, self.near
        ends = first.ends
        total = values + ends[near.target]
        single = first.alone - price + ends
        if not total.size or total.max() < single.max():
            best = int(np.argmax(single))
            return np.array([best] if single[best] > -np.inf else [], dtype=np.int64)
        e = int(np.argmax(total))
        found = [int(near.target[e])]
        while True:
            j = int(np.searchsorted(near.out_of, e, side="right")) - 1
            found.append(j)
            into = np.arange(near.into[j], near.into[j + 1])
            via = values[near.place[into]] - self.losses_of(j, e)
            if not via.size or via.max() < first.alone[j] - price:
                return np.array(found[::-1], dtype=np.int64)
            e = int(near.place[into[np.argmax(via)]])

    def losses_of(self, j: int, e: int) -> FloatArray:
        """Return the losses along arc e out of j to each of the cameras before j, in nats."""
        found = np.empty(self.near.into[j + 1] - self.near.into[j])
        weight = self.weight
        priced.losses_along(j, e, self.near, self.told, self.losses, weight, found)
        return found

    def survivors(self, beat: float) -> Line:
        """Return the line without the candidates and arcs that no placement above `beat` uses.

        `beat` is no less than the score to beat.
        """
        first, near = self.first, self.near
        least = first.threshold(beat) - first.budget * self.price
        good = self.values + self.behind >= least
        source = self.order.kept.source
        single = first.alone - self.price + first.ends >= least
        return first.line.over_arcs(source[good], near.target[good], single)
