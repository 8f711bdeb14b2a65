"""Pictures of a placement over all streets of a network: what is seen, and how well.

A city is drawn to be read from afar: streets in hairlines, what cameras see in colours, cameras as
dots; and beside it what share of the streets is known how well, as no road's error can be drawn.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from models.geometry import FloatArray
from placement.output import cameras_seeing
from reports.streets import COLOURS, buildings_near, error_limits, stretches_of, visible_ground
from reports.style import BLACK, BLUE, GREY, SKY, VERMILION, saved, style

if TYPE_CHECKING:
    from placement.atomic import Content
    from placement.commands import Result

_BUILDINGS = "#d9d4cc"
_MARGIN_M = 50.0
_MANY = 300  # cameras: more are dots


def draw_streets(result: Result) -> dict[str, Content]:
    """Draw the map and the shares of the streets: `map.png` and `map.svg`."""
    with style():
        figure = Figure(figsize=(9.0, 11.0))
        upper, lower = figure.subplots(2, 1, height_ratios=(3.4, 1.0))
        draw_network(upper, result)
        draw_shares(lower, result)
        solution = result.solution
        gap = "" if solution.gap is None else f", gap {100 * solution.gap:.2g} %"
        name = result.scene.instance.name.replace("$", r"\$")
        upper.set_title(
            f"{name}: {len(solution.selected):,} cameras by {solution.method}, "
            f"{solution.objective} {solution.value:.6g} {solution.unit} "
            f"({solution.status.replace('_', ' ')}{gap})"
        )
    return {"map.png": saved(figure, "png"), "map.svg": saved(figure, "svg")}


def draw_network(axes: Axes, result: Result) -> None:
    """Draw buildings, the ground that is seen, streets by class, cameras, a scale and a legend."""
    stretches = stretches_of(result)
    buildings = PolyCollection(
        buildings_near(result, _MARGIN_M), facecolors=_BUILDINGS, linewidths=0, rasterized=True
    )
    axes.add_collection(buildings)
    ground = [piece.outline for pieces in visible_ground(result) for piece in pieces]
    axes.add_collection(
        PolyCollection(ground, facecolors=SKY, alpha=0.5, linewidths=0, rasterized=True)
    )
    for kind, colour in enumerate(COLOURS):
        lines = [stretches.lines[i] for i in np.flatnonzero(stretches.kind == kind)]
        axes.add_collection(
            LineCollection(lines, colors=colour, linewidths=1.4 if kind else 0.4, zorder=2.0 + kind)
        )
    chosen = np.array(sorted(result.solution.selected), dtype=np.int64)
    cameras = result.scene.candidates.cameras.subset(chosen)
    size = 3.5 if len(chosen) <= _MANY else 1.1
    axes.plot(cameras.x_m, cameras.y_m, ".", color=VERMILION, markersize=size, zorder=9)
    xy = result.scene.points.xy
    low, high = xy.min(axis=0) - _MARGIN_M, xy.max(axis=0) + _MARGIN_M
    axes.set_xlim(low[0], high[0])
    axes.set_ylim(low[1], high[1])
    axes.set_aspect("equal", adjustable="box")
    axes.set_xlabel("east x (m)")
    axes.set_ylabel("north y (m)")
    axes.grid(False)
    _scale_bar(axes, low, high)
    handles = [
        Line2D([], [], color=VERMILION, marker=".", linestyle="", label="camera"),
        Patch(color=SKY, alpha=0.5, label="ground that a camera sees"),
        Patch(color=_BUILDINGS, label="building"),
        *(
            Line2D([], [], color=colour, linewidth=2.0, label=label)
            for colour, label in zip(COLOURS, stretches.labels, strict=True)
        ),
    ]
    axes.legend(handles=handles, loc="best", fontsize=8)


def _scale_bar(axes: Axes, low: FloatArray, high: FloatArray) -> None:
    """Draw a bar of a round length, about a sixth of the map, in its lower right corner."""
    most = float(high[0] - low[0]) / 5.0
    power = 10.0 ** np.floor(np.log10(most))
    length = power * max(n for n in (1.0, 2.0, 5.0) if n * power <= most)
    x = float(high[0]) - 0.03 * float(high[0] - low[0])
    y = float(low[1]) + 0.03 * float(high[1] - low[1])
    axes.plot([x - length, x], [y, y], color=BLACK, linewidth=2.5, solid_capstyle="butt", zorder=10)
    label = f"{length / 1000.0:g} km" if length >= 1000.0 else f"{length:g} m"
    axes.annotate(
        label, (x - 0.5 * length, y), xytext=(0, 3), textcoords="offset points", ha="center"
    )


def draw_shares(axes: Axes, result: Result) -> None:
    """Draw which share of the streets is known to within an error, and what the prior knows."""
    sigma = np.sort(result.prediction.position_sigma_m)
    share = 100.0 * np.arange(1, len(sigma) + 1) / len(sigma)
    at = np.unique(np.linspace(0, len(sigma) - 1, 2000).astype(np.int64))
    axes.step(sigma[at], share[at], where="post", color=BLUE)
    prior = result.scene.instance.objective.prior_sigma_m * np.sqrt(2.0)
    axes.axvline(prior, color=GREY, linestyle=":", label="without cameras")
    for limit in error_limits(result):
        axes.axvline(limit, color=GREY, linewidth=0.6)
    seen = cameras_seeing(result.scene.information, result.solution.selected) > 0
    axes.set_title(f"{100.0 * float(np.mean(seen)):.1f} % of the streets are seen by a camera")
    axes.set_xlabel("rms position error of a car that stands there (m)")
    axes.set_ylabel("share of the streets (%)")
    axes.set_xlim(0.0, 1.05 * prior)
    axes.set_ylim(0.0, max(1.3 * 100.0 * float(np.mean(seen)), 5.0) if seen.mean() < 0.7 else 102.0)
    axes.legend(loc="upper left", fontsize=8)
