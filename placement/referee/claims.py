"""What a solution and its budget curve claim: bound, gap and status against a value known here."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from placement.candidates import Candidates
from placement.constraints import Constraints
from placement.referee.checks import Check, is_number, near, none_of, same
from placement.referee.rules import rule_checks
from placement.referee.tables import number, read_csv, whole
from placement.referee.values import MAXIMISED, Scene, eyes_of, whole_value
from placement.solution import OPTIMAL_GAP, Status

# Stored information is float32 (6e-8 relative an entry), and the referee's derivatives are
# differences: values agree to 1e-8; whatever somebody changed shows in more than a millionth.
VALUE_TOLERANCE = 1e-6


def certificate_checks(record: Mapping[str, Any], value: float, maximise: bool) -> list[Check]:
    """Check bound, gap and status against each other and against the value derived here."""
    side = "upper_bound" if maximise else "lower_bound"
    bound, gap, status = record.get(side), record.get("gap"), record.get("status")
    stated = record.get("value")
    checks = [
        Check("bound.side", side in record and _other(side) not in record, side, _sides(record)),
        Check("status.word", status in set(map(str, Status)), [str(s) for s in Status], status),
    ]
    if bound is None:
        checks.append(same("gap", None, gap))
        checks.append(Check("status", status != "optimal", "not optimal without a bound", status))
        return checks
    slack = VALUE_TOLERANCE * abs(value)
    sign = 1.0 if maximise else -1.0
    holds = is_number(bound) and sign * bound >= sign * value - slack
    checks.append(
        Check("bound.holds", holds, f"at {'least' if maximise else 'most'} {value!r}", bound, slack)
    )
    if not (is_number(bound) and is_number(stated)):
        return [*checks, none_of("gap", ["bound and value must both be numbers"])]
    distance = abs(bound - stated)
    share = 0.0 if distance == 0.0 else distance / abs(stated) if stated else None
    if share is None:
        checks.append(same("gap", None, gap))
    else:
        checks.append(near("gap", share, gap, 1e-9 * share + 1e-15))
    proven = distance <= OPTIMAL_GAP * abs(stated) * (1.0 + 1e-9)
    right = (status == "optimal") == proven
    wanted = "optimal" if proven else "not optimal: the gap is open"
    checks.append(Check("status", right, wanted, status))
    return checks


def curve_checks(
    path: Path, scene: Scene, candidates: Candidates, constraints: Constraints
) -> list[Check]:
    """Check every row of `budget_curve.csv`: its placement, value, bound, gap and status.

    Its budgets follow each other without a hole, and the last is the folder's own.
    """
    maximise = scene.instance.objective.kind in MAXIMISED
    sign = 1.0 if maximise else -1.0
    faults: list[str] = []
    last = {"value": -math.inf, "bound": -math.inf}
    rows = read_csv(path)
    budgets = [whole(row.get("k") or "") for row in rows]
    own = list(range(constraints.budget - len(rows) + 1, constraints.budget + 1))
    if not rows or budgets != own:
        faults.append(f"k must rise by one to the budget of {constraints.budget}")
    for n, row in enumerate(rows):
        k, words = whole(row.get("k") or ""), (row.get("selected") or "").split()
        chosen = [whole(word) for word in words]
        if not isinstance(k, int) or not all(
            isinstance(i, int) and 0 <= i < len(candidates) for i in chosen
        ):
            faults.append(f"row {n}: k and selected must be whole numbers")
            continue
        indices = [i for i in chosen if isinstance(i, int)]
        allowed = replace(constraints, budget=k)
        rules = rule_checks(scene.instance, candidates, allowed, indices)
        faults += [f"row {n}: {check.name}: {check.got}" for check in rules if not check.passed]
        value = whole_value(scene, eyes_of(candidates, indices))
        record: dict[str, Any] = {key: _finite(row.get(key)) for key in ("value", "bound", "gap")}
        record["upper_bound" if maximise else "lower_bound"] = record["bound"]
        stated = near("value", value, record["value"], VALUE_TOLERANCE * abs(value))
        record["status"] = row.get("status")
        # The table holds ten digits, so its gaps are rounded: only large ones can be divided out.
        if (record["gap"] or 0.0) < 1e-6:
            record["gap"] = None
        found = [stated, *certificate_checks(record, value, maximise)]
        wrong = [c.name for c in found if not c.passed and (c.name != "gap" or record["gap"])]
        faults += [f"row {n}: {name}" for name in wrong if name != "gap"]
        if "gap" in wrong and not _gap_is_near(record):
            faults.append(f"row {n}: gap")
        for key in ("value", "bound"):
            now = record[key]
            if now is not None and sign * now < last[key] - 1e-9 * abs(now):
                faults.append(f"row {n}: {key} is worse than with fewer cameras")
            last[key] = sign * now if now is not None else last[key]
    return [none_of("budget_curve.csv", faults)]


def _gap_is_near(record: Mapping[str, Any]) -> bool:
    value, bound, gap = record["value"], record["bound"], record["gap"]
    if value is None or bound is None or not value:
        return False
    return bool(abs(abs(bound - value) / abs(value) - gap) <= 1e-8)


def _finite(text: str | None) -> float | None:
    found = number(text)
    return found if math.isfinite(found) else None


def _other(side: str) -> str:
    return "lower_bound" if side == "upper_bound" else "upper_bound"


def _sides(record: Mapping[str, Any]) -> str:
    sides = [side for side in ("upper_bound", "lower_bound") if side in record]
    return " and ".join(sides) or "none"
