"""Chama: coverage formulation (Klise et al. 2017), a Pyomo model handed to HiGHS in process.

Its `redundancy` r asks for r + 1 sensors; groups go in by its grouping constraint.
"""

from __future__ import annotations

import importlib
from typing import Any

import numpy as np
import pandas as pd

from benchmarks.rivals.registry import Answer, CannotSayError, Limits
from benchmarks.runner.subjects import Subject
from placement.objectives.coverage import Coverage


def solve_chama(subject: Subject, limits: Limits) -> Answer:
    """Build Chama's model and solve it; sensors are named by candidate number."""
    pyomo: Any = importlib.import_module("pyomo.environ")
    chama: Any = importlib.import_module("chama.optimize")

    f, constraints = subject.problem.objective, subject.problem.constraints
    if not isinstance(f, Coverage) or f.partial:
        raise CannotSayError(f"Chama minimises impacts and maximises coverage; no {f.name}")
    if constraints.separation_m:
        raise CannotSayError("no word for budget.separation_m")
    if constraints.limits_money and constraints.budget < constraints.n:
        raise CannotSayError("either a count or money, not both")
    rows = np.split(f.indices, f.indptr[1:-1])
    deaf = [i for i, row in enumerate(rows) if not row.size]
    usable = constraints.usable()
    names = [i for i, row in enumerate(rows) if row.size and usable[i]]
    table = pd.DataFrame({"Sensor": names, "Coverage": [[int(t) for t in rows[i]] for i in names]})
    seen = sorted({int(t) for i in names for t in rows[i]})
    formulation = chama.CoverageFormulation()
    sensor = None
    if constraints.limits_money and constraints.cost is not None:
        sensor = pd.DataFrame({"Sensor": names, "Cost": constraints.cost[names]})
    model = formulation.create_pyomo_model(
        table,
        sensor=sensor,
        entity=pd.DataFrame({"Entity": seen, "Weight": f.weights[seen]}),
        sensor_budget=constraints.money if sensor is not None else constraints.budget,
        use_sensor_cost=sensor is not None,
        use_entity_weight=True,
        redundancy=f.times - 1,
    )
    for group in np.unique(constraints.group[constraints.group >= 0]):
        members = [int(i) for i in names if constraints.group[i] == group]
        if len(members) > 1:
            formulation.add_grouping_constraint(members, max_select=1)
    for i in np.unique(constraints.required):
        if int(i) in deaf:
            continue
        formulation.add_grouping_constraint([int(i)], select=1)
    solver = pyomo.SolverFactory("appsi_highs")
    solver.config.time_limit = limits.time_limit_s
    results = solver.solve(model)
    chosen = [int(s) for s in model.sensor_list if (pyomo.value(model.y[s]) or 0.0) > 0.5]
    bound = results.problem.upper_bound
    return Answer(chosen, None if bound is None else float(bound))
