"""Gains of cameras given one or two others on a chain that has the background taken in.

The gain of b given a is

    g(b | a) = log det(Λ' + θ Λ_a + θ Λ_b) − log det(Λ' + θ Λ_a)

over the whole trajectory, Λ' the information of odometry and background (`tempered.process`), Λ_i
with a persistent camera's offsets marginalised. Cameras out of each other's sight depend on one
another only through the car's covariance where the later window begins (`tempered.crossings`).
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from placement.objectives.windows.filter import put6, row6
from placement.tempered.crossings import ROW, after, cross, run_through, work_space, worth
from placement.tempered.process import carry, predict_ahead, prior_at, step_on

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


@njit(cache=True, parallel=True)
def add_pair_gains(process, cameras, rows, alone, extra, alive, weight, begin, end, pairs):  # type: ignore[no-untyped-def]
    """Add `weight` times the gains given each a in begin … end − 1 to row a of `pairs` (n, n).

    `rows` (n, ROW) are each camera's own stretch and `alone` (n,) its gain given nobody. Where they
    lack a piece of what a camera sees, `extra` (n,) is the most that this adds. Pairs not `alive`
    are −∞.
    """
    for a in prange(begin, end):
        _pair_gains_of(a, process, cameras, rows, alone, extra, alive, weight, pairs)


@njit(cache=True)
def _pair_gains_of(a, process, cameras, rows, alone, extra, alive, weight, pairs):  # type: ignore[no-untyped-def]
    n = alone.size
    gains = np.empty(n)
    gains_given(a, process, cameras, rows, alone, extra, alive[a], n, gains)
    for b in range(a + 1, n):
        if not alive[a, b]:
            pairs[a, b] = -np.inf
        elif cameras.last[b] >= 0:
            pairs[a, b] = rounded_up(np.float64(pairs[a, b]) + weight * gains[b])


@njit(cache=True)
def gains_given(a, process, cameras, rows, alone, extra, wanted, stop, gains):  # type: ignore[no-untyped-def]
    """Fill `gains` (n,) with the gains given camera a of those b in a + 1 … stop − 1 `wanted` (n,).

    0 for the blind; `rows`, `alone` and `extra` as in `add_pair_gains`.
    """
    first, last = cameras.first, cameras.last
    farthest = -1
    for b in range(a + 1, stop):
        if wanted[b] and last[b] >= 0 and first[b] > last[a]:
            farthest = max(farthest, first[b])
    p = cameras.offsets.shape[2]
    space = work_space(2, p)
    ahead, row = np.empty((farthest + 1, 6)), np.empty(ROW)
    both = np.empty(2, np.int64)
    both[0] = a
    given = 0.0
    if last[a] >= 0:
        start = prior_at(process, first[a])
        given = worth(start, rows[a])
        if farthest > last[a]:
            predict_ahead(process, after(start, rows[a]), last[a], farthest, ahead)
    for b in range(a + 1, stop):
        if not wanted[b]:
            continue
        if last[b] < 0:
            gains[b] = 0.0
            continue
        if last[a] < 0:
            gain = alone[b]
        elif first[b] > last[a]:
            gain = worth(row6(ahead, first[b]), rows[b])
        else:
            both[1] = b
            s = min(first[a], first[b])
            cross(process, cameras, both, s, max(last[a], last[b]), space, row)
            gain = worth(prior_at(process, s), row) - given
        if not gain <= alone[b]:  # nor where it is no number
            gain = alone[b]
        gains[b] = max(gain, 0.0) + extra[b]


@njit(cache=True, parallel=True)
def add_triple_gains(  # type: ignore[no-untyped-def]
    process,
    cameras,
    rows,
    alone,
    extra,
    exact,
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

    Where h and the pair j, k see the same stretch, the gain is given j and what h saw before that
    stretch, unless `exact`; less to be conditioned on is valid. `rows`, `alone`, `extra`: as for
    pairs.
    """
    for place in prange(nodes.size):
        _triple_gains_of(
            nodes[place], process, cameras, rows, alone, extra, exact, weight,
            into, source, out_of, target, triple, out,
        )  # fmt: skip


