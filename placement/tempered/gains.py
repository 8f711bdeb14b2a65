"""Gains of cameras given one or two others and a background of fractional cameras.

Every kernel works on one drive with white errors. `base` (t, 3) is the background's information,
and candidates count with a share θ of theirs: the gain of i given j is

    g(i | j) = log det(Λ_0 + base + θ Λ_j + θ Λ_i) − log det(Λ_0 + base + θ Λ_j)

over the whole trajectory, Λ_0 the odometry's information, computed over i's window alone between
stored messages (`placement.objectives.windows.entropy` has the formula and its proof).
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit, prange

from placement.objectives.windows.filter import (
    RESCALE,
    add_rows,
    filter_forward,
    inform_backward,
    log_det_plus,
    parallel,
    predict,
    pull_back,
    put6,
    row6,
    update,
)

# A gain is a difference of sums of a few hundred logarithms, 1e-13 off each; far more is allowed.
GAIN_ABSOLUTE = 1e-9
GAIN_RELATIVE = 1e-9


@njit(cache=True, inline="always")
def rounded_up(gain):  # type: ignore[no-untyped-def]
    """Return a float32 that is no less than the exact gain."""
    if gain <= 0.0:
        return np.float32(GAIN_ABSOLUTE)
    # float32 rounds to within 6e-8 of the value
    return np.float32(gain * (1.0 + 1.3e-7 + GAIN_RELATIVE) + GAIN_ABSOLUTE)


@njit(cache=True)
def gain_over_window(indptr, indices, blocks, scale, i, steps, total, before, logs, later, through):  # type: ignore[no-untyped-def]
    """Return candidate i's gain; all messages must be right over its window, `before` at its start.

    `through` (t,): log dets up to and including t and log det(I + P_t Γ_t), as `walk` leaves it.
    """
    first, stop = indptr[i], indptr[i + 1]
    if first == stop:
        return 0.0
    isotropic = blocks.shape[1] == 1
    t = np.int64(indices[first])
    p = row6(before, t)
    log_sum, product = logs[t], 1.0
    for e in range(first, stop):
        u = np.int64(indices[e])
        while t < u:
            t += 1
            p = predict(p, steps[t])
            if t < u:
                q0, q1, q2, q3, q4, q5, det = update(p, total[t, 0], total[t, 1], total[t, 2])
                p = (q0, q1, q2, q3, q4, q5)
                product *= det
                if product > RESCALE:
                    log_sum += math.log(product)
                    product = 1.0
        jtt = scale * np.float64(blocks[e, 0])
        jtn, jnn = 0.0, jtt
        if not isotropic:
            jtn, jnn = scale * np.float64(blocks[e, 1]), scale * np.float64(blocks[e, 2])
        q0, q1, q2, q3, q4, q5, det = update(
            p, total[t, 0] + jtt, total[t, 1] + jtn, total[t, 2] + jnn
        )
        p = (q0, q1, q2, q3, q4, q5)
        product *= det
        if product > RESCALE:
            log_sum += math.log(product)
            product = 1.0
    return log_sum + math.log(product) + log_det_plus(p, row6(later, t)) - through[t]


@njit(cache=True)
def walk(steps, total, lo, hi, before, after, logs, later, through):  # type: ignore[no-untyped-def]
    """Renew the forward messages of samples lo…hi, from `before` and `logs` at `lo`."""
    p = row6(before, lo)
    log_sum = logs[lo]
    for t in range(lo, hi + 1):
        if t > lo:
            p = predict(p, steps[t])
            put6(before, t, p)
            logs[t] = log_sum
        q0, q1, q2, q3, q4, q5, det = update(p, total[t, 0], total[t, 1], total[t, 2])
        p = (q0, q1, q2, q3, q4, q5)
        put6(after, t, p)
        log_sum += math.log(det)
        through[t] = log_sum + log_det_plus(p, row6(later, t))


@njit(cache=True)
def walk_back(steps, total, lo, hi, later):  # type: ignore[no-untyped-def]
    """Renew the backward messages of samples lo…hi − 1, from `later` at `hi`."""
    g = row6(later, hi)
    for t in range(hi, lo, -1):
        g = (g[0] + total[t, 0], g[1] + total[t, 1], g[2], g[3] + total[t, 2], g[4], g[5])
        q = (steps[t, 4], steps[t, 5], steps[t, 6], steps[t, 7], steps[t, 8], steps[t, 9])
        g = pull_back(parallel(g, q), steps[t])
        put6(later, t - 1, g)


@njit(cache=True, parallel=True)
def add_pair_gains(  # type: ignore[no-untyped-def]
    indptr, indices, blocks, scale, steps, p0, base, weight, begin, end, alone, pairs
):
    """Add `weight` times the gains given each a in begin…end − 1, to row a of `pairs` (n, n).

    Only b > a are written. Given a = n, which is nobody, the gains go to `alone` (n,).
    """
    n, samples = alone.size, steps.shape[0]
    for a in prange(begin, end):
        total = base.copy()
        if a < n:
            one = np.ones(1)
            add_rows(indptr, indices, blocks, scale, one, np.arange(a, a + 1), total)
        before, after = np.empty((samples, 6)), np.empty((samples, 6))
        logs, through = np.empty(samples), np.empty(samples)
        later = np.empty((samples, 6))
        filter_forward(steps, p0, total, before, after, logs)
        inform_backward(steps, total, later)
        for t in range(samples):
            det = update(row6(before, t), total[t, 0], total[t, 1], total[t, 2])[6]
            through[t] = logs[t] + math.log(det) + log_det_plus(row6(after, t), row6(later, t))
        if a == n:
            for b in range(n):
                gain = gain_over_window(
                    indptr, indices, blocks, scale, b, steps, total, before, logs, later, through
                )
                alone[b] += weight * max(gain, 0.0)
        else:
            for b in range(a + 1, n):
                if indptr[b] == indptr[b + 1]:
                    continue
                gain = gain_over_window(
                    indptr, indices, blocks, scale, b, steps, total, before, logs, later, through
                )
                pairs[a, b] = rounded_up(np.float64(pairs[a, b]) + weight * max(gain, 0.0))


@njit(cache=True, parallel=True)
def add_triple_gains(  # type: ignore[no-untyped-def]
    indptr,
    indices,
    blocks,
    scale,
    steps,
    p0,
    base,
    weight,
    into,
    source,
    out_of,
    target,
    triple,
    nodes,
    out,
):
    """Add `weight` times the gains of k given h → j to `out`, for j in `nodes` and all h, k.

    Arcs are sorted by target, those into j are `into[j]:into[j + 1]` with their `source`; those out
    of j have their `target` in `out_of[j]:out_of[j + 1]`. The gains given arc a are
    `out[triple[a]:triple[a + 1]]`, in the order of its target's arcs out. Those that are −∞ stay.
    """
    n, samples = into.size - 1, steps.shape[0]
    first, last = np.empty(n, np.int64), np.empty(n, np.int64)
    for i in range(n):
        empty = indptr[i] == indptr[i + 1]
        first[i] = samples - 1 if empty else indices[indptr[i]]
        last[i] = 0 if empty else indices[indptr[i + 1] - 1]
    before0, after0 = np.empty((samples, 6)), np.empty((samples, 6))
    logs0, later0 = np.empty(samples), np.empty((samples, 6))
    filter_forward(steps, p0, base, before0, after0, logs0)
    inform_backward(steps, base, later0)
    one = np.ones(1)
    for place in prange(nodes.size):
        j = nodes[place]
        begin, end = out_of[j], out_of[j + 1]
        if begin == end or into[j] == into[j + 1]:
            continue
        low, high = first[j], last[j]
        for m in range(begin, end):
            low = min(low, first[target[m]])
            high = max(high, last[target[m]])
        before, after, later = before0.copy(), np.empty((samples, 6)), later0.copy()
        logs, through = logs0.copy(), np.empty(samples)
        total = base.copy()
        add_rows(indptr, indices, blocks, scale, one, np.arange(j, j + 1), total)
        for a in range(into[j], into[j + 1]):
            h = source[a]
            wanted = False
            for m in range(begin, end):
                if out[triple[a] + m - begin] > -np.inf:
                    wanted = True
            if not wanted:
                continue
            add_rows(indptr, indices, blocks, scale, one, np.arange(h, h + 1), total)
            start = min(low, first[h], first[j])
            back = max(last[h], last[j])
            walk_back(steps, total, min(start, low), back, later)
            # samples before `start` know of neither h nor j, those after `back` have base's future
            walk(steps, total, start, max(high, back), before, after, logs, later, through)
            for m in range(begin, end):
                k = target[m]
                if indptr[k] == indptr[k + 1] or out[triple[a] + m - begin] == -np.inf:
                    continue
                gain = gain_over_window(
                    indptr, indices, blocks, scale, k, steps, total, before, logs, later, through
                )
                at = triple[a] + m - begin
                out[at] = rounded_up(np.float64(out[at]) + weight * max(gain, 0.0))
            # undo: exactly, from the base
            for t in range(start, back + 1):
                for q in range(6):
                    later[t, q] = later0[t, q]
            for t in range(first[h], last[h] + 1):
                for q in range(3):
                    total[t, q] = base[t, q]
            for e in range(indptr[j], indptr[j + 1]):
                t = indices[e]
                for q in range(3):
                    total[t, q] = base[t, q]
            add_rows(indptr, indices, blocks, scale, one, np.arange(j, j + 1), total)
            put6(before, start, row6(before0, start))
            logs[start] = logs0[start]
            for t in range(start, max(high, back) + 1):
                put6(before, t, row6(before0, t))
                logs[t] = logs0[t]


@njit(cache=True)
def fill_pair_gains(into, out_of, target, triple, pairs, begin, out):  # type: ignore[no-untyped-def]
    """Set the gains of k given h → j to those given j alone, for j ≥ begin; −∞ stays."""
    for j in range(begin, into.size - 1):
        for a in range(into[j], into[j + 1]):
            for m in range(out_of[j], out_of[j + 1]):
                at = triple[a] + m - out_of[j]
                if out[at] > -np.inf:
                    out[at] = pairs[j, target[m]]
