"""Best-first search over partial placements, bounded by the tempered chain.

A node is a path i_1 < … < i_l with its exact g (see `placement.tempered.bound`), and what the
second order or the diagram lets it still gain after its last two cameras. The open node of greatest
total bounds every placement that is left, at any time; when none beats the incumbent, that is the
best.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable

import numpy as np

from models.geometry import FloatArray, IntArray
from placement.constraints import Constraints
from placement.problem import Run
from placement.tempered.bound import SecondOrder
from placement.tempered.diagram import Diagram
from placement.tempered.gains import GAIN_ABSOLUTE, GAIN_RELATIVE, set_gains

MOST_OPEN = 2_000_000  # nodes; beyond, memory would be the next limit
MOST_EXPANDED = 500_000  # nodes, some minutes: the last per mille may take for ever


def search(
    second: SecondOrder | Diagram,
    constraints: Constraints,
    run: Run,
    beat: Callable[[], float],
    offer: Callable[[IntArray], None],
    report: Callable[[float], None],
) -> bool:
    """Expand nodes until none beats `beat()`; return whether that end was reached.

    `offer` is given placements worth a look, `report` each lower bound on those not yet refuted.
    """
    first, arcs = second.first, second.arcs
    line, budget = first.line, first.budget
    if budget < 2:
        return False
    offer(np.empty(0, dtype=np.int64))
    for i in np.flatnonzero(np.isfinite(first.alone + first.ends)):
        offer(line.candidate[[i]])
    begun, may_end = second.begin(), first.ends
    reach = second.start + second.after(budget - 2, begun)
    order = np.flatnonzero(reach >= first.threshold(beat()))
    heap: list[tuple[float, tuple[int, ...], int]] = [
        (-float(reach[a]), (int(arcs.source[a]), int(arcs.target[a])), int(begun[a])) for a in order
    ]
    heapq.heapify(heap)
    expanded = 0
    while heap:
        top = -heap[0][0]
        if top < first.threshold(beat()):
            report(beat())
            return True
        if expanded % 64 == 0:
            report(float(first.as_bound(np.array([top]))[0]))
            if run.out_of_time() or len(heap) > MOST_OPEN or expanded > MOST_EXPANDED:
                return False
        negative, path, state = heapq.heappop(heap)
        expanded += 1
        j = path[-1]
        chosen = line.candidate[list(path)]
        if may_end[j] == 0.0 and not constraints.violations(chosen):
            offer(chosen)
        following = arcs.out[arcs.out_of[j] : arcs.out_of[j + 1]]
        if len(path) == budget or not following.size:
            continue
        targets = arcs.target[following]
        groups = line.group[list(path)]
        free = ~np.isin(line.group[targets], groups[groups >= 0])
        held = np.array(path, dtype=np.int64)
        reached, alive = second.follow(j, state)
        total = gains_beyond(second, held, targets)
        total += second.after(budget - len(path) - 1, reached)
        total = np.minimum(total, -negative)
        for m in np.flatnonzero(free & alive & (total >= first.threshold(beat()))):
            heapq.heappush(heap, (-float(total[m]), (*path, int(targets[m])), int(reached[m])))
    report(beat())
    return True


def gains_beyond(second: SecondOrder | Diagram, held: IntArray, targets: IntArray) -> FloatArray:
    """Return g of the positions `held` together with each of `targets` (m,), rounded up."""
    found = np.zeros(targets.size)
    for d in second.first.drives:
        found += d.weight * set_gains(d.process, d.cameras, d.all_rows, held, targets)
    return found * (1.0 + GAIN_RELATIVE) + GAIN_ABSOLUTE
