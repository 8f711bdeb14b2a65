"""Best paths to second order where each camera costs a price, over classes of predecessors.

The value V(e) of an arc e = j → k is that of the best path that ends with it: over the classes c
of cameras before j, V_c + g(k | j) − loss(e, c) − price, V_c the best of the arcs into j of that
class, with what they pay to pass for it.
One pass takes as long as there are losses, for all budgets at once.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from placement.sieve.classes import IMPOSSIBLE, STEPS


@njit(cache=True)
def forward(pairs, alone, classes, losses, price, values):  # type: ignore[no-untyped-def]
    """Fill `values` (m,), by source, with the best path that ends with each arc."""
    n_far, n_beyond = classes.n_far, classes.n_beyond
    best = np.empty(1 + n_far + n_beyond)
    for j in range(alone.size):
        begin, end = classes.out_of[j], classes.out_of[j + 1]
        if begin == end:
            continue
        one = np.full(classes.many[j], -np.inf)
        best[:] = -np.inf
        best[0] = alone[j] - price
        for a in range(classes.into[j], classes.into[j + 1]):
            v = values[classes.place[a]]
            best[classes.group[a]] = max(best[classes.group[a]], v + classes.extra[a])
            if classes.near[a]:
                one[classes.rank[a]] = v
        for e in range(begin, end):
            at = classes.row_at[e]
            most = best[0]
            for c in range(1, 1 + n_far):
                if losses[at + c] != IMPOSSIBLE:
                    most = max(most, best[c] - losses[at + c] / STEPS)
            if classes.ahead[e]:
                for c in range(one.size):
                    loss = losses[at + 1 + n_far + c]
                    if loss != IMPOSSIBLE:
                        most = max(most, one[c] - loss / STEPS)
            else:
                for c in range(1 + n_far, 1 + n_far + n_beyond):
                    if losses[at + c] != IMPOSSIBLE:
                        most = max(most, best[c] - losses[at + c] / STEPS)
            values[e] = most + pairs[j, classes.target[e]] - price


@njit(cache=True)
def backward(pairs, may_end, classes, losses, price, values):  # type: ignore[no-untyped-def]
    """Fill `values` (m,), by source, with the most that a path adds behind each arc."""
    n_far, n_beyond = classes.n_far, classes.n_beyond
    best = np.empty(1 + n_far + n_beyond)
    for j in range(may_end.size - 1, -1, -1):
        one = np.full(classes.many[j], may_end[j])
        best[:] = may_end[j]
        for e in range(classes.out_of[j], classes.out_of[j + 1]):
            at = classes.row_at[e]
            v = pairs[j, classes.target[e]] - price + values[e]
            if v == -np.inf:
                continue
            best[0] = max(best[0], v)
            for c in range(1, 1 + n_far):
                if losses[at + c] != IMPOSSIBLE:
                    best[c] = max(best[c], v - losses[at + c] / STEPS)
            if classes.ahead[e]:
                for c in range(one.size):
                    loss = losses[at + 1 + n_far + c]
                    if loss != IMPOSSIBLE:
                        one[c] = max(one[c], v - loss / STEPS)
            else:
                for c in range(1 + n_far, 1 + n_far + n_beyond):
                    if losses[at + c] != IMPOSSIBLE:
                        best[c] = max(best[c], v - losses[at + c] / STEPS)
        for a in range(classes.into[j], classes.into[j + 1]):
            v = best[classes.group[a]] + classes.extra[a]
            if classes.near[a]:
                v = max(v, one[classes.rank[a]])
            values[classes.place[a]] = v
