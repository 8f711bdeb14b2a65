"""The stages of a chain search over one set of windows: bound, leave out, bound more sharply.

Everything here is about placements of at most `budget` nodes whose score exceeds `beat`; what
cannot be part of one is left out, so later stages see fewer nodes and arcs.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from models.geometry import BoolArray, FloatArray, IntArray
from placement.chain import first_order, second_order
from placement.chain.first_order import NONE
from placement.chain.labels import MOST_LABELS, Outcome, search_labels
from placement.chain.pairs import Arcs, pair_arcs, restricted_arcs
from placement.chain.second_order import Priced
from placement.chain.windows import Windows


@dataclass(frozen=True, slots=True)
class Stage:
    """What is left of a problem, and the best bound on it.

    nodes (n,) are positions in the windows the search started from; B (n, budget + 1) are
    first-order values to go, F likewise from the start; `prices` hold the second order.
    """

    nodes: IntArray
    windows: Windows
    arcs: Arcs
    budget: int
    F: FloatArray
    B: FloatArray
    bound: float
    prices: tuple[Priced, ...] = ()


class OutOfTimeError(Exception):
    """Time is up between two tables; what there is of them is of no use."""


def first_stage(
    windows: Windows, budget: int, out_of_time: Callable[[], bool] = lambda: False
) -> Stage:
    """Bound to first order, for every count up to `budget` at once.

    Raises:
        OutOfTimeError: once `out_of_time()` says so; it is asked between the tables, on 50,000
            poses about once a second.
    """
    arcs = pair_arcs(windows)
    if out_of_time():
        raise OutOfTimeError
    F = first_order.forward(windows, arcs, budget)
    if out_of_time():
        raise OutOfTimeError
    B = first_order.backward(windows, arcs, budget)
    bound = float(np.max(first_order.through(F, B), initial=0.0)) if budget else 0.0
    return Stage(np.arange(len(windows)), windows, arcs, budget, F, B, bound)


def first_path(stage: Stage) -> IntArray:
    """Return the nodes of the first-order bound's own path."""
    return stage.nodes[first_order.decode(stage.windows, stage.arcs, stage.F, stage.budget)]


def eliminated(stage: Stage, beat: float) -> Stage:
    """Leave out the nodes and arcs that no placement beating `beat` can use, by what is known."""
    arcs, k = stage.arcs, stage.budget
    node = first_order.through(stage.F, stage.B) > beat
    arc = _through_arcs(stage) > beat
    if stage.prices:
        used = np.zeros(len(node), dtype=np.bool_)
        starts = np.full(len(node), np.inf)
        ways = np.full(len(arcs), np.inf)
        for p in stage.prices:
            starts = np.minimum(starts, p.start + p.after_start + k * p.price)
            ways = np.minimum(ways, p.arc + p.after_arc + k * p.price)
        arc &= ways > beat
        used[starts > beat] = True
        used[arcs.source[arc]] = True
        used[arcs.target[arc]] = True
        node &= used
    node |= stage.windows.mandatory
    return _restricted(stage, node, arc)


def priced(stage: Stage, prices: list[float]) -> Stage:
    """Add second-order values at the given prices; the bound is the least of them."""
    found = tuple(second_order.price_paths(stage.windows, stage.arcs, p) for p in prices)
    bound = min([stage.bound, *(p.best + stage.budget * p.price for p in found)])
    return Stage(
        stage.nodes,
        stage.windows,
        stage.arcs,
        stage.budget,
        stage.F,
        stage.B,
        max(bound, 0.0),
        found,
    )


def marginal_price(stage: Stage) -> float:
    """Return what the last camera of the budget adds to the first-order bound: a first price."""
    best = np.max(stage.F, axis=0, initial=NONE)
    best[0] = 0.0
    return max(0.0, float(best[stage.budget] - best[stage.budget - 1])) if stage.budget else 0.0


def label_pass(
    stage: Stage, beat: float, margin: float, width: int, most: int = MOST_LABELS
) -> Outcome:
    """Search the stage by labels; the path found is in the numbers of the stage's windows."""
    prices = list(stage.prices)
    return search_labels(stage.windows, stage.arcs, prices, stage.B, beat, margin, width, most)


def _through_arcs(stage: Stage) -> FloatArray:
    """Return, for each arc, the first-order bound on placements that use it."""
    arcs, k = stage.arcs, stage.budget
    best = np.full(len(arcs), NONE)
    for size in range(1, k):
        np.maximum(best, stage.F[arcs.source, size] + stage.B[arcs.target, k - size - 1], out=best)
    return best + arcs.gain


def _restricted(stage: Stage, node: BoolArray, arc: BoolArray) -> Stage:
    kept = arc & node[stage.arcs.source] & node[stage.arcs.target]
    prices = tuple(
        Priced(p.price, p.start[node], p.arc[kept], p.after_start[node], p.after_arc[kept], p.best)
        for p in stage.prices
    )
    return Stage(
        stage.nodes[node],
        stage.windows.subset(node),
        restricted_arcs(stage.arcs, arc, node),
        stage.budget,
        np.ascontiguousarray(stage.F[node]),
        np.ascontiguousarray(stage.B[node]),
        stage.bound,
        prices,
    )
