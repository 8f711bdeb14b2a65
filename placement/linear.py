"""The best placement where every candidate is worth a fixed amount: sums, not sets.

Bounds come down to this: a submodular score lies below a sum of gains, a concave one below its
tangent. With a budget and at most one of each group the best sum is exact and greedy finds it.
"""

from __future__ import annotations

import numpy as np

from models.geometry import FloatArray, IntArray
from placement.constraints import Constraints


def best_sum(constraints: Constraints, worth: FloatArray) -> tuple[IntArray, float]:
    """Maximise Σ_{i ∈ S} worth_i over placements S; return S (sorted) and the maximum.

    Required candidates count whatever their worth; of the rest only positive ones are taken,
    as a placement may hold fewer than the budget. `worth` is (c,).
    """
    usable = constraints.usable()
    usable[constraints.required] = False
    required = np.unique(constraints.required)
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
