"""Coverage by few cameras: every placement looked at, or beaten by a bound on all that begin so.

Where samples must be seen twice, linear programs tell little: half a camera here and half a camera
there cover what no camera covers. With a budget of a few, choosing them in order and leaving out
the beginnings that cannot be completed well enough is quicker than any tree of linear programs:

    f(S ∪ T) ≤ g(S ∪ T) ≤ g(S) + Σ_{j ∈ T} gain_g(j | S),   g(S) = Σ_t w_t min(looks, m)/m ≥ f(S),

as g is submodular; and the last camera is chosen by its gain in f itself, exactly.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from models.geometry import BoolArray, FloatArray, IntArray
from placement.constraints import Constraints
from placement.objectives.coverage import Coverage
from placement.problem import Run

# Sums of weights looked at in the worst case: a second or two.
MOST_WORK = 1e9
# Sums of a few hundred weights in another order differ by less, relative.
_SLACK = 1e-12


def best_few(
    objective: Coverage, constraints: Constraints, allowed: BoolArray, incumbent: float, run: Run
) -> tuple[list[int], float, int] | None:
    """Search all placements of the candidates `allowed` (c,) for one that beats `incumbent`.

    Return the best found (empty if none beats it), an upper bound on every placement, and how many
    beginnings were looked at; None where that is too much work, where cameras are required or must
    keep their distance, or where time ran out.
    """
    few = np.flatnonzero(allowed)
    k = min(constraints.budget, few.size)
    if constraints.required.size or constraints.separation_m or k < 2 or objective.partial:
        return None
    lengths = np.diff(objective.indptr)[few]
    if math.comb(few.size, k - 1) * float(lengths.sum()) > MOST_WORK:
        return None
    worth: FloatArray = objective.seen[few] @ objective.weights
    order = few[np.argsort(-worth, kind="stable")]
    cost = np.zeros(constraints.n) if constraints.cost is None else constraints.cost
    purse = constraints.purse if constraints.limits_money else math.inf
    best, chosen, nodes = incumbent, np.empty(0, dtype=np.int64), 0
    for first in range(order.size):
        if run.out_of_time():
            return None
        score, found, looked = _search_from(
            first,
            order,
            objective.indptr,
            objective.indices,
            objective.weights,
            objective.times,
            constraints.group,
            cost,
            purse,
            k,
            best,
            _SLACK,
        )
        nodes += looked
        if found.size:
            best, chosen = score, found
    return [int(i) for i in chosen], best * (1.0 + _SLACK), nodes


@njit(cache=True)
def _search_from(  # type: ignore[no-untyped-def]
    first: int,
    order: IntArray,
    indptr: IntArray,
    indices: NDArray[np.int32],
    weights: FloatArray,
    times: int,
    group: IntArray,
    cost: FloatArray,
    purse: float,
    k: int,
    incumbent: float,
    slack: float,
):
    """Search the placements that hold order[first] and otherwise only what comes after it."""
    n = len(order)
    counts = np.zeros(len(weights), np.int64)
    stack = np.zeros(k, np.int64)  # positions in `order`
    best, chosen, nodes = incumbent, np.zeros(0, np.int64), 0
    exact, shared = np.zeros(n), np.zeros(n)
    if cost[order[first]] > purse:
        return best, chosen, nodes
    stack[0] = first
    depth, spent, descend = 1, cost[order[first]], True
    for e in range(indptr[order[first]], indptr[order[first] + 1]):
        counts[indices[e]] += 1
    while depth > 0:
        if descend:
            # What each later candidate adds to f, and to g.
            nodes += 1
            f, g = 0.0, 0.0
            for t in range(len(weights)):
                if counts[t] >= times:
                    f += weights[t]
                g += weights[t] * min(counts[t], times) / times
            top = np.zeros(k)  # the greatest gains in g, ascending, of as many as may still come
            room = k - depth
            best_last, last = 0.0, -1
            for p in range(stack[depth - 1] + 1, n):
                i = order[p]
                fits = spent + cost[i] <= purse
                for d in range(depth):
                    if group[i] >= 0 and group[order[stack[d]]] == group[i]:
                        fits = False
                exact[p], shared[p] = 0.0, 0.0
                if not fits:
                    continue
                for e in range(indptr[i], indptr[i + 1]):
                    t = indices[e]
                    if counts[t] == times - 1:
                        exact[p] += weights[t]
                    if counts[t] < times:
                        shared[p] += weights[t] / times
                if exact[p] > best_last:
                    best_last, last = exact[p], p
                if room > 0 and shared[p] > top[0]:
                    at = 0
                    while at + 1 < room and top[at + 1] < shared[p]:
                        top[at] = top[at + 1]
                        at += 1
                    top[at] = shared[p]
            if f + (best_last if room > 0 else 0.0) > best * (1.0 + slack):
                best = f + (best_last if room > 0 else 0.0)
                size = depth + (1 if room > 0 and last >= 0 else 0)
                chosen = np.empty(size, np.int64)
                for d in range(depth):
                    chosen[d] = order[stack[d]]
                if size > depth:
                    chosen[depth] = order[last]
            bound = g
            for r in range(room):
                bound += top[r]
            if room >= 2 and bound > best * (1.0 + slack):
                stack[depth] = stack[depth - 1]
                depth += 1
                descend = False
                continue
            # Nothing below: go on beside the camera added last.
            i = order[stack[depth - 1]]
            for e in range(indptr[i], indptr[i + 1]):
                counts[indices[e]] -= 1
            spent -= cost[i]
            if depth == 1:
                return best, chosen, nodes
            descend = False
            continue
        # Take the next candidate for the last place that fits.
        p = stack[depth - 1] + 1
        while p < n:
            i = order[p]
            fits = spent + cost[i] <= purse
            for d in range(depth - 1):
                if group[i] >= 0 and group[order[stack[d]]] == group[i]:
                    fits = False
            if fits:
                break
            p += 1
        if p >= n:
            depth -= 1
            if depth == 0:
                return best, chosen, nodes
            i = order[stack[depth - 1]]
            for e in range(indptr[i], indptr[i + 1]):
                counts[indices[e]] -= 1
            spent -= cost[i]
            if depth == 1:
                return best, chosen, nodes
            continue
        stack[depth - 1] = p
        i = order[p]
        for e in range(indptr[i], indptr[i + 1]):
            counts[indices[e]] += 1
        spent += cost[i]
        descend = True
    return best, chosen, nodes