@njit(cache=True)
def _triple_gains_of(  # type: ignore[no-untyped-def]
    j, process, cameras, rows, alone, extra, exact, weight,
    into, source, out_of, target, triple, out,
):  # fmt: skip
    # apart from the parallel loop, whose body takes numba twice as long
    p = cameras.offsets.shape[2]
    first, last = cameras.first, cameras.last
    samples = process.prior.shape[0]
    begin, end = out_of[j], out_of[j + 1]
    if begin == end or into[j] == into[j + 1]:
        return
    space = work_space(3, p)
    none = np.empty((3 + 3 * p, 0))
    two, three, one = np.empty(2, np.int64), np.empty(3, np.int64), np.empty(1, np.int64)
    by_h, ahead, row = np.empty((samples, 6)), np.empty((samples, 6)), np.empty(ROW)
    # what j and each k that meets it make of their stretch together
    joint = np.empty((end - begin, ROW))
    farthest = 0
    for m in range(begin, end):
        k = target[m]
        if last[k] < 0:
            continue
        farthest = max(farthest, first[k])
        if last[j] >= 0 and first[k] <= last[j]:
            two[0], two[1] = j, k
            s = min(first[j], first[k])
            cross(process, cameras, two, s, max(last[j], last[k]), space, joint[m - begin])
    for a in range(into[j], into[j + 1]):
        h = source[a]
        wanted = False
        for m in range(begin, end):
            if out[triple[a] + m - begin] > -np.inf:
                wanted = True
        if not wanted:
            continue
        # `by_h` from h's first sample on: the car as h knows it; until then nobody does
        h_from = samples
        if last[h] >= 0:
            h_from = first[h]
            low = max(first[j] if last[j] >= 0 else farthest, last[h])
            set_covariance(space[0], prior_at(process, h_from))
            one[0] = h
            run_through(process, cameras, one, h_from, last[h], space, none, by_h)
            predict_ahead(process, row6(by_h, last[h]), last[h], max(low, farthest), by_h)
        # `ahead` behind both
        behind = -1
        both_worth = 0.0
        if last[j] >= 0:
            if last[h] < 0:
                p_j = prior_at(process, first[j])
                p_end, behind = after(p_j, rows[j]), last[j]
            elif first[j] > last[h]:
                p_j = row6(by_h, first[j])
                p_end, behind = after(p_j, rows[j]), last[j]
            else:
                two[0], two[1] = h, j
                s, behind = min(first[h], first[j]), max(last[h], last[j])
                cross(process, cameras, two, s, behind, space, row)
                both_worth = worth(prior_at(process, s), row)
                p_end = after(prior_at(process, s), row)
            predict_ahead(process, p_end, behind, farthest, ahead)
        elif last[h] >= 0:
            behind = last[h]
            predict_ahead(process, row6(by_h, last[h]), behind, farthest, ahead)
        for m in range(begin, end):
            k = target[m]
            at = triple[a] + m - begin
            if last[k] < 0 or out[at] == -np.inf:
                continue
            if behind < 0:
                gain = alone[k]
            elif first[k] > behind:
                gain = worth(row6(ahead, first[k]), rows[k])
            elif last[j] < 0:
                gain = alone[k]
            else:
                s = min(first[j], first[k])
                if exact and last[h] >= s:
                    three[0], three[1], three[2] = h, j, k
                    s = min(s, first[h])
                    stop = max(max(last[h], last[j]), last[k])
                    set_covariance(space[0], prior_at(process, s))
                    gain = run_through(
                        process, cameras, three, s, stop, space, none, np.empty((0, 6))
                    )
                    gain -= cameras.own[h] + cameras.own[j] + cameras.own[k]
                    if both_worth == 0.0:
                        p_h = prior_at(process, first[h])
                        both_worth = worth(p_h, rows[h]) + worth(row6(by_h, first[j]), rows[j])
                    gain -= both_worth
                else:
                    # the car as it comes to s; h's later measurements are left out
                    if s > h_from:
                        p_s = ahead_of(process, row6(by_h, s - 1), s)
                    else:
                        p_s = prior_at(process, s)
                    p_j = carry(process, p_s, s, first[j])
                    if first[k] <= last[j]:
                        gain = worth(p_s, joint[m - begin]) - worth(p_j, rows[j])
                    else:
                        p_k = carry(process, after(p_j, rows[j]), last[j], first[k])
                        gain = worth(p_k, rows[k])
            if not gain <= alone[k]:
                gain = alone[k]
            gain = max(gain, 0.0) + extra[k]
            out[at] = rounded_up(np.float64(out[at]) + weight * gain)


