"""A placement from linear programs: decide for the weightiest group, solve again, to the end.

Rounding one fractional x takes all decisions at once; here each decision is taken knowing the
others, at one warm linear program apiece (diving: Berthold 2006). Where samples count only once
two cameras see them, what greedy and swaps find is far from what this finds.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from models.geometry import FloatArray, IntArray
from placement.bounds.cut_program import CutProgram
from placement.bounds.matroid import Choice, best_choice, using, without


def dive(
    program: CutProgram, choice: Choice, x: FloatArray, remaining: Callable[[], float]
) -> IntArray:
    """Return a placement of `choice` near `x` (c,), what its linear program chose."""
    while choice.used.sum() < choice.budget and remaining() > 0.0:
        open_ = choice.allowed & ~choice.used[choice.group]
        if not np.any(x[open_] > 0.0):
            break
        taken = int(np.argmax(np.where(open_, x, -1.0)))
        narrower = _holding(choice, taken)
        if not narrower.feasible:
            choice = without(choice, np.array([taken]))
            x = np.where(choice.allowed, x, 0.0)
            continue
        choice = narrower
        fraction = program.solve(choice, remaining())
        if fraction is None:
            break
        x = fraction.x
    return best_choice(choice, np.where(choice.allowed, x + 1e-9, 0.0))[0]


def _holding(choice: Choice, candidate: int) -> Choice:
    group = int(choice.group[candidate])
    others = choice.group == group
    others[candidate] = False
    return using(without(choice, others), group)
