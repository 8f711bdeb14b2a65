"""Best paths to second order where each camera costs a price.

The value V(e) of an arc e = j → k is that of the best path that ends with it: over the cameras i
before j, V(i → j) + g(k | j) − loss(i, e) − price. Losses of cameras ahead to near ones are kept
one by one, all others are found again in each pass, many at a time (`placement.sieve.shared`). A
path that falls short of `need` even with the best that may follow to first order, `ahead`, goes no
further. Weights are above 0.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from placement.sieve.neighbours import IMPOSSIBLE, STEPS
from placement.sieve.shared import MARGIN, TERMS, put_left, put_right, raise_by, worth_of
from placement.sieve.told import congruent

LOOK = 16  # cameras between two looks at whether any more can be better


@njit(cache=True)
def wide_row6(a, t):  # type: ignore[no-untyped-def]
    """Return row `t` of a float32 array (t, 6) as six scalars of float64."""
    return (
        np.float64(a[t, 0]), np.float64(a[t, 1]), np.float64(a[t, 2]),
        np.float64(a[t, 3]), np.float64(a[t, 4]), np.float64(a[t, 5]),
    )  # fmt: skip


@njit(cache=True)
def put_before(told, near, a, j, at_early, weight, m, out):  # type: ignore[no-untyped-def]
    """Fill `out` (15,) with the numbers of E of arc a into j, at `early` or at `beyond`."""
    e = wide_row6(told.before, a)
    if near.near[a] or at_early:
        put_left(e, weight, out)
        return
    congruent(told.link[j], e, m)
    put_left((m[0, 0], m[0, 1], m[0, 2], m[1, 1], m[1, 2], m[2, 2]), weight, out)


@njit(cache=True)
def put_after(told, e, weight, out):  # type: ignore[no-untyped-def]
    """Fill `out` (15,) with the numbers of K of arc e."""
    put_right(wide_row6(told.after, e), weight, out)


@njit(cache=True)
def work_space(near):  # type: ignore[no-untyped-def]
    """Return columns and their best, on either side, for the most arcs of a camera; a row; E."""
    width = max(np.max(np.diff(near.out_of)), np.max(np.diff(near.into)))
    return (
        np.zeros((2, TERMS, width), np.float32),
        np.zeros((2, width), np.float32),
        np.empty(TERMS, np.float32),
        np.empty((3, 3)),
    )


@njit(cache=True)
def forward(  # type: ignore[no-untyped-def]
    gain, alone, near, told, losses, weight, price, ahead, need, values
):
    """Fill `values` (m,), by source, with the best path that ends with each arc.

    `gain` (m,) are the first-order gains, also by source; `ahead` (n,) is the most that may follow
    each camera.
    """
    n = alone.size
    columns, best, row, m = work_space(near)
    for j in range(n):
        begin, end = near.out_of[j], near.out_of[j + 1]
        if begin == end:
            continue
        # who comes, the best first
        first, value = near.into[j], np.empty(near.into[j + 1] - near.into[j])
        one = np.full(near.many[j], -np.inf)
        for q in range(value.size):
            v = values[near.place[first + q]]
            value[q] = v if v + ahead[j] >= need else -np.inf
            if near.near[first + q]:
                one[near.rank[first + q]] = value[q]
        order = np.argsort(-value)
        # the greatest value on either side: near ones are for those ahead no part of the products
        start = alone[j] - price
        tops = np.full(2, start)
        for q in range(value.size):
            tops[1] = max(tops[1], value[q])
            if not near.near[first + q]:
                tops[0] = max(tops[0], value[q])
        # who may follow, ahead and beyond
        many = np.zeros(2, np.int64)
        for e in range(begin, end):
            side = 0 if near.ahead[e] else 1
            put_after(told, e, 1.0, columns[side, :, many[side]])
            many[side] += 1
        best[:] = 0.0
        for side in range(2):
            if many[side] == 0 or tops[side] == -np.inf:
                continue
            best[side] = math.exp((start - tops[side]) / weight)
            for number in range(order.size):
                q = order[number]
                if value[q] == -np.inf:
                    break
                if side == 0 and near.near[first + q]:
                    continue
                share = math.exp((value[q] - tops[side]) / weight)
                if number % LOOK == 0 and share * (1.0 + 2.0 * MARGIN) <= np.min(
                    best[side, : many[side]]
                ):
                    break
                put_before(told, near, first + q, j, side == 0, share, m, row)
                raise_by(row, columns[side], many[side], best[side])
        many[:] = 0
        for e in range(begin, end):
            side = 0 if near.ahead[e] else 1
            most = worth_of(best[side, many[side]], tops[side], weight)
            many[side] += 1
            if side == 0:
                at = near.row_at[e]
                for c in range(one.size):
                    loss = losses[at + c]
                    if loss != IMPOSSIBLE:
                        most = max(most, one[c] - loss / STEPS)
            values[e] = most + gain[e] - price


@njit(cache=True)
def backward(  # type: ignore[no-untyped-def]
    gain, may_end, near, told, losses, weight, price, ahead, need, values, behind
):
    """Fill `behind` (m,), by source, with the most that a path adds behind each arc.

    Of arcs that no path worth having goes through by `values`, with −∞.
    """
    n = may_end.size
    columns, best, row, m = work_space(near)
    for j in range(n - 1, -1, -1):
        begin, end = near.out_of[j], near.out_of[j + 1]
        # who comes: far ones at `early`, all at `beyond`
        many = np.zeros(2, np.int64)
        one = np.full(near.many[j], may_end[j])
        for a in range(near.into[j], near.into[j + 1]):
            if not values[near.place[a]] + ahead[j] >= need:
                continue
            if not near.near[a]:
                put_before(told, near, a, j, True, 1.0, m, columns[0, :, many[0]])
                many[0] += 1
            put_before(told, near, a, j, False, 1.0, m, columns[1, :, many[1]])
            many[1] += 1
        if many[1] == 0:
            for a in range(near.into[j], near.into[j + 1]):
                behind[near.place[a]] = -np.inf
            continue
        # who may follow, the best first
        value = np.empty(end - begin)
        for e in range(begin, end):
            v = gain[e] - price + behind[e]
            value[e - begin] = v if values[e] + behind[e] >= need else -np.inf
        order = np.argsort(-value)
        tops = np.full(2, may_end[j])
        for e in range(begin, end):
            side = 0 if near.ahead[e] else 1
            tops[side] = max(tops[side], value[e - begin])
        best[:] = 0.0
        for side in range(2):
            if many[side] == 0 or tops[side] == -np.inf:
                continue
            best[side] = math.exp((may_end[j] - tops[side]) / weight)
            for number in range(order.size):
                e = begin + order[number]
                if value[e - begin] == -np.inf:
                    break
                if (side == 0) != near.ahead[e]:
                    continue
                share = math.exp((value[e - begin] - tops[side]) / weight)
                if number % LOOK == 0 and share * (1.0 + 2.0 * MARGIN) <= np.min(
                    best[side, : many[side]]
                ):
                    break
                put_after(told, e, share, row)
                raise_by(row, columns[side], many[side], best[side])
        for e in range(begin, end):
            if near.ahead[e] and value[e - begin] > -np.inf:
                at, v = near.row_at[e], value[e - begin]
                for c in range(one.size):
                    loss = losses[at + c]
                    if loss != IMPOSSIBLE:
                        one[c] = max(one[c], v - loss / STEPS)
        many[:] = 0
        for a in range(near.into[j], near.into[j + 1]):
            most = -np.inf
            if values[near.place[a]] + ahead[j] >= need:
                most = worth_of(best[1, many[1]], tops[1], weight)
                many[1] += 1
                if near.near[a]:
                    most = max(most, one[near.rank[a]])
                else:
                    most = max(most, worth_of(best[0, many[0]], tops[0], weight))
                    many[0] += 1
            behind[near.place[a]] = most


@njit(cache=True)
def losses_along(j, e, near, told, losses, weight, found):  # type: ignore[no-untyped-def]
    """Fill `found` with the losses along arc e out of j to each camera before j, in nats."""
    row, column, m = np.empty(TERMS), np.empty(TERMS), np.empty((3, 3))
    put_after(told, e, 1.0, column)
    for a in range(near.into[j], near.into[j + 1]):
        if near.ahead[e] and near.near[a]:
            loss = losses[near.row_at[e] + near.rank[a]]
            found[a - near.into[j]] = np.inf if loss == IMPOSSIBLE else loss / STEPS
            continue
        put_before(told, near, a, j, near.ahead[e], 1.0, m, row)
        product = row[TERMS - 1]
        for q in range(TERMS - 1):
            product += row[q] * column[q]
        found[a - near.into[j]] = -worth_of(product, 0.0, weight)
