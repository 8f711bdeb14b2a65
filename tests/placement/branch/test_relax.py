"""The relaxation under money finds the price: its bound is the conic solver's, nearly."""

from __future__ import annotations

from typing import Any

import cvxpy as cp
import numpy as np
import pytest

from benchmarks.instances.generators import fusion
from placement.branch.design import design_of
from placement.branch.relax import relax
from placement.information_problem import InformationProblem

MONEY = (3.0, 8.0, 20.0)


def conic(problem: InformationProblem) -> float:
    """Return the optimum of the relaxation by an interior point."""
    prior, factors = np.asarray(problem.prior), np.asarray(problem.factors)
    x: Any = cp.Variable(len(factors))
    whole = prior + sum(x[i] * (f @ f.T) for i, f in enumerate(factors))
    rules = [x >= 0.0, x <= 1.0, np.asarray(problem.cost) @ x <= float(problem.budget)]
    model = cp.Problem(cp.Maximize(cp.log_det(whole)), rules)
    model.solve(solver=cp.CLARABEL)
    return float(model.value) - float(np.linalg.slogdet(prior)[1])


@pytest.mark.parametrize("money", MONEY)
@pytest.mark.parametrize("start", [0.0, 0.05, 4.0])
def test_the_price_of_money_is_found_from_anywhere(money: float, start: float) -> None:
    drawn = InformationProblem(**fusion(n=5, c=14, money=money, seed=1))
    design, wanted = design_of(drawn.problem()), conic(drawn)
    p = len(design.ids)
    bound, *_ = relax(
        design.kind, False, design.base, design.root, design.V, design.group, design.cost,
        design.purse, True, np.arange(p), np.empty(0, dtype=np.int64), design.k, np.zeros(p),
        start, wanted - 0.5, 1e-9, 400, np.empty(p), np.empty(p),
    )  # fmt: skip
    assert wanted - 1e-6 * abs(wanted) <= bound <= wanted + 0.12
