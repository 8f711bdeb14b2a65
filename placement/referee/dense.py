"""The referee for bare problems: the value by one dense inverse, the rules, a bound of its own.

Nothing here is shared with the objectives or solvers but the file's reader: the information of the
chosen is summed in the file's own units, without whitening, and the bound is a tangent's at points
of plain Frank–Wolfe steps.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from models.geometry import FloatArray
from placement.experiments import read_table
from placement.information_problem import InformationProblem, read_problem
from placement.referee.bounds import SLACK, Knapsack
from placement.referee.checks import Check, is_number, near, none_of, same

ROUNDS = 300
UNITS = {"log_det": "nats", "trace_inverse": "state^2"}
MONEY_SLACK = 1e-9  # ten prices of 0.1 fit into 1.0
TOLERANCE = 1e-6


def dense_checks(
    folder: Path,
    record: Mapping[str, Any],
    certificate: Callable[[Mapping[str, Any], float, bool], list[Check]],
) -> tuple[list[Check], list[str], dict[str, Any]]:
    """Return the checks of a bare problem's folder, what is left on trust, and the bounds."""
    bare = read_problem(folder / "problem.npz")
    c = len(bare.factors)
    maximise = bare.objective == "log_det"
    listed = record.get("selected")
    selected = listed if isinstance(listed, list) else []
    inside = sorted({i for i in selected if type(i) is int and 0 <= i < c})
    value = dense_value(bare, inside)
    # what the matrix's own rounding leaves open, relative to the trace or absolute in nats
    doubt = _doubt(bare)
    slack = TOLERANCE * abs(value) + (doubt if maximise else doubt * abs(value))
    count = c if bare.cost is not None else int(bare.budget)
    checks = [
        same("instance_sha256", bare.sha256(), record.get("instance_sha256")),
        Check("selected", listed == inside, "different candidates, sorted", listed),
        same("objective", bare.objective, record.get("objective")),
        same("unit", UNITS[bare.objective], record.get("unit")),
        same("budget", count, record.get("budget")),
        same("candidates", c, record.get("candidates")),
        same("cameras", [], record.get("cameras")),
        none_of("rules", _broken(bare, inside)),
        *_money(bare, inside, record),
        same("placements.csv", inside, _table(folder)),
        near("value", value, record.get("value"), slack),
        *certificate(record, value, maximise),
    ]
    side = "upper_bound" if maximise else "lower_bound"
    recorded = record.get(side)
    found: dict[str, Any] = {"recorded": recorded, "derived": None}
    if not is_number(recorded):
        return checks, [], found
    sign = 1.0 if maximise else -1.0
    derived = sign * dense_bound(bare)
    found |= {"derived": derived}
    if value:
        found["derived_gap"] = abs(derived - value) / abs(value)
    holds = sign * derived >= sign * value - slack
    checks.append(Check("bound.derived", holds, f"beyond {value!r}", derived, slack))
    if sign * recorded >= sign * derived - slack:
        return checks, [], found
    return checks, [f"{side} {recorded:.9g}, tighter than the {derived:.9g} derived here"], found


def dense_value(bare: InformationProblem, selected: list[int]) -> float:
    """Return log det M − log det Λ, or tr M⁻¹, of M = Λ + Σ F Fᵀ."""
    M = np.array(bare.prior, dtype=float)
    for i in selected:
        F = np.asarray(bare.factors[i], dtype=float)
        M = M + F @ F.T
    if bare.objective == "log_det":
        return float(np.linalg.slogdet(M)[1] - np.linalg.slogdet(bare.prior)[1])
    return float(np.trace(np.linalg.inv(M)))


def dense_bound(bare: InformationProblem) -> float:
    """Return an upper bound on every design's score: the least tangent of Frank–Wolfe's points."""
    F = np.asarray(bare.factors, dtype=float)
    c = len(F)
    group = np.full(c, -1) if bare.group is None else np.asarray(bare.group)
    money = math.inf if bare.cost is None else float(bare.budget) * (1.0 + MONEY_SLACK)
    count = c if bare.cost is not None else int(bare.budget)
    cost = None if bare.cost is None else np.asarray(bare.cost, dtype=float)
    usable = np.ones(c, dtype=np.bool_) if cost is None else cost <= money
    knapsack = Knapsack(usable, group.astype(np.int64), count, cost, money)
    x, bound = np.zeros(c), math.inf
    for n in range(ROUNDS):
        M = bare.prior + np.einsum("cir,cjr,c->ij", F, F, x, optimize=True)
        score, slope = _tangent(bare, M, F)
        tangent = score - math.fsum(slope * x) + knapsack.most(slope)
        bound = min(bound, tangent + SLACK * (abs(score) + math.fsum(np.abs(slope * x))))
        corner = np.zeros(c)
        corner[knapsack.best(slope)] = 1.0
        x += 2.0 / (n + 2.0) * (corner - x)
    return bound


def _tangent(bare: InformationProblem, M: FloatArray, F: FloatArray) -> tuple[float, FloatArray]:
    """Return the score at information `M` and its slope by each candidate (c,)."""
    inverse = np.linalg.inv(M)
    if bare.objective == "log_det":
        score = float(np.linalg.slogdet(M)[1] - np.linalg.slogdet(bare.prior)[1])
        return score, np.einsum("cir,ij,cjr->c", F, inverse, F, optimize=True)
    slope = np.einsum("cir,ij,cjr->c", F, inverse @ inverse, F, optimize=True)
    return -float(np.trace(inverse)), slope


def _doubt(bare: InformationProblem) -> float:
    """Return n ε times the prior's condition number: what rounding its entries may change."""
    return len(bare.prior) * float(np.finfo(float).eps) * float(np.linalg.cond(bare.prior))


def _broken(bare: InformationProblem, selected: list[int]) -> list[str]:
    faults = []
    if bare.cost is None and len(selected) > bare.budget:
        faults.append(f"{len(selected)} candidates exceed the budget of {bare.budget:g}")
    if bare.group is not None:
        groups = [int(bare.group[i]) for i in selected if bare.group[i] >= 0]
        faults += [
            f"group {g} holds {groups.count(g)}" for g in sorted(set(groups)) if groups.count(g) > 1
        ]
    if bare.cost is not None:
        spent = math.fsum(float(bare.cost[i]) for i in selected)
        if spent > bare.budget * (1.0 + MONEY_SLACK):
            faults.append(f"the candidates cost {spent:.10g}, and there is {bare.budget:.10g}")
    return faults


def _money(bare: InformationProblem, selected: list[int], record: Mapping[str, Any]) -> list[Check]:
    if bare.cost is None:
        return []
    spent = math.fsum(float(bare.cost[i]) for i in selected)
    return [
        near("cost", spent, record.get("cost"), 1e-9 * spent),
        same("money", float(bare.budget), record.get("money")),
    ]


def _table(folder: Path) -> list[int]:
    """Return the candidates that `placements.csv` names."""
    path = folder / "placements.csv"
    text = path.read_text(encoding="utf-8") if path.is_file() else ""
    if text.strip().count("\n") < 1:  # a header alone: nothing was chosen
        return []
    rows = read_table(path).factors[:, :, 0]
    return [int(row[0]) for row in rows]


def read_record(folder: Path) -> dict[str, Any]:
    """Read `solution.json`.

    Raises:
        ValueError: in one line, if it is not there or not a JSON object.
    """
    path = folder / "solution.json"
    try:
        record = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise ValueError(f"{path} must be what `placement solve --out` writes ({error})") from None
    if not isinstance(record, dict):
        raise ValueError(f"{path} must be what `placement solve --out` writes, got no object")
    return record
