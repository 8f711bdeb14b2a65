"""Branch on the concave relaxation where its optimum is not near enough: best first, anytime.

A node says which groups a placement must use and which candidates are left (`Choice`), climbs from
its parent's x by a few Newton steps, and is bounded by its tangents, over all its placements and
exactly. A *floor* between the value to beat and the bound makes nodes small: who cannot be part of
a placement above it is struck out, which group each of those uses must be used, and a node below it
is done with. What is proven is the greatest of the floor and the open nodes' bounds. A floor that
is reached is lowered.

Which group to split is tried out on the quadratic model, some milliseconds each: splits differ by
a factor of a hundred in how far the bound falls.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from models.geometry import FloatArray, IntArray
from placement.bounds.branching import children, halves, last_placement, use_or_not
from placement.bounds.concave import EXCHANGES, exchange
from placement.bounds.matroid import Choice, best_choice, restricted_choice, without
from placement.bounds.restrict import narrowed
from placement.bounds.tangent import GAIN_ERROR, sum_up
from placement.objectives.base import Curved
from placement.problem import Run

LEFT = 0.75  # of the gap is left below the first floor; its cube below the next, and so on
STEPS = 3  # of a node's climb
ENOUGH = 0.05  # a node's climb may end this share of its distance to the floor below its bound
TRIED = 12  # splits that are tried out on the quadratic model
NEAR = 0.5  # of the gap: who loses less than this much may take up weight
FEWEST_NEAR = 100
FAINT = 1e-7  # a smaller share is none
SLACK = 1e-9  # relative: what is struck out misses the value to beat by no more than rounding


@dataclass(frozen=True, slots=True)
class Node:
    """What placements are left, a fractional choice x (c,) of them and its slope, and a bound."""

    choice: Choice
    x: FloatArray
    slope: FloatArray
    bound: float


def split_until(
    objective: Curved,
    choice: Choice,
    x: FloatArray,
    run: Run,
    *,
    beat: float,
    report: Callable[[float], None],
    offer: Callable[[IntArray], None],
) -> int:
    """Bound the placements of `choice` ever better, from the relaxation's optimum `x` (c,).

    `report` is told each better bound; none is below `beat`. `offer` is shown placements that look
    good. Ends when `run` is out of time, or the bound within rounding of `beat`; returns the number
    of nodes looked at.
    """
    looked = 0
    beat += SLACK * abs(beat)
    tangent, losses = _certificate(objective, choice, x)
    bound, left = tangent, LEFT
    while not run.out_of_time() and bound > beat + SLACK * abs(beat):
        floor = beat + left * (bound - beat)
        keep = np.flatnonzero(choice.allowed & (losses <= margin(tangent, floor)))
        small = narrowed(objective, keep, x.size)
        if not isinstance(small, Curved):
            break
        tree = Tree(small, run, floor, Shown(offer, keep))
        finished = tree.grow(restricted_choice(choice, keep), x[keep], bound, report)
        looked += tree.nodes
        bound, left = floor, left * left * left
        if not finished or tree.settled > floor:
            break
    return looked


def _certificate(objective: Curved, choice: Choice, x: FloatArray) -> tuple[float, FloatArray]:
    """Return the bound of the tangent at `x`, and what each candidate loses to it (c,)."""
    score, slope = objective.relaxed(x)
    chosen, loss = best_choice(choice, slope)
    return sum_up(np.concatenate([[score], -slope * x, slope[chosen]]), GAIN_ERROR), loss


@dataclass(frozen=True, slots=True)
class Shown:
    """Show placements of the candidates `keep` to someone who numbers all."""

    offer: Callable[[IntArray], None]
    keep: IntArray

    def __call__(self, chosen: IntArray) -> None:
        """Offer `chosen`."""
        self.offer(self.keep[chosen])


@dataclass(slots=True)
class Tree:
    """The open nodes above `floor`."""

    objective: Curved
    run: Run
    floor: float
    offer: Callable[[IntArray], None]
    nodes: int = 0
    settled: float = -np.inf  # the best of the placements that were all a node had left
    open: list[tuple[float, int, Node]] = field(default_factory=list)
    _pushed: int = 0

    def grow(
        self, choice: Choice, x: FloatArray, bound: float, report: Callable[[float], None]
    ) -> bool:
        """Work until nothing is open (True) or time is up; `bound` holds for the root."""
        root = self.relax(choice, x, bound)
        if root is not None:
            self._push(root)
        while self.open:
            negative, _, node = self.open[0]
            report(max(-negative, self.floor, self.settled))
            if self.run.out_of_time():
                return False
            found = []
            for part, start in self.split(node):
                if self.run.out_of_time():  # the node stays open: its parts are not all bounded
                    return False
                found.append(self.relax(part, start, node.bound))
            heapq.heappop(self.open)
            if not found:
                self._settle(node)
            for child in found:
                if child is not None:
                    self._push(child)
        report(max(self.floor, self.settled))
        return True

    def _settle(self, node: Node) -> None:
        """Take a node of one placement at that placement's score."""
        chosen = last_placement(node.choice)
        x = np.zeros(node.x.size)
        x[chosen] = 1.0
        score = sum_up(np.array([self.objective.relaxed(x)[0]]), SLACK)
        self.settled = max(self.settled, min(node.bound, score))
        self.offer(chosen)

    def relax(self, choice: Choice, x: FloatArray, bound: float) -> Node | None:
        """Climb from `x` and bound `choice`, as `bound` does; None if it is below the floor."""
        self.nodes += 1
        best: Node | None = None
        x = feasible(choice, x, np.ones(x.size))
        score, slope = self.objective.relaxed(x)
        for step in range(STEPS + 1):
            chosen, loss = best_choice(choice, slope)
            here = sum_up(np.concatenate([[score], -slope * x, slope[chosen]]), GAIN_ERROR)
            if here < bound or best is None:
                bound = min(bound, here)
                best = Node(choice, x, slope, bound)
            if bound <= self.floor:
                return None
            choice = decided(choice, slope, chosen, loss, margin(here, self.floor))
            if not choice.feasible:
                return None
            enough = ENOUGH * max(score - self.floor, 0.0)
            if step == STEPS or here - score <= enough or self.run.out_of_time():
                break
            climbed = self._climb(choice, x, score, slope, chosen, loss, here - score)
            if climbed is None:
                break
            x, score, slope = climbed
        self.offer(chosen)
        return None if best is None else replace(best, choice=choice, bound=bound)

    def _climb(
        self,
        choice: Choice,
        x: FloatArray,
        score: float,
        slope: FloatArray,
        chosen: IntArray,
        loss: FloatArray,
        gap: float,
    ) -> tuple[FloatArray, float, FloatArray] | None:
        """Take one Newton step from `x` within `choice`; None where it does not rise."""
        start = feasible(choice, x, slope)
        near = np.flatnonzero(choice.allowed & (loss <= NEAR * gap))
        near = near[np.argsort(loss[near], kind="stable")][: max(FEWEST_NEAR, 2 * choice.budget)]
        among = np.flatnonzero((start > 0.0) | (x > 0.0))
        among = np.union1d(np.union1d(among, near), chosen)
        curvature = self.objective.curvature(x, among)
        if curvature is None:
            return None
        model = Model(among, x, slope, curvature)
        y = model.best(choice, start, 1e-3 * gap)[0]
        new, new_slope = self.objective.relaxed(y)
        if new > score or not np.array_equal(start, x):
            return y, new, new_slope
        y = x + 0.3 * (y - x)
        new, new_slope = self.objective.relaxed(y)
        return (y, new, new_slope) if new > score else None

    def split(self, node: Node) -> list[tuple[Choice, FloatArray]]:
        """Return the parts of a node by whichever split the quadratic model likes best."""
        tried = self._splits(node)
        if not tried:
            return [(part, node.x) for part in children(node.choice, node.x)]
        among = np.flatnonzero(node.x > 0.0)
        curvature = self.objective.curvature(node.x, among)
        if curvature is None:
            return [(part, node.x) for part in tried[0]]
        model = Model(among, node.x, node.slope, curvature)
        best: list[tuple[Choice, FloatArray]] = []
        most = -1.0
        room = max(node.bound - self.floor, 1e-300)
        for parts in tried:
            product, starts = 1.0, []
            for part in parts:
                start = feasible(part, node.x, node.slope)
                fall = room
                if not np.any((start > 0.0) & (node.x == 0.0)):
                    start, fall = model.best(part, start, 1e-3 * room)
                product *= min(max(fall / room, 1e-3), 1.0)
                starts.append((part, start))
            if product > most:
                best, most = starts, product
        return best

    def _splits(self, node: Node) -> list[list[Choice]]:
        """Return the splits worth trying: use a group or not, or one half of its poses or not."""
        choice, x = node.choice, node.x
        mass = np.bincount(choice.group, x * choice.allowed, len(choice.used))
        spread = np.bincount(choice.group, np.minimum(x, 1.0 - x) * choice.allowed, len(mass))
        doubt = np.where(choice.used, spread, np.minimum(mass, 1.0 - mass))
        groups = np.argsort(-doubt, kind="stable")[:TRIED]
        found = []
        left = np.bincount(choice.group[choice.allowed], minlength=len(mass))
        for group in groups[doubt[groups] > FAINT]:
            if choice.used[group] and left[group] < 2:
                continue
            if choice.used[group]:
                found.append(halves(choice, int(group), x))
            else:
                found.append(use_or_not(choice, int(group)))
        return [parts for parts in found if parts]

    def _push(self, node: Node) -> None:
        self._pushed += 1
        heapq.heappush(self.open, (-node.bound, self._pushed, node))


