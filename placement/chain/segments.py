"""Improve a placement stretch by stretch: each stretch solved (nearly) exactly, the rest held.

With the cameras outside a stretch fixed, what they tell is prior knowledge: A = I + their
information replaces I, and A^{-1/2} J A^{-1/2} replaces J, since

    log det(A + J) − log det A = log det(I + A^{-1/2} J A^{-1/2}).

So a stretch is a problem of the same form, and small: a dozen cameras take a fraction of a
second by the chain and its labels. Swapping single cameras cannot find what such a move finds.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from models.geometry import FloatArray, IntArray
from placement.chain.stages import eliminated, first_stage, label_pass, marginal_price, priced
from placement.chain.windows import Windows

# Prices to look at, as shares of the first-order one: conditioning on more makes cameras cheaper.
SHARES = (0.7, 0.8, 0.9, 1.0)
WIDTH = 100
MARGIN = 1e-9


def conditioned(windows: Windows, base: FloatArray) -> Windows:
    """Return `windows` given prior information `base` (nnz, 3) at each of their entries."""
    a, c, b = 1.0 + base[:, 0], base[:, 1], 1.0 + base[:, 2]
    # The square root of a 2×2 matrix A is (A + √det I) / √(tr + 2 √det).
    root = np.sqrt(np.maximum(a * b - c * c, 0.0))
    size = np.sqrt(a + b + 2.0 * root)
    p, q, r = (a + root) / size, c / size, (b + root) / size
    p, q, r = r / (p * r - q * q), -q / (p * r - q * q), p / (p * r - q * q)
    x, y, z = windows.block.T
    u, v, s, t = p * x + q * y, p * y + q * z, q * x + r * y, q * y + r * z
    block = np.column_stack([u * p + v * q, u * q + v * r, s * q + t * r])
    excess = block[:, 0] + block[:, 2]
    excess += np.maximum(block[:, 0] * block[:, 2] - block[:, 1] ** 2, 0.0)
    own = windows.weight * np.log1p(excess)
    alone = np.add.reduceat(own, windows.indptr[:-1]) if len(windows) else np.empty(0)
    return replace(windows, block=np.ascontiguousarray(block), det=1.0 + excess, alone=alone)


def best_in_stretch(windows: Windows, budget: int, beat: float, width: int = WIDTH) -> IntArray:
    """Return nodes of a placement that scores more than `beat`, the best found; empty if none."""
    nothing = np.empty(0, dtype=np.int64)
    if not len(windows) or not budget:
        return nothing
    stage = first_stage(windows, budget)
    price = marginal_price(stage)
    stage = eliminated(stage, beat)
    for _ in range(2):  # values on what is left are sharper: once more
        if not len(stage.nodes):
            return nothing
        stage = eliminated(priced(stage, [price * share for share in SHARES]), beat)
    if not len(stage.nodes):
        return nothing
    stage = priced(stage, [price * share for share in SHARES])
    return stage.nodes[label_pass(stage, beat, MARGIN * abs(beat), width).path]


def improve_by_stretches(
    windows: Windows,
    selected: IntArray,
    evaluate: Callable[[IntArray], float],
    base_of: Callable[[IntArray], FloatArray],
    cameras: int,
    stop: Callable[[], bool],
) -> IntArray:
    """Sweep once over stretches of about `cameras` cameras, overlapping by half.

    `selected` are nodes; `evaluate` gives the exact score of nodes, `base_of` the information
    (nnz, 3) that nodes leave at every entry of `windows`. Required nodes stay. Return the
    improved nodes; the same if nothing helped.
    """
    middle = windows.first + windows.last
    chosen = selected[np.argsort(middle[selected], kind="stable")]
    score = evaluate(chosen)
    step = max(1, cameras // 2)
    for begin in range(0, max(1, len(chosen) - step), step):
        if stop():
            break
        inside = chosen[begin : begin + cameras]
        low = middle[chosen[begin - 1]] if begin else -1
        high = middle[chosen[begin + cameras]] if begin + cameras < len(chosen) else 1 << 62
        fixed = np.concatenate([np.setdiff1d(chosen, inside), inside[windows.mandatory[inside]]])
        taken = windows.group[fixed]
        free = (middle > low) & (middle < high) & ~windows.mandatory
        free &= ~np.isin(windows.group, taken[taken >= 0])
        rest = evaluate(fixed)
        part = conditioned(windows, base_of(fixed)).subset(free)
        room = len(chosen) - len(fixed)
        beat = (score - rest) * (1.0 + MARGIN) + MARGIN
        found = best_in_stretch(part, room, beat)
        if not found.size:
            continue
        better = np.concatenate([fixed, np.flatnonzero(free)[found]])
        value = evaluate(better)
        if value > score:
            chosen, score = better[np.argsort(middle[better], kind="stable")], value
    return np.sort(chosen)
