"""Labels that meet are merged downward: least cost, a Loewner lower bound of both covariances."""

from __future__ import annotations

import numpy as np
from numba import njit

from placement.diagram.arrays import CLASSES, NODES
from placement.diagram.order import below, block_join, meet

NEAR = 0.003  # the relative difference in cost at which labels inside clusters are kept apart
HOPELESS = 1e3  # an ε beyond which no two labels are near
FALLING = (0.99, 0.9, 0.7, 0.5, 0.25, 0.1, 0.01)  # shares of P that are tried as a lower bound


@njit(cache=True, inline="always")
def row(p, n):  # type: ignore[no-untyped-def]
    """Return row n of (·, 6) as a tuple."""
    return (p[n, 0], p[n, 1], p[n, 2], p[n, 3], p[n, 4], p[n, 5])


@njit(cache=True, inline="always")
def scaled(p, f):  # type: ignore[no-untyped-def]
    """Return f times a covariance (6,)."""
    return (f * p[0], f * p[1], f * p[2], f * p[3], f * p[4], f * p[5])


@njit(cache=True)
def thin(  # type: ignore[no-untyped-def]
    n,
    cost,
    p,
    rank,
    near,
    width,
    epsilon,
    slack,
    probing,
    assigned,
    kept_cost,
    kept_p,
    own_cost,
    own_p,
    own_near,
    own_rank,
    scratch_m,
    scratch_v,
):
    """Merge `n` labels into at most `width`; return (kept, the ε it took, merges).

    Labels are taken in the order of `rank`. A label is dropped if a kept one dominates it, and
    merged into a kept one whose own P is at most 1 + ε times its, and whose own cost is at most
    ε · near above. `assigned` (n,) tells which kept label stands for each.
    """
    order = np.argsort(rank[:n])
    least = rank[order[0]]
    while True:
        kept, merges = 0, 0
        fits = True
        for a0 in range(n):
            a = order[a0]
            q = row(p, a)
            c = cost[a]
            found = -1
            for b in range(0 if probing else kept):
                if kept_cost[b] <= c and below(row(kept_p, b), q, 1.0):
                    found = b
                    break
            if found >= 0:
                assigned[a] = found
                continue
            grow = epsilon * (1.0 + slack * (rank[a] - least))
            shrink = 1.0 / (1.0 + grow)
            for b in range(kept):
                if c >= own_cost[b] - grow * own_near[b] and below(row(own_p, b), q, shrink):
                    found = b
                    break
            if found < 0 and kept == width and epsilon > HOPELESS:
                found = 0  # singular covariances are below nothing: merge them all the same
            if found >= 0:
                b = found
                s = row(kept_p, b)
                low = scaled(s, shrink * (1.0 - 1e-12))
                if not below(low, q, 1.0):
                    # earlier merges moved the kept label: only its own P is known to be below q
                    low = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
                r = meet(s, q, low, scratch_m, scratch_v)
                for x in range(6):
                    kept_p[b, x] = r[x]
                if c < kept_cost[b]:
                    kept_cost[b] = c
                assigned[a] = b
                merges += 1
                continue
            if kept == width:
                fits = False
                break
            kept_cost[kept] = c
            own_cost[kept] = c
            own_near[kept] = near[a]
            own_rank[kept] = rank[a]
            for x in range(6):
                kept_p[kept, x] = q[x]
                own_p[kept, x] = q[x]
            assigned[a] = kept
            kept += 1
        if fits:
            return kept, epsilon, merges
        epsilon *= 1.5


@njit(cache=True)
def slot_of(parity, m, length, family, kind, k, span, families, slots):  # type: ignore[no-untyped-def]
    """Return the first of the slots for labels inside clusters of that count, end and class."""
    at = ((parity * (k + 1) + m) * (span + 1) + length) * families + family
    return (at * CLASSES + kind) * slots


@njit(cache=True, inline="always")
def second_class(second, span):  # type: ignore[no-untyped-def]
    """Return the class 1…CLASSES − 1 of a second view that lasts `second` samples more."""
    if second <= 0:
        return 1
    return min(CLASSES - 1, 2 + (second - 1) * (CLASSES - 2) // span)


@njit(cache=True)
def put_pending(  # type: ignore[no-untyped-def]
    lead, slots, q, cost, node, cost_of, near_of, p_of, togo, counter, scratch_m, scratch_v
):
    """Merge a label into one of the `slots` from `lead` on; return (slot, whether it was empty).

    The slot of nearest cost is taken, or an empty one if none is within NEAR of it: labels of
    unlike cost so far are unlike in what they know of the heading (by nearness of P, 34 % of a gap
    was left where this leaves 3 %). Information still pending is the caller's to merge.
    """
    best, gap, empty = -1, np.inf, -1
    for s in range(lead, lead + slots):
        if node[s] < 0:
            if empty < 0:
                empty = s
            continue
        d = abs(cost - near_of[s])
        if near_of[s] != 0.0:
            d /= abs(near_of[s])
        if d < gap:
            best, gap = s, d
    if best < 0 or (gap > NEAR and empty >= 0):
        s = empty
        node[s] = counter[NODES]
        togo[counter[NODES]] = np.inf
        counter[NODES] += 1
        cost_of[s] = cost
        near_of[s] = cost
        for x in range(6):
            p_of[s, x] = q[x]
        return s, True
    s = best
    p = row(p_of, s)
    if not below(p, q, 1.0):
        low = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        for shrink in FALLING:
            if below(p, q, shrink):
                low = scaled(p, shrink)
                break
        r = meet(p, q, low, scratch_m, scratch_v)
        for x in range(6):
            p_of[s, x] = r[x]
    cost_of[s] = min(cost_of[s], cost)
    return s, False


@njit(cache=True, inline="always")
def merge_block(block, j0, j1, j2, fresh):  # type: ignore[no-untyped-def]
    """Set `block` (3,) to J, or to the Loewner join with it unless `fresh`."""
    if fresh:
        block[0], block[1], block[2] = j0, j1, j2
    else:
        block[0], block[1], block[2] = block_join(block[0], block[1], block[2], j0, j1, j2)
