"""Branch-and-cut for `localisation`, `coverage` and `entropy`: exact given time, and anytime.

A mixed-integer program with one level z_t for each sample and submodular and tangent cuts on it
(`bounds.cuts`), added only where violated. Each node's linear program is HiGHS's; each node's
bound is ours (`bounds.tangent.cut_bound`), as is the tree, so that `optimal` rests on no
solver's tolerance. Candidates whose reduced cost exceeds the distance to the incumbent are left
out for good: on `winding` with ten cameras 92 of 10,440 remain after the root.

`coverage` has cuts of its own (`bounds.coverage_cuts`); where its weights are whole numbers a
bound of 1000.7 is one of 1000, which closes most nodes.

`entropy` is no sum over samples: one level stands for all of it, with cuts on it as a whole
(`bounds.whole_cuts`), from the optimum of the concave relaxation on.
"""

from __future__ import annotations

import heapq
import itertools
import math
from dataclasses import dataclass, field, replace

import numpy as np

from models.geometry import FloatArray, IntArray
from placement.bounds.branching import WHOLE, children, last_placement
from placement.bounds.concave import best_fraction
from placement.bounds.coverage_cuts import CoverageCuts, merged
from placement.bounds.coverage_tree import best_few
from placement.bounds.cut_program import CutProgram, Fraction
from placement.bounds.cuts import Cuts, joined
from placement.bounds.cuttable import Cuttable, Maker, cut_maker, n_levels, restricted
from placement.bounds.matroid import Choice, best_choice, restricted_choice, root_choice, without
from placement.bounds.restrict import restricted_constraints
from placement.bounds.tangent import cut_bound
from placement.bounds.whole_cuts import WholeCutMaker
from placement.objectives.coverage import Coverage
from placement.objectives.entropy import Entropy
from placement.objectives.localisation import Localisation
from placement.problem import Problem, Run
from placement.solution import Proposal, Status
from placement.solvers.dive import dive
from placement.solvers.exchange import polish
from placement.solvers.first_placement import first_placement

# A node within this share of the incumbent holds nothing better; a tenth of what counts as
# optimal, so that rounding elsewhere cannot spoil the status.
TOLERANCE = 1e-7
ROOT_ROUNDS = 60
# Stop cutting where a round lowers the bound by less than this share of the gap.
STALL = 0.02
DIVE_EVERY = 10  # nodes
MOST_FAILURES = 200  # of HiGHS, before the search stops with the bound it has
LEAVE_TIME_S = 0.2  # for the verb's own checks, out of the time limit


def solve_mip(problem: Problem, run: Run) -> Proposal:
    """Cut, fix and branch until the incumbent is proven best or time is up.

    Raises:
        ValueError: for another objective, or `coverage` that counts shares of looks.
    """
    objective = problem.objective
    if not isinstance(objective, Localisation | Coverage | Entropy):
        raise ValueError(
            "method mip needs the objective localisation, coverage or entropy, "
            f"got {objective.name}"
        )
    if isinstance(objective, Coverage) and objective.partial and objective.times > 1:
        raise ValueError("method mip needs coverage without partial")
    search = Search(problem, objective, run)
    search.start()
    if isinstance(objective, Coverage) and search.look_at_all():
        return Proposal(search.incumbent, run.score_bound, stats=search.stats())
    finished = search.explore()
    return Proposal(
        search.incumbent,
        run.score_bound,
        Status.FEASIBLE if finished else Status.TIME_LIMIT,
        search.stats(),
    )


