"""Depth-first search below one node: relax, certify, fix, round, branch; all of it compiled.

A node fixes some candidates in and some out (`state`: 1, −1, 0 for free) and remembers x of its
parent's relaxation, where its own climb starts. Every number that prunes comes from
`placement.branch.certify`. The last one or two candidates of a design are found by enumeration.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from placement.branch.certify import upper
from placement.branch.climb import LOG_DET
from placement.branch.relax import relax
from placement.branch.small import (
    descending,
    inverse_factor,
    log_diagonal,
    sum_squares,
)
from placement.branch.swaps import gain_over, information_of, score_of

FREE, IN, OUT = 0, 1, -1
_EPS = 2.220446049250313e-16


@njit(cache=True)
def search(  # type: ignore[no-untyped-def]
    kind, projects, base, root, V, group, cost, purse, k, priced, slack,
    states, xs, bounds, prices, top, limit, rounds, best, chosen,
):  # fmt: skip
    """Work off the stack's first `top` nodes until it is empty or full, or `limit` were looked at.

    `base` (n, n) = root·rootᵀ is the prior, V (c, r, n) the candidates' columns, `group` (c,) their
    groups 0…c − 1, `cost` (c,) and `purse` matter if `priced`. A node whose bound is at most
    score + `slack` is done with. `chosen` (k,) takes the best design, −1 behind its last.
    Return (nodes left on the stack, nodes looked at, best score, the greatest bound closed).
    """
    c, r, n = V.shape
    nodes = 0
    closed = -np.inf
    ids, T = np.empty(c, np.int64), np.empty(c, np.int64)
    hold_all, leave_all = np.empty(c), np.empty(c)
    while top > 0 and nodes < limit and top + 2 <= bounds.size:
        top -= 1
        if bounds[top] <= best + slack:
            closed = max(closed, bounds[top])
            continue
        nodes += 1
        state, price = states[top].copy(), prices[top]
        t, p, spent, clash = _read(state, group, cost, purse, priced, T, ids)
        if clash or t > k or (priced and spent > purse):
            continue  # what must be in cannot be in together
        m = k - t
        if priced or m == 0 or p == 0:  # the node's fixed part is a design of its own
            best = _offer(kind, base, V, T, t, best, chosen)
            if m == 0 or p == 0:
                closed = max(closed, min(bounds[top], best))
                continue
        if not priced and (m == 1 or (m == 2 and r == 1 and kind == LOG_DET)):
            best, reached = _last_ones(kind, base, V, group, ids[:p], T, t, m, best, slack, chosen)
            closed = max(closed, min(bounds[top], reached))
            continue
        hold, leave, x = hold_all[:p], leave_all[:p], np.empty(p)
        for a in range(p):
            x[a] = xs[top, ids[a]]
        bound, total, price, constant, fixed, project = relax(
            kind, projects, base, root, V, group, cost, purse - spent, priced,
            ids[:p], T[:t], m, x, price, best + slack, slack, rounds, hold, leave,
        )  # fmt: skip
        bound = min(bound, bounds[top])
        if bound <= best + slack:
            closed = max(closed, bound)
            continue
        best = _round(kind, base, V, group, cost, purse, k, ids[:p], T, t, spent, x, best, chosen)
        branch, merit = -1, -np.inf
        for a in range(p):
            worst = upper(kind, project, priced, n, constant, fixed, total - hold[a])
            if worst <= best + slack:
                state[ids[a]] = OUT
                closed = max(closed, worst)
                continue
            without = upper(kind, project, priced, n, constant, fixed, total - leave[a])
            if without <= best + slack:
                state[ids[a]] = IN
                closed = max(closed, without)
                continue
            here = _merit(x[a])
            if here > merit:
                merit, branch = here, a
        for a in range(p):
            xs[top, ids[a]] = x[a]
        bounds[top], prices[top] = bound, price
        for i in range(c):
            states[top, i] = state[i]
        if branch < 0:  # all is fixed: one more look at what is left
            top += 1
            continue
        i = ids[branch]
        prices[top + 1] = price
        for a in range(c):
            states[top + 1, a], xs[top + 1, a] = state[a], xs[top, a]
        states[top, i], states[top + 1, i] = OUT, IN
        bounds[top] = min(
            bound, upper(kind, project, priced, n, constant, fixed, total - leave[branch])
        )
        bounds[top + 1] = min(
            bound, upper(kind, project, priced, n, constant, fixed, total - hold[branch])
        )
        top += 2
    return top, nodes, best, closed


@njit(cache=True)
def _read(state, group, cost, purse, priced, T, ids):  # type: ignore[no-untyped-def]
    """List who is in and who is free, striking out in place who cannot join those in any more.

    Return (how many are in, how many free, what those in cost, whether they exclude each other).
    """
    t, p, spent, clash = 0, 0, 0.0, False
    full = np.zeros(state.size, np.bool_)
    for i in range(state.size):
        if state[i] == IN:
            T[t] = i
            t += 1
            spent += cost[i]
            clash = clash or full[group[i]]
            full[group[i]] = True
    for i in range(state.size):
        if state[i] == FREE:
            if full[group[i]] or (priced and spent + cost[i] > purse):
                state[i] = OUT
            else:
                ids[p] = i
                p += 1
    return t, p, spent, clash


@njit(cache=True)
def _merit(x):  # type: ignore[no-untyped-def]
    """Return how much both children may be below: what log det loses at weight x gone, and full."""
    x = min(max(x, 1e-9), 1.0 - 1e-9)
    return (-np.log1p(-x) - x) * (1.0 - x)


@njit(cache=True)
def _offer(kind, base, V, T, t, best, chosen):  # type: ignore[no-untyped-def]
    """Keep a design if it is the best so far; return the best score."""
    score = score_of(kind, base, V, T, t)
    if score > best:
        for at in range(chosen.size):
            chosen[at] = T[at] if at < t else -1
        return score
    return best


@njit(cache=True)
def _round(kind, base, V, group, cost, purse, k, ids, T, t, spent, x, best, chosen):  # type: ignore[no-untyped-def]
    """Offer the design that takes the heaviest of x as long as they fit."""
    design = np.empty(k, np.int64)
    for at in range(t):
        design[at] = T[at]
    full = np.zeros(group.size, np.bool_)
    count = t
    for a in descending(x):
        i = ids[a]
        if count == k:
            break
        if full[group[i]] or spent + cost[i] > purse:
            continue
        full[group[i]] = True
        spent += cost[i]
        design[count] = i
        count += 1
    return _offer(kind, base, V, design, count, best, chosen)


@njit(cache=True)
def _last_ones(kind, base, V, group, ids, T, t, m, best, slack, chosen):  # type: ignore[no-untyped-def]
    """Look at every way to add the last one or two; return the best score and a bound on all."""
    n, r, p = V.shape[2], V.shape[1], ids.size
    reached = -np.inf
    if m == 1:
        for a in range(p):
            T[t] = ids[a]
            score = score_of(kind, base, V, T, t + 1)
            reached = max(reached, score + 64.0 * n * _EPS * (1.0 + abs(score)))
            best = _offer(kind, base, V, T, t + 1, best, chosen)
        return best, reached
    W, M = np.empty((n, n)), information_of(base, V, T, t)
    if not inverse_factor(M, W):
        return best, np.inf
    half, pulled = np.empty((p, r, n)), np.empty((r, n))
    block, right = np.empty((r, r)), np.empty((r, r))
    single, condition = np.empty(p), 0.0
    for a in range(n):
        condition += M[a, a]
    condition *= sum_squares(W)
    for a in range(p):
        single[a] = gain_over(kind, W, V, ids[a], half[a], pulled, block, right)
    # a prior of 1e-6 leaves a condition of 1e7 or so until the last ones are in
    here = -2.0 * log_diagonal(W) + 8.0 * n * _EPS * condition
    order = descending(single)
    for first in range(p):
        a = order[first]
        if here + 2.0 * single[a] <= best + slack:
            reached = max(reached, here + 2.0 * single[a])
            break
        for follow in range(first + 1, p):
            b = order[follow]
            if here + single[a] + single[b] <= best + slack:
                reached = max(reached, here + single[a] + single[b])
                break
            if group[ids[a]] == group[ids[b]]:
                continue
            cross = 0.0
            for e in range(n):
                cross += half[a, 0, e] * half[b, 0, e]
            # det(I₂ + …) = exp(s_a + s_b) − cross²
            share = min(cross * cross * np.exp(-single[a] - single[b]), 1.0 - 1e-15)
            both = here + single[a] + single[b] + np.log1p(-share)
            reached = max(reached, both)
            if both > best:
                T[t], T[t + 1] = ids[a], ids[b]
                best = _offer(kind, base, V, T, t + 2, best, chosen)
    return best, reached
