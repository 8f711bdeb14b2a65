"""What a car needs from the floor on: stretches someone must see, chains of cameras in reach."""

from __future__ import annotations

import numpy as np
from numba import njit

from placement.objectives.windows.filter import predict, row6, update


@njit(cache=True)
def floor_reach(steps, base, floor, limit):  # type: ignore[no-untyped-def]
    """Return (t,) the first violation of a car that knows all before t, and then drives alone."""
    t_end = steps.shape[0]
    out = np.empty(t_end, dtype=np.int64)
    for t in range(t_end):
        p = row6(floor, t)
        out[t] = t_end
        for s in range(t, t_end):
            if s > t:
                p = predict(p, steps[s])
            q0, q1, q2, q3, q4, q5, _ = update(p, base[s, 0], base[s, 1], base[s, 2])
            p = (q0, q1, q2, q3, q4, q5)
            if q3 > limit:
                out[t] = s
                break
    return out


@njit(cache=True)
def stretches(reach, first, last, units, times, out):  # type: ignore[no-untyped-def]
    """Fill `out` (t + 1,): units that stretches after t need, no camera seeing two of them.

    Within t…reach(t) someone must see the car, `times` over; whoever sees it there sees nothing
    from the end of the last such view on. Cameras may be in view at t already.
    """
    t_end = reach.size
    out[t_end] = 0
    for t in range(t_end - 1, -1, -1):
        out[t] = 0
        if reach[t] == t_end:
            continue
        least, end = np.int64(1_000_000), t
        for v in range(first.size):
            if first[v] <= reach[t] and last[v] >= t:
                least = min(least, units[v])
                end = max(end, last[v] + 1)
        if end == t:
            out[t] = 1_000_000
        else:
            out[t] = min(1_000_000, times * least + out[end])


@njit(cache=True)
def by_chains(reach, first, last, units, floor, hope):  # type: ignore[no-untyped-def]
    """Raise `floor` and `hope` (t + 1,) by the cheapest chain of cameras, each in reach."""
    t_end = reach.size
    for t in range(t_end - 1, -1, -1):
        if reach[t] < t_end:
            best = np.int64(1_000_000)
            for v in range(first.size):
                if t <= first[v] <= reach[t]:
                    best = min(best, units[v] + hope[last[v] + 1])
            floor[t] = max(floor[t], best)
        hope[t] = max(hope[t], hoped(t, first, last, units, floor, hope))


@njit(cache=True)
def hoped(t, first, last, units, floor, hope):  # type: ignore[no-untyped-def]
    """Return the least of `floor` at t and of a camera that sees t, come from before it."""
    best = floor[t]
    for v in range(first.size):
        if first[v] < t <= last[v]:
            best = min(best, units[v] + hope[last[v] + 1])
    return best


@njit(cache=True)
def chains(first, last, units, floor, sure, hope):  # type: ignore[no-untyped-def]
    """Fill `hope` (t + 1,) from `floor`: what the end of a set needs if cameras may follow in it.

    `sure` is needed even then.
    """
    t_end = floor.size - 1
    hope[t_end] = 0
    for t in range(t_end - 1, -1, -1):
        hope[t] = max(sure[t], hope[t], hoped(t, first, last, units, floor, hope))


@njit(cache=True)
def least_of_sets(first, last, units, hope):  # type: ignore[no-untyped-def]
    """Return (v,) what a set takes at least that starts with a camera and holds another."""
    out = np.empty(first.size, dtype=np.int64)
    for v in range(first.size):
        best = np.int64(1_000_000)
        w = v
        while w > 0 and first[w - 1] == first[v]:
            w -= 1
        while w < first.size and first[w] <= last[v]:
            best = min(best, units[w] + hope[max(last[v], last[w]) + 1])
            w += 1
        out[v] = units[v] + best
    return out
