"""The same problem with fewer candidates, once the others are proven not to matter."""

from __future__ import annotations

import numpy as np

from models.geometry import IntArray
from placement.constraints import Constraints
from placement.information import Information
from placement.objectives.localisation import Localisation


def restricted_objective(objective: Localisation, keep: IntArray) -> Localisation:
    """Return `localisation` over the candidates `keep` alone, numbered 0 … len(keep) − 1."""
    lengths = np.diff(objective.indptr)[keep]
    starts = objective.indptr[keep]
    ends = np.cumsum(lengths)
    entries = np.arange(int(lengths.sum())) + np.repeat(starts - (ends - lengths), lengths)
    information = Information(
        objective.information.n_samples,
        np.concatenate([[0], ends]).astype(np.int64),
        objective.indices[entries],
        objective.blocks[entries],
    )
    return Localisation(information, objective.prior_sigma_m, objective.weights)


def restricted_constraints(constraints: Constraints, keep: IntArray) -> Constraints:
    """Return the constraints over `keep`, which must hold every required candidate."""
    position = np.full(constraints.n, -1, dtype=np.int64)
    position[keep] = np.arange(keep.size)
    forbidden = position[constraints.forbidden]
    return Constraints(
        int(keep.size),
        constraints.budget,
        constraints.group[keep],
        position[constraints.required],
        forbidden[forbidden >= 0],
    )
