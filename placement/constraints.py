"""What a placement must obey: the budget, one pose a group, required and forbidden poses."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from models.geometry import BoolArray, IntArray


class Infeasible(ValueError):  # noqa: N818 - reads as the fact it states
    """No placement can obey the constraints; the message names those that contradict."""


@dataclass(frozen=True, slots=True)
class Constraints:
    """Say which subsets of `n` candidates are placements.

    `budget` is the most candidates a placement may hold. `group` (n,) gives each candidate's
    group (its mount, under one-per-mount), −1 for none: a placement holds at most one of each.
    `required` and `forbidden` are sorted candidate indices.
    """

    n: int
    budget: int
    group: IntArray
    required: IntArray
    forbidden: IntArray

    def __post_init__(self) -> None:
        """Check shapes and ranges, and refuse contradictions by name."""
        if self.budget < 0:
            raise Infeasible(f"budget.cameras must be at least 0, got {self.budget}")
        if self.group.shape != (self.n,):
            raise ValueError(f"group must have shape ({self.n},), got {self.group.shape}")
        for name, indices in (("required", self.required), ("forbidden", self.forbidden)):
            if indices.size and (indices.min() < 0 or indices.max() >= self.n):
                bad = indices[(indices < 0) | (indices >= self.n)][0]
                raise ValueError(f"{name} must hold candidates 0…{self.n - 1}, got {bad}")
        both = np.intersect1d(self.required, self.forbidden)
        if both.size:
            raise Infeasible(f"candidate {both[0]} is both required and forbidden")
        if np.unique(self.required).size > self.budget:
            raise Infeasible(
                f"{self.required.size} required poses exceed budget.cameras = {self.budget}"
            )
        groups = self.group[self.required]
        groups = groups[groups >= 0]
        values, counts = np.unique(groups, return_counts=True)
        if np.any(counts > 1):
            first = values[counts > 1][0]
            pair = self.required[self.group[self.required] == first][:2]
            raise Infeasible(
                f"required candidates {pair[0]} and {pair[1]} share mount {first}, "
                "and budget.one_per_mount allows one"
            )

    def usable(self) -> BoolArray:
        """Mark the candidates (n,) that some placement may hold next to the required ones."""
        mask = np.ones(self.n, dtype=np.bool_)
        mask[self.forbidden] = False
        taken = self.group[self.required]
        taken = taken[taken >= 0]
        mask[np.isin(self.group, taken)] = False
        mask[self.required] = True
        return mask

    def addable(self, selected: IntArray) -> BoolArray:
        """Mark the candidates (n,) that may join `selected` now; none once the budget is used."""
        mask = np.zeros(self.n, dtype=np.bool_)
        if len(selected) >= self.budget:
            return mask
        mask[:] = True
        mask[self.forbidden] = False
        taken = self.group[selected]
        mask[np.isin(self.group, taken[taken >= 0])] = False
        mask[selected] = False
        return mask

    def violations(self, selected: Iterable[int]) -> list[str]:
        """List, in words, every constraint that `selected` breaks; empty when it is a placement."""
        chosen = np.asarray(list(selected), dtype=np.int64)
        found = []
        if chosen.size != np.unique(chosen).size:
            found.append("a candidate is selected twice")
        if chosen.size and (chosen.min() < 0 or chosen.max() >= self.n):
            return [*found, f"a selected candidate lies outside 0…{self.n - 1}"]
        if chosen.size > self.budget:
            found.append(f"{chosen.size} cameras exceed the budget of {self.budget}")
        groups = self.group[chosen]
        values, counts = np.unique(groups[groups >= 0], return_counts=True)
        found += [
            f"mount {v} holds {c} cameras" for v, c in zip(values, counts, strict=True) if c > 1
        ]
        missing = np.setdiff1d(self.required, chosen)
        found += [f"required candidate {i} is missing" for i in missing]
        found += [
            f"forbidden candidate {i} is selected" for i in np.intersect1d(self.forbidden, chosen)
        ]
        return found


def count_only(n: int, budget: int) -> Constraints:
    """Allow any `budget` of `n` candidates."""
    none = np.empty(0, dtype=np.int64)
    return Constraints(n, budget, np.full(n, -1, dtype=np.int64), none, none)
