"""The best placement where every candidate is worth a fixed amount: sums, not sets.

Bounds come down to this: a submodular score lies below a sum of gains, a concave one below its
tangent. With a budget and at most one of each group the best sum is exact and greedy finds it.
Money is priced (Lagrange): whatever the price, a bound; separation is left out, which keeps it one.
"""

from __future__ import annotations

import numpy as np

from models.geometry import FloatArray, IntArray
from placement.constraints import Constraints

_PRICE_STEPS = 40


def best_sum(constraints: Constraints, worth: FloatArray) -> tuple[IntArray, float]:
    """Maximise Σ_{i ∈ S} worth_i over placements S; return S (sorted) and the maximum.

    Required candidates count whatever their worth; of the rest only positive ones are taken,
    as a placement may hold fewer than the budget. `worth` is (c,). Money and separation are left
    out: the maximum bounds that of placements, and S may break them.
    """
    usable = constraints.usable()
    required = constraints.required
    if required.size:
        usable[required] = False
        required = np.unique(required)
    candidates = np.flatnonzero(usable & (worth > 0.0))
    group = constraints.group[candidates]
    grouped = candidates[group >= 0]
    if grouped.size:
        best = np.full(int(constraints.group.max()) + 1, -np.inf)
        np.maximum.at(best, constraints.group[grouped], worth[grouped])
        winners = grouped[worth[grouped] == best[constraints.group[grouped]]]
        _, first = np.unique(constraints.group[winners], return_index=True)
        candidates = np.concatenate([candidates[group < 0], winners[first]])
    room = constraints.budget - required.size
    if room < candidates.size:
        keep = np.argpartition(-worth[candidates], room - 1)[:room] if room else slice(0)
        candidates = candidates[keep]
    selected = np.sort(np.concatenate([required, candidates])).astype(np.int64)
    return selected, float(np.sum(worth[selected]))


def most_sum(constraints: Constraints, worth: FloatArray) -> float:
    """Return an upper bound on Σ_{i ∈ S} worth_i over placements S, exact where money is no limit.

    At any price λ ≥ 0 of money, Σ worth ≤ max_S Σ (worth − λ cost) + λ money; the best λ is found
    by bisection on what its S spends. `worth` is (c,).
    """
    bound = best_sum(constraints, worth)[1]
    cost = constraints.cost
    if cost is None or not constraints.limits_money:
        return bound

    def priced(price: float) -> tuple[float, float]:
        selected, total = best_sum(constraints, worth - price * cost)
        return total + price * constraints.purse, constraints.total_cost(selected)

    paying = constraints.usable() & (cost > 0.0) & (worth > 0.0)
    low, high = 0.0, float(np.max(worth[paying] / cost[paying], initial=0.0))
    for _ in range(_PRICE_STEPS):
        middle = 0.5 * (low + high)
        total, spent = priced(middle)
        bound = min(bound, total)
        low, high = (middle, high) if spent > constraints.purse else (low, middle)
    return bound
