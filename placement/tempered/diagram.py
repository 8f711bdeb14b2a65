"""The tempered chain given all that came before, as a relaxed decision diagram.

By the chain rule g(S) = Σ g(i_l | i_1 … i_{l−1}). The first order conditions on i_{l−1} alone, the
second on two; here the condition is i_{l−1} and a label of it, which stands for every path there
through some neighbours in the line (`placement.tempered.labels`). Each camera has a label for
paths that begin with it and up to `width` for its predecessors in the line, so a state of the
dynamic program is a camera and roughly who came before it, and the bound is the longest path
through states: valid for any width, and the sharper the fewer arcs are alive and the wider it is.

Labels forget what earlier cameras measure once the next has come into view; the second order does
not. Where that has been computed, a gain is capped by the greatest of the second order among the
predecessors that a label stands for.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from models.geometry import BoolArray, FloatArray, IntArray
from placement.tempered import paths
from placement.tempered.bound import Line, SecondOrder, Tempered
from placement.tempered.labels import EMPTY, Hope, Labels, pass_labels
from placement.tempered.paths import Arcs

NODES = 16  # cameras between two looks at the clock


@dataclass(slots=True)
class Diagram:
    """The bound over the arcs of a line that are alive; `width` labels a camera, budget ≥ 2.

    What is part of no placement above `beat` is left out on the way. `second`, if given, is the
    second order over the same arcs, share and background; `beyond` (n,) what an earlier diagram of
    that share and background has found at `price`.
    """

    first: Tempered
    width: int
    beat: float
    second: SecondOrder | None = None
    price: float = -1.0
    beyond: FloatArray | None = None
    arcs: Arcs = field(init=False)
    enters: IntArray = field(init=False)  # (m,) the label of its target that an arc leads to
    state_of: IntArray = field(init=False)  # (n + 1,) states of each camera
    gain_at: IntArray = field(init=False)  # (m + 1,) into the gains, by source
    gains: NDArray[np.float32] = field(init=False)
    start: FloatArray = field(init=False)  # (m,) paths of two cameras
    ends: FloatArray = field(init=False)
    F: FloatArray = field(init=False)  # (k, s) best path of l + 1 cameras into each state
    B: FloatArray = field(init=False)  # (k, s) what at most r cameras can add after it

    def __post_init__(self) -> None:
        """Pass the labels along the line and find the best paths."""
        first = self.first
        n = first.line.candidate.size
        self.arcs = arcs = paths.lay_out(first.line.alive)
        self.enters, labels = enter(arcs.into, self.width)
        self.state_of = np.concatenate([[0], np.cumsum(labels)]).astype(np.int64)
        source, target = arcs.source[arcs.out], arcs.target[arcs.out]
        self.gain_at = np.concatenate([[0], np.cumsum(labels[source])]).astype(np.int64)
        self.gains = np.zeros(int(self.gain_at[-1]), dtype=np.float32)
        enters = self.enters[arcs.out]
        hope = self._hope()
        single = len(first.drives) == 1
        for d in first.drives:
            early_at = d.narrow.first.copy()
            np.minimum.at(early_at, source, d.narrow.first[target])
            found = self._labels()
            for begin in range(0, n, NODES):
                paths.stop_in_time(first.run)
                pass_labels(
                    d.process, d.narrow, d.rows, d.whole, d.alone, d.weight, single, first.pairs,
                    arcs.out_of, target, enters, self.state_of, self.gain_at, early_at, hope,
                    np.arange(begin, min(begin + NODES, n)), found, self.gains,
                )  # fmt: skip
        if self.second is not None:
            cap_by_second(
                arcs.into, arcs.out_of, arcs.triple, self.second.gains, self.enters, self.state_of,
                self.gain_at, self.gains,
            )  # fmt: skip
        self.ends = first.ends
        self.start = first.alone[arcs.source] + first.pairs[arcs.source, arcs.target]
        self._tables()

    def _hope(self) -> Hope:
        """Price a camera at what the last of the budget adds, and say what may lie beyond each."""
        first = self.first
        if self.beyond is None:
            best = np.maximum.accumulate(np.max(first.F + first.ends, axis=1, initial=0.0))
            self.price = float(best[-1] - best[-2]) if len(best) > 1 else 0.0
            self.price = max(self.price, 0.0) if np.isfinite(self.price) else 0.0
            self.beyond = priced_beyond(first.pairs, first.ends, self.price)
        need = first.threshold(self.beat) - first.budget * self.price
        return Hope(self.price, self.beyond, need)

    def _labels(self) -> Labels:
        states = int(self.state_of[-1])
        so_far = np.full(states, -np.inf)
        so_far[self.state_of[:-1]] = self.first.alone - self.price
        return Labels(np.full((states, 6), EMPTY), np.full((states, 6), EMPTY), so_far)

    def _tables(self) -> None:
        first, arcs = self.first, self.arcs
        k, states = first.budget, int(self.state_of[-1])
        self.F, self.B = np.empty((k, states)), np.empty((k, states))
        self.F[0] = -np.inf
        self.F[0, self.state_of[:-1]] = first.alone
        self.B[0] = np.repeat(self.ends, np.diff(self.state_of))
        place = np.empty(len(arcs.out), dtype=np.int64)
        place[arcs.out] = np.arange(len(arcs.out))
        gain_of = self.gain_at[place]
        target, enters = arcs.target[arcs.out], self.enters[arcs.out]
        self.beyond = priced_beyond_states(
            arcs.out_of, target, enters, self.state_of, self.gain_at, self.gains, self.ends,
            self.price,
        )  # fmt: skip
        for level in range(1, k):
            paths.stop_in_time(first.run)
            self.F[level] = step_forward(
                arcs.into, arcs.source, self.enters, self.state_of, gain_of, self.gains,
                self.F[level - 1],
            )  # fmt: skip
            self.B[level] = step_back(
                arcs.out_of, target, enters, self.state_of, self.gain_at, self.gains, self.ends,
                self.B[level - 1],
            )  # fmt: skip

    def bound(self) -> float:
        """Return an upper bound on the score of every placement of the line."""
        none = 0.0 if not self.first.line.required.any() else -np.inf
        ends = np.repeat(self.ends, np.diff(self.state_of))
        best = float(np.max(self.F + ends, initial=-np.inf))
        return float(self.first.as_bound(np.array([max(none, best)]))[0])

    def after(self, further: int, arcs: IntArray) -> FloatArray:
        """Return what at most `further` cameras can add behind each of `arcs` (m,)."""
        found: FloatArray = self.B[further][
            self.state_of[self.arcs.target[arcs]] + self.enters[arcs]
        ]
        return found

    def path(self) -> IntArray:
        """Return the candidates of a best path."""
        ends = self.F + np.repeat(self.ends, np.diff(self.state_of))
        level, state = np.unravel_index(int(np.argmax(ends)), ends.shape)
        if ends[level, state] == -np.inf:
            return np.empty(0, dtype=np.int64)
        arcs = self.arcs
        camera = np.repeat(np.arange(len(arcs.into) - 1), np.diff(self.state_of))
        place = np.empty(len(arcs.out), dtype=np.int64)
        place[arcs.out] = np.arange(len(arcs.out))
        found = [int(camera[state])]
        for row in range(int(level) - 1, -1, -1):
            k = found[-1]
            best, before = -np.inf, -1
            for a in range(int(arcs.into[k]), int(arcs.into[k + 1])):
                if self.state_of[k] + self.enters[a] != state:
                    continue
                j = int(arcs.source[a])
                low, high = int(self.state_of[j]), int(self.state_of[j + 1])
                at = int(self.gain_at[place[a]])
                value = self.F[row, low:high] + self.gains[at : at + high - low]
                if value.max() > best:
                    best, before = float(value.max()), low + int(np.argmax(value))
            state = np.int64(before)
            found.append(int(camera[before]))
        return self.first.line.candidate[np.array(found[::-1], dtype=np.int64)]

    def survivors(self, beat: float) -> Line:
        """Return the line without the candidates and arcs that no placement above `beat` uses."""
        line, arcs = self.first.line, self.arcs
        least = self.first.threshold(beat)
        good = reaching(
            arcs.out_of, arcs.target[arcs.out], self.enters[arcs.out], self.state_of, self.gain_at,
            self.gains, self.F, self.B, least,
        )  # fmt: skip
        alive: BoolArray = np.zeros_like(line.alive)
        alive[arcs.source[arcs.out[good]], arcs.target[arcs.out[good]]] = True
        single = self.first.alone + self.ends >= least
        keep = np.flatnonzero(alive.any(axis=0) | alive.any(axis=1) | line.required | single)
        smaller = line.subset(keep)
        return Line(smaller.candidate, smaller.group, smaller.required, alive[np.ix_(keep, keep)])


def enter(into: IntArray, width: int) -> tuple[IntArray, IntArray]:
    """Return the label that each arc (m,), sorted by target, leads to, and the labels of each (n,).

    Label 0 is of paths that begin there; predecessors share the others in their order, equally.
    """
    degree = np.diff(into)
    labels = np.minimum(degree, width)
    rank = np.arange(into[-1]) - np.repeat(into[:-1], degree)
    enters = 1 + rank * np.repeat(labels, degree) // np.maximum(np.repeat(degree, degree), 1)
    return enters.astype(np.int64), (labels + 1).astype(np.int64)


@njit(cache=True)
def priced_beyond(pairs, may_end, price):  # type: ignore[no-untyped-def]
    """Return the most that paths on from each camera add (n,), each further camera at a price."""
    n = may_end.size
    found = may_end.copy()
    for a in range(n - 2, -1, -1):
        best = found[a]
        for b in range(a + 1, n):
            best = max(best, pairs[a, b] - price + found[b])
        found[a] = best
    return found


@njit(cache=True)
def priced_beyond_states(out_of, target, enters, state_of, gain_at, gains, may_end, price):  # type: ignore[no-untyped-def]
    """Return the same by the gains of the diagram, the greatest over each camera's states (n,)."""
    n = may_end.size
    by_state, found = np.empty(state_of[-1]), may_end.copy()
    for j in range(n - 1, -1, -1):
        low, high = state_of[j], state_of[j + 1]
        by_state[low:high] = may_end[j]
        for e in range(out_of[j], out_of[j + 1]):
            beyond = by_state[state_of[target[e]] + enters[e]] - price
            for state in range(low, high):
                value = gains[gain_at[e] + state - low] + beyond
                by_state[state] = max(by_state[state], value)
        found[j] = np.max(by_state[low:high])
    return found


