"""A line through one sieve after another, at shares nearer and nearer to 1."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numba import get_num_threads

from placement.problem import Run
from placement.sieve.classes import BEYOND
from placement.sieve.sieve import Sieve, size_of
from placement.tempered.bound import Line, Tempered

PASSES = 6
MOST_LOSSES = 1_200_000_000  # of two bytes
CLASSES = (40, 32, 24, 16, 12, 8)  # of far cameras: the more, the sharper
LOSS_S, CLASS_S = 2e-7, 3e-7  # processor seconds for a loss to a near camera, and to a class
MOST_SHARE = 0.75  # of the time left, that a pass may take


def sift(
    line: Line,
    share: float,
    first_order: Callable[[Line, float], Tempered],
    score: Callable[[], float],
    report: Callable[[Sieve, float], bool],
    enough: Callable[[Line], bool],
    run: Run,
) -> tuple[Line, float]:
    """Return what sieves leave of a line, and the share that bounded best; a single drive.

    Each pass goes halfway from the share of the one before to 1, until the bound no longer falls,
    `report` says that it is closed, what is left is `enough`, or a pass would take too long.
    """
    best, best_share = np.inf, share
    for _ in range(PASSES):
        if enough(line):
            break
        first = first_order(line, share)
        n_far = room_for(line, first, run)
        if n_far == 0:
            break
        run.progress(f"{n_far} classes, share {share:.4g}", None)
        sieve = Sieve(first, score(), n_far)
        bound = sieve.bound()
        closed = report(sieve, share)
        line = sieve.survivors(score())
        if closed or line.candidate.size == 0 or bound >= best:
            break
        best, best_share = bound, share
        share = (1.0 + share) / 2
    return line, best_share


def room_for(line: Line, first: Tempered | None, run: Run) -> int:
    """Return how many classes of far cameras a sieve has room and time for, 0 where for none.

    Without the first order over the line, by its arcs alone.
    """
    found = classes_in_time(int(line.alive.sum()), 0, run.remaining())
    if found and first is not None:
        found = classes_in_time(*size_of(first), run.remaining())
    return found


def classes_in_time(arcs: int, losses: int, seconds: float) -> int:
    """Return how many classes there is room and time for, 0 where not for the fewest."""
    for n_far in CLASSES:
        room = losses + arcs * (n_far + BEYOND) <= MOST_LOSSES
        needed_s = LOSS_S * losses + CLASS_S * arcs * n_far
        if room and needed_s <= MOST_SHARE * seconds * get_num_threads():
            return n_far
    return 0
