"""The objectives that `mip` can cut: who makes cuts of each, and how many levels they speak of."""

from __future__ import annotations

from dataclasses import replace

from models.geometry import IntArray
from placement.bounds.coverage_cuts import CoverageCuts, restricted_coverage
from placement.bounds.cuts import CutMaker
from placement.bounds.restrict import restricted_information, restricted_objective
from placement.bounds.whole_cuts import WholeCutMaker
from placement.objectives.coverage import Coverage
from placement.objectives.entropy import Entropy
from placement.objectives.localisation import Localisation

Cuttable = Localisation | Coverage | Entropy
Maker = CutMaker | CoverageCuts | WholeCutMaker


def cut_maker(objective: Cuttable) -> Maker:
    """Cut sample by sample where the score is a sum over samples, else as a whole."""
    if isinstance(objective, Coverage):
        return CoverageCuts(objective)
    return CutMaker(objective) if isinstance(objective, Localisation) else WholeCutMaker(objective)


def n_levels(objective: Cuttable) -> int:
    """Return how many terms the score is a sum of."""
    if isinstance(objective, Localisation | Coverage):
        return objective.information.n_samples
    return 1


def restricted(objective: Cuttable, keep: IntArray) -> Cuttable:
    """Return the same objective over the candidates `keep` alone."""
    if isinstance(objective, Coverage):
        return restricted_coverage(objective, keep)
    if isinstance(objective, Localisation):
        return restricted_objective(objective, keep)
    return Entropy(
        [
            replace(drive, information=restricted_information(drive.information, keep))
            for drive in objective.drives
        ]
    )
