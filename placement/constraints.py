"""What a placement must obey: count, money, one pose a group, separation, required, forbidden."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import sparse

from models.geometry import BoolArray, FloatArray, IntArray
from placement.separation import cliques, too_near

# Prices are decimal: ten cameras of 0.1 fit into 1.0, whatever binary sums say.
MONEY_TOLERANCE = 1e-9


class Infeasible(ValueError):  # noqa: N818 - reads as the fact it states
    """No placement can obey the constraints; the message names those that contradict."""


@dataclass(frozen=True, slots=True)
class Constraints:
    """Say which subsets of `n` candidates are placements.

    `budget` is the most candidates a placement may hold. `group` (n,) gives each candidate's
    group (its mount, under one-per-mount), −1 for none: a placement holds at most one of each.
    `required` and `forbidden` are sorted candidate indices. `cost` (c,) is what each costs, and
    `money` the most that all of them may; `place_m` (c, 2) is where each stands, and cameras at
    different places are at least `separation_m` apart (both to 1e-9 relative).
    """

    n: int
    budget: int
    group: IntArray
    required: IntArray
    forbidden: IntArray
    cost: FloatArray | None = None
    money: float = math.inf
    place_m: FloatArray | None = None
    separation_m: float = 0.0

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
                f"required candidates {pair[0]} and {pair[1]} share mount or group {first}, "
                "and budget.one_per_mount or budget.groups allows one"
            )
        self._check_money()
        self._check_separation()

    def _check_money(self) -> None:
        if math.isnan(self.money) or self.money < 0.0:
            raise ValueError(f"budget.money must be at least 0, got {self.money}")
        if self.cost is None:
            if not math.isinf(self.money):
                raise ValueError(f"cost must be given with budget.money = {self.money:g}, got None")
            return
        if self.cost.shape != (self.n,):
            raise ValueError(f"cost must have shape ({self.n},), got {self.cost.shape}")
        bad = ~(np.isfinite(self.cost) & (self.cost >= 0.0))
        if bad.any():
            i = int(np.argmax(bad))
            raise ValueError(f"cost[{i}] must be finite and at least 0, got {self.cost[i]}")
        spent = self.total_cost(np.unique(self.required))
        if spent > self.purse:
            raise Infeasible(
                f"the {self.required.size} required poses cost {spent:.10g} and exceed "
                f"budget.money = {self.money:.10g}"
            )

    def _check_separation(self) -> None:
        if not (math.isfinite(self.separation_m) and self.separation_m >= 0.0):
            raise ValueError(f"budget.separation_m must be at least 0, got {self.separation_m}")
        if not self.separation_m:
            return
        if self.place_m is None or self.place_m.shape != (self.n, 2):
            raise ValueError(f"place_m must have shape ({self.n}, 2) with budget.separation_m")
        for at, i in enumerate(self.required):
            near = too_near(self.place_m[self.required[:at]], self.place_m[i], self.separation_m)
            if near.any():
                other = self.required[int(np.argmax(near))]
                apart = float(np.hypot(*(self.place_m[i] - self.place_m[other])))
                raise Infeasible(
                    f"required candidates {other} and {i} stand {apart:.6g} m apart, "
                    f"and budget.separation_m wants {self.separation_m:g}"
                )

    @property
    def purse(self) -> float:
        """The most that cameras may cost, rounding of decimal prices allowed for."""
        return self.money * (1.0 + MONEY_TOLERANCE)

    @property
    def limits_money(self) -> bool:
        """Whether money could run out before everything allowed is bought."""
        return self.cost is not None and not math.isinf(self.money)

    def beyond_matroid(self) -> tuple[str, ...]:
        """Name the constraints that are not a budget with at most one of each group.

        Methods made for those alone must refuse these; as a *bound* ignoring them stays valid.
        """
        money = ("budget.money",) if self.limits_money else ()
        return money + (("budget.separation_m",) if self.separation_m else ())

    def total_cost(self, selected: IntArray) -> float:
        """Return what `selected` costs; 0 where nothing has a price."""
        return 0.0 if self.cost is None else math.fsum(self.cost[selected])

    def usable(self) -> BoolArray:
        """Mark the candidates (n,) that some placement may hold next to the required ones."""
        mask = np.ones(self.n, dtype=np.bool_)
        mask[self.forbidden] = False
        if self.required.size:
            taken = self.group[self.required]
            mask[np.isin(self.group, taken[taken >= 0])] = False
        if self.limits_money or self.separation_m:
            mask &= self._compatible(np.unique(self.required))
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
        taken = taken[taken >= 0]
        if taken.size:
            mask[np.isin(self.group, taken)] = False
        if self.limits_money or self.separation_m:
            mask &= self._compatible(selected)
        mask[selected] = False
        return mask

    def _compatible(self, selected: IntArray) -> BoolArray:
        """Mark the candidates (c,) that money and separation allow beside `selected`."""
        mask = np.ones(self.n, dtype=np.bool_)
        if self.cost is not None and self.limits_money:
            mask &= self.cost <= self.purse - self.total_cost(selected)
        if self.place_m is not None and self.separation_m:
            for i in selected:
                mask &= ~too_near(self.place_m, self.place_m[i], self.separation_m)
        return mask

    def trimmed(self, order: IntArray) -> IntArray:
        """Return a placement: the required candidates, then those of `order` that still fit.

        Sorted; what does not fit beside those before it is left out.
        """
        chosen = [int(i) for i in np.unique(self.required)]
        for i in order:
            if self.addable(np.array(chosen, dtype=np.int64))[i]:
                chosen.append(int(i))
        return np.sort(np.array(chosen, dtype=np.int64))

    def side_rows(self) -> tuple[Any, FloatArray]:
        """List what the matroid leaves out as linear rows: A (m, c) CSR and b (m,) with A x ≤ b.

        Money is one row, scaled so that b = 1. Separation is one row for each of a set of cliques
        of places that are too near each other: at most one camera stands on any of them. Where a
        place may hold several cameras its cliques are left out, so the rows are a relaxation:
        every placement satisfies them, and other sets may.
        """
        rows: list[Any] = []
        if self.cost is not None and self.limits_money:
            scale = self.purse if self.purse > 0.0 else 1.0
            rows.append(sparse.csr_array(self.cost[None, :] / scale))
        limits = [1.0 if self.purse > 0.0 else 0.0] * len(rows)
        if self.place_m is not None and self.separation_m:
            found = cliques(self.place_m, self.group, self.separation_m)
            rows.append(found)
            limits += [1.0] * found.shape[0]
        if not rows:
            return sparse.csr_array((0, self.n)), np.empty(0)
        return sparse.csr_array(sparse.vstack(rows)), np.array(limits)

    def linear_rows(self) -> tuple[Any, FloatArray]:
        """List every constraint but required and forbidden as A x ≤ b: budget, groups, the sides.

        The first row is the count, then one for each group, then `side_rows`.
        """
        grouped = np.flatnonzero(self.group >= 0)
        values, row = np.unique(self.group[grouped], return_inverse=True)
        groups = sparse.csr_array(
            (np.ones(grouped.size), (row, grouped)), shape=(len(values), self.n)
        )
        sides, limits = self.side_rows()
        matrix = sparse.vstack([sparse.csr_array(np.ones((1, self.n))), groups, sides])
        upper = np.concatenate([[float(self.budget)], np.ones(len(values)), limits])
        return sparse.csr_array(matrix), upper

    def violations(self, selected: Iterable[int]) -> list[str]:
        """List, in words, every constraint that `selected` breaks; empty when it is a placement."""
        chosen = np.asarray(list(selected), dtype=np.int64)
        names = chosen.tolist()  # of few, Python's sets are ten times as fast as NumPy's
        distinct = set(names)
        found = []
        if len(distinct) < len(names):
            found.append("a candidate is selected twice")
        if names and (min(names) < 0 or max(names) >= self.n):
            return [*found, f"a selected candidate lies outside 0…{self.n - 1}"]
        if len(names) > self.budget:
            found.append(f"{len(names)} cameras exceed the budget of {self.budget}")
        held = Counter(self.group[chosen].tolist())
        found += [
            f"mount {v} holds {held[v]} cameras" for v in sorted(held) if v >= 0 and held[v] > 1
        ]
        missing = sorted(set(self.required.tolist()) - distinct)
        found += [f"required candidate {i} is missing" for i in missing]
        if self.forbidden.size:
            both = np.intersect1d(self.forbidden, chosen)
            found += [f"forbidden candidate {i} is selected" for i in both]
        if self.limits_money and self.total_cost(chosen) > self.purse:
            spent = self.total_cost(chosen)
            found.append(f"the cameras cost {spent:.10g}, and there is {self.money:.10g}")
        if self.place_m is not None and self.separation_m:
            for at, i in enumerate(chosen):
                near = too_near(self.place_m[chosen[:at]], self.place_m[i], self.separation_m)
                found += [
                    f"candidates {j} and {i} stand nearer than {self.separation_m:g} m"
                    for j in chosen[:at][near]
                ]
        return found


def count_only(n: int, budget: int) -> Constraints:
    """Allow any `budget` of `n` candidates."""
    none = np.empty(0, dtype=np.int64)
    return Constraints(n, budget, np.full(n, -1, dtype=np.int64), none, none)
