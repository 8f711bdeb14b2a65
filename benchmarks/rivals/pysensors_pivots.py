"""PySensors: candidates as rows of a basis, ranked by pivoted QR or by two-point energies.

QR pivoting (Manohar et al. 2018) is greedy D-optimality without a prior, for at most as many
sensors as states; with more, the two-point greedy (Klishin et al. 2023) takes a diagonal prior.
"""

from __future__ import annotations

import importlib
from typing import Any

import numpy as np

from benchmarks.rivals.greedy_libraries import count_alone
from benchmarks.rivals.registry import Answer, CannotSayError, Limits
from benchmarks.runner.subjects import Subject
from placement.objectives.log_det import LogDet


def solve_pysensors(subject: Subject, limits: Limits) -> Answer:
    """Rank the experiments and take the first k."""
    optimizers: Any = importlib.import_module("pysensors.optimizers")

    del limits
    f, constraints = subject.problem.objective, subject.problem.constraints
    if not isinstance(f, LogDet) or f.rank != 1:
        raise CannotSayError("a sensor of PySensors is one row of a basis: rank-one designs only")
    k = count_alone(constraints)
    basis = np.ascontiguousarray(f.columns.T)
    if k <= f.n_states:
        ranked = optimizers.QR().fit(basis).get_sensors()
        return Answer([int(i) for i in ranked[:k]], note="pivoted QR: no prior, proves nothing")
    diagonal = np.diag(f.prior)
    if not np.allclose(f.prior, np.diag(diagonal)):
        raise CannotSayError("more sensors than states need a diagonal prior")
    sensors = optimizers.TPGR(n_sensors=k, prior=1.0 / np.sqrt(diagonal), noise=1.0)
    sensors.fit(basis, 1.0 / np.sqrt(diagonal))
    return Answer([int(i) for i in sensors.sensors_], note="two-point greedy: proves nothing")
