"""The tempered chain given all that came before, as a relaxed decision diagram.

By the chain rule g(S) = Σ g(i_l | i_1 … i_{l−1}). The first order conditions on i_{l−1} alone, the
second on two; here the condition is i_{l−1} and a label of it, which stands for many paths there
(`placement.tempered.labels`). Paths share a label that come through neighbours in the line and, if
the bound is so far above the incumbent that whole cameras may be wasted, have wasted about as much.
A state of the dynamic program is a camera and a label of it, and the bound is the longest path
through states: valid for any number of labels, and the sharper the more there are.

Labels forget what earlier cameras measure once the next has come into view; the second order does
not. Where that has been computed, a gain is capped by the greatest of the second order among the
predecessors that a label stands for.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from models.geometry import BoolArray, FloatArray, IntArray
from placement.tempered import paths, states
from placement.tempered.bound import SecondOrder, Tempered
from placement.tempered.labels import EMPTY, Hope, Labels, pass_labels
from placement.tempered.line import Line
from placement.tempered.paths import Arcs
from placement.tempered.states import Layout

NODES = 16  # cameras between two looks at the clock
MANY = 5_000_000  # gains, from which on labels are merged more roughly
SPARE = 1e-5  # share by which merged labels are larger than they need be
MOST_GRADES = 4  # labels by what has been wasted
WIDEST = 200  # labels of a camera: their numbers are bytes


@dataclass(slots=True)
class Diagram:
    """The bound over the arcs of a line that are alive; up to `width` labels a camera, budget ≥ 2.

    What is part of no placement above `beat` is left out on the way. `second`, if given, is the
    second order over the same arcs, share and background; `beyond` (n,) what an earlier diagram
    or sieve of that share and background has found at `price`, behind an arc into each camera.
    """

    first: Tempered
    width: int
    beat: float
    second: SecondOrder | None = None
    price: float = -1.0
    beyond: FloatArray | None = None
    arcs: Arcs = field(init=False)
    layout: Layout = field(init=False)
    gains: NDArray[np.float32] = field(init=False)
    ends: FloatArray = field(init=False)  # (s,) 0 where a path may end
    F: FloatArray = field(init=False)  # (k, s), if counted
    B: FloatArray = field(init=False)

    def __post_init__(self) -> None:
        """Pass the labels along the line and find the best paths."""
        first = self.first
        line = first.line
        if self.beyond is None:
            self.price = last_worth(first)
            self.beyond = states.priced_beyond(first.pairs, first.ends, self.price)
        need = first.threshold(self.beat) - first.budget * self.price
        span = float(np.max(first.alone - self.price + self.beyond, initial=-np.inf)) - need
        grades = 1
        if 0.0 < span < np.inf and self.price > 0.0:
            grades = int(np.clip(np.ceil(2.0 * span / self.price), 1, MOST_GRADES))
        self.arcs = paths.lay_out(line)
        grades = min(grades, self.width)
        self.layout = layout = lay_out(self.arcs, min(self.width, WIDEST) // grades, grades)
        self.gains = np.zeros(len(layout.leads), dtype=np.float32)
        spare = SPARE if self.gains.size < MANY else 100.0 * SPARE
        hope = Hope(self.price, self.beyond, need, max(span, 1e-300), grades, spare)
        for number, d in enumerate(first.drives):
            early_at = d.narrow.first.copy()
            source = self.arcs.source[self.arcs.out]
            np.minimum.at(early_at, source, d.narrow.first[layout.target])
            found = self._labels()
            for begin in range(0, line.candidate.size, NODES):
                paths.stop_in_time(first.run)
                pass_labels(
                    d.process, d.narrow, d.rows, d.piece, d.extra, d.weight,
                    len(first.drives) == 1, number == 0, first.pairs, layout, early_at, hope,
                    np.arange(begin, min(begin + NODES, line.candidate.size)), found, self.gains,
                )  # fmt: skip
        if self.second is not None:
            states.cap_by_second(layout, self.arcs.triple, self.second.gains, self.gains)
        self.ends = np.repeat(first.ends, np.diff(layout.state_of))
        self._best_paths()

    def _labels(self) -> Labels:
        n_states = int(self.layout.state_of[-1])
        so_far = np.full(n_states, -np.inf)
        so_far[self.layout.state_of[:-1]] = self.first.alone - self.price
        return Labels(np.full((n_states, 6), EMPTY), np.full((n_states, 6), EMPTY), so_far)

    def _best_paths(self) -> None:
        first, layout = self.first, self.layout
        back = states.priced_back(layout, self.gains, first.ends, self.price)
        # labels differ from diagram to diagram, cameras do not
        self.beyond = np.maximum.reduceat(back, layout.state_of[:-1])
        k = first.budget
        self.F, self.B = np.empty((k, self.ends.size)), np.empty((k, self.ends.size))
        self.F[0], self.B[0] = -np.inf, self.ends
        self.F[0, layout.state_of[:-1]] = first.alone
        for level in range(1, k):
            paths.stop_in_time(first.run)
            self.F[level] = states.step_forward(layout, self.gains, self.F[level - 1])
            self.B[level] = states.step_back(layout, self.gains, first.ends, self.B[level - 1])

    def bound(self) -> float:
        """Return an upper bound on all placements of the line, but those not above `beat`."""
        none = 0.0 if not self.first.line.required.any() else -np.inf
        best = float(np.max(self.F + self.ends, initial=-np.inf))
        return float(self.first.as_bound(np.array([np.maximum(none, best)]))[0])

    @property
    def start(self) -> FloatArray:
        """Return the paths of two cameras (m,), by arc; −∞ where they lead to nothing."""
        first, arcs = self.first, self.arcs
        found = first.alone[arcs.source] + first.pairs[arcs.source, arcs.target]
        begin = self.layout.gain_at[self.layout.place]
        return np.where(self.gains[begin] > -np.inf, found, -np.inf)

    def begin(self) -> IntArray:
        """Return the state (m,) that each arc leads to from a path that begins with its source."""
        at = self.layout.gain_at[self.layout.place]
        found: IntArray = self.layout.state_of[self.arcs.target] + self.layout.leads[at]
        return found

    def follow(self, camera: int, state: int) -> tuple[IntArray, BoolArray]:
        """Return the states that the arcs out of a camera in `state` lead to, and which lead on."""
        layout = self.layout
        out = slice(int(layout.out_of[camera]), int(layout.out_of[camera + 1]))
        at = layout.gain_at[out] + (state - int(layout.state_of[camera]))
        reached: IntArray = layout.state_of[layout.target[out]] + layout.leads[at]
        alive: BoolArray = self.gains[at] > -np.inf
        return reached, alive

    def after(self, further: int, reached: IntArray) -> FloatArray:
        """Return what at most `further` cameras can add behind each of the states `reached`."""
        found: FloatArray = self.B[further][reached]
        return found

    def path(self) -> IntArray:
        """Return the candidates of a best path."""
        found = states.trace_states(self.layout, self.gains, self.F, self.ends)
        return self.first.line.candidate[found]

    def survivors(self, beat: float) -> Line:
        """Return the line without the candidates and arcs that no placement above `beat` uses."""
        line, arcs = self.first.line, self.arcs
        least = self.first.threshold(beat)
        good = states.reaching(self.layout, self.gains, self.F, self.B, least)
        of = arcs.out[good]
        single = self.first.alone + self.first.ends >= least
        return line.over_arcs(arcs.source[of], arcs.target[of], single)


def last_worth(first: Tempered) -> float:
    """Return what the last camera of the budget adds to the first order's best paths."""
    best = np.maximum.accumulate(np.max(first.F + first.ends, axis=1, initial=0.0))
    price = float(best[-1] - best[-2]) if len(best) > 1 else 0.0
    return max(price, 0.0) if np.isfinite(price) else 0.0


def lay_out(arcs: Arcs, places: int, grades: int) -> Layout:
    """Give each camera a label for paths that begin there and `grades` for each place before it.

    Its predecessors share up to `places` places, equally and in their order.
    """
    degree = np.diff(arcs.into)
    taken = np.minimum(degree, places)
    rank = np.arange(arcs.into[-1]) - np.repeat(arcs.into[:-1], degree)
    share = rank * np.repeat(taken, degree) // np.maximum(np.repeat(degree, degree), 1)
    labels = 1 + taken * grades
    source = arcs.source[arcs.out]
    gain_at = np.concatenate([[0], np.cumsum(labels[source])]).astype(np.int64)
    place = np.empty(len(arcs.out), dtype=np.int64)
    place[arcs.out] = np.arange(len(arcs.out))
    return Layout(
        arcs.into,
        arcs.source,
        place,
        arcs.out_of,
        arcs.target[arcs.out],
        (1 + share * grades)[arcs.out].astype(np.int64),
        np.concatenate([[0], np.cumsum(labels)]).astype(np.int64),
        gain_at,
        np.zeros(int(gain_at[-1]), dtype=np.uint8),
    )
