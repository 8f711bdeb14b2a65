"""Two questions about objectives: do returns diminish, and do they foretell the closed loop."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd
from scipy.stats import spearmanr

from models.geometry import IntArray
from placement.objectives.base import Objective

# Gains this far apart, relative to the larger, are the same gain in different orders of summing.
ROUNDING = 1e-9


def diminishing_returns(
    objective: Objective, mount: IntArray, triples: int, rng: np.random.Generator
) -> dict[str, float]:
    """Sample sets A ⊂ B and a camera i, and count where i gains more on B than on A.

    Sets have 0 to 6 cameras on mounts of their own; gains are of the score, so that more is
    better. Returns the share of violations in per cent, and the worst gain on B over that on A.
    """
    sign = 1.0 if objective.maximise else -1.0
    violations, worst = 0, 1.0
    poses = [np.flatnonzero(mount == m) for m in np.unique(mount)]
    for _ in range(triples):
        size = int(rng.integers(2, min(8, len(poses)) + 1))
        chosen = np.array(
            [rng.choice(poses[m]) for m in rng.choice(len(poses), size, replace=False)]
        )
        small = chosen[1 : 1 + int(rng.integers(0, size - 1))]
        gains = []
        for base in (small, chosen[1:]):
            before, after = (
                objective.value(np.sort(s)) for s in (base, np.append(base, chosen[0]))
            )
            gains.append(sign * (after - before))
        on_a, on_b = gains
        if on_b > on_a + ROUNDING * max(abs(on_a), abs(on_b)) + 1e-12:
            violations += 1
            worst = max(worst, on_b / on_a) if on_a > 0.0 else np.inf
    return {
        "triples": triples,
        "violations_percent": 100.0 * violations / triples,
        "worst_gain_ratio": worst,
    }


def rank_correlations(driven: pd.DataFrame, objectives: Sequence[str]) -> pd.DataFrame:
    """Return, for each road and k, Spearman's ρ of each objective with the closed loop.

    Signed so that 1 means: the better the objective, the smaller the error. Over the sets of one k
    on one road, and under k = 0 over all of the road's. A set counts once, whoever found it.
    """
    driven = driven.drop_duplicates(["road", "k", "set"])
    rows = []
    for road, on_road in driven.groupby("road", sort=False):
        for k in (0, *sorted(on_road["k"].unique())):
            part = on_road[on_road["k"] == k] if k else on_road
            part = part.dropna(subset=["cross_track_rms_m"])
            rows += [
                {
                    "road": road,
                    "k": k,
                    "sets": len(part),
                    "objective": name,
                    "cross_track": _rho(part, name, "cross_track_rms_m"),
                    "error": _rho(part, name, "error_rms_m"),
                }
                for name in objectives
            ]
    return pd.DataFrame(rows)


def _rho(part: pd.DataFrame, objective: str, error: str) -> float:
    if len(part) < 3 or part[objective].nunique() < 2 or part[error].nunique() < 2:
        return float("nan")
    sign = -1.0 if objective in ("localisation", "entropy") else 1.0
    return sign * float(spearmanr(part[objective], part[error]).statistic)
