"""The same problem with fewer candidates, once the others are proven not to matter."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from models.geometry import FloatArray, IntArray
from placement.constraints import Constraints
from placement.information import Information
from placement.objectives.base import Relaxable
from placement.objectives.localisation import Localisation
from placement.objectives.navigation import NavigationObjective


def restricted_objective(objective: Localisation, keep: IntArray) -> Localisation:
    """Return `localisation` over the candidates `keep` alone, numbered 0 … len(keep) − 1."""
    return Localisation(
        restricted_information(objective.information, keep),
        objective.prior_sigma_m,
        objective.weights,
    )


def restricted_information(information: Information, keep: IntArray) -> Information:
    """Return the rows `keep` of the information of all candidates."""
    lengths = np.diff(information.indptr)[keep]
    starts = information.indptr[keep]
    ends = np.cumsum(lengths)
    entries = np.arange(int(lengths.sum())) + np.repeat(starts - (ends - lengths), lengths)
    return replace(
        information,
        indptr=np.concatenate([[0], ends]).astype(np.int64),
        indices=information.indices[entries],
        blocks=information.blocks[entries],
        white=None if information.white is None else information.white[entries],
        offsets=None if information.offsets is None else information.offsets[entries],
    )


def narrowed(objective: Relaxable, keep: IntArray, n_candidates: int) -> Relaxable:
    """Return the concave extension over the candidates `keep` alone, the others held at 0.

    Objectives that know their candidates' information are rebuilt, so that the others cost nothing.
    """
    if isinstance(objective, Localisation):
        return restricted_objective(objective, keep)
    if isinstance(objective, NavigationObjective):
        drives = [
            replace(drive, information=restricted_information(drive.information, keep))
            for drive in objective.drives
        ]
        smaller = objective.over(drives)
        if isinstance(smaller, Relaxable):
            return smaller
    return _Narrowed(objective, keep, n_candidates)


class _Narrowed:
    """Any concave extension over some of its candidates."""

    def __init__(self, objective: Relaxable, keep: IntArray, n_candidates: int) -> None:
        self.objective = objective
        self.keep = keep
        self.n_candidates = n_candidates

    def relaxed(self, x: FloatArray) -> tuple[float, FloatArray]:
        """Return score and gradient (len(keep),) at `x`."""
        full = np.zeros(self.n_candidates)
        full[self.keep] = x
        score, slope = self.objective.relaxed(full)
        return score, slope[self.keep]


def restricted_constraints(constraints: Constraints, keep: IntArray) -> Constraints:
    """Return the constraints over `keep`, which must hold every required candidate."""
    position = np.full(constraints.n, -1, dtype=np.int64)
    position[keep] = np.arange(keep.size)
    forbidden = position[constraints.forbidden]
    return replace(
        constraints,
        n=int(keep.size),
        group=constraints.group[keep],
        required=position[constraints.required],
        forbidden=forbidden[forbidden >= 0],
        cost=None if constraints.cost is None else constraints.cost[keep],
        place_m=None if constraints.place_m is None else constraints.place_m[keep],
    )