@dataclass(slots=True)
class Model:
    """The quadratic model of a score at `x` (c,) over the candidates `among` (m,)."""

    among: IntArray
    x: FloatArray
    slope: FloatArray
    curvature: FloatArray

    def best(self, choice: Choice, start: FloatArray, gap: float) -> tuple[FloatArray, float]:
        """Maximise it over the placements of `choice`, from `start` (c,); return how far it falls.

        `gap` is how near the maximum must be.
        """
        among, here = self.among, restricted_choice(choice, self.among)
        y = start[among].copy()
        held = np.bincount(here.group, y, len(here.used)).astype(np.float64)
        slope = self.slope[among] + self.curvature @ (y - self.x[among])
        # who is not allowed must not gain weight
        slope[~here.allowed] = -1e300
        budget = float(choice.budget)
        exchange(
            y,
            slope,
            self.curvature,
            here.group,
            here.used[here.group],
            held,
            budget,
            gap / max(budget, 1.0),
            EXCHANGES,
        )
        y[y < FAINT] = 0.0
        step = y - self.x[among]
        fall = -float(self.slope[among] @ step + 0.5 * step @ self.curvature @ step)
        out = np.zeros(self.x.size)
        out[among] = y
        return out, fall


def margin(bound: float, floor: float) -> float:
    """Return what must be lost to `bound` to be below `floor`, whatever rounding did."""
    return bound - floor + SLACK * abs(floor)


