"""Prove dense designs: branch-and-bound on the concave relaxation, for log det and trace.

Nodes are relaxed by exchanges of weight, bounded by certificates that hold whatever the relaxation
got wrong, and lose every candidate that no better design holds (`placement.branch`). Where a
design has exactly as many columns as the state has dimensions, candidates fixed in are projected
out; that bound is what makes budgets of n tractable. Starts are swapped designs, so the tree has
little but proving to do.

The tree is best-first between short depth-first dives: the bound falls all the time, and memory is
what the dives leave open. A node is done with once its bound is within 5e-7 of the best design,
relative; so the certificate is `optimal` when the tree is empty.
"""

from __future__ import annotations

import heapq
import time
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from models.geometry import FloatArray, IntArray
from placement.branch.climb import LOG_DET, TRACE_INVERSE
from placement.branch.design import Design, design_of
from placement.branch.relax import relax
from placement.branch.swaps import better_by_swaps, score_of
from placement.branch.symmetry import orbits, products
from placement.branch.tree import FREE, IN, OUT, search
from placement.problem import Problem, Run
from placement.solution import OPTIMAL_GAP, Proposal, Status
from placement.solvers.greedy import climb

STARTS = 24  # designs that are swapped to a standstill before the tree
SWEEPS = 200
SWAPPING_S = 20.0
DIVE = 256  # nodes between two looks at the clock
ROOT_ROUNDS, ROUNDS = 400, 12  # climbs and certificates of a node
ROOT_WORK = 2e9  # the root's rounds are fewer where each takes long: 10 s for 100,000 × 50
LEAST_LEFT = 3  # fewer to be chosen are found sooner than their symmetries
MOST_UNFOLDED = 400  # nodes whose symmetries are looked for
MOST_OPEN = 40_000_000  # open nodes times candidates; beyond, dives end their subtree


def solve_branch(problem: Problem, run: Run) -> Proposal:
    """Find a design by swaps, then prove or better it; anytime.

    Raises:
        ValueError: for objectives other than `log_det` and `trace_inverse`, or separation.
    """
    tree = Tree(problem, run)
    tree.start()
    finished = tree.explore()
    return Proposal(
        tree.selected(),
        run.score_bound,
        Status.FEASIBLE if finished else Status.TIME_LIMIT,
        tree.stats(),
    )