@njit(cache=True)
def set_covariance(m, p):  # type: ignore[no-untyped-def]
    """Write six numbers as the car's part of `m`."""
    m[0, 0], m[1, 1], m[2, 2] = p[0], p[3], p[5]
    m[0, 1], m[0, 2], m[1, 2] = p[1], p[2], p[4]
    m[1, 0], m[2, 0], m[2, 1] = p[1], p[2], p[4]


@njit(cache=True, inline="always")
def ahead_of(process, p, t):  # type: ignore[no-untyped-def]
    """Return the covariance at sample t of a car that had `p` one sample before."""
    return step_on(p, process.f, process.q, t)


@njit(cache=True)
def set_gains(process, cameras, rows, held, targets):  # type: ignore[no-untyped-def]
    """Return the log det of the positions `held` together with each of `targets` (m,).

    Windows that overlap, or are bridged by others, are filtered together, from the last sample
    before them where no camera is in view; what lies before is filtered once.
    """
    p = cameras.offsets.shape[2]
    first, last = cameras.first, cameras.last
    samples = process.prior.shape[0]
    seeing = held[last[held] >= 0]
    order = np.argsort(first[seeing], kind="mergesort")
    seeing = seeing[order]
    space = work_space(seeing.size + 1, p)
    none = np.empty((3 + (seeing.size + 1) * p, 0))
    # clusters of windows: members order begins[c]:begins[c + 1], their samples, and log dets
    begins = np.empty(seeing.size + 1, np.int64)
    count, reach = 0, -1
    for i in range(seeing.size):
        if first[seeing[i]] > reach:
            begins[count] = i
            count += 1
        reach = max(reach, last[seeing[i]])
    begins[count] = seeing.size
    entry = np.empty((count, 6))
    ends, value = np.empty(count, np.int64), np.empty(count)
    car = np.empty((samples, 6))
    total = 0.0
    ahead = process.prior.copy()
    for c in range(count):
        members = seeing[begins[c] : begins[c + 1]]
        start, stop = first[members[0]], 0
        for i in members:
            stop = max(stop, last[i])
        put6(entry, c, row6(ahead, start))
        set_covariance(space[0], row6(ahead, start))
        value[c] = run_through(process, cameras, members, start, stop, space, none, car)
        for i in members:
            value[c] -= cameras.own[i]
        total += value[c]
        ends[c] = stop
        beyond = first[seeing[begins[c + 1]]] if c + 1 < count else samples - 1
        predict_ahead(process, row6(car, stop), stop, beyond, ahead)
    found = np.empty(targets.size)
    for m in range(targets.size):
        k = targets[m]
        if last[k] < 0:
            found[m] = total
            continue
        if count == 0 or first[k] > ends[count - 1]:
            found[m] = total + worth(row6(ahead, first[k]), rows[k])
            continue
        # from the first cluster that ends at or after k's first sample
        c = count - 1
        while c > 0 and ends[c - 1] >= first[k]:
            c -= 1
        members = np.empty(seeing.size - begins[c] + 1, np.int64)
        members[:-1] = seeing[begins[c] :]
        members[-1] = k
        start, stop = first[k], last[k]
        for i in members:
            start, stop = min(start, first[i]), max(stop, last[i])
        kept = 0.0
        for d in range(c):
            kept += value[d]
        before = row6(entry, c)
        if first[k] < first[seeing[begins[c]]]:
            before = prior_at(process, first[k])
            if c > 0:
                before = carry(process, row6(car, ends[c - 1]), ends[c - 1], first[k])
        set_covariance(space[0], before)
        joint = run_through(process, cameras, members, start, stop, space, none, np.empty((0, 6)))
        for i in members:
            joint -= cameras.own[i]
        found[m] = max(kept + joint, total)
    return found


@njit(cache=True)
def fill_pair_gains(into, out_of, target, triple, pairs, begin, out):  # type: ignore[no-untyped-def]
    """Set the gains of k given h → j to those given j alone, for j ≥ begin; −∞ stays."""
    for j in range(begin, into.size - 1):
        for a in range(into[j], into[j + 1]):
            for m in range(out_of[j], out_of[j + 1]):
                at = triple[a] + m - out_of[j]
                if out[at] > -np.inf:
                    out[at] = pairs[j, target[m]]
