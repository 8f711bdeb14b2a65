"""A line through one sieve after another, at shares nearer and nearer to 1."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numba import get_num_threads

from placement.problem import Run
from placement.sieve.sieve import Sieve, losses_of
from placement.tempered.bound import Line, Tempered

PASSES = 6
MOST_LOSSES = 1_200_000_000  # of two bytes
LOSS_S = 1.8e-7  # processor seconds for each
MOST_SHARE = 0.8  # of the time left, that a pass may take


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
        many = losses_of(first)
        if many > MOST_LOSSES or LOSS_S * many > MOST_SHARE * run.remaining() * get_num_threads():
            break
        run.progress(f"{many} losses by class, share {share:.4g}", None)
        sieve = Sieve(first, score())
        bound = sieve.bound()
        closed = report(sieve, share)
        line = sieve.survivors(score())
        if closed or line.candidate.size == 0 or bound >= best:
            break
        best, best_share = bound, share
        share = (1.0 + share) / 2
    return line, best_share
