"""Which candidates stand near which: places along the road, numbered in order."""

from __future__ import annotations

import numpy as np

from models.geometry import IntArray
from placement.problem import Problem


def number_places(problem: Problem) -> IntArray | None:
    """Number the places along the road from its start and return each candidate's, (c,).

    Mounts on both sides of one place share its number. None where there is no road.
    """
    if problem.arc_length_m is None:
        return None
    return np.unique(problem.arc_length_m, return_inverse=True)[1].astype(np.int64)


def addable_near(
    problem: Problem, selected: list[int], place: IntArray, centre: int, steps: int
) -> IntArray:
    """Return the candidates that may join `selected` and lie within `steps` places of `centre`."""
    allowed = problem.constraints.addable(np.array(selected, dtype=np.int64))
    return np.flatnonzero(allowed & (np.abs(place - centre) <= steps))