def decided(
    choice: Choice, slope: FloatArray, chosen: IntArray, loss: FloatArray, most: float
) -> Choice:
    """Strike out who costs more than `most`, and use the groups whose absence would.

    `chosen` and `loss` (c,) are of `best_choice(choice, slope)`, whose tangent bounds the node's
    placements; those of interest are worth no less than that by more than `most`.
    """
    left = np.flatnonzero(choice.allowed)
    best = np.full(len(choice.used), -np.inf)
    np.maximum.at(best, choice.group[left], slope[left])
    taken = np.zeros(len(choice.used), dtype=np.bool_)
    taken[choice.group[chosen]] = True
    # without a group's member the best of those left over joins, if any is worth anything
    spare = best[~taken & (best > 0.0)] if chosen.size == choice.budget else np.empty(0)
    next_best = float(np.max(spare, initial=0.0))
    needed = taken & (best - next_best > most)
    return replace(without(choice, choice.allowed & (loss > most)), used=choice.used | needed)


def feasible(choice: Choice, x: FloatArray, slope: FloatArray) -> FloatArray:
    """Return `x` (c,) made a fractional choice of `choice`: a start, not the nearest one."""
    y = np.where(choice.allowed, x, 0.0)
    y /= np.maximum(np.bincount(choice.group, y, len(choice.used)), 1.0)[choice.group]
    held = np.bincount(choice.group, y, len(choice.used))
    for group in np.flatnonzero(choice.used & (held < 1.0)):
        members = np.flatnonzero((choice.group == group) & choice.allowed)
        weight = y[members] if np.any(y[members] > 0.0) else slope[members]
        y[members[np.argmax(weight)]] += 1.0 - held[group]
    free = ~choice.used[choice.group]
    over = float(np.sum(y)) - choice.budget
    if over > 0.0:
        total = float(np.sum(y[free]))
        y[free] *= max(0.0, 1.0 - over / total) if total > 0.0 else 0.0
    return y
