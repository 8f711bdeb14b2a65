"""The pictures of roads to choose from: the map of all, and length against error."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator, ScalarFormatter

from models.construction.homotopy import spelled
from models.footprints import footprint_polygon
from placement.assemble import Scene, assemble
from placement.obstacles import build_obstacles
from reports.style import BLACK, CYCLE, GREY, SKY, VERMILION, saved, style

if TYPE_CHECKING:
    from placement.atomic import Content
    from placement.construction import Choice

_DRAWN_RANGE_M = 60.0
_DASHES = {"arcs": "--", "clothoids": "-"}
_MARKERS = "os^vD<>pPX"  # by class; open: arcs, filled: clothoids
_APART = 0.035  # of the axes: labels nearer than this would overlap
_MOST_LINES = 5


def draw(choice: Choice) -> dict[str, Content]:
    """Draw the roads judged and their Pareto front: `pareto.png` and `pareto.svg`."""
    figure = draw_choice(choice)
    return {"pareto.png": saved(figure, "png"), "pareto.svg": saved(figure, "svg")}


def draw_choice(choice: Choice, title: str = "") -> Figure:
    """Draw the map above, length against what the roads are judged by below."""
    with style():
        figure = Figure(figsize=(7.5, 8.0))
        upper, lower = figure.subplots(2, 1, height_ratios=(1.6, 1.0))
        _draw_map(upper, choice, assemble(choice.instance))
        _draw_front(lower, choice)
        if title:
            figure.suptitle(title, fontsize=10)
    return figure


def _colours(choice: Choice) -> dict[tuple[int, ...], str]:
    words = list(dict.fromkeys(one.road.word for one in choice.judged))
    return {word: CYCLE[n % len(CYCLE)] for n, word in enumerate(words)}


def _draw_map(axes: Axes, choice: Choice, scene: Scene) -> None:
    for n, ring in enumerate(build_obstacles(choice.instance).rings):
        label = "obstacle" if n == 0 else None
        axes.fill(ring[:, 0], ring[:, 1], color=GREY, alpha=0.6, linewidth=0, label=label)
    chosen = choice.judged[choice.chosen]
    if chosen.solution is not None:
        selected = np.array(sorted(chosen.solution.selected), dtype=np.int64)
        cameras = scene.candidates.cameras.subset(selected)
        reach = min(scene.instance.camera.max_range_m, _DRAWN_RANGE_M)
        for i in range(len(selected)):
            outline = footprint_polygon(cameras, i, reach)
            if len(outline):
                axes.fill(outline[:, 0], outline[:, 1], color=SKY, alpha=0.2, linewidth=0)
        axes.plot(
            cameras.x_m, cameras.y_m, "o", color=VERMILION, markersize=4, label="camera", zorder=4
        )
    colours = _colours(choice)
    for n, one in enumerate(choice.judged):
        points = one.road.road().sample(1.0)
        axes.plot(
            points.x_m, points.y_m, _DASHES[one.road.kind], color=colours[one.road.word],
            linewidth=2.4 if n == choice.chosen else 0.8,
            label=f"chosen: road {n}" if n == choice.chosen else None,
            zorder=3,
        )  # fmt: skip
    site = choice.judged[0].road.site
    for pose, word, marker in ((site.start, "start", "^"), (site.goal, "goal", "*")):
        axes.plot(pose.x_m, pose.y_m, marker, color=BLACK, markersize=7, label=word, zorder=5)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("east x (m)")
    axes.set_ylabel("north y (m)")
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=5, fontsize=8)


def _draw_front(axes: Axes, choice: Choice) -> None:
    colours = _colours(choice)
    markers = {word: _MARKERS[n % len(_MARKERS)] for n, word in enumerate(colours)}
    by_count = choice.measure == "cameras"
    shown: set[tuple[tuple[int, ...], str]] = set()
    front: list[tuple[float, float]] = []
    places: list[tuple[int, float, float]] = []
    for n, one in enumerate(choice.judged):
        if one.solution is None:
            continue
        height = float(one.cameras) if by_count else 100.0 * np.sqrt(one.error_m2)
        key = (one.road.word, one.road.kind)
        label = None if key in shown else f"{spelled(one.road.word)}, {one.road.kind}"
        shown.add(key)
        axes.plot(
            one.road.length_m, height, markers[one.road.word], color=colours[one.road.word],
            markersize=6, label=label, linestyle="none",
            markerfacecolor="none" if one.road.kind == "arcs" else colours[one.road.word],
        )  # fmt: skip
        places.append((n, one.road.length_m, height))
        if choice.front[n]:
            front.append((one.road.length_m, height))
    axes.step(*zip(*front, strict=True), where="post", color=GREY, linewidth=0.9, label="front")
    axes.margins(x=0.08, y=0.15)
    _number(axes, places)
    if by_count:
        axes.yaxis.set_major_locator(MaxNLocator(integer=True, min_n_ticks=1))
    axes.set_xlabel("length of road (m)")
    axes.set_ylabel("cameras needed" if by_count else "predicted rms position error (cm)")
    axes.legend(fontsize=7, loc="center left", bbox_to_anchor=(1.0, 0.5), title="class, bends")


def _number(axes: Axes, places: list[tuple[int, float, float]]) -> None:
    """Write each road's number beside its mark, where no other number stands in the way."""
    (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
    taken: list[tuple[float, float]] = []
    for n, x, y in places:
        at = (x - left) / (right - left), (y - low) / (high - low)
        if all(abs(at[0] - u) > _APART or abs(at[1] - v) > 2.0 * _APART for u, v in taken):
            axes.annotate(
                str(n), (x, y), xytext=(-6, 5), textcoords="offset points", fontsize=7, ha="right"
            )
            taken.append(at)


def draw_counts(table: pd.DataFrame) -> Figure:
    """Draw the error of each map's shortest roads by number of cameras, one panel a map."""
    maps = list(dict.fromkeys(table["map"]))
    with style():
        columns = min(3, len(maps))
        rows = -(-len(maps) // columns)
        figure = Figure(figsize=(3.1 * columns, 2.7 * rows + 0.3))
        axes = np.atleast_1d(figure.subplots(rows, columns, sharex=True)).ravel()
        for ax, name in zip(axes, maps, strict=False):
            part = table[table["map"] == name]
            shortest = part.groupby("road")["length_m"].first().nsmallest(_MOST_LINES).index
            part = part[part["road"].isin(shortest)]
            for n, (_road, line) in enumerate(part.groupby("road")):
                rms = 100.0 * np.sqrt(line["error_m2"])
                length = line["length_m"].iloc[0]
                colour, marker = CYCLE[n % len(CYCLE)], "osv^D"[n % 5]
                ax.plot(
                    line["cameras"], rms, marker + "-", color=colour, markersize=3.5,
                    linewidth=0.9, label=f"{length:.0f} m, {line['class'].iloc[0]}",
                )  # fmt: skip
            ax.set_title(name, fontsize=9)
            ax.set_yscale("log")
            ax.set_yticks([2, 5, 10, 20, 50, 100])
            ax.minorticks_off()
            ax.yaxis.set_major_formatter(ScalarFormatter())
            ax.set_xlabel("cameras k")
            ax.xaxis.set_tick_params(labelbottom=True)
            ax.legend(fontsize=6)
        for ax in axes[len(maps) :]:
            ax.set_visible(False)
        for ax in axes[::columns]:
            ax.set_ylabel("rms position error (cm)")
    return figure
