"""Lower bounds on the cost to the end: looked up for a label, and completed backward.

Backward, each label learns `togo`, a lower bound on the cost from its P to the end: the least,
over its arcs, of the arc's cost and the target's togo. Any label with m cameras at t whose P is
above λ ≤ 1 times another's has at least λ times its togo, as the map is concave in P with
nonnegative value at 0. So the labels of one sweep are the pruning table of the next.

A sweep that starts at the root also tells where placements below its threshold can pass at all:
each that has nothing pending at t, with m cameras so far, is represented by one of the labels
there, so its cost to go is at least the least of theirs, and there is none where no label is left.
All this holds for placements below the threshold only; the others cost the threshold anyway.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from models.geometry import FloatArray, IntArray
from placement.diagram.arrays import Table
from placement.diagram.order import below

SHRINKS = (1.0, 0.97, 0.9, 0.75, 0.5)  # the λ that are tried


@njit(cache=True)
def least_togo(p, lo, hi, table_p, table_togo):  # type: ignore[no-untyped-def]
    """Return a lower bound on the cost from `p` to the end, from rows lo…hi − 1 of a table.

    Rows are sorted by falling togo.
    """
    best = 0.0
    for n in range(lo, hi):
        togo = table_togo[n]
        if togo <= best:
            break
        q = (
            table_p[n, 0],
            table_p[n, 1],
            table_p[n, 2],
            table_p[n, 3],
            table_p[n, 4],
            table_p[n, 5],
        )
        for shrink in SHRINKS:
            if shrink * togo <= best:
                break
            if below(q, p, shrink):
                best = shrink * togo
                break
    return best


@njit(cache=True)
def hopes(road, span, price, table, cuts, out):  # type: ignore[no-untyped-def]
    """Fill `out` (t + 1, k + 2): least cost from a cluster that ends before t, or goes on.

    The cost to go from the floor, by the table, or what an earlier sweep's labels there need,
    `cuts` (t + 1, k + 1); or, with one camera more, from a later end.
    """
    floor_p, floor_cost = road.floor_p, road.floor_cost
    t_end, k = out.shape[0] - 1, out.shape[1] - 2
    for m in range(k + 2):
        out[t_end, m] = 0.0
    for t in range(t_end - 1, -1, -1):
        f = floor_p[t]
        q = (f[0], f[1], f[2], f[3], f[4], f[5])
        out[t, k + 1] = np.inf
        for m in range(k, -1, -1):
            best = cuts[t, m]
            if best < np.inf:
                best = max(best, least_togo(q, table.lo[t, m], table.hi[t, m], table.p, table.togo))
            more = 0 if price > 0.0 else m + 1
            for u in range(0 if price == 0.0 else 1, min(span, t_end - t + 1)):
                ahead = floor_cost[t + u] - floor_cost[t] + price + out[t + u, more]
                best = min(best, ahead)
            out[t, m] = best


@njit(cache=True)
def backward(arcs, source, target, cost, togo, best_arc):  # type: ignore[no-untyped-def]
    """Complete `togo`; best_arc is the arc that gives it, −1 for the end or the table.

    Arcs into a label were recorded before those that leave it.
    """
    for a in range(arcs - 1, -1, -1):
        c = cost[a] + togo[target[a]]
        if source[a] >= 0 and c < togo[source[a]]:
            togo[source[a]] = c
            best_arc[source[a]] = a


@njit(cache=True)
def least_by_cut(lo, hi, togo, out):  # type: ignore[no-untyped-def]
    """Raise `out` (t + 1, k + 1) to the least togo of the labels at each sample and count."""
    for t in range(lo.shape[0]):
        for m in range(lo.shape[1]):
            least = np.inf
            for n in range(lo[t, m], hi[t, m]):
                least = min(least, togo[n])
            out[t, m] = max(out[t, m], least)


def merged_table(
    old: Table, node_lo: IntArray, node_hi: IntArray, node_p: FloatArray, node_togo: FloatArray
) -> Table:
    """Put the labels of a sweep and the rows of `old` into one table."""
    lo, hi = np.zeros_like(old.lo), np.zeros_like(old.hi)
    size = int(np.sum(node_hi - node_lo) + np.sum(old.hi - old.lo))
    p, togo = np.empty((size, 6)), np.empty(size)
    used = _merge(
        old.lo, old.hi, old.p, old.togo, node_lo, node_hi, node_p, node_togo, lo, hi, p, togo
    )
    return Table(lo, hi, p[:used].copy(), togo[:used].copy())


@njit(cache=True)
def _merge(  # type: ignore[no-untyped-def]
    old_lo, old_hi, old_p, old_togo, new_lo, new_hi, new_p, new_togo, lo, hi, p, togo
):
    used = 0
    for t in range(new_lo.shape[0]):
        for m in range(new_lo.shape[1]):
            a, b = new_lo[t, m], new_hi[t, m]
            c, d = old_lo[t, m], old_hi[t, m]
            n = b - a + d - c
            values = np.empty(n)
            values[: b - a] = -new_togo[a:b]
            values[b - a :] = -old_togo[c:d]
            order = np.argsort(values)
            lo[t, m] = used
            for x in range(n):
                o = order[x]
                q = new_p[a + o] if o < b - a else old_p[c + o - (b - a)]
                # a row no better than an earlier one (greater togo) with a smaller P says nothing
                known = False
                for y in range(max(lo[t, m], used - 64), used):
                    known = True
                    for z in range(6):
                        if p[y, z] != q[z]:
                            known = False
                    if known:
                        break
                if known:
                    continue
                p[used] = q
                togo[used] = -values[o]
                used += 1
            hi[t, m] = used
    return used
