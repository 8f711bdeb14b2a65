"""What a car needs from the floor on: stretches that must be seen, by cameras within reach."""

from __future__ import annotations

import numpy as np
from numba import njit

from placement.fewest.arrays import MOST_UNITS
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
def mend(reach, at, first, last, units, span, times, sure, floor, hope):  # type: ignore[no-untyped-def]
    """Raise what is needed (t + 1,) by what is known to be needed later.

    sure: even where cameras are in view that have been paid. Within t…reach(t) `times` cameras must
    see the car, and who sees it there sees nothing from the end of the last such view on.
    floor: nothing is pending, so those cameras start within t…reach(t): `times` of them, and what
    follows after one of them. hope: cameras in view are paid besides. No view exceeds `span`.
    """
    t_end = reach.size
    for t in range(t_end - 1, -1, -1):
        early = at[max(0, t - span + 1)]
        if reach[t] < t_end:
            least, end = np.int64(MOST_UNITS), t
            cheapest, best = np.int64(MOST_UNITS), np.int64(MOST_UNITS)
            for v in range(early, at[reach[t] + 1]):
                if last[v] < t:
                    continue
                least = min(least, units[v])
                end = max(end, last[v] + 1)
                if first[v] >= t:
                    cheapest = min(cheapest, units[v])
                    best = min(best, units[v] + hope[last[v] + 1])
            after = times * least + hope[end] if end > t else MOST_UNITS
            sure[t] = max(sure[t], min(after, MOST_UNITS))
            floor[t] = max(floor[t], sure[t], min((times - 1) * cheapest + best, MOST_UNITS))
        pending = floor[t]
        for v in range(early, at[t]):
            if last[v] >= t:
                pending = min(pending, units[v] + hope[last[v] + 1])
        hope[t] = max(hope[t], sure[t], pending)


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
