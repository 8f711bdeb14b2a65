"""The referee on tolerance: every drive filtered densely, all cameras working or one dark."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from placement.constraints import Constraints
from placement.referee.checks import Check
from placement.referee.sight import Eye
from placement.referee.values import Scene, filtered, lateral_variance, sights_of

# The solvers' information is stored in float32; 2σ follows it to a few parts in ten million.
SLACK = 1e-6


def tolerance_value(
    scene: Scene, eyes: Sequence[Eye], selected: Sequence[int], constraints: Constraints
) -> tuple[float, list[Check]]:
    """Return the number of cameras, or their price, and a check that each drive is in tolerance.

    With `budget.failures` = 1 there is one more check: the worst of all failures and drives.
    """
    tau = scene.instance.objective.tolerance_m
    checks = []
    for number, drive in enumerate(scene.drives()):
        name = "tolerance" if number == 0 and not scene.others else f"tolerance.drive[{number}]"
        sights = sights_of(drive, eyes)
        checks.append(_within(name, drive, [worst(drive, sights)], tau))
        if scene.instance.budget.failures:
            dark = [worst(drive, sights[:n] + sights[n + 1 :]) for n in range(len(sights))]
            if dark:
                checks.append(_within(f"{name}.one_dark", drive, dark, tau))
    if constraints.cost is None:
        return float(len(selected)), checks
    return math.fsum(constraints.cost[i] for i in selected), checks


def worst(scene: Scene, sights: Sequence[object]) -> tuple[float, float]:
    """Return the largest 2σ across the road and where it is, both in metres."""
    lateral = lateral_variance(scene, filtered(scene, sights).covariance)  # type: ignore[arg-type]
    t = int(np.argmax(lateral))
    return 2.0 * math.sqrt(float(lateral[t])), float(scene.track.s_m[t])


def _within(name: str, scene: Scene, found: list[tuple[float, float]], tau: float) -> Check:
    n = int(np.argmax([reached for reached, _ in found]))
    reached, where = found[n]
    which = f", camera {n} dark" if name.endswith("one_dark") else ""
    got = f"{reached:.6g} m at s = {where:.6g} m of {scene.name}{which}"
    return Check(name, reached <= tau * (1.0 + SLACK), f"2σ of at most {tau:g} m", got, SLACK * tau)
