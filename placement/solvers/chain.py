"""The chain bound, and the search it makes possible: `localisation` along one road.

1. Pairwise gains and the first-order bound for every budget in one dynamic program. Its best
   path is a placement; on weakly coupled roads it *is* the optimum.
2. The incumbent is improved stretch by stretch, each stretch solved nearly exactly.
3. Bounds to first and second order, the latter at the price a camera that makes it least, in
   several orders of the candidates; each leaves out what cannot be part of anything better.
4. Labels: partial placements with exact scores, wider and wider, until none is given up.

The method works for any `localisation` problem (the bound is valid in whatever order candidates
come) and is strong where windows are short compared with the path.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field

import numpy as np

from models.geometry import FloatArray, IntArray
from placement.chain import backtracking, second_order
from placement.chain.labels import MOST_LABELS
from placement.chain.segments import improve_by_stretches
from placement.chain.stages import (
    OutOfTimeError,
    Stage,
    eliminated,
    first_path,
    first_stage,
    label_pass,
    marginal_price,
    priced,
)
from placement.chain.windows import Windows, ordered_windows, reordered
from placement.objectives.localisation import Localisation
from placement.problem import Problem, Run
from placement.solution import Proposal, Status
from placement.solvers.exchange import polish
from placement.solvers.greedy import climb

# As near as this (relative) is proven: a tenth of what the verb calls optimal.
TOLERANCE = 1e-7
WIDTHS = (10, 100, 1_000, 10_000, 100_000)
STRETCHES = (10, 16)
# Weights of the windows' centres, by which candidates are ordered: see `windows.reordered`.
# The first order is bounded by power 1, its best; these are for the second.
POWERS = (0.3, 0.6, 0.15, 0.45)
FIRST_SPREAD, NEXT_SPREAD = (0.7, 1.05), (0.96, 1.04)  # where to look for the best price
PRICE_WIDTH = 0.02  # and how finely
STEP_S = 2e-6  # a guess at the seconds an arc takes in one sweep, until it is measured
PRICE_SHARES = (1.0, 0.97, 0.93, 1.03)
MOST_PAIRS = 60_000_000  # a gigabyte of arcs: beyond it only greedy's bound is given
LEAVE_TIME_S = 0.3
FIRST_RATE = 200_000.0  # labels a second, before it is measured; most machines do more


def solve_chain(problem: Problem, run: Run) -> Proposal:
    """Bound, eliminate and search along the path until proven or out of time.

    Raises:
        ValueError: for an objective other than `localisation`.
    """
    if not isinstance(problem.objective, Localisation):
        raise ValueError(
            f"method chain needs the objective localisation, got {problem.objective.name}"
        )
    search = ChainSearch(problem, problem.objective, run)
    try:
        finished = search.run_stages()
    except OutOfTimeError:
        finished = False
    return Proposal(
        search.incumbent,
        run.score_bound,
        Status.FEASIBLE if finished else Status.TIME_LIMIT,
        search.stats,
    )


@dataclass(slots=True)
class ChainSearch:
    """The state of one search: the incumbent, the bound, and how the bound came about."""

    problem: Problem
    objective: Localisation
    run: Run
    incumbent: list[int] = field(default_factory=list)
    score: float = -np.inf
    stats: dict[str, object] = field(default_factory=dict)
    allowance: float = 0.0  # rounding in the chain's sums, nats
    _budget: int = 0  # for candidates that see anything
    _left_out: bool = False  # whether candidates were left out since they fall short
    _step_s: float = 0.0  # how long the last uninterruptible step took, now that there is less left

    def run_stages(self) -> bool:
        """Go through the stages; return False if time ran out first."""
        state, _, _ = climb(self.problem, self.run)
        polish(self.problem, self.run, state)
        self._offer(np.array(state.selected, dtype=np.int64))
        self.stats["bound_from"] = "diminishing returns"
        if self._proven() or self._out_of_time():
            return self._proven()
        windows = ordered_windows(self.objective, self.problem.constraints)
        self._budget = self.problem.constraints.budget - self._deaf_required()
        budget = min(self._budget, len(windows))
        if not self._affordable(windows, budget):
            self.stats["chain"] = "too many overlapping pairs"
            return True
        self.allowance = _allowance(windows, budget)
        self.run.progress("chain bound, first order", None)
        stage = first_stage(windows, budget, self._out_of_time)
        self._publish(stage.bound, "chain, first order")
        self.stats["first_order_bound"] = stage.bound
        self._offer(windows.candidate[first_path(stage)], polishing=True)
        if self._proven() or self._out_of_time():
            return self._proven()
        return self._orders(windows, stage)

    def _orders(self, windows: Windows, stage: Stage) -> bool:
        """Bound in one order after another, leaving out candidates for good; then search.

        That no better placement holds a candidate is true whatever order proved it, so each order
        starts from what the last one left.
        """
        # A third of the time at most for the placement: the rest is for the bound.
        rest = 0.67 * self.run.remaining()
        for cameras in STRETCHES:
            self._improve(windows, cameras, rest if np.isfinite(rest) else 0.0)
        price = marginal_price(stage)
        left = self._eliminated(stage).windows
        best: tuple[float, float] = (np.inf, POWERS[0])
        for power in POWERS:
            before = len(left)
            left, price, bound = self._bound_in_order(left, power, price)
            best = min(best, (bound, power))
            if self._proven() or self._out_of_time():
                return self._proven()
            if len(left) > 0.8 * before:  # labels prove more in the same time
                break
        self.stats["candidates_left"] = len(left)
        left, _ = reordered(left, best[1])
        count = min(self._budget, len(left))
        stage = self._eliminated(first_stage(left, count, self._out_of_time))
        for _ in range(3):
            before = len(stage.arcs)
            stage = self._priced(stage, price)
            if self._proven() or self._out_of_time():
                return self._proven()
            if len(stage.arcs) > 0.7 * before:
                break
        self.stats["arcs_left"] = len(stage.arcs)
        return self._labels(stage)

    def _bound_in_order(
        self, windows: Windows, power: float, price: float
    ) -> tuple[Windows, float, float]:
        """Bound to first and second order; return what is left, the best price, the bound."""
        windows, _ = reordered(windows, power)
        stage = first_stage(windows, min(self._budget, len(windows)), self._out_of_time)
        self._publish(stage.bound, f"chain, first order, power {power}")
        stage = self._eliminated(stage)
        # The first order's price is a rough guess, another order's a good one.
        spread = FIRST_SPREAD if power == POWERS[0] else NEXT_SPREAD
        price = self._best_price(stage, price, spread)
        stage = self._priced(stage, price)
        return stage.windows, price, stage.bound

    def _priced(self, stage: Stage, price: float) -> Stage:
        """Bound at prices about `price`, and leave out what that refutes."""
        # Each price takes two sweeps; where there is no time for all of them, take the first.
        shares = PRICE_SHARES if self.run.remaining() > 10.0 * self._step_s else PRICE_SHARES[:1]
        if self._out_of_time(3.0 * self._step_s):
            return stage
        began = time.monotonic()
        stage = priced(stage, [price * share for share in shares])
        self._step_s = (time.monotonic() - began) / (2.0 * len(shares))
        self._publish(stage.bound, "chain, second order")
        return self._eliminated(stage)

    def _labels(self, stage: Stage) -> bool:
        """Search by labels, each pass wider than the last, until none is given up."""
        rate = FIRST_RATE
        for width in WIDTHS:
            if self._out_of_time():
                return False
            # A pass cannot be interrupted, only kept small: so many labels as there is time for,
            # a third of them lost to starting again with more room.
            time_s = max(0.0, self.run.remaining() - LEAVE_TIME_S)
            most = int(min(MOST_LABELS, 0.6 * rate * time_s)) + 1
            began = time.monotonic()
            self.run.progress(f"labels, {width} a camera", None)
            found = label_pass(stage, self._beat(), TOLERANCE * self.score, width, most)
            self.stats["labels"] = found.labels
            if found.labels > 10_000:
                rate = found.labels / (time.monotonic() - began)
            left = max(found.given_up, self._beat())
            if stage.windows.wraps:
                left = max(left, found.score)
            self._publish(left, f"chain, labels of width {width}")
            if found.path.size:
                self._offer(stage.windows.candidate[found.path], polishing=True)
            if not np.isfinite(found.given_up):
                return most > MOST_LABELS  # out of memory, or else out of time
            if self._proven():
                break
            if found.given_up <= self._beat():
                break  # what is unproven lies in the cut of a closed path, not in the width
            stage = self._eliminated(stage)
        return True

    def _best_price(self, stage: Stage, guess: float, spread: tuple[float, float]) -> float:
        """Find the price of least second-order bound by golden section.

        The bound is convex in the price. Every bound on the way is published, every path offered.
        """
        price, low, high = guess, spread[0] * guess, spread[1] * guess
        if not self._step_s:
            self._step_s = STEP_S * len(stage.arcs)
        if self._short():
            return price
        ratio = (np.sqrt(5.0) - 1.0) / 2.0
        seen: dict[float, float] = {}

        def bound_at(value: float) -> float:
            if value not in seen:
                began = time.monotonic()
                best, start, arc = second_order.forward_best(stage.windows, stage.arcs, value)
                self._step_s = time.monotonic() - began
                seen[value] = best + stage.budget * value
                if seen[value] <= min(seen.values()):
                    self._publish(seen[value], "chain, second order")
                    path = backtracking.decode(stage.windows, stage.arcs, start, arc)
                    self._offer(stage.windows.candidate[path], polishing=True)
            return seen[value]

        bound_at(price)
        while not (self._proven() or self._short()) and high - low > PRICE_WIDTH * price:
            one, two = high - ratio * (high - low), low + ratio * (high - low)
            if bound_at(one) <= bound_at(two):
                high = two
            else:
                low = one
        return min(seen, key=lambda value: seen[value])

    def _improve(self, windows: Windows, cameras: int, leave_s: float) -> None:
        """Sweep over stretches until a sweep changes nothing, or `leave_s` seconds are left."""

        def stop() -> bool:
            return self._out_of_time(leave_s)

        node_of = np.full(self.objective.n_candidates, -1, dtype=np.int64)
        node_of[windows.candidate] = np.arange(len(windows))

        def evaluate(nodes: IntArray) -> float:
            return self.objective.value(windows.candidate[nodes])

        def base_of(nodes: IntArray) -> FloatArray:
            x = np.zeros(self.objective.n_candidates)
            x[windows.candidate[nodes]] = 1.0
            sums = self.objective.scale * self.objective.sums(x)
            return np.ascontiguousarray(sums[windows.sample])

        while not (stop() or self._proven()):
            before = self.score
            nodes = node_of[np.array(self.incumbent, dtype=np.int64)]
            deaf = [i for i, node in zip(self.incumbent, nodes, strict=True) if node < 0]
            better = improve_by_stretches(
                windows, nodes[nodes >= 0], evaluate, base_of, cameras, stop
            )
            self._offer(
                np.concatenate([windows.candidate[better], np.array(deaf, dtype=np.int64)]),
                polishing=True,
            )
            self.run.progress(f"stretches of {cameras} cameras, score {self.score:.6g}", None)
            if self.score <= before * (1.0 + 1e-9):
                return

    def _offer(self, selected: IntArray, *, polishing: bool = False) -> None:
        """Take a path as a placement: one of each group, required ones in, filled up by swaps."""
        constraints = self.problem.constraints
        required = np.unique(constraints.required)
        chosen = np.concatenate([required, np.setdiff1d(selected, required)])
        group = constraints.group[chosen]
        key = np.where(group < 0, constraints.n + np.arange(chosen.size), group)
        _, first = np.unique(key, return_index=True)
        chosen = chosen[np.sort(first)][: constraints.budget]
        if polishing and not self._out_of_time():
            state = self.objective.state(chosen)
            if state.score > 0.9 * self.score:  # swaps would take long, and not get there
                kept = self.run.incumbent
                polish(self.problem, self.run, state)
                self.run.incumbent = kept
                chosen = np.array(state.selected, dtype=np.int64)
        if constraints.violations(chosen):
            return
        score = self.objective.value(chosen)
        if score > self.score:
            self.score, self.incumbent = score, [int(i) for i in np.sort(chosen)]
            self.run.incumbent = self.incumbent

    def _publish(self, bound: float, source: str) -> None:
        """Keep a valid bound if it is the best, with what rounding may have cost it."""
        # Where candidates were left out, placements of at most `_beat` may be among what is gone.
        raised = bound + self.allowance
        if self._left_out:
            raised = max(raised, self.score * (1.0 + 0.5 * TOLERANCE))
        if self.run.score_bound is None or raised < self.run.score_bound:
            self.run.score_bound = raised
            self.stats["bound_from"] = source
        gap = self.run.score_bound / self.score - 1.0 if self.score > 0.0 else 0.0
        self.run.progress(f"score {self.score:.6g}, gap {100.0 * max(gap, 0.0):.3g} %", None)

    def _beat(self) -> float:
        """Return the score a placement must exceed to matter, less what rounding may hide."""
        return self.score * (1.0 + 0.5 * TOLERANCE) - self.allowance

    def _proven(self) -> bool:
        bound = self.run.score_bound
        return bound is not None and bound <= self.score * (1.0 + TOLERANCE)

    def _deaf_required(self) -> int:
        """Count the required candidates that see nothing: they use budget, but no path."""
        required = np.unique(self.problem.constraints.required)
        return int(np.sum(np.diff(self.objective.indptr)[required] == 0))

    def _affordable(self, windows: Windows, budget: int) -> bool:
        spans = np.searchsorted(np.sort(windows.first), windows.last, side="right")
        before = np.searchsorted(np.sort(windows.last), windows.first)
        pairs = int(np.sum(spans - before)) // 2
        self.stats["pairs"] = pairs
        return pairs <= MOST_PAIRS and len(windows) * budget <= MOST_PAIRS

    def _eliminated(self, stage: Stage) -> Stage:
        """Leave out what cannot beat the incumbent."""
        self._left_out = True
        return eliminated(stage, self._beat())

    def _short(self) -> bool:
        """Return whether another sweep at a new price, and those that must follow, may not fit."""
        return self._out_of_time(4.0 * self._step_s)

    def _out_of_time(self, needed_s: float = 0.0) -> bool:
        return self.run.remaining() <= LEAVE_TIME_S + needed_s


def _allowance(windows: Windows, budget: int) -> float:
    """Bound the rounding error of a whole path: its largest gains' errors, and their sum's."""
    if not budget or not len(windows):
        return 0.0
    largest = np.partition(windows.slack, len(windows) - budget)[len(windows) - budget :]
    total = np.partition(windows.alone, len(windows) - budget)[len(windows) - budget :].sum()
    # Three orders' worth of errors in each gain, and one rounding for each addition.
    return float(4.0 * largest.sum() + 4.0 * budget * np.finfo(np.float64).eps * total)
