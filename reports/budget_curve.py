"""The picture of a budget curve: the best value found for each budget, and the proven band."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from models.geometry import FloatArray
from reports.style import BLUE, SKY, VERMILION, saved, style

if TYPE_CHECKING:
    from placement.atomic import Content
    from placement.budget_curve import BudgetCurve


def draw(curve: BudgetCurve) -> dict[str, Content]:
    """Draw values, the band up to the bound, and the concave hull: `budget_curve.png`, `.svg`."""
    solutions = curve.solutions
    k = curve.first + np.arange(len(solutions))
    value = np.array([s.value for s in solutions])
    bound = np.array([np.nan if s.bound is None else s.bound for s in solutions])
    with style():
        figure = Figure(figsize=(7.0, 4.2))
        axes = figure.subplots()
        if np.isfinite(bound).any():
            axes.fill_between(k, value, bound, color=SKY, alpha=0.4, label="proven band")
        axes.plot(k, value, "o-", color=BLUE, markersize=3, label="best placement found")
        sign = 1.0 if solutions[0].maximise else -1.0
        hull = _hull(sign * value)
        # at every k: a chord is straight in the value, not in its logarithm
        chords = np.interp(k, k[hull], value[hull])
        axes.plot(k, chords, "--", color=VERMILION, linewidth=0.8, label="concave hull")
        if not solutions[0].maximise and np.all(value > 0.0):
            axes.set_yscale("log")
        axes.set_xlabel("cameras k")
        axes.set_ylabel(f"{solutions[0].objective} ({solutions[0].unit.replace('^2', '²')})")
        axes.legend(loc="best", fontsize=8)
    return {"budget_curve.png": saved(figure, "png"), "budget_curve.svg": saved(figure, "svg")}


def _hull(score: FloatArray) -> list[int]:
    """Return the corners of the concave hull of scores at equal steps."""
    corners: list[int] = []
    for n in range(len(score)):
        while len(corners) > 1:
            a, b = corners[-2], corners[-1]
            if (score[b] - score[a]) * (n - b) > (score[n] - score[b]) * (b - a):
                break
            corners.pop()
        corners.append(n)
    return corners
