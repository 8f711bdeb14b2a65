"""Three pictures of a run: performance profiles, gap against time, seconds against size.

Performance profiles are those of Dolan & Moré (2002): for each solver, on what share of the
instances it reached the best value within τ times the seconds of the fastest that did.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from benchmarks.runner.summary import SAME, Row, behind, best_values, seconds_of, solved

if TYPE_CHECKING:
    from placement.atomic import Content

MARKERS = "osD^v<>Ph*X"
SMALLEST_GAP = 1e-8
_STYLE: Any = {
    "axes.grid": True,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "figure.constrained_layout.use": True,
    "font.size": 9.0,
    "grid.alpha": 0.3,
    "legend.frameon": False,
    "savefig.dpi": 160,
    "svg.hashsalt": "placement",
}


def figures(rows: Sequence[Row]) -> dict[str, Content]:
    """Return the files of all three figures, PNG and SVG; none where nothing was solved."""
    good = [row for row in rows if solved(row)]
    if not good:
        return {}
    solvers = list(dict.fromkeys(str(row["solver"]) for row in rows))
    looks = {
        solver: {"color": mpl.colormaps["tab20"](k % 20), "marker": MARKERS[k % len(MARKERS)]}
        for k, solver in enumerate(solvers)
    }
    files: dict[str, Content] = {}
    for name, draw in (
        ("performance_profile", _profile),
        ("gap_time", _gap_time),
        ("scaling", _scaling),
    ):
        with mpl.rc_context(_STYLE):
            figure = Figure(figsize=(7.5, 4.5))
            draw(figure, rows, looks)
        for kind in ("png", "svg"):
            files[f"{name}.{kind}"] = _saved(figure, kind)
    return files


def profile(rows: Sequence[Row], solver: str) -> list[float]:
    """Return, for each instance and seed, the solver's seconds over the fastest's that was best.

    Infinite where it did not reach the best value.
    """
    best = best_values(rows)
    ratios = []
    for case in dict.fromkeys((row["instance"], row["seed"]) for row in rows):
        here = [row for row in rows if (row["instance"], row["seed"]) == case]
        reached = {str(row["solver"]): seconds_of(row) for row in here if behind(row, best) <= SAME}
        if reached:
            ratios.append(reached.get(solver, np.inf) / min(reached.values()))
    return ratios


def _profile(figure: Figure, rows: Sequence[Row], looks: Mapping[str, Any]) -> None:
    axes = figure.subplots()
    highest = 10.0
    for solver, look in looks.items():
        ratios = np.sort(profile(rows, solver))
        finite = ratios[np.isfinite(ratios)]
        if not finite.size:
            continue
        highest = max(highest, 2.0 * float(finite[-1]))
        share = np.arange(1, finite.size + 1) / ratios.size
        axes.step(
            [*finite, 1e12], [*share, share[-1]], where="post", label=solver, color=look["color"]
        )
    axes.set_xscale("log")
    axes.set_xlim(1.0, highest)
    axes.set_ylim(0.0, 1.02)
    axes.set_xlabel("processor seconds over those of the fastest that reached the best value")
    axes.set_ylabel("share of the instances")
    figure.legend(*axes.get_legend_handles_labels(), loc="outside right upper", fontsize=8)


def _gap_time(figure: Figure, rows: Sequence[Row], looks: Mapping[str, Any]) -> None:
    axes = figure.subplots()
    for solver, look in looks.items():
        own = [
            row
            for row in rows
            if row["solver"] == solver
            and solved(row)
            and row.get("gap") is not None
            and row["status"] != "wrong_bound"
        ]
        if own:
            seconds = [seconds_of(row) for row in own]
            gaps = [max(float(row["gap"]), SMALLEST_GAP) for row in own]
            axes.plot(seconds, gaps, linestyle="none", markersize=4, label=solver, **look)
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.axhline(1e-6, color="0.5", linewidth=0.8)
    axes.set_xlabel("processor seconds")
    axes.set_ylabel("proven gap (below the line: optimal)")
    figure.legend(*axes.get_legend_handles_labels(), loc="outside right upper", fontsize=8)


def _scaling(figure: Figure, rows: Sequence[Row], looks: Mapping[str, Any]) -> None:
    axes = figure.subplots()
    for solver, look in looks.items():
        points = sorted(
            (float(row["candidates"]), seconds_of(row))
            for row in rows
            if row["solver"] == solver and solved(row)
        )
        if points:
            size, seconds = zip(*points, strict=True)
            axes.plot(size, seconds, linestyle="none", markersize=4, label=solver, **look)
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel("candidates")
    axes.set_ylabel("processor seconds")
    figure.legend(*axes.get_legend_handles_labels(), loc="outside right upper", fontsize=8)


def _saved(figure: Figure, kind: str) -> Callable[[Path], None]:
    """Return a function that writes `figure` undated, so that equal figures are equal bytes."""

    def save(path: Path) -> None:
        with mpl.rc_context(_STYLE):
            figure.savefig(
                path, format=kind, metadata={"Date": None} if kind == "svg" else {"Software": None}
            )

    return save
