"""Prove placements for `entropy` on a road: relaxation, chains, diagrams, best-first search.

Swaps and rearranged stretches give a placement. The concave relaxation gives a first bound and its
optimum y, at once. The tempered chain (`placement.tempered.bound`) then bounds, with y as its
background, what cameras between y and themselves can add; candidates and arcs that cannot beat the
placement are left out, which lets the next share θ, then the diagram, whose gains are given all
that came before (`placement.tempered.diagram`), then the second order bound more sharply; and the
best paths, polished by swaps, better the placement. What remains is searched best first.

Cameras with persistent offsets have a chain for a background (`placement.tempered.chains`), and a
dear and weak relaxation: it has a twentieth of the time unless it comes near. Where it comes very
near it is branched on. `stats["bounds"]` tells what each stage has proven.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field

import numpy as np

from models.geometry import FloatArray, IntArray
from placement.bounds.concave import best_fraction
from placement.bounds.concave_tree import split_until
from placement.objectives.entropy import Entropy
from placement.problem import Problem, Run
from placement.sieve.first import FirstOrder
from placement.sieve.passes import sift
from placement.sieve.sieve import Sieve
from placement.solution import Proposal, Status
from placement.solvers.exchange import polish
from placement.solvers.greedy import climb
from placement.solvers.incumbent import Incumbent
from placement.tempered.background import Background, background_of, chains_of, stand_in
from placement.tempered.bound import SecondOrder, Tempered, room_for_pairs
from placement.tempered.diagram import Diagram
from placement.tempered.dominance import undominated
from placement.tempered.line import Line, make_line
from placement.tempered.paths import OutOfTimeError
from placement.tempered.search import search
from placement.tempered.shares import better_share

# Shares tried on a thinned line, to choose that of the first pass over all candidates.
SHARES = (1.0, 0.95, 0.9, 0.8, 0.7, 0.6, 0.5, 0.35)
THINNED = 600  # candidates of a thinned line
THINNED_LONG = 2500  # of one without room for all pairs: the fewer, the nearer to 1 the best share
FIRST_ORDER_PASSES = 5
SECOND_ORDER_PASSES = 8
LONG_S = 5.0  # a line whose first-order pass takes longer goes through sieves at once
LABEL_PASSES = 12
MOST_GAINS = 20_000_000  # gains of a diagram: with its tables, some 200 MB
NARROW, WIDE = 4, 48  # labels a camera
GAIN_S = 1.5e-6  # seconds for each
KICK_SHARE = 0.05  # of the time left, for rearranging the first placement
SHARE_SEARCH = 0.3  # of the time left, for shares that bound the whole line better
WORTH_IT = 0.8  # go on while a pass leaves fewer than this share of the arcs
PERSISTENT_SHARES = (1.0, 0.98, 0.95, 0.9, 0.8, 0.6, 0.4)  # with persistent errors
RELAXED_SHARE = 0.05  # of the time left, for the relaxation of persistent errors
LONGER_SHARE = 0.6  # the same once it bounds within PROMISING of the score
PROMISING = 0.02
SPLIT_WITHIN = 0.005  # of the score: a relaxation as near as this is branched on,
SPLIT_SHARE = 0.8  # for this share of the time left: chains come nowhere near it
MOST_TRIPLES = 250_000_000  # second-order gains held at one time: 1 GB


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
class Proof(Incumbent):
    """The stages of a proof, one after another."""

    background: list[Background] = field(init=False)
    # by share: candidates, a price, and what may come beyond each of them
    _beyond: dict[float, tuple[IntArray, float, FloatArray | None]] = field(default_factory=dict)
    _sieved: bool = False  # whether the line has been through a sieve

    def work(self) -> bool:
        """Go through the stages; return whether there is nothing left that time could improve."""
        run = self.run
        state, _, _ = climb(self.problem, run)
        polish(self.problem, run, state)
        self.rearrange(state, KICK_SHARE)
        self.stats["bounds"] = {}
        self.offer(np.array(state.selected, dtype=np.int64))
        self.bounded("greedy", np.inf if run.score_bound is None else run.score_bound)
        line = self._relax()
        if self.closed() or self.problem.constraints.budget == 0:
            return True
        if line is None:
            return not run.out_of_time()
        if self.problem.constraints.budget == 1:
            alone = self._tempered(line, 1.0)
            self.bounded("each camera alone", alone.bound_of_one())
            return True
        share, seconds = self._best_share(line, SHARES if self.white else PERSISTENT_SHARES)
        if self._sieves and (
            seconds * line.candidate.size**2 > LONG_S or not room_for_pairs(line.candidate.size)
        ):
            # what suits the second order is nearer to 1
            line = self._sieve(line, share + (1.0 - share) * (0.5 if self.white else 0.75), share)
        if not self._sieved and room_for_pairs(line.candidate.size):
            line = self._first_order(line, share, seconds)
            if self.closed() or self.problem.constraints.budget < 2:
                return True
            share = float(self.stats["share"])
            line = self._sieve(line, share, share)
        if self.closed():
            return True
        if not room_for_pairs(line.candidate.size):
            self.use_what_is_left()
            return False
        line = self._diagrams(line)
        if self.closed():
            return True
        finished = self._second_order(line)
        if not finished:
            self.use_what_is_left()
        return finished

    def _relax(self) -> Line | None:
        """Bound by the concave relaxation; return who is left, None where chains cannot go."""
        constraints = self.problem.constraints
        choice = undominated(self.objective, constraints)
        self.run.progress("solving the concave relaxation", None)
        relaxation = self.inner
        longer = self.for_a_share(LONGER_SHARE).deadline
        if not self.white:
            relaxation = self.for_a_share(RELAXED_SHARE)

        def report(bound: float) -> None:
            self.bounded("relaxation", bound)
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
                self.for_a_share(SPLIT_SHARE),
                beat=self.score,
                report=lambda bound: self.bounded("relaxation, branched", bound),
                offer=self.offer,
            )
        left = np.flatnonzero(found.choice.allowed)
        self.stats["candidates_after_relaxation"] = int(left.size)
        if not self._sieves and not room_for_pairs(left.size):
            return None
        known = chains_of(self.objective, found.x)
        if known is None:
            white = stand_in(self.objective)
            y = best_fraction(white, choice, self.inner, tolerance=1e-3).x
            known = list(background_of(white, y))
        self.background = known
        return make_line(self.objective, constraints, left)

    @property
    def white(self) -> bool:
        """Whether no camera's errors persist."""
        return not any(drive.persistent for drive in self.objective.drives)

    @property
    def _sieves(self) -> bool:
        """Whether there is a single drive, as a sieve wants it."""
        return len(self.objective.drives) == 1

    def _first_order(self, line: Line, share: float, seconds: float) -> Line:
        """Bound by first-order chains at the shares that bound best, and thin out the line.

        The first pass is at `share`; a pair of candidates takes `seconds`.
        """
        for _ in range(FIRST_ORDER_PASSES):
            n = line.candidate.size
            if n < 2 or 0.25 * seconds * n * n > self.inner.remaining():
                break
            before = line.n_arcs
            started = time.monotonic()
            bound = self._chain(line, share)
            if self.closed():
                return line
            line = bound.survivors(self.score)
            if time.monotonic() - started < 1.0:
                break
            if line.n_arcs > WORTH_IT * before:
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
        self.bounded(f"tempered chain, first order, share {share:g}", bound.bound())
        self.try_path(bound.path())
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
            return not self.closed() and time.monotonic() + took < until

        return better_share(share, bound, evaluate, may_go_on), line

    def _sieve(self, line: Line, share: float, least_share: float) -> Line:
        """Thin out a line with more pairs of arcs than the second order has room for.

        From `share` on, or from `least_share` where that leaves too many.
        """
        self.stats["share"] = share
        if not self._sieves or self.problem.constraints.budget < 2:
            return line

        def report(found: FirstOrder | Sieve, share: float) -> bool:
            if isinstance(found, FirstOrder):
                self.bounded(f"tempered chain, first order, share {share:.4g}", found.bound())
                return self.closed()
            self.bounded(f"tempered chain, second order, sieved, share {share:.4g}", found.bound())
            self.try_path(found.path())
            self._beyond[share] = found.first.line.candidate, found.price, found.beyond
            return self.closed()

        line, self.stats["share"], sieves = sift(
            line,
            share,
            least_share,
            self._tempered,
            lambda: self.score,
            report,
            lambda left: (
                self._triples(left) <= MOST_TRIPLES and room_for_pairs(left.candidate.size)
            ),
            self.inner,
        )
        self._sieved = self._sieved or sieves > 0
        self._left(line)
        return line

    def _diagrams(self, line: Line) -> Line:
        """Bound by gains given all that came before, and thin out the line."""
        low = float(self.stats.get("share", 1.0))
        shares = sorted({low, (low + 1.0) / 2})
        known = self._beyond
        stuck = 0
        for number in range(LABEL_PASSES):
            before = line.n_arcs
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
            self.bounded(f"tempered diagram, share {share:g}", diagram.bound())
            self.try_path(diagram.path())
            line = diagram.survivors(self.score)
            self._left(line)
            if self.closed() or line.candidate.size == 0:
                break
            stuck = stuck + 1 if line.n_arcs > WORTH_IT * before else 0
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
            before = line.n_arcs
            share = shares[number % len(shares)]
            second = SecondOrder(self._tempered(line, share), self.score)
            bound = second.bound()
            self.bounded(f"tempered chain, second order, share {share:g}", bound)
            if best is None or bound < best[0]:
                best = bound, share
            self.try_path(second.path())
            if self.closed():
                return True
            line = second.survivors(self.score)
            self._left(line)
            if line.candidate.size == 0:
                self.bounded("tempered chain, nothing left", self.score)
                return True
            if number + 1 >= len(shares) and line.n_arcs > WORTH_IT * before:
                break
        if best is None or second is None:
            return False
        share = best[1]
        candidates: list[tuple[float, float, SecondOrder | Diagram]] = []
        for other in sorted({share, 1.0, high}):
            second = SecondOrder(self._tempered(line, other), self.score)
            width = min(WIDE, MOST_GAINS // max(line.n_arcs, 1))
            diagram = Diagram(second.first, width, self.score, second)
            self.bounded(f"tempered diagram, second order, share {other:g}", diagram.bound())
            candidates.append((second.bound(), other, second))
            candidates.append((diagram.bound(), other, diagram))
        _, share, sharpest = min(candidates, key=lambda entry: entry[:2])
        self.stats["search_share"] = share
        self.run.progress("searching what is left", None)
        return search(
            sharpest,
            self.problem.constraints,
            self.inner,
            lambda: self.score,
            self.offer,
            lambda bound: self.bounded("search", bound),
        )

    def _best_share(self, line: Line, shares: tuple[float, ...]) -> tuple[float, float]:
        """Return the share that bounds a thinned line best, and seconds per pair of candidates."""
        thinned = THINNED if room_for_pairs(line.candidate.size) else THINNED_LONG
        step = max(1, -(-line.candidate.size // thinned))
        keep = np.arange(line.candidate.size)
        thin = line.subset(keep[(keep % step == 0) | line.required])
        took, best = np.inf, (np.inf, shares[0])
        for share in shares if len(shares) > 1 else ():
            started = time.monotonic()
            best = min(best, (self._tempered(thin, share).bound(), share))
            took = min(took, time.monotonic() - started)
        return best[1], took / max(thin.candidate.size, 1) ** 2

    def _tempered(self, line: Line, share: float) -> Tempered:
        self.run.progress(
            f"{line.candidate.size} candidates, {line.n_arcs} arcs, share {share:.3g}",
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
        out, into = line.degrees
        return int(np.sum(out * into))

    def _left(self, line: Line) -> None:
        self.stats["candidates_left"] = int(line.candidate.size)
        self.stats["arcs_left"] = line.n_arcs
