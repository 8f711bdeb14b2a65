"""Best paths through the states of the tempered diagram: a camera and one of its labels.

Gains lie by arc, sorted by source, one for each label of the source, and next to each the label of
the target that it leads to. −∞ marks what is part of no placement worth having. Rows of the tables
count cameras: F[l, s] is the best path of l + 1 cameras into state s, B[r, s] the most that at most
r further ones can add.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from models.geometry import FloatArray, IntArray


class Layout(NamedTuple):
    """m arcs between n cameras and their labels; states are numbered camera by camera."""

    into: IntArray  # (n + 1,) arcs into each camera, sorted by target
    source: IntArray  # (m,) in that order
    place: IntArray  # (m,) where each of those is among the arcs sorted by source
    out_of: IntArray  # (n + 1,) arcs out of each camera, sorted by source
    target: IntArray  # (m,) in that order
    base: IntArray  # (m,) the first label of the target that an arc may lead to
    state_of: IntArray  # (n + 1,) states of each camera
    gain_at: IntArray  # (m + 1,) gains of each arc
    leads: NDArray[np.uint8]  # the label of the target that each gain leads to


@njit(cache=True, parallel=True)
def cap_by_second(layout, triple, second, gains):  # type: ignore[no-untyped-def]
    """Lower gains to the greatest of the second order among whom a label stands for.

    `second` is laid out by `triple` as `gains.add_triple_gains` says.
    """
    for j in prange(layout.into.size - 1):
        begin, end = layout.out_of[j], layout.out_of[j + 1]
        most = np.empty(layout.state_of[j + 1] - layout.state_of[j], np.float32)
        for e in range(begin, end):
            most[:] = -np.inf
            for a in range(layout.into[j], layout.into[j + 1]):
                gain = second[triple[a] + e - begin]
                from_a = layout.place[a]
                for at in range(layout.gain_at[from_a], layout.gain_at[from_a + 1]):
                    if gains[at] > -np.inf:
                        most[layout.leads[at]] = max(most[layout.leads[at]], gain)
            for c in range(1, most.size):
                at = layout.gain_at[e] + c
                gains[at] = min(gains[at], most[c])


@njit(cache=True, parallel=True)
def step_forward(layout, gains, found):  # type: ignore[no-untyped-def]
    """Return the next row of F (s,)."""
    longer = np.full(found.size, -np.inf)
    for k in prange(layout.into.size - 1):
        for a in range(layout.into[k], layout.into[k + 1]):
            begin = layout.gain_at[layout.place[a]]
            low = layout.state_of[layout.source[a]]
            for c in range(layout.state_of[layout.source[a] + 1] - low):
                value = found[low + c] + gains[begin + c]
                if value > -np.inf:
                    to = layout.state_of[k] + layout.leads[begin + c]
                    longer[to] = max(longer[to], value)
    return longer


@njit(cache=True, parallel=True)
def step_back(layout, gains, may_end, found):  # type: ignore[no-untyped-def]
    """Return the next row of B (s,); `may_end` (n,) is by camera."""
    longer = np.empty(found.size)
    for j in prange(layout.into.size - 1):
        low, high = layout.state_of[j], layout.state_of[j + 1]
        longer[low:high] = may_end[j]
        for e in range(layout.out_of[j], layout.out_of[j + 1]):
            to = layout.state_of[layout.target[e]]
            for c in range(high - low):
                at = layout.gain_at[e] + c
                longer[low + c] = max(longer[low + c], gains[at] + found[to + layout.leads[at]])
    return longer


@njit(cache=True, parallel=True)
def reaching(layout, gains, F, B, least):  # type: ignore[no-untyped-def]
    """Mark the arcs (m,), sorted by source, on some path of at most k cameras worth `least`."""
    k = F.shape[0]
    good = np.zeros(layout.target.size, np.bool_)
    for j in prange(layout.into.size - 1):
        low, high = layout.state_of[j], layout.state_of[j + 1]
        for e in range(layout.out_of[j], layout.out_of[j + 1]):
            for c in range(high - low):
                at = layout.gain_at[e] + c
                if gains[at] == -np.inf:
                    continue
                to = layout.state_of[layout.target[e]] + layout.leads[at]
                for level in range(k - 1):
                    if F[level, low + c] + gains[at] + B[k - 2 - level, to] >= least:
                        good[e] = True
                        break
                if good[e]:
                    break
    return good


@njit(cache=True)
def priced_beyond(pairs, may_end, price):  # type: ignore[no-untyped-def]
    """Return the most that paths on from each camera add (n,) by first-order gains, at a price."""
    n = may_end.size
    found = may_end.copy()
    for a in range(n - 2, -1, -1):
        best = found[a]
        for b in range(a + 1, n):
            best = max(best, pairs[a, b] - price + found[b])
        found[a] = best
    return found


@njit(cache=True)
def priced_back(layout, gains, may_end, price):  # type: ignore[no-untyped-def]
    """Return the most that paths on from each state add (s,), each further camera at a price."""
    found = np.empty(layout.state_of[-1])
    for j in range(may_end.size - 1, -1, -1):
        low, high = layout.state_of[j], layout.state_of[j + 1]
        found[low:high] = may_end[j]
        for e in range(layout.out_of[j], layout.out_of[j + 1]):
            to = layout.state_of[layout.target[e]]
            for c in range(high - low):
                at = layout.gain_at[e] + c
                found[low + c] = max(
                    found[low + c], gains[at] - price + found[to + layout.leads[at]]
                )
    return found


def trace_states(
    layout: Layout, gains: NDArray[np.float32], F: FloatArray, ends: FloatArray
) -> IntArray:
    """Return the cameras of a best path of at most k cameras; `ends` (s,) is 0 where it may end."""
    best = F + ends
    level, state = (int(i) for i in np.unravel_index(int(np.argmax(best)), best.shape))
    if best[level, state] == -np.inf:
        return np.empty(0, dtype=np.int64)
    camera = np.repeat(np.arange(len(layout.into) - 1), np.diff(layout.state_of))
    found = [int(camera[state])]
    for row in range(level - 1, -1, -1):
        k, most, before = found[-1], -np.inf, -1
        for a in range(int(layout.into[k]), int(layout.into[k + 1])):
            j, e = int(layout.source[a]), int(layout.place[a])
            low, at = int(layout.state_of[j]), int(layout.gain_at[e])
            until = int(layout.gain_at[e + 1])
            leads = layout.state_of[k] + layout.leads[at:until] == state
            value = np.where(leads, F[row, low : low + until - at] + gains[at:until], -np.inf)
            if value.max() > most:
                most, before = float(value.max()), low + int(np.argmax(value))
        state = before
        found.append(int(camera[before]))
    return np.array(found[::-1], dtype=np.int64)