@njit(cache=True, parallel=True)
def cap_by_second(into, out_of, triple, second, enters, state_of, gain_at, gains):  # type: ignore[no-untyped-def]
    """Lower gains to the greatest of the second order among whom a label stands for.

    `second` is laid out by `triple` as `gains.add_triple_gains` says.
    """
    for j in prange(into.size - 1):
        begin, end = out_of[j], out_of[j + 1]
        most = np.empty(state_of[j + 1] - state_of[j], np.float32)
        for e in range(begin, end):
            most[:] = -np.inf
            for a in range(into[j], into[j + 1]):
                most[enters[a]] = max(most[enters[a]], second[triple[a] + e - begin])
            for c in range(1, most.size):
                gains[gain_at[e] + c] = min(gains[gain_at[e] + c], most[c])


@njit(cache=True, parallel=True)
def step_forward(into, source, enters, state_of, gain_of, gains, found):  # type: ignore[no-untyped-def]
    """Return the next row of F (s,); `gain_of` (m,) is by arc."""
    longer = np.full(found.size, -np.inf)
    for k in prange(into.size - 1):
        for a in range(into[k], into[k + 1]):
            j, at, to = source[a], gain_of[a], state_of[k] + enters[a]
            best = longer[to]
            for c in range(state_of[j + 1] - state_of[j]):
                best = max(best, found[state_of[j] + c] + gains[at + c])
            longer[to] = best
    return longer


