"""A node of a search tree: which candidates remain, which groups must be used, and the best sum.

Candidates without a group get one of their own, so every decision is about groups: *use* one, or
shrink it (to nothing: leave it out; to one pose: choose it, once it must be used).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy import sparse

from models.geometry import BoolArray, FloatArray, IntArray
from placement.constraints import Constraints


@dataclass(frozen=True, slots=True)
class Choice:
    """Say which placements a node still allows.

    group (c,) numbers every candidate's group 0…g − 1, `allowed` (c,) marks the candidates that
    are left, `used` (g,) the groups of which a placement must hold one, `budget` the most in all.
    `side_matrix` (r, c) and `side_limits` (r,) are what else every placement keeps, A x ≤ b:
    `best_choice` ignores it, linear programs and `cut_bound` need not.
    """

    group: IntArray
    allowed: BoolArray
    used: BoolArray
    budget: int
    side_matrix: Any = field(default_factory=lambda: sparse.csr_array((0, 0)))
    side_limits: FloatArray = field(default_factory=lambda: np.empty(0))

    @property
    def feasible(self) -> bool:
        """Whether any placement is left."""
        left = np.zeros(len(self.used), dtype=np.bool_)
        left[self.group[self.allowed]] = True
        if not (self.used.sum() <= self.budget and np.all(left[self.used])):
            return False
        return not len(self.side_limits) or self._sides_can_hold()

    def _sides_can_hold(self) -> bool:
        """Whether the side rows admit the cheapest member of every group that must be used."""
        columns = np.flatnonzero(self.allowed & self.used[self.group])
        if not columns.size:
            return bool(np.all(self.side_limits >= 0.0))
        columns = columns[np.argsort(self.group[columns], kind="stable")]
        starts = np.flatnonzero(np.diff(self.group[columns], prepend=-1))
        least = np.minimum.reduceat(self.side_matrix[:, columns].toarray(), starts, axis=1)
        return bool(np.all(least.sum(axis=1) <= self.side_limits * (1.0 + 1e-9) + 1e-12))


def root_choice(constraints: Constraints) -> Choice:
    """Return the placements that `constraints` allow."""
    c = constraints.n
    alone = constraints.group < 0
    key = np.where(alone, constraints.group.max(initial=0) + 1 + np.arange(c), constraints.group)
    _, group = np.unique(key, return_inverse=True)
    group = group.astype(np.int64)
    used = np.zeros(int(group.max(initial=-1)) + 1, dtype=np.bool_)
    used[group[constraints.required]] = True
    matrix, limits = constraints.side_rows()
    return Choice(group, constraints.usable(), used, constraints.budget, matrix, limits)


def best_choice(choice: Choice, worth: FloatArray) -> tuple[IntArray, FloatArray]:
    """Maximise Σ worth over the placements of `choice`, exactly; worth (c,).

    Return the best placement, and for every candidate (c,) how much less the best placement that
    *holds* it is worth: 0 for the members of the best, infinity for candidates not allowed.
    Greedy is exact here, as placements are the independent sets of a (contracted) matroid.
    """
    c, g = len(worth), len(choice.used)
    nothing = np.empty(0, dtype=np.int64)
    best = np.full(g, -np.inf)
    left = np.flatnonzero(choice.allowed)
    np.maximum.at(best, choice.group[left], worth[left])
    winner = np.full(g, -1, dtype=np.int64)
    on_top = left[worth[left] == best[choice.group[left]]]
    winner[choice.group[on_top[::-1]]] = on_top[::-1]  # the lowest index wins a tie
    forced = np.flatnonzero(choice.used)
    free = np.flatnonzero(~choice.used & (best > 0.0))
    room = choice.budget - forced.size
    if room < free.size:
        free = free[np.argsort(-best[free], kind="stable")[:room]] if room > 0 else nothing
    taken = np.concatenate([forced, free])
    selected = np.sort(winner[taken])
    # What must leave for another group's member: nothing while there is room, else the least.
    price = 0.0 if taken.size < choice.budget else float(np.min(best[free], initial=np.inf))
    leaves = np.full(g, price)
    leaves[taken] = best[taken]
    loss = np.full(c, np.inf)
    loss[left] = np.maximum(leaves[choice.group[left]] - worth[left], 0.0)
    loss[selected] = 0.0
    return selected, loss


def without(choice: Choice, candidates: IntArray | BoolArray) -> Choice:
    """Return `choice` with some candidates no longer allowed."""
    allowed = choice.allowed.copy()
    allowed[candidates] = False
    return replace(choice, allowed=allowed)


def using(choice: Choice, group: int) -> Choice:
    """Return `choice` with one more group that must be used."""
    used = choice.used.copy()
    used[group] = True
    return replace(choice, used=used)


def restricted_choice(choice: Choice, keep: IntArray) -> Choice:
    """Return `choice` over the candidates `keep` alone; groups keep their numbers."""
    sides = choice.side_matrix[:, keep] if len(choice.side_limits) else choice.side_matrix
    return replace(
        choice, group=choice.group[keep], allowed=choice.allowed[keep], side_matrix=sides
    )
