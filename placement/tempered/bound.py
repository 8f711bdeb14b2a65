"""The tempered chain bound on the entropy of every placement.

Let f(x) = log det(Λ_0 + Σ x_i Λ_i) − log det Λ_0, concave in x, and s the indicator of a placement
S. For any background y ≥ 0 and any share 0 < θ ≤ 1, concavity between y and s gives

    f(S) ≤ [ f((1 − θ) y + θ s) − (1 − θ) f(y) ] / θ.

The first term is f((1 − θ) y) + g(S), where g(S) = f((1 − θ) y + θ s) − f((1 − θ) y) is again a
log det ratio: monotone and submodular in S. So the chain rule and diminishing returns, over the
cameras of S in any fixed order, give

    g(S) ≤ g(i_1) + Σ_{l ≥ 2} g(i_l | i_{l−1})                                   (first order)
    g(S) ≤ g(i_1) + g(i_2 | i_1) + Σ_{l ≥ 3} g(i_l | i_{l−1}, i_{l−2})           (second order)

and every placement is a path. θ = 1 is the chain bound; as θ → 0 the gains turn into slopes, whose
interactions vanish, and the bound into the tangent of the concave relaxation at y. In between, the
background screens distant cameras from each other, as they do in truth, while neighbours are
still whole cameras and not fractions. Measured on `winding`: `car`, k = 20: concave 3.6 %, chain
19 %, tempered (θ = 0.7, first order) under 1.5 %. The best y found is the relaxation's own optimum;
mixing the incumbent into it was worse everywhere.

Nothing above depends on the order, on how windows overlap, or on duplicates. Leaving constraints
out of account (two poses of one mount that are not neighbours on the path) only adds paths.
Cameras and arcs whose best path stays below the incumbent cannot be part of a better placement;
that is a fact about placements, so what different θ and y rule out adds up.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from models.geometry import BoolArray, FloatArray, IntArray
from placement.bounds.restrict import restricted_information
from placement.objectives.entropy import Entropy
from placement.objectives.navigation_chain import Drive
from placement.problem import Run
from placement.tempered import paths
from placement.tempered.background import Background, constant_of, process_of
from placement.tempered.gains import add_pair_gains, add_triple_gains, fill_pair_gains
from placement.tempered.line import Line, arcs_out
from placement.tempered.pieces import extra_of, own_stretch, pieces_of
from placement.tempered.process import Cameras, Process, cameras_of

ROWS = 128  # of gains between two looks at the clock
TRIPLES = 500_000  # the same
ARC_WORK = 50  # gains that take as long as one arc
TRIPLE_S = 6e-5  # seconds for three windows that meet, with offsets
MOST_PAIRS = 5e8  # bytes of a table of first-order gains; a line longer than 11,000 needs sieves
TRIPLE_SHARE = 0.15  # of the time left that those may take


class OnDrive(NamedTuple):
    """One drive of a tempered bound: its weight, the chain, and what the line's cameras see.

    `narrow` are the cameras that others are conditioned on, with one piece of what some see
    (`placement.tempered.pieces`); `rows` and `all_rows` (n, ROW) are the cameras' own stretches, of
    the narrow and all, `piece` and `alone` (n,) their gains given nobody, `extra` (n,) the rest.
    """

    weight: float
    process: Process
    narrow: Cameras
    rows: FloatArray
    piece: FloatArray
    extra: FloatArray
    cameras: Cameras
    all_rows: FloatArray
    alone: FloatArray


@dataclass(slots=True)
class Tempered:
    """The bound for one background a drive and one share, over a line of candidates."""

    objective: Entropy
    line: Line
    budget: int
    theta: float
    background: Sequence[Background]
    run: Run
    alone: FloatArray = field(init=False)
    _pairs: NDArray[np.float32] | None = field(init=False, default=None)
    _tables: tuple[FloatArray, FloatArray] | None = field(init=False, default=None)
    constant: float = field(init=False)
    drives: list[OnDrive] = field(init=False)

    def __post_init__(self) -> None:
        """Lay out the drives, and what each camera gains by itself."""
        self.drives = [
            on_drive(drive, self.line.candidate, base, self.theta)
            for drive, base in zip(self.objective.drives, self.background, strict=True)
        ]
        self.alone = np.zeros(self.line.candidate.size)
        for d in self.drives:
            self.alone += d.weight * d.alone
        self.constant = constant_of(self.objective, self.background, self.theta)
        self.alone = self.alone * (1.0 + 1e-9) + 1e-9 * (self.alone > 0.0)
        self.alone[~self.line.may_start] = -np.inf

    @property
    def pairs(self) -> NDArray[np.float32]:
        """Return all gains to first order (n, n); −∞ where there is no arc."""
        if self._pairs is None:
            n, alive = self.line.candidate.size, self.line.alive
            pairs = np.zeros((n, n), dtype=np.float32)
            for d in self.drives:
                for begin in range(0, n, ROWS):
                    paths.stop_in_time(self.run)
                    add_pair_gains(
                        d.process, d.narrow, d.rows, d.piece, d.extra, alive, d.weight,
                        begin, min(begin + ROWS, n), pairs,
                    )  # fmt: skip
            self._pairs = pairs
        return self._pairs

    @property
    def tables(self) -> tuple[FloatArray, FloatArray]:
        """Return the tables F and B (k, n) of best paths (`placement.tempered.paths.tables`)."""
        if self._tables is None:
            k = max(self.budget, 1)
            self._tables = paths.tables(self.pairs, self.alone, self.ends, k, self.run)
        return self._tables

    @property
    def F(self) -> FloatArray:  # noqa: N802
        """Return the best path of l + 1 cameras that ends with each, (k, n)."""
        return self.tables[0]

    @property
    def B(self) -> FloatArray:  # noqa: N802
        """Return the most that at most r further cameras add to each, (k, n)."""
        return self.tables[1]

    def bounds(self) -> FloatArray:
        """Return the bound for every budget 0 … k, (k + 1,); −∞ where there is no placement."""
        none = 0.0 if not self.line.required.any() else -np.inf
        best = np.max(self.F + self.ends, axis=1, initial=-np.inf)
        return self.as_bound(np.maximum.accumulate(np.concatenate([[none], best])))

    def bound(self) -> float:
        """Return an upper bound on the score of every placement of the line."""
        return float(self.bounds()[self.budget])

    def bound_of_one(self) -> float:
        """Return an upper bound on the score of every placement of at most one camera."""
        none = 0.0 if not self.line.required.any() else -np.inf
        best = np.maximum(none, np.max(self.alone + self.ends, initial=-np.inf))
        return float(self.as_bound(np.array([best]))[0])

    def as_bound(self, gain: FloatArray) -> FloatArray:
        """Turn bounds on g into bounds on f."""
        bounds: FloatArray = (self.constant + gain + 1e-12 * np.maximum(gain, 0.0)) / self.theta
        return bounds

    def threshold(self, beat: float) -> float:
        """Return the g that a path must reach to stand for a score of `beat`."""
        return beat * self.theta - self.constant - 1e-9 * abs(beat)

    def path(self) -> IntArray:
        """Return the candidates of a best path."""
        return self.line.candidate[paths.trace_path(self.pairs, self.F, self.ends)]

    def survivors(self, beat: float) -> Line:
        """Return the line without the candidates and arcs that no placement above `beat` uses."""
        least = self.threshold(beat)
        keep = np.flatnonzero((paths.best_through(self.F, self.B) >= least) | self.line.required)
        rows = np.ix_(keep, keep)
        F, B = np.ascontiguousarray(self.F[:, keep]), np.ascontiguousarray(self.B[:, keep])
        alive = paths.arcs_above(np.ascontiguousarray(self.pairs[rows]), F, B, least)
        line = self.line.subset(keep)
        return replace(line, arcs=arcs_out(keep.size, *np.nonzero(alive)))

    @property
    def ends(self) -> FloatArray:
        """Return 0 for each position (n,) where a path may end, −∞ where not."""
        return self.line.ends


def room_for_pairs(n: int) -> bool:
    """Say whether there is room for a table of the gains of n cameras given another."""
    return 4.0 * n * n <= MOST_PAIRS


class SecondOrder:
    """The second order over the arcs of a line that are alive."""

    def __init__(self, first: Tempered, beat: float) -> None:
        """Compute the gains given two, and the tables of best paths over arcs; budget ≥ 2.

        Pairs of arcs that to first order are part of no placement above `beat` are left out.
        """
        self.first = first
        line, run = first.line, first.run
        self.arcs = arcs = paths.lay_out(line)
        self.gains = np.zeros(int(arcs.triple[-1]), dtype=np.float32)
        layout = (arcs.into, arcs.source, arcs.out, arcs.out_of, arcs.target, arcs.triple)
        least = first.threshold(beat)
        paths.mark_hopeless(*layout, first.pairs, first.F, first.B, least, self.gains)
        # three windows that meet are filtered whole where that is cheap: always without offsets
        meeting = sum(triples_that_meet(arcs, d.narrow) for d in first.drives)
        meeting *= float(np.mean(self.gains > -np.inf)) if self.gains.size else 0.0
        white = all(d.cameras.offsets.shape[2] == 0 for d in first.drives)
        self.exact = white or TRIPLE_S * meeting < TRIPLE_SHARE * min(run.remaining(), 1e3)
        target = arcs.target[arcs.out]
        # an arc is filtered once, which takes as long as some dozens of gains
        work = np.cumsum(np.diff(arcs.into) * (np.diff(arcs.out_of) + ARC_WORK))
        at_a_time = TRIPLES if white or not self.exact else TRIPLES // 20
        n = line.candidate.size
        # the tables pass twice over all pairs of arcs for each camera, some nanoseconds a pair
        reserve_s = 1.0 + 6e-9 * first.budget * float(arcs.triple[-1])
        begin = 0
        while begin < n and run.remaining() > reserve_s:
            done = work[begin - 1] if begin else 0
            end = int(np.searchsorted(work, done + at_a_time, side="right"))
            end = min(max(end, begin + 1), n)
            for d in first.drives:
                add_triple_gains(
                    d.process,
                    d.narrow,
                    d.rows,
                    d.piece,
                    d.extra,
                    self.exact,
                    d.weight,
                    arcs.into,
                    arcs.source,
                    arcs.out_of,
                    target,
                    arcs.triple,
                    np.arange(begin, end),
                    self.gains,
                )
            begin = end
        # where time ran short, conditioning on one camera is as valid as on two
        self.complete = begin == n
        fill_pair_gains(arcs.into, arcs.out_of, target, arcs.triple, first.pairs, begin, self.gains)
        self.ends = first.ends
        self.start = first.alone[arcs.source] + first.pairs[arcs.source, arcs.target]
        self.F, self.B = paths.arc_tables(
            arcs, self.gains, self.start, self.ends, first.budget, run
        )

    def bound(self) -> float:
        """Return an upper bound on the score of every placement of the line."""
        line = self.first.line
        few = 0.0 if not line.required.any() else -np.inf
        one = float(np.max(self.first.alone + self.ends, initial=-np.inf))
        more = float(np.max(self.F + self.ends[self.arcs.target], initial=-np.inf))
        return float(self.first.as_bound(np.array([np.max([few, one, more])]))[0])

    def begin(self) -> IntArray:
        """Return the states that arcs (m,) lead to from the start of a path: themselves."""
        return np.arange(len(self.arcs.source))

    def follow(self, camera: int, _state: int) -> tuple[IntArray, BoolArray]:
        """Return the arcs out of a camera, and that all of them may be followed."""
        found = self.arcs.out[self.arcs.out_of[camera] : self.arcs.out_of[camera + 1]]
        return found, np.ones(len(found), dtype=np.bool_)

    def after(self, further: int, reached: IntArray) -> FloatArray:
        """Return what at most `further` cameras can add behind each of the arcs `reached`."""
        found: FloatArray = self.B[further][reached]
        return found

    def path(self) -> IntArray:
        """Return the candidates of a best path."""
        found = paths.trace_arcs(self.arcs, self.gains, self.F, self.ends)
        return self.first.line.candidate[found]

    def survivors(self, beat: float) -> Line:
        """Return the line without the candidates and arcs that no placement above `beat` uses."""
        line = self.first.line
        good = paths.best_through(self.F, self.B) >= self.first.threshold(beat)
        single = self.first.alone + self.ends >= self.first.threshold(beat)
        return line.over_arcs(self.arcs.source[good], self.arcs.target[good], single)


def triples_that_meet(arcs: paths.Arcs, cameras: Cameras) -> float:
    """Count the pairs of arcs h → j → k where h sees what j or k sees, or some before it."""
    found = 0
    for j in range(len(arcs.into) - 1):
        before = np.sort(cameras.last[arcs.source[arcs.into[j] : arcs.into[j + 1]]])
        following = arcs.target[arcs.out[arcs.out_of[j] : arcs.out_of[j + 1]]]
        begins = np.minimum(cameras.first[following], cameras.first[j])
        found += int(np.sum(before.size - np.searchsorted(before, begins)))
    return float(found)


def on_drive(drive: Drive, candidates: IntArray, base: Background, theta: float) -> OnDrive:
    """Lay out `candidates` of one drive with a share 1 − `theta` of the background `base` taken in.

    Each counts with a share `theta` of its information.
    """
    process = process_of(drive, base, theta)
    over = replace(drive, information=restricted_information(drive.information, candidates))
    cameras = cameras_of(over, theta)
    all_rows, by_itself = own_stretch(process, cameras)
    cut, whole = pieces_of(over)
    narrow, rows, piece = cameras, all_rows, by_itself
    if not whole.all():
        narrow = cameras_of(cut, theta)
        rows, piece = own_stretch(process, narrow)
    extra = extra_of(by_itself, piece, whole)
    return OnDrive(drive.weight, process, narrow, rows, piece, extra, cameras, all_rows, by_itself)
