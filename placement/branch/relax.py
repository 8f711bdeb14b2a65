"""The concave relaxation of one node: climb, certify, and find the price of money.

Weights are moved until the certificate (`placement.branch.certify`) is as near as it needs to be.
Where money is limited it is priced; the price that leaves none over is bracketed and bisected, from
the parent's price on. Any price gives a valid bound.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from placement.branch.certify import best_sum, log_blocks, squares, total_square, upper
from placement.branch.climb import LOG_DET, climb, slopes_of
from placement.branch.small import (
    add_weighted,
    columns_of,
    gram,
    inverse_factor,
    log_diagonal,
    sum_squares,
    times,
)

_EPS = 2.220446049250313e-16
_SHARE = 0.1  # a node that cannot be pruned is relaxed to this share of its distance
_STEPS = 24  # exchanges between two certificates


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
    growth = 1.1 if price > 0.0 else 2.0  # a parent's price is nearly right
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
            # the price that leaves no money over is the best: bisect once it is between two
            if over > 1e-6 * (1.0 + left):
                low = price
                price = growth * price if high == np.inf else 0.5 * (low + high)
                if price == 0.0:
                    price = _first_price(worth, cost, ids)
            elif over < -1e-3 * (1.0 + left) and price > 0.0:
                high = price
                price = price / growth if low == 0.0 and growth < 2.0 else 0.5 * (low + high)
            else:
                break
            growth = min(2.0, growth * growth)
            if turn > rounds // 2 or (high < np.inf and high - low <= 1e-3 * high):
                break
        slopes_of(kind, theta, G, r, slope)
        if priced:
            for a in range(p):
                prices[a] = price * cost[ids[a]]
        climb(
            kind, theta, slope, G, r, x, m, local, distinct, prices, np.int64(_STEPS),
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
