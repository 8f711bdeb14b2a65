"""Exact search along the path: partial placements as labels, bounded by the chain, dominated.

A label is a partial placement i_1 < … < i_c, with its exact score. It is dropped where

- its score and the best that the chain bound lets it still add (the second order from its last
  two cameras, at several prices, and the first order with the exact count left) fall short of the
  incumbent;
- another label that ends in the same camera *dominates* it: it holds no more cameras, bars no
  group that the other leaves open, and scores at least as much even after making good what the
  other could gain more. For information A and B on what lies ahead, and any further R,

      [log det(B + R) − log det B] − [log det(A + R) − log det A] ≤ log det(A + D) − log det B,

  D the positive part of B − A: as B ⪯ A + D and diminishing returns give
  log det(A + D + R) − log det(A + R) ≤ log det(A + D) − log det A.

Labels of which nothing reaches past position p merge there: only the best of each count goes on.
At most `width` labels are kept at a node; the bound of those given up is what stays unproven.
So every width yields a valid bound and a placement, and one that gives up none is exact.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from models.geometry import FloatArray, IntArray
from placement.chain.first_order import NONE
from placement.chain.label_kernel import run_labels
from placement.chain.pairs import Arcs
from placement.chain.second_order import Priced
from placement.chain.windows import Windows

ROOM = 300_000  # labels to start with; more when they run out
MOST_LABELS = 20_000_000


@dataclass(frozen=True, slots=True)
class Outcome:
    """What one pass found.

    path: nodes of the best complete label, empty if none beat the incumbent; score: its score,
    exact where windows do not wrap, else a bound on it. given_up: the best bound of any label
    given up for want of width or memory, NONE if there was none. labels: how many were made.
    """

    path: IntArray
    score: float
    given_up: float
    labels: int


def search_labels(
    windows: Windows,
    arcs: Arcs,
    prices: list[Priced],
    B: FloatArray,
    beat: float,
    margin: float,
    width: int,
    most: int = MOST_LABELS,
) -> Outcome:
    """Look for a placement of at most `budget` nodes whose score exceeds `beat`.

    `prices` are second-order values over the same windows and arcs, `B` (n, budget + 1) the
    first-order values to go. An arc that is missing between overlapping windows is taken as
    proven useless. Whatever is found must in turn be beaten by `margin`. A pass that would make
    more than `most` labels stops, and has then given up everything.
    """
    n = len(windows)
    after_arc = np.array([p.after_arc for p in prices]).T.reshape(len(arcs), len(prices))
    after_start = np.array([p.after_start for p in prices]).T.reshape(n, len(prices))
    weight = np.zeros(windows.n_positions)
    weight[windows.position] = windows.weight
    # Candidates without a group get one of their own.
    free = windows.group.max(initial=-1) + 1 + np.arange(n)
    _, group = np.unique(np.where(windows.group < 0, free, windows.group), return_inverse=True)
    room = min(ROOM, most)
    while True:
        node, parent = np.empty(room, np.int32), np.empty(room, np.int32)
        score = np.empty(room)
        made, best, given_up = run_labels(
            windows.indptr,
            windows.position,
            windows.block,
            weight,
            windows.first,
            windows.last,
            group.astype(np.int64),
            windows.mandatory,
            windows.alone,
            arcs.out_of,
            arcs.by_source,
            arcs.target,
            arcs.gain,
            np.array([p.price for p in prices]),
            np.ascontiguousarray(after_start),
            np.ascontiguousarray(after_arc),
            B,
            beat,
            margin,
            not windows.wraps,
            width,
            node,
            parent,
            score,
        )
        if made < room or room >= most:
            break
        room = min(most, room * 4)
    path: list[int] = []
    at = best
    while at >= 0:
        path.append(int(node[at]))
        at = int(parent[at])
    found = float(score[best]) if best >= 0 else NONE
    return Outcome(np.array(path[::-1], np.int64), found, float(given_up), int(made))