@dataclass(slots=True)
class Search:
    """The state of one branch-and-cut: the incumbent, the open nodes, the one linear program."""

    problem: Problem
    objective: Cuttable
    run: Run
    incumbent: list[int] = field(default_factory=list)
    score: float = 0.0
    nodes: int = 0
    _failures: int = 0
    root_bound: float = np.inf
    closed_bound: float = -np.inf  # the greatest bound of any node given up as good as done
    left_at_root: int = 0
    _open: list[tuple[float, int, Choice]] = field(default_factory=list)
    _serial: itertools.count[int] = field(default_factory=itertools.count)
    # The problem as it stands, without the candidates that are ruled out: `_keep` holds the
    # original numbers of those that are left, and nodes and cuts speak of positions in it.
    _keep: IntArray = field(init=False)
    _objective: Cuttable = field(init=False)
    _maker: Maker = field(init=False)
    _program: CutProgram = field(init=False)

    def start(self) -> None:
        """Find an incumbent by greedy and swaps, and open the root."""
        self._offer(first_placement(self.problem, self.objective, self.run))
        root = root_choice(self.problem.constraints)
        self._keep = np.arange(self.objective.n_candidates)
        simple = merged(self.objective) if isinstance(self.objective, Coverage) else self.objective
        self._push(np.inf, self._begun(simple, root))
        if isinstance(self._maker, WholeCutMaker):
            _, _, root = self._open.pop()
            selected = np.array(self.incumbent, dtype=np.int64)
            root, bound, tangent = self._relaxed(root, selected, self._maker)
            cuts = joined([self._program.cuts, tangent])
            self._program = CutProgram(root, cuts, n_levels(self._objective))
            self._push(bound, root)

    def _begun(self, objective: Cuttable, choice: Choice) -> Choice:
        """Make a new program of `objective`, over the candidates `_keep`; return what is left."""
        self._objective, self._maker = objective, cut_maker(objective)
        position = np.full(self.objective.n_candidates, -1, dtype=np.int64)
        position[self._keep] = np.arange(self._keep.size)
        here = position[np.array(self.incumbent, dtype=np.int64)]
        cuts = [self._maker.submodular(here[:0]), self._maker.submodular(here[here >= 0])]
        # A candidate that no sample hears from adds nothing: leave it out unless it must be in.
        left_out = np.ones(self._keep.size, dtype=np.bool_)
        left_out[cuts[0].candidate] = False
        if isinstance(self._maker, CoverageCuts):
            few = restricted_constraints(self.problem.constraints, self._keep)
            left_out |= self._maker.useless(few)
        required = position[self.problem.constraints.required]
        left_out[required] = False
        choice = without(choice, left_out)
        self._program = CutProgram(choice, joined(cuts), n_levels(objective))
        return choice

    def _relaxed(
        self, root: Choice, selected: IntArray, maker: WholeCutMaker
    ) -> tuple[Choice, float, Cuts]:
        """Solve the concave relaxation: who is left of `root`, a bound, and the first cut."""
        self.run.progress("solving the concave relaxation", None)
        inner = Run(self.run.rng, deadline=self.run.deadline - LEAVE_TIME_S)
        found = best_fraction(
            maker.objective,
            root,
            inner,
            beat=self._threshold(),
            start=selected,
            report=self._publish,
        )
        # who was struck may hold placements of up to the threshold
        bound = max(found.bound, self._threshold())
        self.root_bound = bound
        self._publish(bound)
        return found.choice, bound, maker.tangent(found.x)

    def look_at_all(self) -> bool:
        """Settle `coverage` by few cameras without linear programs; return whether that is done."""
        if not isinstance(self._objective, Coverage):
            return False
        allowed = self._open[0][2].allowed
        found = best_few(self._objective, self.problem.constraints, allowed, self.score, self.run)
        if found is None:
            return False
        selected, bound, self.nodes = found
        if selected:
            self._offer(np.array(selected, dtype=np.int64))
        self.run.score_bound = bound
        self._open.clear()
        return True

    def explore(self) -> bool:
        """Work through the open nodes, the highest bound first; return whether none is left."""
        while self._open:
            if self._out_of_time() or self._failures > MOST_FAILURES:
                return False
            negative, _, choice = heapq.heappop(self._open)
            bound = -negative
            if bound <= self._threshold():
                self._close(bound)
                self._publish(-np.inf)
                continue
            self._process(bound, choice)
            self._publish(-np.inf)
        self._publish(-np.inf)
        return True

    def stats(self) -> dict[str, object]:
        """Return what there is to tell about the search."""
        return {
            "nodes": self.nodes,
            "open_nodes": len(self._open),
            "cuts": len(self._program.cuts),
            "root_bound": self.root_bound,
            "candidates_after_root": self.left_at_root,
            "bound_from": "cut multipliers of HiGHS, certified in float64",
        }

    def _process(self, bound: float, choice: Choice) -> None:
        """Bound one node by cutting; then close it, or branch."""
        self.nodes += 1
        root = self.nodes == 1
        chosen: IntArray | None = None
        fraction: Fraction | None = None
        for round_ in range(ROOT_ROUNDS):
            choice = self._shrink(choice)
            program = self._program
            fraction = program.solve(choice, self._remaining())
            if fraction is None:
                break
            before = bound
            node_bound, loss = cut_bound(
                program.cuts,
                fraction.multiplier,
                choice,
                n_levels(self._objective),
                fraction.price,
            )
            slack = self._slack(node_bound)
            bound = min(bound, self._reachable(node_bound))
            if root:
                self.root_bound = bound
                self._publish(bound)
            self._round(fraction.x, choice, thorough=root or self.nodes % 10 == 0)
            if bound <= self._threshold():
                self._close(bound)
                return
            # Whoever no placement that beats the incumbent can hold is left out.
            choice = without(choice, choice.allowed & (loss > slack))
            if not choice.feasible:
                self._close(min(bound, self._threshold()))
                return
            whole = bool(np.all(np.minimum(fraction.x, 1.0 - fraction.x) <= WHOLE))
            if whole:
                chosen = np.flatnonzero(fraction.x > 0.5)
                self._offer(self._keep[chosen])
                cuts = self._violated_at(chosen, fraction)
            else:
                stalled = before - bound < STALL * (bound - self.score)
                if round_ >= (5 if root else 1) and stalled:
                    if self._dived(fraction.x, choice) and root:
                        continue  # the better incumbent leaves more candidates out
                    break
                # Many small violations are not worth a round each.
                worth_it = max(self._violation(fraction.z), 1e-3 * (bound - self.score))
                cuts = self._maker.separate(fraction.x, fraction.z, worth_it)
            if not len(cuts) or self._out_of_time():
                break
            program.add(cuts)
        if root:
            self.left_at_root = int(choice.allowed.sum())
        if fraction is None and not self._out_of_time():
            # HiGHS failed on this node, or called it infeasible on its own word: split it blindly.
            self._failures += 1
            fraction = Fraction(np.where(choice.allowed, 0.5, 0.0), np.zeros(0), np.zeros(0))
        if fraction is None:
            self._push(bound, choice)
            return
        parts = children(choice, fraction.x)
        if not parts:
            self._offer(self._keep[last_placement(choice)])
        for part in parts:
            self._push(bound, part)

    def _round(self, x: FloatArray, choice: Choice, *, thorough: bool) -> None:
        """Try the placement nearest to x; polish it if that is worth the time."""
        worth = x + 1e-9 * choice.allowed
        selected, _ = best_choice(choice, np.where(choice.allowed, worth, 0.0))
        self._offer(self._keep[selected], polishing=thorough)

    def _dived(self, x: FloatArray, choice: Choice) -> bool:
        """Look below a node for a placement of `coverage`; return whether the incumbent rose."""
        if not isinstance(self._objective, Coverage) or self.nodes % DIVE_EVERY != 1:
            return False
        before = self.score
        self._offer(self._keep[dive(self._program, choice, x, self._remaining)], polishing=True)
        return self.score > before

    def _offer(self, selected: IntArray, *, polishing: bool = False) -> None:
        """Keep `selected` if it is a placement and better than the incumbent."""
        if self.problem.constraints.violations(selected):
            return
        score = self.objective.value(selected)
        if polishing and not self._out_of_time():
            kept = self.run.incumbent
            state = self.objective.state(selected)
            polish(self.problem, self.run, state)
            self.run.incumbent = kept
            selected = np.array(state.selected, dtype=np.int64)
            score = self.objective.value(selected)
        if score > self.score or not self.incumbent:
            self.score = score
            self.incumbent = [int(i) for i in np.sort(selected)]
            self.run.incumbent = self.incumbent

    def _violated_at(self, chosen: IntArray, fraction: Fraction) -> Cuts:
        """Return the cuts at R = the chosen set, tight there, that its levels violate."""
        cuts = self._maker.submodular(chosen)
        return cuts.subset(
            fraction.z[cuts.sample] > cuts.at(fraction.x) + self._violation(fraction.z)
        )

    def _violation(self, z: FloatArray) -> float:
        """Return the least violation worth a cut: all of them together stay within TOLERANCE."""
        return 0.2 * TOLERANCE * max(abs(self.score), 1e-6) / max(len(z), 1)

    def _shrink(self, choice: Choice) -> Choice:
        """Drop from objective, cuts and nodes the candidates that no open node allows.

        Done only once half of them are gone, as the linear program then starts cold; at the root
        of `coverage` sooner, as samples that the same candidates see are then made one, and poses
        that see no more than another are left out anew. Return `choice` in the new numbering.
        """
        allowed = choice.allowed.copy()
        for _, _, other in self._open:
            allowed |= other.allowed
        root = isinstance(self._objective, Coverage) and not self._open
        if allowed.sum() > (0.8 if root else 0.5) * self._keep.size:
            return choice
        keep = np.flatnonzero(allowed)
        position = np.full(self._keep.size, -1, dtype=np.int64)
        position[keep] = np.arange(keep.size)
        self._open = [(b, serial, restricted_choice(c, keep)) for b, serial, c in self._open]
        self._keep = self._keep[keep]
        self._objective = restricted(self._objective, keep)
        choice = restricted_choice(choice, keep)
        if root and isinstance(self._objective, Coverage):
            return self._begun(merged(self._objective), choice)
        self._maker = cut_maker(self._objective)
        cuts = self._program.cuts.renumbered(position)
        everything = replace(choice, allowed=allowed[keep])
        self._program = CutProgram(everything, cuts, n_levels(self._objective))
        return choice

    def _push(self, bound: float, choice: Choice) -> None:
        heapq.heappush(self._open, (-bound, next(self._serial), choice))

    def _close(self, bound: float) -> None:
        self.closed_bound = max(self.closed_bound, bound)

    def _reachable(self, bound: float) -> float:
        """Return the greatest value at most `bound` that a placement can have.

        Where whole weights are summed, values are whole.
        """
        step = self._step()
        return step * math.floor(bound / step) if step and math.isfinite(bound) else bound

    def _slack(self, bound: float) -> float:
        """Return the loss from `bound` beyond which a placement cannot beat the incumbent.

        Where values are whole it must fall below the next whole one, no further.
        """
        step = self._step()
        least = (step - 1e-6) if step else -1e-9 * abs(bound)
        return max(0.0, bound - self.score - least)

    def _step(self) -> float:
        return self.objective.step if isinstance(self.objective, Coverage) else 0.0

    def _threshold(self) -> float:
        return self.score + TOLERANCE * abs(self.score)

    def _publish(self, current: float) -> None:
        """Tell the run the best bound proven so far: the worst over every node not refuted."""
        worst = max(self.closed_bound, current, self.score)
        if self._open:
            worst = max(worst, -self._open[0][0])
        if self.run.score_bound is None or worst < self.run.score_bound:
            self.run.score_bound = worst
        gap = (self.run.score_bound - self.score) / max(abs(self.score), 1e-300)
        self.run.progress(
            f"{self.nodes} nodes, score {self.score:.6g}, gap {100.0 * gap:.3g} %", None
        )

    def _remaining(self) -> float:
        return max(0.0, self.run.remaining() - LEAVE_TIME_S)

    def _out_of_time(self) -> bool:
        return self._remaining() <= 0.0
