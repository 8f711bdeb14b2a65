"""A line through one sieve after another, at shares nearer and nearer to 1."""

from __future__ import annotations

import os
from collections.abc import Callable

import numpy as np
from numba import get_num_threads

from placement.problem import Run
from placement.sieve.first import FirstOrder
from placement.sieve.sieve import Sieve
from placement.tempered.bound import Tempered
from placement.tempered.line import Line

PASSES = 8
MOST_BYTES = 6e9
MEMORY_SHARE = 0.3  # of the machine's memory, where that is less
ARC_BYTES, LOSS_BYTES = 100, 2
LOSS_S, ARC_S = 2e-7, 7e-7  # processor seconds for a loss kept, and for all else of an arc
PASS_S = 1.2e-6  # for an arc in all passes over paths
MOST_SHARE = 0.85  # of the time left, that a sieve may take


def sift(
    line: Line,
    share: float,
    least_share: float,
    first_order: Callable[[Line, float], Tempered],
    score: Callable[[], float],
    report: Callable[[FirstOrder | Sieve, float], bool],
    enough: Callable[[Line], bool],
    run: Run,
) -> tuple[Line, float, int]:
    """Return what sieves leave of a line, the best share or the last tried, and how many they were.

    On a single drive. Each pass goes halfway from the share of the one before to 1, until the bound
    no longer falls, `report` says that it is closed, what is left is `enough`, or a pass would take
    too long. Where too much is left at `share` to begin with, `least_share` is tried.
    """
    best, best_share = np.inf, share
    for number in range(PASSES):
        if line.candidate.size == 0 or enough(line):
            return line, best_share, number
        if line.arcs is not None and not room_for(line.n_arcs, 0, run):
            return line, best_share, number
        order = FirstOrder(first_order(line, share), score(), most_arcs())
        if report(order, share):
            return line, best_share, number
        if not room_for(order.arcs, order.losses, run) and number == 0 and share > least_share:
            share = best_share = least_share
            order = FirstOrder(first_order(order.left(), share), score(), most_arcs())
            if report(order, share):
                return line, best_share, number
        if not room_for(order.arcs, order.losses, run):
            return order.left(), best_share, number
        sieve = Sieve(order, passes_s(order.arcs))
        bound = sieve.bound()
        closed = report(sieve, share)
        line = sieve.survivors(score())
        if closed or bound >= best:
            return line, best_share, number + 1
        best, best_share = bound, share
        share = (1.0 + share) / 2
    return line, best_share, PASSES


def room_for(arcs: int, losses: int, run: Run) -> bool:
    """Say whether there is room and time for a sieve of so many arcs and losses."""
    room = ARC_BYTES * arcs + LOSS_BYTES * losses <= most_bytes()
    needed_s = LOSS_S * losses + ARC_S * arcs + passes_s(arcs)
    return room and needed_s <= MOST_SHARE * run.remaining() * get_num_threads()


def most_bytes() -> float:
    """Return the memory that a sieve may take."""
    try:
        machine = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, ValueError, OSError):  # not every system says
        return MOST_BYTES
    return min(MOST_BYTES, MEMORY_SHARE * machine) if machine > 0 else MOST_BYTES


def most_arcs() -> int:
    """Return how many arcs there is memory for."""
    return int(most_bytes() / ARC_BYTES)


def passes_s(arcs: int) -> float:
    """Return how long all passes over paths of so many arcs take, in seconds."""
    return PASS_S * arcs
