"""What `auto` does for `trace`: search for a placement, bound it by the best means, say which.

    search       rearranges stretches of road while that helps;
    relaxation   the concave relaxation's tangent bound: cheap, any length of view, any error;
    diagram      the relaxed decision diagram along the road: tight, for views that are short.

Persistent offsets make every look at an objective dear, so there the search is over cameras whose
offsets are known, and its placement is polished with them unknown; the relaxation begins likewise
where that of known offsets ended. The diagram knows the offsets of cameras whose views meet, and of
required ones. Bounds are lower bounds on the value; the greatest counts, and `stats["bound_from"]`
names it.

A time limit is shared out: a quarter for the search, a tenth for the relaxation (and where offsets
persist a sixth of what is left, or half where many views meet), the rest for the diagram (and the
placement, there). Without one the diagram stops at MOST_LABELS, and what persistent offsets make
dear after DEAR_S or DEARER_S seconds.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, cast

import numpy as np

from models.geometry import FloatArray
from placement.bounds.concave import best_fraction
from placement.bounds.matroid import root_choice
from placement.objectives.base import Relaxable
from placement.objectives.trace import Trace
from placement.problem import Problem, Run
from placement.solution import OPTIMAL_GAP, Proposal, Status
from placement.solvers.diagram import Proof, publish, shortened
from placement.solvers.exchange import polish
from placement.solvers.search import rearrange, solve_search

MOST_LABELS = 20e6  # about 20 s
DEAR_S = 10.0
DEARER_S = 60.0  # for the relaxation where offsets persist
SHORT_S = 20.0  # a time limit that compiling can eat
FAINT = 1e-3  # of a camera: less is left out of a fractional choice, which stays a choice
EVERYWHERE = "every camera at once"
RELAXATION = "concave relaxation"
TOLERANCE = 1e-3
DEAR_TOLERANCE = 0.01
CROWDED = 0.5  # all drives' views end to end, as a share of the road: from here on it is much
RELAXED_SHARE, RELAXED_SHARE_FEW = 0.5, 0.15  # of the time left, for persistent offsets' relaxation
SWEPT_SHARE = 0.75  # of what is then left, for their diagram; the rest is for the placement


def solve_trace_proof(problem: Problem, run: Run) -> Proposal:
    """Search, relax, and refine the diagram; return the best placement and the best bound.

    Raises:
        ValueError: for an objective other than `trace`.
    """
    if not isinstance(problem.objective, Trace):
        raise ValueError(f"this proof needs the objective trace, got {problem.objective.name}")
    proof = TraceProof(problem, run)
    finished = proof.work()
    return Proposal(
        proof.proof.incumbent,
        run.score_bound,
        Status.FEASIBLE if finished else Status.TIME_LIMIT,
        proof.stats,
    )


@dataclass(slots=True)
class TraceProof:
    """The diagram's proof with a search before it and a relaxation beside it."""

    problem: Problem
    run: Run
    stats: dict[str, Any] = field(default_factory=dict)
    total: float = math.inf
    proof: Proof = field(init=False)

    def __post_init__(self) -> None:
        """Prepare the proof, not yet its diagrams."""
        limited = math.isfinite(self.run.deadline)
        self.proof = Proof(self.problem, self.run, math.inf if limited else MOST_LABELS)

    def work(self) -> bool:
        """Do all of it; return whether no time was missing."""
        run, proof = self.run, self.proof
        limited = math.isfinite(run.deadline)
        total = self.total = run.remaining()
        self.stats["bounds"] = {}
        # less than nothing is known for a start: the error if every usable camera were there
        every = np.flatnonzero(self.problem.constraints.usable())
        self._bounded(EVERYWHERE, proof.known.objective.value(every))
        with shortened(run, 0.25 * total):
            self._search()
        with shortened(run, max(0.1 * total, min(2.0, 0.5 * total)) if limited else DEAR_S):
            x = self._relax()
        if self.problem.constraints.budget == 0 or run.out_of_time():
            return not run.out_of_time()
        if proof.persistent:
            share = RELAXED_SHARE if self._crowded() else RELAXED_SHARE_FEW
            relaxing = share * run.remaining()
            with shortened(run, max(relaxing, 0.1) if limited else DEARER_S):
                self._relax_truly(x)
            if max(self.stats["bounds"].values()) >= (1.0 - OPTIMAL_GAP) * proof.true_value:
                self.stats["diagram"] = "left out: nothing is left to prove"
                return not run.out_of_time()
        if total < SHORT_S and run.remaining() < 0.5 * total:
            # compiling ate it: the diagram's kernels, too, may have to be compiled, for longer
            self.stats["diagram"] = "no time"
            return False
        try:
            proof.prepare()
        except ValueError as error:  # views too long
            self.stats["diagram"] = str(error)
            return not run.out_of_time()
        with shortened(run, (SWEPT_SHARE if proof.persistent else 1.0) * run.remaining()):
            finished = proof.refine()
        self._bounded(proof.stats()["bound_from"], proof.bound)
        self.stats["sweeps"] = proof.sweeps
        unproven = max(self.stats["bounds"].values()) < (1.0 - OPTIMAL_GAP) * proof.true_value
        if proof.persistent and limited and unproven:
            self._rearrange()
        return finished and not run.out_of_time()

    def _crowded(self) -> bool:
        """Say whether views meet so often, or drives are so many, that diagrams take too long."""
        drives = cast("Trace", self.problem.objective).drives
        information = drives[0].information
        seen = np.diff(information.indptr)
        typical = float(np.median(seen[seen > 0])) if seen.any() else 0.0
        budget = self.problem.constraints.budget
        return bool(len(drives) * budget * typical >= CROWDED * information.n_samples)

    def _search(self) -> None:
        """Search for a placement; offer what is found."""
        proof, run = self.proof, self.run
        found = solve_search(proof.known, run)
        self.stats["search"] = {k: v for k, v in found.stats.items() if not isinstance(v, dict)}
        proof.offer(found.selected)
        if proof.persistent:
            state = self.problem.objective.state(np.array(proof.incumbent, dtype=np.int64))
            with shortened(run, min(DEAR_S, 0.5 * run.remaining())):
                polish(self.problem, run, state)
            proof.offer(state.selected)

    def _relax(self) -> FloatArray:
        """Bound by the concave relaxation, offsets known; return its fractional choice (c,)."""
        proof, run = self.proof, self.run
        fraction = best_fraction(
            cast("Relaxable", proof.known.objective),
            root_choice(self.problem.constraints),
            Run(run.rng, run.deadline, run.progress),
            start=np.array(proof.selected, dtype=np.int64),
            tolerance=TOLERANCE,
        )
        self._bounded(RELAXATION, -fraction.bound)
        return fraction.x

    def _relax_truly(self, x: FloatArray) -> None:
        """Bound by the concave relaxation with offsets unknown, from a fractional choice (c,)."""
        run = self.run
        if run.out_of_time() or self.total < SHORT_S:
            return  # one look takes some seconds, and nothing interrupts it

        def report(bound: float) -> None:
            self._bounded(RELAXATION, -bound)
            gap = 1.0 + bound / self.proof.true_value
            run.progress(f"concave relaxation, gap {100.0 * gap:.3g} %", None)

        best_fraction(
            cast("Relaxable", self.problem.objective),
            root_choice(self.problem.constraints),
            Run(run.rng, run.deadline, run.progress),
            start=np.where(x > FAINT, x, 0.0),
            tolerance=DEAR_TOLERANCE,
            report=report,
        )

    def _rearrange(self) -> None:
        """Rearrange stretches of the placement, offsets unknown, in the time that is left."""
        state = self.problem.objective.state(np.array(self.proof.incumbent, dtype=np.int64))
        rearrange(self.problem, self.run, state)
        self.proof.offer(state.selected)

    def _bounded(self, source: str, bound: float) -> None:
        """Keep a lower bound on the value, if it is the best so far."""
        kept = self.stats["bounds"]
        kept[source] = max(bound, kept.get(source, -math.inf))
        self.stats["bound_from"] = max(kept, key=kept.__getitem__)
        publish(self.run, -bound)
