"""The second order over millions of arcs: a sieve that leaves few to what comes after it.

`SecondOrder` keeps a gain for every pair of arcs and filters windows that meet together; on a line
of ten thousand cameras there are 10¹⁰ pairs. Here a gain is that given the camera before, less a
loss by class of the one before that (`placement.sieve.losses`), and cameras are not counted but
cost a price μ ≥ 0: max over paths of any length of (gains − μ) + k μ bounds those of at most k
cameras, for any μ (`placement.sieve.priced`). The best μ is where the best path has k.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from models.geometry import BoolArray, FloatArray, IntArray
from placement.sieve import priced
from placement.sieve.classes import IMPOSSIBLE, STEPS, Classes, classes_of
from placement.sieve.features import RANK, features_of, pairs_that_meet
from placement.sieve.losses import Known, fill_losses
from placement.tempered import paths, states
from placement.tempered.bound import Line, Tempered
from placement.tempered.diagram import last_worth

NODES = 32  # cameras between two looks at the clock
N_FAR = 16  # classes of far cameras
SPARE = 1.0  # prices that a path may waste and still be told apart from others
PRICES = 8  # tried at most
PASS_S = 2.5e-9  # seconds a loss takes in a pass over paths


@dataclass(slots=True)
class Sieve:
    """The bound over the arcs of a line that are alive, on a single drive; budget ≥ 2.

    What is part of no placement above `beat` may be left out of it.
    """

    first: Tempered
    beat: float
    n_far: int = N_FAR
    classes: Classes = field(init=False)
    losses: NDArray[np.uint16] = field(init=False)
    price: float = field(init=False)
    values: FloatArray = field(init=False)  # (m,) the best path that ends with each arc
    behind: FloatArray = field(init=False)  # (m,) and what may follow it
    least: float = field(init=False)
    # (n,) the most that follows each camera that an arc has led to, at the price
    beyond: FloatArray = field(init=False)

    def __post_init__(self) -> None:
        """Compute all losses and find the price that bounds best."""
        first = self.first
        line, run = first.line, first.run
        (d,) = first.drives
        price = last_worth(first)
        need = first.threshold(self.beat) - first.budget * price
        beyond = states.priced_beyond(first.pairs, first.ends, price)
        into = priced_into(first.pairs, first.alone, price)
        known = Known(price, into, beyond, need, SPARE * max(price, 1e-9))
        self.classes = classes = classes_of(paths.lay_out(line.alive), d.narrow, self.n_far)
        self.losses = np.zeros(int(classes.row_at[-1]), dtype=np.uint16)
        features = features_of(d.process, d.narrow, RANK)
        paths.stop_in_time(run)
        meeting = pairs_that_meet(d.narrow, features)
        n = line.candidate.size
        # losses left at 0 where time runs short are those of the first order
        reserve_s = 1.0 + PASS_S * (PRICES + 1) * self.losses.size
        for begin in range(0, n, NODES):
            if run.remaining() < reserve_s:
                break
            paths.stop_in_time(run)
            fill_losses(
                d.process, d.narrow, d.rows, d.whole, line.group, d.weight, first.pairs, classes,
                features, meeting, known, np.arange(begin, min(begin + NODES, n)), self.losses,
            )  # fmt: skip
        self._find_price(price)
        self.behind = np.full(len(classes.target), -np.inf)
        priced.backward(first.pairs, first.ends, classes, self.losses, self.price, self.behind)
        self.beyond = first.ends.copy()
        np.maximum.at(self.beyond, classes.target, self.behind)

    def _find_price(self, price: float) -> None:
        """Halve the interval that holds the best price, by how long the best path is."""
        budget = self.first.budget
        low, high, self.least = 0.0, np.inf, np.inf
        for _ in range(PRICES):
            paths.stop_in_time(self.first.run)
            values = np.full(len(self.classes.target), -np.inf)
            priced.forward(
                self.first.pairs, self.first.alone, self.classes, self.losses, price, values
            )
            bound = self._worth(values, price) + budget * price
            length = len(self._trace(values, price))
            if bound < self.least:
                self.least, self.price, self.values = bound, price, values
            if length == budget or price == 0.0:
                break
            if length > budget:
                low = price
            else:
                high = price
            price = 0.5 * (low + high) if np.isfinite(high) else 1.5 * price
            price = price if price > 1e-9 else 0.0

    def _worth(self, values: FloatArray, price: float) -> float:
        ends = self.first.ends
        none = 0.0 if not self.first.line.required.any() else -np.inf
        one = float(np.max(self.first.alone - price + ends, initial=-np.inf))
        return max(none, one, float(np.max(values + ends[self.classes.target], initial=-np.inf)))

    def bound(self) -> float:
        """Return an upper bound on all placements of the line, but those not above `beat`."""
        return float(self.first.as_bound(np.array([self.least]))[0])

    def path(self) -> IntArray:
        """Return the candidates of a best path."""
        return self.first.line.candidate[self._trace(self.values, self.price)]

    def _trace(self, values: FloatArray, price: float) -> IntArray:
        """Return the positions of a best path by `values` at a price."""
        first, classes = self.first, self.classes
        ends = first.ends
        total = values + ends[classes.target]
        single = first.alone - price + ends
        if not total.size or total.max() < single.max():
            best = int(np.argmax(single))
            return np.array([best] if single[best] > -np.inf else [], dtype=np.int64)
        e = int(np.argmax(total))
        found = [int(classes.target[e])]
        while True:
            j = int(np.searchsorted(classes.out_of, e, side="right")) - 1
            found.append(j)
            into = np.arange(classes.into[j], classes.into[j + 1])
            row = self.losses[classes.row_at[e] : classes.row_at[e + 1]]
            column = classes.group[into].astype(np.int64)
            if classes.ahead[e]:
                column = np.where(
                    classes.near[into], 1 + classes.n_far + classes.rank[into], column
                )
            loss = np.where(row[column] == IMPOSSIBLE, np.inf, row[column] / STEPS)
            alone = classes.near[into] & classes.ahead[e]
            via = values[classes.place[into]] - loss
            via = np.where(alone, via, via + classes.extra[into])
            if not via.size or via.max() < first.alone[j] - price:
                return np.array(found[::-1], dtype=np.int64)
            e = int(classes.place[into[np.argmax(via)]])

    def survivors(self, beat: float) -> Line:
        """Return the line without the candidates and arcs that no placement above `beat` uses."""
        first, classes = self.first, self.classes
        least = first.threshold(beat) - first.budget * self.price
        good = self.values + self.behind >= least
        alive: BoolArray = np.zeros_like(first.line.alive)
        source = np.repeat(np.arange(len(first.alone)), np.diff(classes.out_of))
        alive[source[good], classes.target[good]] = True
        return first.line.over_arcs(alive, first.alone - self.price + first.ends >= least)


def size_of(first: Tempered) -> tuple[int, int]:
    """Return the arcs that a sieve would pass over, and its losses if there were no classes."""
    classes = classes_of(paths.lay_out(first.line.alive), first.drives[0].narrow, 0, 0)
    return len(classes.target), int(classes.row_at[-1])


def priced_into(pairs: NDArray[np.float32], alone: FloatArray, price: float) -> FloatArray:
    """Return the best first-order path that ends with each camera (n,), each at a price."""
    found = alone - price
    for j in range(len(found)):
        found[j] = max(found[j], np.max(found[:j] + pairs[:j, j], initial=-np.inf) - price)
    return found
