"""One sweep from the start of the road to its end and back, whatever its labels count."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from models.geometry import FloatArray, IntArray
from placement.diagram.alone import Alone
from placement.diagram.arrays import (
    ARCS,
    FULL,
    NODES,
    Arcs,
    Nodes,
    Road,
    Rules,
    Table,
    Views,
    add_root,
    new_storage,
)
from placement.diagram.sweep import forward
from placement.diagram.togo import backward, hopes

CHUNK = 4  # samples swept between looks at the clock
MOST_NODES, MOST_ARCS, MOST_WAITING = 24_000_000, 80_000_000, 4_000_000


class OutOfTime(Exception):  # noqa: N818 - a signal, not an error
    """The sweep was stopped by the clock."""


@dataclass(frozen=True, slots=True)
class Swept:
    """The labels and arcs of a sweep with their costs to go; `roots` as they were given."""

    nodes: Nodes
    arcs: Arcs
    best_arc: IntArray
    roots: IntArray
    labels: int
    epsilon: float
    counters: list[int]

    def path(self, node: int, candidate: IntArray) -> list[int]:
        """Return the cameras of the best path from a label on; `candidate` (v,) is each move's."""
        path = []
        while self.best_arc[node] >= 0:
            arc = self.best_arc[node]
            if self.arcs.move[arc] >= 0:
                path.append(int(candidate[self.arcs.move[arc]]))
            node = int(self.arcs.target[arc])
        return path


def sweep_once(
    p0: FloatArray,
    road: Road,
    views: Views,
    alone: Alone,
    rules: Rules,
    table: Table,
    cuts: FloatArray,
    most: int,
    roots: list[tuple[int, float]],
    out_of_time: Callable[[], bool],
    progress: Callable[[float], None],
) -> Swept | None:
    """Sweep from `roots` (their counts, increasing, and costs) with counts up to `most`.

    `table` and `cuts` (t + 1, most + 1) are what earlier sweeps have taught.
    Return None if storage ran out.

    Raises:
        OutOfTime: before the end is reached.
    """
    t = road.steps.shape[0]
    storage = new_storage(t, most, views, rules.slots, MOST_NODES, MOST_ARCS, MOST_WAITING)
    for count, cost in roots:
        add_root(storage.pool, storage.counter, count, cost, p0)
    hope = np.zeros((t + 1, most + 2))
    hopes(road, views.span, rules.price, table, cuts, hope)
    bin_epsilon = np.zeros(most + 1)
    found: IntArray = np.empty(0, dtype=np.int64)
    for begin in range(0, t, CHUNK):
        if out_of_time():
            raise OutOfTime
        progress(begin / t)
        end = min(t, begin + CHUNK)
        forward(begin, end, most, road, views, alone, rules, hope, table, bin_epsilon, storage)
        if storage.counter[FULL]:
            return None
        if begin == 0:  # roots are the only labels to which an arc leads from nowhere
            first = storage.arcs.source[: storage.counter[ARCS]]
            found = storage.arcs.target[np.flatnonzero(first < 0)].astype(np.int64)
    nodes, arcs = storage.nodes, storage.arcs
    labels = int(storage.counter[NODES])
    best_arc = np.full(labels, -1, dtype=np.int64)
    backward(int(storage.counter[ARCS]), arcs.source, arcs.target, arcs.cost, nodes.togo, best_arc)
    return Swept(
        nodes, arcs, best_arc, found, labels, float(bin_epsilon.max()), storage.counter.tolist()
    )
