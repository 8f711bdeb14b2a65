"""The rules of a placement, checked from the instance and not from `placement.constraints`."""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np

from placement.candidates import Candidates
from placement.constraints import Constraints
from placement.instance import Instance
from placement.referee.checks import Check, is_number, none_of, same

ANGLE_DEG = 1e-6
LENGTH_M = 1e-6


def form_check(selected: Any, n_candidates: int) -> Check:
    """Check that `selected` is a sorted list of different candidate indices."""
    faults = []
    if not isinstance(selected, list):
        faults.append(f"a {type(selected).__name__} instead of a list")
        return none_of("selected.form", faults)
    wrong = [i for i in selected if not isinstance(i, int) or isinstance(i, bool)]
    faults += [f"{i!r} is not a whole number" for i in wrong]
    if not wrong:
        faults += [
            f"{i} lies outside 0…{n_candidates - 1}" for i in selected if not 0 <= i < n_candidates
        ]
        faults += [f"{i} comes {n} times" for i, n in Counter(selected).items() if n > 1]
        if selected != sorted(selected):
            faults.append("not in increasing order")
    return none_of("selected.form", faults)


def rule_checks(
    instance: Instance, candidates: Candidates, constraints: Constraints, selected: Sequence[int]
) -> list[Check]:
    """Check every constraint of `[budget]` on the candidates `selected`.

    `constraints` gives only the required and forbidden poses that selectors mean.
    """
    budget, chosen = instance.budget, list(selected)
    mounts = [int(candidates.mount[i]) for i in chosen]
    checks = [
        Check("budget.cameras", len(chosen) <= constraints.budget, constraints.budget, len(chosen)),
        none_of(
            "budget.required",
            [f"candidate {i} is missing" for i in constraints.required.tolist() if i not in chosen],
        ),
        none_of(
            "budget.forbidden",
            [f"candidate {i} is there" for i in constraints.forbidden.tolist() if i in chosen],
        ),
    ]
    if budget.one_per_mount:
        full = [f"mount {m} holds {n}" for m, n in Counter(mounts).items() if n > 1]
        checks.append(none_of("budget.one_per_mount", full))
    if budget.groups:
        crowded = [
            f"groups[{g}] holds {n}"
            for g, group in enumerate(budget.groups)
            if (n := sum(mount in group for mount in mounts)) > 1
        ]
        checks.append(none_of("budget.groups", crowded))
    if budget.separation_m > 0.0:
        checks.append(_separation(candidates, sorted(set(mounts)), budget.separation_m))
    if budget.money is not None and constraints.cost is not None:
        spent = math.fsum(constraints.cost[i] for i in chosen)
        limit = budget.money * (1.0 + 1e-9)
        checks.append(Check("budget.money", spent <= limit, f"at most {budget.money:.10g}", spent))
    return checks


def _separation(candidates: Candidates, mounts: Sequence[int], separation_m: float) -> Check:
    x, y = candidates.mount_x_m, candidates.mount_y_m
    near = [
        f"mounts {a} and {b} stand {distance:.6g} m apart"
        for a, b in itertools.combinations(mounts, 2)
        if (distance := math.hypot(x[a] - x[b], y[a] - y[b])) < separation_m * (1.0 - 1e-9)
    ]
    return none_of("budget.separation_m", near)


def camera_checks(
    candidates: Candidates,
    constraints: Constraints,
    selected: Sequence[int],
    rows: Any,
    name: str,
) -> list[Check]:
    """Check each recorded camera against the candidate that it is said to be."""
    if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
        return [none_of(name, ["not a list of tables"])]
    checks = [same(f"{name}.count", len(selected), len(rows))]
    faults: list[str] = []
    for n, (i, row) in enumerate(zip(selected, rows, strict=False)):
        for key, wanted in expected_camera(candidates, constraints, i).items():
            got = row.get(key)
            if not _agrees(key, wanted, got):
                faults.append(f"[{n}].{key} is {got!r}, wanted {wanted!r}")
    checks.append(none_of(f"{name}.fields", faults))
    return checks


def expected_camera(candidates: Candidates, constraints: Constraints, i: int) -> dict[str, Any]:
    """Return what `solution.json` must say of candidate i."""
    from placement.referee.values import eyes_of

    eye = eyes_of(candidates, [i])[0]
    named = any(kind.name for kind in candidates.kinds)
    kind = {"type": candidates.kinds[int(candidates.kind[i])].name} if named else {}
    cost = {} if constraints.cost is None else {"cost": float(constraints.cost[i])}
    return {
        "mount": int(candidates.mount[i]),
        "x_m": eye.x_m,
        "y_m": eye.y_m,
        "height_m": eye.height_m,
        "yaw_deg": float(np.degrees(eye.yaw_rad)) % 360.0,
        "pitch_deg": float(np.degrees(eye.pitch_rad)),
        "hfov_deg": float(np.degrees(eye.hfov_rad)),
        "vfov_deg": float(np.degrees(eye.vfov_rad)),
        "projection": eye.projection,
        **kind,
        **cost,
    }


def _agrees(key: str, wanted: Any, got: Any) -> bool:
    if not isinstance(wanted, float):
        return type(wanted) is type(got) and bool(wanted == got)
    if not is_number(got):
        return False
    if key.endswith("_deg"):
        return abs((got - wanted + 180.0) % 360.0 - 180.0) <= ANGLE_DEG
    return bool(abs(got - wanted) <= LENGTH_M + 1e-9 * abs(wanted))