@dataclass(slots=True)
class Tree:
    """The open nodes, the best design, and what is proven."""

    problem: Problem
    run: Run
    design: Design = field(init=False)
    score: float = -np.inf
    closed: float = -np.inf
    nodes: int = 0
    projects: bool = False
    scale: float = np.inf  # no better design's score is smaller than this, in magnitude
    best: IntArray = field(init=False)
    open: list[tuple[float, int, Any, Any, float]] = field(default_factory=list)
    _made: int = 0
    _root: dict[str, Any] = field(default_factory=dict)

    def start(self) -> None:
        """Lay out the arrays and find a first design."""
        self.run.incumbent = [int(i) for i in np.unique(self.problem.constraints.required)]
        self.design = design_of(self.problem)
        if self.design.kind == TRACE_INVERSE:  # all candidates together leave the least trace
            self.scale = abs(self._score(self.design.ids))
        self.best = self.design.ids[self.design.required]
        self.score = self._score(self.best)
        started = time.monotonic()
        state, _, _ = climb(self.problem, self.run)
        self._swap(np.flatnonzero(np.isin(self.design.ids, state.selected)))
        for start in range(STARTS):
            # from very many candidates a start takes long, and greedy's is a good one
            if self.run.out_of_time() or time.monotonic() - started > SWAPPING_S:
                break
            self.run.progress("swapping", start / STARTS)
            self._swap(self._random_start())

    def explore(self) -> bool:
        """Work until nothing is open or time is up; return whether nothing is."""
        if self.run.out_of_time():
            return False
        self._plant()
        self._unfold()
        while self.open:
            self._publish()
            if self.run.out_of_time():
                return False
            bound, _, state, x, price = heapq.heappop(self.open)
            if -bound <= self.score + self._slack():
                self.closed = max(self.closed, -bound)
                continue
            self.dive(-bound, state, x, price, DIVE, ROUNDS)
        self._publish()
        return True

    def selected(self) -> list[int]:
        """Return the best design."""
        return sorted(int(i) for i in self.best)

    def stats(self) -> dict[str, Any]:
        """Return what there is to tell."""
        return {
            "nodes": self.nodes,
            "open": len(self.open),
            "projected": self.projects,
            **self._root,
        }

    def _slack(self) -> float:
        """Return how near a bound must come, by the best there may be and not by a bad start."""
        return 0.5 * OPTIMAL_GAP * min(abs(self.score), self.scale)

    def _plant(self) -> None:
        """Bound the root by whichever bound is better there; strike out whom it excludes."""
        design = self.design
        state = np.where(design.required, IN, FREE).astype(np.int8)
        r, n = design.V.shape[1:]
        ways = [False]
        if design.kind == LOG_DET and not design.priced and design.k * r == n:
            ways.append(True)
        bounds = []
        for way in ways:
            probe = Tree(self.problem, self.run)
            probe.design, probe.score, probe.best = design, self.score, self.best
            probe.projects, probe.scale = way, self.scale
            work = design.V.size * (n + 24)
            rounds = int(np.clip(ROOT_WORK / max(work, 1), ROUNDS, ROOT_ROUNDS))
            probe.dive(np.inf, state, np.zeros(len(state)), 0.0, 1, rounds)
            bounds.append((probe.bound(), way, probe))
        # Below the root only the projected bound gains by every candidate fixed in.
        near = 0.1 * (bounds[0][0] - self.score)
        _, self.projects, probe = min(bounds, key=lambda entry: entry[0] - near * entry[1])
        self._root = {"root_bound": probe.bound(), "root_gap": probe.bound() - self.score}
        self.nodes, self.closed = probe.nodes, probe.closed
        if design.kind == TRACE_INVERSE:
            self.scale = max(self.scale, abs(probe.bound()))
        self.score, self.best, self.open = probe.score, probe.best, probe.open
        self._shrink()

    def _unfold(self) -> None:
        """Branch on orbits of symmetric candidates, one in or all out, while there are any.

        The open nodes are replaced by those where no symmetry is left, or too few candidates are
        to be chosen for it to pay.
        """
        design = self.design
        alone = np.unique(design.group).size == design.group.size
        if design.kind != LOG_DET or design.priced or not alone or not self.open:
            return
        gram = products(design.V)
        if gram is None:
            return
        leaves: list[Any] = []
        waiting, self.open = self.open, []
        # the root's two children made one again: which candidate it branched on breaks symmetry
        waiting = _merged(waiting)
        looked = merged = 0
        while waiting:
            node = heapq.heappop(waiting)
            bound, _, state, x, price = node
            here, there = np.flatnonzero(state == FREE), np.flatnonzero(state == IN)
            m = design.k - there.size
            if -bound <= self.score + self._slack() or here.size < m:
                self.closed = max(self.closed, min(-bound, self.score + self._slack()))
                continue
            if m <= LEAST_LEFT or looked >= MOST_UNFOLDED or self.run.out_of_time():
                leaves.append(node)
                continue
            looked += 1
            self.run.progress(f"looking for symmetries, {len(waiting)} nodes", None)
            inside = np.concatenate([here, there])
            colours = np.where(np.arange(inside.size) < here.size, 0, 1)
            labels = orbits(gram[np.ix_(inside, inside)], colours)[: here.size]
            sizes = np.bincount(labels, minlength=inside.size)
            if sizes.max() == 1:
                leaves.append(node)
                continue
            merged += 1
            y = np.ascontiguousarray(x[here])
            found, *_ = relax(
                design.kind, self.projects, design.base, design.root, design.V, design.group,
                design.cost, design.purse, False, here, there, m, y, price,
                self.score + self._slack(), self._slack(), ROUNDS, np.empty(here.size),
                np.empty(here.size),
            )  # fmt: skip
            self.nodes += 1
            bound = -min(-bound, found)
            weight = np.bincount(labels, weights=y, minlength=inside.size)
            orbit = int(np.argmax(np.where(sizes > 1, weight, -1.0)))
            chosen = state.copy()
            chosen[here[np.argmax(labels == orbit)]] = IN
            without = state.copy()
            without[here[labels == orbit]] = OUT
            spread = x.copy()
            spread[here] = y
            for child in (chosen, without):
                self._made += 1
                heapq.heappush(waiting, (bound, self._made, child, spread, price))
        heapq.heapify(leaves)
        self.open = leaves
        if merged:
            self._root["orbits_merged"] = merged

    def _shrink(self) -> None:
        """Leave out the candidates that no open node allows."""
        if not self.open:
            return
        keep = np.zeros(len(self.design.ids), dtype=np.bool_)
        for _, _, state, _, _ in self.open:
            keep |= state != OUT
        self.design = self.design.keep(keep)
        self.open = [(b, n, s[keep], x[keep], p) for b, n, s, x, p in self.open]
        self._root["candidates_left"] = int(keep.sum())

    def bound(self) -> float:
        """Return the bound on every design's score; the heap's first is its greatest."""
        best_open = -self.open[0][0] if self.open else -np.inf
        bound = max(self.score, self.closed, best_open)
        return bound + self.design.doubt * abs(bound) if np.isfinite(bound) else bound

    def _publish(self) -> None:
        """Tell the run what is proven."""
        bound = self.bound()
        if np.isfinite(bound):
            known = self.run.score_bound
            self.run.score_bound = bound if known is None else min(known, bound)
        gap = (bound - self.score) / max(abs(self.score), 1e-300)
        self.run.progress(
            f"{self.nodes} nodes, {len(self.open)} open, {self.score:.8g} ≤ {bound:.8g} "
            f"({100 * gap:.2g} %)",
            None,
        )

    def dive(
        self, bound: float, state: Any, x: FloatArray, price: float, limit: int, rounds: int
    ) -> None:
        """Search below one node for `limit` nodes; keep what stays open."""
        design = self.design
        c = len(design.ids)
        size = min(c, 2 * DIVE) + 8
        states = np.empty((size, c), dtype=np.int8)
        xs = np.empty((size, c))
        bounds, prices = np.empty(size), np.zeros(size)
        states[0], xs[0], bounds[0], prices[0] = state, x, bound, price
        chosen = np.full(max(design.k, 1), -1, dtype=np.int64)
        top = 1
        while top > 0:
            top, nodes, score, closed = search(
                design.kind, self.projects, design.base, design.root, design.V, design.group,
                design.cost, design.purse, design.k, design.priced, self._slack(),
                states, xs, bounds, prices, top, limit, rounds, self.score, chosen,
            )  # fmt: skip
            self.nodes += nodes
            self.closed = max(self.closed, closed)
            if score > self.score:
                self._improve(chosen)
            full = top + 2 > size
            if full or len(self.open) * c < MOST_OPEN or self.run.out_of_time():
                break
        for at in range(top):
            self._made += 1
            entry = (-bounds[at], self._made, states[at].copy(), xs[at].copy(), prices[at])
            heapq.heappush(self.open, entry)

    def _improve(self, chosen: IntArray) -> None:
        found = chosen[chosen >= 0]
        self.best = self.design.ids[found]
        self.score = self._score(self.best)
        self.run.incumbent = self.selected()
        self._swap(found)

    def _score(self, ids: IntArray) -> float:
        """Score a design by the tree's own kernel, of which its bounds speak."""
        design = self.design
        inside = np.flatnonzero(np.isin(design.ids, ids))
        return float(score_of(design.kind, design.base, design.V, inside, inside.size))

    def _swap(self, start: IntArray) -> None:
        """Better a design (indices into `ids`) by swaps and keep it if it is the best."""
        design = self.design
        chosen = np.full(max(design.k, 1), -1, dtype=np.int64)
        chosen[: start.size] = start
        score = -np.inf
        for _ in range(SWEEPS):
            before = score
            count, score = better_by_swaps(
                design.kind, design.base, design.V, design.group, design.cost, design.purse,
                design.required, design.k, chosen, 1,
            )  # fmt: skip
            if score == before or self.run.out_of_time():
                break
        if score > self.score + 1e-12 * abs(self.score):
            self.score = score
            self.best = design.ids[chosen[:count]]
            self.run.incumbent = self.selected()

    def _random_start(self) -> IntArray:
        """Draw a design: the required, then whoever fits, in a random order."""
        design = self.design
        chosen = [int(i) for i in np.flatnonzero(design.required)]
        groups = {int(design.group[i]) for i in chosen}
        spent = float(design.cost[chosen].sum())
        for i in self.run.rng.permutation(len(design.ids)):
            if len(chosen) >= design.k:
                break
            if int(design.group[i]) in groups or spent + design.cost[i] > design.purse:
                continue
            chosen.append(int(i))
            groups.add(int(design.group[i]))
            spent += float(design.cost[i])
        return np.array(chosen, dtype=np.int64)


def _merged(nodes: list[Any]) -> list[Any]:
    """Return one node that allows whatever the given ones allow."""
    bound, made, _, x, price = min(nodes, key=lambda node: node[0])
    states = np.array([node[2] for node in nodes])
    alike = np.all(states == states[0], axis=0)
    return [(bound, made, np.where(alike, states[0], FREE).astype(np.int8), x, price)]
