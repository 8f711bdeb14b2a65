"""How a node is split: use a group or not; where it is used, one half of its poses or the other."""

from __future__ import annotations

import numpy as np

from models.geometry import FloatArray, IntArray
from placement.bounds.matroid import Choice, best_choice, using, without

WHOLE = 1e-6  # an x this near 0 or 1 is taken for it


def children(choice: Choice, x: FloatArray) -> list[Choice]:
    """Return the parts of `choice`, whose linear program chose x (c,); none that hold nothing.

    Every placement of `choice` is in one of them. Where exactly one is left (`last_placement`),
    or none, the list is empty.
    """
    mass = np.bincount(choice.group, x * choice.allowed, len(choice.used))
    left = np.bincount(choice.group[choice.allowed], minlength=len(choice.used))
    undecided = ~choice.used & (left > 0)
    fractional = np.minimum(mass, 1.0 - mass)
    if np.any(undecided & (fractional > WHOLE)):
        at = int(np.argmax(np.where(undecided, fractional, -1.0)))
        return use_or_not(choice, at)
    spread = np.bincount(choice.group, np.minimum(x, 1.0 - x) * choice.allowed, len(mass))
    several = left > 1
    if np.any(several & (spread > WHOLE)):
        return halves(choice, int(np.argmax(np.where(several, spread, -1.0))), x)
    # Nothing is fractional, yet bound and score differ: any decision will do.
    if np.any(choice.used & several):
        return halves(choice, int(np.argmax(choice.used & several)), x)
    if np.any(undecided) and choice.used.sum() < choice.budget:
        return use_or_not(choice, int(np.argmax(undecided * (1.0 + mass))))
    return []


def last_placement(choice: Choice) -> IntArray:
    """Return the placement of a `choice` that has no `children`: one of each group it must use."""
    return best_choice(choice, np.where(choice.used[choice.group], 1.0, -1.0))[0]


def use_or_not(choice: Choice, group: int) -> list[Choice]:
    """Return what is left if a group must be used, and if it must not."""
    parts = [using(choice, group), without(choice, choice.group == group)]
    return [part for part in parts if part.feasible]


def halves(choice: Choice, group: int, x: FloatArray) -> list[Choice]:
    """Return what is left without one half of a group's poses, and without the other."""
    members = np.flatnonzero((choice.group == group) & choice.allowed)
    # Alternate by weight, so that each half has about half of it.
    order = members[np.argsort(-x[members], kind="stable")]
    halves = [order[0::2], order[1::2]]
    if not choice.used[group]:
        parts = [without(choice, half) for half in halves]
        return [part for part in parts if part.feasible]
    return [without(choice, half) for half in halves]
