"""Leave out a pose where another of its mount always knows at least as much.

If Λ_i ⪯ Λ_j for two poses of one group, of which a placement holds at most one, then exchanging i
for j never lowers a score that is monotone in the information, and never breaks a constraint. So
some best placement holds no dominated pose. Equal poses: the lowest index stays.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numba import njit

from models.geometry import BoolArray, IntArray
from placement.bounds.matroid import Choice, root_choice, without
from placement.constraints import Constraints
from placement.information import Information
from placement.objectives.entropy import Entropy


def undominated(objective: Entropy, constraints: Constraints) -> Choice:
    """Return what may be chosen, without the poses of white cameras that others dominate.

    Where offsets persist blocks do not say who knows more, and where poses of a mount may differ in
    price more knowledge is not always better: then nobody is left out.
    """
    choice = root_choice(constraints)
    if any(drive.persistent for drive in objective.drives) or constraints.beyond_matroid():
        return choice
    seen_by = [drive.information for drive in objective.drives]
    lost = dominated(seen_by, constraints.group, choice.allowed)
    lost[constraints.required] = False
    return without(choice, lost)


def dominated(seen_by: Sequence[Information], group: IntArray, allowed: BoolArray) -> BoolArray:
    """Mark those of the `allowed` (c,) that another allowed one of their group dominates.

    They must do so on every drive (`seen_by`), sample by sample, in the Loewner order of the blocks
    as stored: exactly, without a tolerance. Candidates of group −1 are dominated by nobody.
    """
    marks = np.zeros(group.size, dtype=np.bool_)
    for g in np.unique(group[allowed & (group >= 0)]):
        members = np.flatnonzero(allowed & (group == g))
        above = np.ones((members.size, members.size), dtype=np.bool_)
        for info in seen_by:
            compare_rows(info.indptr, info.indices, info.blocks, members, above)
        # of equals the first stays: the others are dominated by it
        equal = above & above.T
        loses = above & ~(equal & (members[:, None] < members[None, :]))
        np.fill_diagonal(loses, val=False)
        marks[members[loses.any(axis=1)]] = True
    return marks


@njit(cache=True)
def compare_rows(indptr, indices, blocks, members, above):  # type: ignore[no-untyped-def]
    """Clear above[a, b] unless row members[a] ⪯ row members[b] at every sample."""
    isotropic = blocks.shape[1] == 1
    for a in range(members.size):
        for b in range(members.size):
            if a == b or not above[a, b]:
                continue
            e, stop = indptr[members[a]], indptr[members[a] + 1]
            f, end = indptr[members[b]], indptr[members[b] + 1]
            while e < stop:
                while f < end and indices[f] < indices[e]:
                    f += 1
                if f == end or indices[f] != indices[e]:
                    break
                tt = np.float64(blocks[f, 0]) - np.float64(blocks[e, 0])
                if tt < 0.0:
                    break
                if not isotropic:
                    tn = np.float64(blocks[f, 1]) - np.float64(blocks[e, 1])
                    nn = np.float64(blocks[f, 2]) - np.float64(blocks[e, 2])
                    if nn < 0.0 or tt * nn < tn * tn:
                        break
                e += 1
            if e < stop:
                above[a, b] = False
