"""Depth-first search below one node: relax, certify, fix, round, branch; all of it compiled.

A node fixes some candidates in and some out (`state`: 1, −1, 0 for free) and remembers x of its
parent's relaxation, where its own climb starts. Every number that prunes comes from
`placement.branch.certify`. The last one or two candidates of a design are found by enumeration.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from placement.branch.certify import best_sum, log_blocks, squares, total_square, upper
from placement.branch.climb import LOG_DET, climb, slopes_of
from placement.branch.small import (
    add_weighted,
    columns_of,
    descending,
    gram,
    inverse_factor,
    log_diagonal,
    sum_squares,
    times,
)
from placement.branch.swaps import gain_over, information_of, score_of

FREE, IN, OUT = 0, 1, -1
_EPS = 2.220446049250313e-16
_SHARE = 0.1  # a node that cannot be pruned is relaxed to this share of its distance
_STEPS = 24  # exchanges between two certificates


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
def relax(  # type: ignore[no-untyped-def]
    kind, projects, base, root, V, group, cost, left, priced,
    ids, T, m, x, price, cutoff, slack, rounds, hold, leave,
):  # fmt: skip
    """Bound a node: climb from x (p,), certify, until pruned or as good as it needs to be.

    Return (bound, best sum, price, constant, fixed, projected) of the best certificate; x, `hold`
    and `leave` (p,) are its, too. `left` is the money still there.
    """
    n, r, p, t = V.shape[2], V.shape[1], ids.size, T.size
    project = projects and kind == LOG_DET and not priced and m * r == n - t * r
    told, F = columns_of(V, T), columns_of(V, ids)
    start, ridge = 0.0, np.zeros(p)
    if project:
        start, G, along = _projected(told, F, r)
        d = G.shape[0]
        within = np.eye(d)
    else:
        G, d, along = F, n, ridge
        within = base.copy()
        add_weighted(within, told, 1, np.ones(t * r))
    local, distinct = _local_groups(group, ids)
    whole = not priced
    worth, prices = np.empty(p), np.zeros(p)
    slope, taken = np.empty(p), np.empty(p, np.bool_)
    hold_now, leave_now, kept = np.empty(p), np.empty(p), x.copy()
    W = np.empty((d, d))
    best, best_total, best_constant, best_fixed, best_price = np.inf, 0.0, 0.0, 0.0, price
    low, high = 0.0, np.inf  # prices known to be too low, and too high
    if whole:
        _fill(x, local, m)
    for turn in range(rounds):
        M = within.copy()
        add_weighted(M, G, r, x)
        if not inverse_factor(M, W):
            break
        theta = gram(W)
        logs = -2.0 * log_diagonal(W)
        squares_sum = sum_squares(W)
        fixed, constant = 0.0, logs
        if project:
            constant += start
            for a in range(p):
                ridge[a] = squares_sum * (1.0 + along[a])
            log_blocks(W, G, r, ridge, worth)
            value = constant
        elif kind == LOG_DET:
            fixed = total_square(W, root) + total_square(W, told)
            squares(W, G, r, worth)
            value = constant
        else:
            constant = squares_sum * (1.0 - 8.0 * n * _EPS)  # tr Θ
            fixed = total_square(theta, root) + total_square(theta, told)
            squares(theta, G, r, worth)
            value = -squares_sum
        over = 0.0
        if priced:
            spent = 0.0
            for a in range(p):
                prices[a] = price * cost[ids[a]]
                worth[a] -= prices[a]
                spent += x[a] * cost[ids[a]]
            fixed += price * left
            value += price * (left - spent)
            over = spent - left
        total = best_sum(worth, local, distinct, m, whole, leave_now, hold_now, taken)
        bound = upper(kind, project, priced, n, constant, fixed, total)
        bound += 64.0 * n * _EPS * (1.0 + abs(bound) + abs(constant))
        if bound < best:
            best, best_total, best_constant, best_fixed = bound, total, constant, fixed
            best_price = price
            for a in range(p):
                hold[a], leave[a], kept[a] = hold_now[a], leave_now[a], x[a]
            if best <= cutoff:
                break
        gap = bound - value
        enough = max(0.1 * slack, _SHARE * max(value - cutoff, 0.0))
        if gap <= enough:
            if not priced:
                break
            # the price that leaves no money over is the best: bisect, doubling at first
            if over > 1e-6 * (1.0 + left):
                low = price
                price = 2.0 * price if high == np.inf else 0.5 * (low + high)
                if price == 0.0:
                    price = _first_price(worth, cost, ids)
            elif over < -1e-3 * (1.0 + left) and price > 0.0:
                high = price
                price = 0.5 * (low + high)
            else:
                break
            if turn > rounds // 2 or (high - low) <= 1e-3 * high:
                break
        slopes_of(kind, theta, G, r, slope)
        if priced:
            for a in range(p):
                prices[a] = price * cost[ids[a]]
        climb(
            kind, theta, slope, G, r, x, m, local, distinct, prices, _STEPS,
            0.2 * enough / max(m, 1),
        )  # fmt: skip
    for a in range(p):
        x[a] = kept[a]
    return best, best_total, best_price, best_constant, best_fixed, project


@njit(cache=True)
def _first_price(worth, cost, ids):  # type: ignore[no-untyped-def]
    """Return a price to start from: the mean worth a unit of money of those that cost any."""
    total, count = 0.0, 0
    for a in range(ids.size):
        if cost[ids[a]] > 0.0:
            total += worth[a] / cost[ids[a]]
            count += 1
    return total / count if count else 0.0


@njit(cache=True)
def _projected(known, F, r):  # type: ignore[no-untyped-def]
    """Project on the complement of the columns `known` (n, q), where the prior is the identity.

    Return log det(I + knownᵀ known), G = Uᵀ F (n − q, columns), and for every candidate a bound on
    tr Fᵀ V (I + RRᵀ)⁻¹ Vᵀ F, V R = `known`.
    """
    n, q = known.shape
    p = F.shape[1] // r
    along = np.zeros(p)
    if q == 0:
        return 0.0, F, along
    # Householder reflections turn the columns into R and R^n's axes into [V, U].
    R, turned = known.copy(), F.copy()
    for e in range(q):
        v, norm = R[e:, e].copy(), 0.0
        for a in range(n - e):
            norm += v[a] * v[a]
        v[0] += np.sqrt(norm) if v[0] >= 0.0 else -np.sqrt(norm)
        square = 0.0
        for a in range(n - e):
            square += v[a] * v[a]
        if square > 0.0:
            for columns in (R, turned):
                for b in range(columns.shape[1]):
                    inner = 0.0
                    for a in range(n - e):
                        inner += v[a] * columns[e + a, b]
                    inner *= 2.0 / square
                    for a in range(n - e):
                        columns[e + a, b] -= inner * v[a]
    inside = np.eye(q)
    for a in range(q):
        for b in range(q):
            for e in range(max(a, b), q):
                inside[a, b] += R[a, e] * R[b, e]
    W, condition = np.empty((q, q)), 0.0
    for a in range(q):
        condition += inside[a, a]
    if not inverse_factor(inside, W):
        return np.inf, turned[q:].copy(), along
    inside = times(W, turned[:q].copy())
    for a in range(q):
        for b in range(p * r):
            along[b // r] += inside[a, b] ** 2
    doubt = 4.0 * q * _EPS * condition * sum_squares(W)
    return -2.0 * log_diagonal(W) + doubt, turned[q:].copy(), along * (1.0 + 1e-9)


@njit(cache=True)
def _local_groups(group, ids):  # type: ignore[no-untyped-def]
    """Number the groups of `ids` 0…p − 1; say whether no two share one."""
    p = ids.size
    number = np.full(group.size, -1, np.int64)
    local, count = np.empty(p, np.int64), 0
    for a in range(p):
        g = group[ids[a]]
        if number[g] < 0:
            number[g] = count
            count += 1
        local[a] = number[g]
    return local, count == p


@njit(cache=True)
def _fill(x, local, m):  # type: ignore[no-untyped-def]
    """Scale x to Σ x = m as far as its groups have room, then fill up in order."""
    total = np.sum(x)
    if total > m:
        for a in range(x.size):
            x[a] *= m / total
        return
    p = x.size
    for _ in range(4):
        held = np.zeros(p)
        for a in range(p):
            held[local[a]] += x[a]
        total = np.sum(x)
        lacking = m - total
        if lacking <= 1e-9:
            return
        for a in range(p):
            share = x[a] / total if total > 0.0 else 1.0 / p
            more = min(lacking * share, 1.0 - held[local[a]])
            if more > 0.0:
                x[a] += more
                held[local[a]] += more
    lacking = m - np.sum(x)
    for a in range(p):
        more = min(lacking, 1.0 - held[local[a]])
        if more > 0.0:
            x[a] += more
            held[local[a]] += more
            lacking -= more


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
