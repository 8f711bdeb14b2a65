"""Placements by the same sweep that proves: labels are left out where the bound would merge them.

Each label is then one placement, and what the bound knows to be needed says which of them cannot be
completed within k. So many are left that they are cut down by a guess besides: that from no sample
on much less is needed than the best placement known spends there.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from models.geometry import IntArray
from placement.fewest import arrays
from placement.fewest.arrays import MOST_UNITS, Course, Effort, Known, OutOfTime, Store
from placement.fewest.bound import CHUNK, Counting
from placement.fewest.graph import backward
from placement.fewest.stretches import least_of_sets
from placement.fewest.sweep import sweep

EFFORTS = (Effort(4, 1, 0.03), Effort(10, 1, 0.03), Effort(30, 2, 0.02))
SHARES = (1.0, 0.95, 0.92, 0.9, 0.88)  # of the limit, where offsets persist
MARGINS = (1, 2)  # cameras that the best placement known may be ahead or behind


def tries(
    counting: Counting, known: IntArray, units: IntArray, stop: Callable[[], bool]
) -> Iterator[list[int]]:
    """Yield placements cheaper than `known`, of candidates priced `units` (c,), to be checked.

    A failure that looked worse before may not be the worst in the end, two cameras of a mount may
    not be in view at once, and offsets that persist are known where views overlap: so not all of
    what is found need be in tolerance, or allowed. Where offsets persist stricter limits are tried,
    to make up for their being known. Ends when time is up.
    """
    t = counting.course.steps.shape[0]
    price = int(units[known].sum())
    if price < 1:
        return
    begins = counting.begins(known)
    order = np.argsort(begins)
    spent = np.concatenate([[0], np.cumsum(units[known][order])])
    rest = price - spent[np.searchsorted(begins[order], np.arange(t + 1))]
    dearest = int(units[known].max(initial=1))
    attempts = [(margin, effort, 1.0) for margin in MARGINS for effort in EFFORTS]
    if counting.course.offsets.shape[2]:
        attempts = [(MARGINS[0], EFFORTS[0], share) for share in SHARES]
    for margin, effort, share in attempts:
        guess = np.maximum(rest - margin * dearest, 0)
        try:
            found = find(counting, price - 1, effort, stop, guess, share)
        except OutOfTime:
            return
        if found is not None:
            yield found


def find(
    counting: Counting,
    k: int,
    effort: Effort,
    stop: Callable[[], bool],
    guess: IntArray | None = None,
    share: float = 1.0,
) -> list[int] | None:
    """Look for a placement of at most k prices; return its cameras if there is one.

    guess (t + 1,) is what is guessed to be needed from each sample on. `share` of the limit on the
    lateral variance must be kept. None, too, where storage runs out.

    Raises:
        OutOfTime: when `stop` says so.
    """
    c = counting.course
    c = c._replace(units=c.whole, base=c.plain, limit=share * c.limit)
    t, k = c.steps.shape[0], k * c.per_unit
    floor, hope = counting.floor, counting.hope
    if guess is not None:
        floor, hope = (np.maximum(x, guess * c.per_unit) for x in (floor, hope))
    known = Known(floor, hope, *counting.rows, np.zeros(t, np.bool_), t)
    store = counting.started(k)
    least = least_of_sets(counting.first, counting.last, counting.course.units, hope)
    least += np.where(c.units < MOST_UNITS, 0, MOST_UNITS)
    bin_epsilon = np.zeros(k + 1)
    for begin in range(0, t, CHUNK):
        if stop():
            raise OutOfTime
        sweep(begin, min(t, begin + CHUNK), k, c, known, store, least, effort.width,
              effort.slots, effort.epsilon, arrays.FINDING, bin_epsilon)  # fmt: skip
        if store.counter[arrays.FULL]:
            return None
    backward(c, store)
    counting.labels += int(store.counter[arrays.NODES])
    return path(c, store, k)


def path(course: Course, store: Store, k: int) -> list[int] | None:
    """Return the cameras along the cheapest path to the end, None if it takes more than k."""
    n = int(store.counter[arrays.ARCS])
    begin, to = store.arc_from[:n], store.arc_to[:n]
    node, cameras = int(to[0]), set()
    if store.node_need[node] > k:
        return None
    order = np.argsort(begin, kind="stable")
    sorted_begin = begin[order]
    while node != arrays.END:
        arcs = order[slice(*np.searchsorted(sorted_begin, [node, node + 1]))]
        arc = int(arcs[np.argmin(store.arc_units[arcs] + store.node_need[to[arcs]])])
        if store.arc_camera[arc] >= 0:
            cameras.add(int(course.owner[store.arc_camera[arc]]))
        node = int(to[arc])
    return sorted(cameras)
