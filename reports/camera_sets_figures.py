"""The figures of the study of camera sets."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter

from reports.style import CYCLE, GREY, style

SHOWN = ("search", "exchange", "greedy", "cascade", "uniform", "random")


def draw(tables: Mapping[str, pd.DataFrame]) -> dict[str, Figure]:
    """Draw values over k, the closed loop over k, and which objective foretells it."""
    with style():
        return {
            "trace_over_k": _values(tables["values"]),
            "closed_loop_over_k": _closed_loop(tables["closed_loop"]),
            "which_objective": _ranks(tables["ranks"]),
        }


def _panels(roads: list[str], height: float = 3.0) -> tuple[Figure, list]:  # type: ignore[type-arg]
    columns = 2 if len(roads) == 4 else min(3, len(roads))
    rows = -(-len(roads) // columns)
    figure = Figure(figsize=(max(3.4 * columns + 0.6, 6.5), height * rows + 0.5))
    axes = figure.subplots(rows, columns, squeeze=False).ravel()
    for spare in axes[len(roads) :]:
        spare.set_visible(False)
    for panel, road in zip(axes, roads, strict=False):
        panel.set_title(road)
    return figure, list(axes)


def _ring(n: int) -> dict[str, Any]:
    """Return the look of the n-th line: smaller and smaller rings, so that equals all show."""
    return {"marker": "o", "fillstyle": "none", "markersize": 8.0 - 1.2 * n, "linewidth": 0.8}


def _logarithmic(panel: Axes) -> None:
    """Make the vertical axis logarithmic, plain numbers at 1, 2 and 5; the other has integers."""
    panel.set_yscale("log")
    panel.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    panel.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    panel.yaxis.set_minor_formatter(NullFormatter())
    panel.xaxis.set_major_locator(MaxNLocator(integer=True))


def _values(values: pd.DataFrame) -> Figure:
    """The trace of each method, and the best bound, over the number of cameras."""
    part = values[(values["objective"] == "trace") & values["value"].notna()]
    roads = list(dict.fromkeys(part["road"]))
    figure, axes = _panels(roads)
    for panel, road in zip(axes, roads, strict=False):
        here = part[part["road"] == road]
        for n, (colour, method) in enumerate(zip(CYCLE, SHOWN, strict=False)):
            line = here[here["method"] == method]
            if len(line):
                panel.plot(line["k"], line["value"], color=colour, label=method, **_ring(n))
        bound = here.dropna(subset=["bound"]).groupby("k")["bound"].max()
        if len(bound):
            panel.plot(bound.index, bound, "_", color=GREY, markersize=9, label="proven bound")
        _logarithmic(panel)
        panel.set_xlabel("cameras k")
        panel.set_ylabel("trace (m²)")
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4)
    return figure


def _closed_loop(driven: pd.DataFrame) -> Figure:
    """The car's rms distance from its lane, by what the cameras were placed for."""
    roads = list(dict.fromkeys(driven["road"]))
    figure, axes = _panels(roads)
    for panel, road in zip(axes, roads, strict=False):
        here = driven[driven["road"] == road]
        kinds = [kind for kind in dict.fromkeys(here["placed_for"]) if kind != "nothing"]
        loose = here[here["placed_for"] == "nothing"]
        panel.plot(
            loose["k"], loose["cross_track_rms_m"], ".", color=GREY, markersize=3,
            label="random sets", zorder=1,
        )  # fmt: skip
        for n, (colour, kind) in enumerate(zip(CYCLE, kinds, strict=False)):
            best = here[(here["placed_for"] == kind) & (here["method"] != "random")]
            best = best[best["method"] != "uniform"].groupby("k")["cross_track_rms_m"].min()
            panel.plot(best.index, best, color=colour, label=f"for {kind}", **_ring(n))
        _logarithmic(panel)
        panel.set_xlabel("cameras k")
        panel.set_ylabel("rms cross-track (m)")
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3)
    return figure


def _ranks(ranks: pd.DataFrame) -> Figure:
    """Spearman's ρ of each objective with the closed loop's rms cross-track distance."""
    part = ranks[ranks["k"] > 0]
    roads, names = (list(dict.fromkeys(part[key])) for key in ("road", "objective"))
    figure = Figure(figsize=(7.6, 3.4))
    axes = figure.subplots()
    width = 0.8 / len(names)
    for n, (colour, name) in enumerate(zip(CYCLE, names, strict=False)):
        mean = [
            part[(part["road"] == road) & (part["objective"] == name)]["cross_track"].mean()
            for road in roads
        ]
        axes.bar(np.arange(len(roads)) + (n - 0.5 * (len(names) - 1)) * width, mean, width,
                 color=colour, label=name)  # fmt: skip
    axes.axhline(0.0, color=GREY, linewidth=0.6)
    axes.set_xticks(np.arange(len(roads)), roads)
    axes.set_ylabel("rank correlation with\nrms cross-track, mean over k (–)")
    figure.legend(loc="outside lower center", ncols=5)
    return figure