@njit(cache=True, parallel=True)
def step_back(out_of, target, enters, state_of, gain_at, gains, may_end, found):  # type: ignore[no-untyped-def]
    """Return the next row of B (s,); `may_end` (n,) is by camera."""
    longer = np.empty(found.size)
    for j in prange(out_of.size - 1):
        low, high = state_of[j], state_of[j + 1]
        longer[low:high] = may_end[j]
        for e in range(out_of[j], out_of[j + 1]):
            beyond = found[state_of[target[e]] + enters[e]]
            at = gain_at[e] - low
            for state in range(low, high):
                longer[state] = max(longer[state], gains[at + state] + beyond)
    return longer


@njit(cache=True, parallel=True)
def reaching(out_of, target, enters, state_of, gain_at, gains, F, B, threshold):  # type: ignore[no-untyped-def]
    """Mark the arcs (m,), sorted by source, on some path of at most k cameras with `threshold`."""
    k = F.shape[0]
    good = np.zeros(target.size, np.bool_)
    for j in prange(out_of.size - 1):
        low, high = state_of[j], state_of[j + 1]
        for e in range(out_of[j], out_of[j + 1]):
            to = state_of[target[e]] + enters[e]
            for state in range(low, high):
                need = threshold - gains[gain_at[e] + state - low]
                for level in range(k - 1):
                    if F[level, state] + B[k - 2 - level, to] >= need:
                        good[e] = True
                        break
                if good[e]:
                    break
    return good
