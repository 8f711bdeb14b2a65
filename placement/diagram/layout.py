"""What a diagram knows of a drive before any sweep: its moves, the road, and floors below all."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from models.geometry import BoolArray, FloatArray, IntArray
from placement.diagram.arrays import Road, Views
from placement.diagram.moves import Moves, make_moves
from placement.diagram.order import block_join
from placement.diagram.sweep import near_form
from placement.objectives.navigation import WhiteDrive
from placement.objectives.windows.filter import empty_messages, filter_forward

# What labels inside clusters may hold: (cameras + 1)·span², some 3 kB each at eight slots.
MOST_PENDING = 400_000


def lay_moves(
    drive: WhiteDrive, usable: BoolArray, required: IntArray, budget: int
) -> tuple[Moves, FloatArray]:
    """Return the moves of at most `budget` of the `usable` (c,), and what all placements have.

    The latter (t, 3) is the information of the `required` cameras, and of the moves' tails.

    Raises:
        ValueError: if most views are too long.
    """
    moves, beyond = make_moves(drive, usable, longest_view(budget), budget)
    return moves, drive.total(required) + beyond


def longest_view(budget: int) -> int:
    """Return how many samples of a view a move may hold."""
    return max(1, math.isqrt(MOST_PENDING // (budget + 1)))


def road_above(
    drive: WhiteDrive,
    weight: tuple[float, float],
    base: FloatArray,
    floor: FloatArray,
    reach: int,
) -> Road:
    """Return the road on which placements have at least `base` (t, 3), and at most `floor`.

    `reach` is how many samples ahead labels are compared by.
    """
    before, after, logs = empty_messages(drive.n_samples)
    filter_forward(drive.steps, drive.p0, floor, before, after, logs)
    paid = weight[0] * after[:, 0] + weight[1] * after[:, 3]
    return Road(
        drive.steps,
        base,
        float(weight[0]),
        float(weight[1]),
        before * (1.0 - 1e-12),
        np.concatenate(([0.0], np.cumsum(paid))) * (1.0 - 1e-12),
        near_form(drive.steps, *weight, reach),
    )


def views_of(moves: Moves, t: int, beyond: IntArray | None = None) -> Views:
    """Return the moves as kernels take them.

    `beyond` (t,) cameras of each sample, more than the last count has, are given for nothing.
    """
    rest = np.zeros((0 if beyond is None else t, moves.span, 3))
    length = np.zeros(t, dtype=np.int64)
    if beyond is not None:
        _join_starting(moves.ptr, moves.blocks, moves.at, beyond, rest, length)
    return Views(
        moves.ptr, moves.blocks, moves.at, moves.family, moves.families, moves.span, rest, length
    )


@njit(cache=True)
def _join_starting(ptr, blocks, at, beyond, rest, length):  # type: ignore[no-untyped-def]
    """Fill `rest` with beyond[t] times the join of the moves that start at t."""
    for t in range(at.size - 1):
        if beyond[t] <= 0:
            continue
        for v in range(at[t], at[t + 1]):
            n = ptr[v + 1] - ptr[v]
            length[t] = max(length[t], n)
            for x in range(n):
                b, r = blocks[ptr[v] + x], rest[t, x]
                r[0], r[1], r[2] = block_join(r[0], r[1], r[2], b[0], b[1], b[2])
        rest[t] *= beyond[t] * (1.0 + 1e-12)
