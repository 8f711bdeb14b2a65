"""Prove placements for `entropy` on a road: relaxation, chains, diagrams, best-first search.

Swaps and rearranged stretches give a placement. The concave relaxation gives a first bound and its
optimum y, at once. The tempered chain (`placement.tempered.bound`) then bounds, with y as its
background, what cameras between y and themselves can add; candidates and arcs that cannot beat the
placement are left out, which lets the next share θ, then the diagram, whose gains are given all
that came before (`placement.tempered.diagram`), then the second order bound more sharply; and the
best paths, polished by swaps, better the placement. What remains is searched best first.

Cameras with persistent offsets have a white background, of cameras that stand in for them
(`placement.tempered.background`), and a dear and weak relaxation: it has a tenth of the time unless
it comes near. Where it comes very near it is branched on. `stats["bounds"]` tells what each stage
has proven.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numba import get_num_threads

from models.geometry import FloatArray, IntArray
from placement.bounds.concave import best_fraction
from placement.bounds.concave_tree import split_until
from placement.objectives.base import State
from placement.objectives.entropy import Entropy
from placement.problem import Problem, Run
from placement.sieve.sieve import Sieve, losses_of
from placement.solution import Proposal, Status
from placement.solvers.crossing import breed, meet
from placement.solvers.exchange import polish
from placement.solvers.greedy import best_addition, climb
from placement.solvers.search import rearrange
from placement.tempered.background import background_of, stand_in
from placement.tempered.bound import Line, SecondOrder, Tempered, make_line
from placement.tempered.diagram import Diagram
from placement.tempered.dominance import undominated
from placement.tempered.paths import OutOfTimeError
from placement.tempered.search import search
from placement.tempered.shares import better_share

# Shares tried on a thinned line, to choose that of the first pass over all candidates.
SHARES = (1.0, 0.95, 0.9, 0.8, 0.7, 0.6, 0.5, 0.35)
THINNED = 600  # candidates of a thinned line
FIRST_ORDER_PASSES = 5
SECOND_ORDER_PASSES = 8
SIEVE_PASSES = 6
MOST_LOSSES = 1_200_000_000  # of two bytes
LOSS_S = 1.8e-7  # processor seconds for each
SIEVE_SHARE = 0.8  # of the time left, that a pass may take
LABEL_PASSES = 12
MOST_GAINS = 20_000_000  # gains of a diagram: with its tables, some 200 MB
NARROW, WIDE = 4, 48  # labels a camera
GAIN_S = 1.5e-6  # seconds for each
KICK_SHARE = 0.05  # of the time left, for rearranging the first placement
PATH_SHARE = 0.03  # and for polishing a path
TURN_SHARE = 0.25  # of the time left at the end, for rearranging, then for crossing, in turns
SHARE_SEARCH = 0.3  # of the time left, for shares that bound the whole line better
WORTH_IT = 0.8  # go on while a pass leaves fewer than this share of the arcs
PERSISTENT_SHARES = (1.0, 0.98, 0.95, 0.9, 0.8, 0.6, 0.4)  # with persistent errors
RELAXED_SHARE = 0.05  # of the time left, for the relaxation of persistent errors
LONGER_SHARE = 0.6  # the same once it bounds within PROMISING of the score
PROMISING = 0.02
SPLIT_WITHIN = 0.005  # of the score: a relaxation as near as this is branched on,
SPLIT_SHARE = 0.8  # for this share of the time left: chains come nowhere near it
MOST_PAIRS = 5e8  # bytes of first-order gains; a line longer than 11,000 is not bounded by chains
MOST_TRIPLES = 250_000_000  # second-order gains held at one time: 1 GB
DONE = 1e-7  # relative gap that counts as closed: a tenth of what `optimal` asks for
LEAVE_TIME_S = 0.3


def solve_tempered(problem: Problem, run: Run) -> Proposal:
    """Find a placement by swaps and prove how good it is; stop at a gap of 1e-7 or out of time.

    Raises:
        ValueError: for an objective other than `entropy`.
    """
    if not isinstance(problem.objective, Entropy):
        raise ValueError(
            f"method tempered needs the objective entropy, got {problem.objective.name}"
        )
    proof = Proof(problem, problem.objective, run)
    try:
        finished = proof.work()
    except OutOfTimeError:
        finished = False
    return Proposal(
        proof.selected,
        run.score_bound,
        Status.FEASIBLE if finished else Status.TIME_LIMIT,
        proof.stats,
    )


@dataclass(slots=True)
class Proof:
    """The incumbent, the best bound and what each stage has proven."""

    problem: Problem
    objective: Entropy
    run: Run
    selected: list[int] = field(default_factory=list)
    score: float = -np.inf
    stats: dict[str, Any] = field(default_factory=dict)
    inner: Run = field(init=False)
    background: list[FloatArray] = field(init=False)
    # by share: candidates, a price, and what may come beyond each of them
    _beyond: dict[float, tuple[IntArray, float, FloatArray | None]] = field(default_factory=dict)
    _whole: Tempered | None = None  # the last first order over more arcs than there is room for

    def work(self) -> bool:
        """Go through the stages; return whether there is nothing left that time could improve."""
        run = self.run
        self.inner = Run(run.rng, deadline=run.deadline - LEAVE_TIME_S)
        state, _, _ = climb(self.problem, run)
        polish(self.problem, run, state)
        self._rearrange(state, KICK_SHARE)
        self.stats["bounds"] = {}
        self._offer(np.array(state.selected, dtype=np.int64))
        self._bounded("greedy", np.inf if run.score_bound is None else run.score_bound)
        line = self._relax()
        if self._closed() or self.problem.constraints.budget == 0:
            return True
        if line is None:
            return not run.out_of_time()
        line = self._first_order(line, SHARES if self.white else PERSISTENT_SHARES)
        if self._closed() or self.problem.constraints.budget < 2:
            return True
        line = self._sieve(line)
        if self._closed():
            return True
        line = self._diagrams(line)
        if self._closed():
            return True
        finished = self._second_order(line)
        if not finished:
            self._use_what_is_left()
        return finished

    def _rearrange(self, state: State, share: float) -> None:
        """Move cameras of one stretch together, for a share of the time (see `solvers.search`)."""
        rearrange(self.problem, self._for_a_share(share), state)

    def _for_a_share(self, share: float) -> Run:
        """Return a run of its own for a share of the time left."""
        limit = time.monotonic() + share * min(self.inner.remaining(), 1e3)
        return Run(self.run.rng, min(limit, self.inner.deadline), self.run.progress)

    def _relax(self) -> Line | None:
        """Bound by the concave relaxation; return who is left, None where chains cannot go."""
        constraints = self.problem.constraints
        choice = undominated(self.objective, constraints)
        self.run.progress("solving the concave relaxation", None)
        relaxation = self.inner
        longer = self._for_a_share(LONGER_SHARE).deadline
        if not self.white:
            relaxation = self._for_a_share(RELAXED_SHARE)

        def report(bound: float) -> None:
            self._bounded("relaxation", bound)
            if bound - self.score < PROMISING * self.score:
                relaxation.deadline = max(relaxation.deadline, longer)

        found = best_fraction(
            self.objective,
            choice,
            relaxation,
            beat=self.score,
            start=np.array(self.selected, dtype=np.int64),
            report=report,
        )
        if not self.white and found.bound - self.score < SPLIT_WITHIN * self.score:
            self.stats["relaxation_nodes"] = split_until(
                self.objective,
                choice,
                found.x,
                self._for_a_share(SPLIT_SHARE),
                beat=self.score,
                report=lambda bound: self._bounded("relaxation, branched", bound),
                offer=self._offer,
            )
        left = np.flatnonzero(found.choice.allowed)
        self.stats["candidates_after_relaxation"] = int(left.size)
        if 4.0 * left.size**2 > MOST_PAIRS:
            return None
        white, y = stand_in(self.objective), found.x
        if white is not self.objective:
            y = best_fraction(white, choice, self.inner, tolerance=1e-3).x
        self.background = background_of(white, y)
        return make_line(self.objective, constraints, left)

    def _use_what_is_left(self) -> None:
        """Rearrange the placement and cross it with others, while that helps and there is time."""
        state, before = self.objective.state(np.array(self.selected, dtype=np.int64)), -np.inf
        while state.score > before and not self.inner.out_of_time():
            before = state.score
            self._rearrange(state, TURN_SHARE)
            breed(self.problem, self._for_a_share(TURN_SHARE), state)
        self._offer(np.array(state.selected, dtype=np.int64))

    @property
    def white(self) -> bool:
        """Whether no camera's errors persist."""
        return not any(drive.persistent for drive in self.objective.drives)

    @property
    def _sieves(self) -> bool:
        """Whether there is a single drive, as a sieve wants it."""
        return len(self.objective.drives) == 1

    def _first_order(self, line: Line, shares: tuple[float, ...]) -> Line:
        """Bound by first-order chains at the shares that bound best, and thin out the line."""
        share, seconds = self._best_share(line, shares)
        if self._sieves:
            share = (1.0 + share) / 2  # what suits the sieve, which has the last word, is nearer 1
        for _ in range(FIRST_ORDER_PASSES):
            n = line.candidate.size
            if n < 2 or 0.25 * seconds * n * n > self.inner.remaining():
                break
            before = int(line.alive.sum())
            started = time.monotonic()
            bound = self._chain(line, share)
            if self._closed():
                return line
            line = bound.survivors(self.score)
            if time.monotonic() - started < 1.0:
                break
            if self._sieves and self._triples(line) > MOST_TRIPLES:
                self._whole = bound
                break
            if line.alive.sum() > WORTH_IT * before:
                share, line = self._nearer_share(line, share, bound.bound())
                break
            near = [s for s in (share - 0.05, share, share + 0.05, (1.0 + share) / 2) if s <= 1.0]
            share, _ = self._best_share(line, tuple(near))
        self._left(line)
        self.stats["share"] = share
        return line

    def _chain(self, line: Line, share: float) -> Tempered:
        """Bound a line to first order, and try its best path."""
        bound = self._tempered(line, share)
        self._bounded(f"tempered chain, first order, share {share:g}", bound.bound())
        self._try_path(bound.path())
        return bound

    def _nearer_share(self, line: Line, share: float, bound: float) -> tuple[float, Line]:
        """Try shares on the whole line: what suits a thinned one is nearer to 1.

        Return the best, and who is left after all that were tried.
        """
        until = time.monotonic() + SHARE_SEARCH * min(self.inner.remaining(), 1e3)
        took = 0.0

        def evaluate(other: float) -> float:
            nonlocal line, took
            started = time.monotonic()
            chain = self._chain(line, other)
            line = chain.survivors(self.score)
            took = time.monotonic() - started
            return chain.bound()

        def may_go_on() -> bool:
            return not self._closed() and time.monotonic() + took < until

        return better_share(share, bound, evaluate, may_go_on), line

    def _sieve(self, line: Line) -> Line:
        """Bound by second-order chains over classes, and thin out the line.

        Where so many arcs are left that the second order has no room for their pairs.
        """
        share = float(self.stats.get("share", 1.0))
        known, best = self._whole, np.inf
        for _ in range(SIEVE_PASSES if self._sieves else 0):
            if self._triples(line) <= MOST_TRIPLES:
                break
            if known is not None and known.theta == share and known.covers(line):
                first = known.over(line)
            else:
                first = self._tempered(line, share)
            self._whole = known = None
            many = losses_of(first)
            seconds = LOSS_S * many / get_num_threads()
            if many > MOST_LOSSES or seconds > SIEVE_SHARE * self.inner.remaining():
                break
            self.run.progress(f"{many} losses by class, share {share:.4g}", None)
            sieve = Sieve(first, self.score)
            bound = sieve.bound()
            self._bounded(f"tempered chain, classes, share {share:.4g}", bound)
            self._try_path(sieve.path())
            self._beyond[share] = line.candidate, sieve.price, sieve.beyond
            line = sieve.survivors(self.score)
            self._left(line)
            if self._closed() or line.candidate.size == 0 or bound >= best:
                break
            best, self.stats["share"] = bound, share
            share = (1.0 + share) / 2
        return line

    def _diagrams(self, line: Line) -> Line:
        """Bound by gains given all that came before, and thin out the line."""
        low = float(self.stats.get("share", 1.0))
        shares = sorted({low, (low + 1.0) / 2})
        known = self._beyond
        stuck = 0
        for number in range(LABEL_PASSES):
            before = int(line.alive.sum())
            most = min(MOST_GAINS, 0.25 * self.inner.remaining() / GAIN_S)
            width = min(WIDE, int(most / max(before, 1)) - 1)
            if width < NARROW or stuck == len(shares):
                break
            share = shares[number % len(shares)]
            seen, price, beyond = known.get(share, (line.candidate, -1.0, None))
            if beyond is not None:
                beyond = beyond[np.isin(seen, line.candidate)]
            first = self._tempered(line, share)
            diagram = Diagram(first, width, self.score, price=price, beyond=beyond)
            known[share] = line.candidate, diagram.price, diagram.beyond
            self._bounded(f"tempered diagram, share {share:g}", diagram.bound())
            self._try_path(diagram.path())
            line = diagram.survivors(self.score)
            self._left(line)
            if self._closed() or line.candidate.size == 0:
                break
            stuck = stuck + 1 if line.alive.sum() > WORTH_IT * before else 0
        return line

    def _second_order(self, line: Line) -> bool:
        """Bound by second-order chains over what is left, then search it."""
        low = high = float(self.stats.get("share", 1.0))
        best: tuple[float, float] | None = None  # bound and share of the best so far
        shares = [(low + 1.0) / 2, 1.0, low, (low + 3.0) / 4]
        second: SecondOrder | None = None
        for number in range(SECOND_ORDER_PASSES):
            if self._triples(line) > MOST_TRIPLES:
                return False
            before = int(line.alive.sum())
            share = shares[number % len(shares)]
            second = SecondOrder(self._tempered(line, share), self.score)
            bound = second.bound()
            self._bounded(f"tempered chain, second order, share {share:g}", bound)
            if best is None or bound < best[0]:
                best = bound, share
            self._try_path(second.path())
            if self._closed():
                return True
            line = second.survivors(self.score)
            self._left(line)
            if line.candidate.size == 0:
                self._bounded("tempered chain, nothing left", self.score)
                return True
            if number + 1 >= len(shares) and line.alive.sum() > WORTH_IT * before:
                break
        if best is None or second is None:
            return False
        share = best[1]
        candidates = []
        for other in sorted({share, 1.0, high}):
            second = SecondOrder(self._tempered(line, other), self.score)
            width = min(WIDE, MOST_GAINS // max(int(line.alive.sum()), 1))
            diagram = Diagram(second.first, width, self.score, second)
            self._bounded(f"tempered diagram, second order, share {other:g}", diagram.bound())
            candidates.append((diagram.bound(), other, diagram))
        _, share, diagram = min(candidates, key=lambda entry: entry[:2])
        self.stats["search_share"] = share
        self.run.progress("searching what is left", None)
        return search(
            diagram,
            self.problem.constraints,
            self.inner,
            lambda: self.score,
            self._offer,
            lambda bound: self._bounded("search", bound),
        )

    def _best_share(self, line: Line, shares: tuple[float, ...]) -> tuple[float, float]:
        """Return the share that bounds a thinned line best, and seconds per pair of candidates."""
        thin = self._thinned(line, THINNED)
        took, best = np.inf, (np.inf, shares[0])
        for share in shares if len(shares) > 1 else ():
            started = time.monotonic()
            best = min(best, (self._tempered(thin, share).bound(), share))
            took = min(took, time.monotonic() - started)
        return best[1], took / max(thin.candidate.size, 1) ** 2

    @staticmethod
    def _thinned(line: Line, most: int) -> Line:
        """Return the line over every so many candidates, and all that are required."""
        step = max(1, -(-line.candidate.size // most))
        keep = np.arange(line.candidate.size)
        return line.subset(keep[(keep % step == 0) | line.required])

    def _tempered(self, line: Line, share: float) -> Tempered:
        self.run.progress(
            f"{line.candidate.size} candidates, {int(line.alive.sum())} arcs, share {share:.3g}",
            None,
        )
        budget = self.problem.constraints.budget
        return Tempered(
            self.objective,
            line,
            min(budget, max(line.candidate.size, 1)),
            share,
            self.background,
            self.inner,
        )

    @staticmethod
    def _triples(line: Line) -> int:
        return int(np.sum(line.alive.sum(axis=0) * line.alive.sum(axis=1)))

    def _left(self, line: Line) -> None:
        self.stats["candidates_left"] = int(line.candidate.size)
        self.stats["arcs_left"] = int(line.alive.sum())

    def _try_path(self, path: IntArray) -> None:
        """Polish the placement nearest to a path, if there is one, and keep it if it is better."""
        if self.inner.out_of_time():
            return
        path = self._mended(path)
        if self.problem.constraints.violations(path):
            return
        state = self.objective.state(np.sort(path))
        polish(self.problem, self._for_a_share(PATH_SHARE), state)
        meet(self.problem, self._for_a_share(PATH_SHARE), state, self.selected)
        self._offer(np.array(state.selected, dtype=np.int64))

    def _mended(self, path: IntArray) -> IntArray:
        """Return a path without all but the first camera of each group, filled up greedily."""
        constraints = self.problem.constraints
        group = constraints.group[path]
        _, first = np.unique(group, return_index=True)
        kept = np.union1d(path[first], path[group < 0])
        if kept.size == path.size:
            return path
        state = self.objective.state(kept)
        while len(state.selected) < constraints.budget and not self.inner.out_of_time():
            added = best_addition(self.problem, state)
            if added is None:
                break
            state.add(added)
        return np.array(state.selected, dtype=np.int64)

    def _offer(self, selected: IntArray) -> None:
        """Keep `selected` if it is a placement and better than the incumbent."""
        if self.problem.constraints.violations(selected):
            return
        score = self.objective.value(selected)
        if score > self.score:
            self.score = score
            self.selected = [int(i) for i in np.sort(selected)]
            self.run.incumbent = self.selected

    def _bounded(self, stage: str, bound: float) -> None:
        """Note what a stage has proven: nothing beats both the incumbent and `bound`."""
        # logarithms of numbers near 1 are off by an ulp of 1 each, however small their sum
        samples = sum(drive.weight * drive.information.n_samples for drive in self.objective.drives)
        slack = 4.0 * np.finfo(np.float64).eps * samples if bound > 0.0 else 0.0
        bound = max(float(bound) + slack, self.score)
        known = self.stats["bounds"].get(stage, np.inf)
        self.stats["bounds"][stage] = min(known, bound)
        if self.run.score_bound is None or bound <= self.run.score_bound:
            first = "bound_from" not in self.stats
            if first or self.run.score_bound is None or bound < self.run.score_bound:
                self.stats["bound_from"] = stage
            self.run.score_bound = bound
        gap = (self.run.score_bound - self.score) / max(abs(self.score), 1e-300)
        self.run.progress(f"{stage}: score {self.score:.6g}, gap {100.0 * gap:.3g} %", None)

    def _closed(self) -> bool:
        bound = self.run.score_bound
        return bound is not None and bound - self.score <= DONE * abs(self.score)
