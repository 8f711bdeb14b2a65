"""The figures of the error-model study, each drawn from its table alone."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FormatStrFormatter, ScalarFormatter

from models.errors import COMPONENTS, FORMS
from reports.error_tables import TARGET_M
from reports.style import BLACK, BLUE, CYCLE, GREEN, GREY, ORANGE, VERMILION, style

COLOURS = {"radius": BLUE, "ellipse": GREEN, "covariance": VERMILION}
MARKERS = {"pinhole": "o", "stereographic": "s", "equidistant": "^"}


def draw_coverage(table: pd.DataFrame) -> Figure:
    """Draw the share of reports inside each model's 95 % region, by pitch and lens."""
    figure, axes = _panels(1, 2, (8.0, 3.6), sharey=True)
    for ax, (orientation, part) in zip(axes, table.groupby("orientation_95_deg"), strict=True):
        ax.axhspan(94.0, 96.0, color=GREY, alpha=0.25, linewidth=0)
        for key, rows in part.groupby(["model", "projection"]):
            kind, lens = (str(word) for word in key)
            shift = 1.2 * (list(MARKERS).index(lens) - 1)
            ax.plot(
                rows["pitch_deg"] + shift, rows["percent"], MARKERS[lens], color=COLOURS[kind],
                markersize=4, label=f"{kind}, {lens}",
            )  # fmt: skip
        position = part["position_95_m"].iloc[0]
        ax.set_title(f"installed to {orientation:g}° and {position:g} m", fontsize=9)
        ax.set_xlabel("pitch below the horizon (°)")
        ax.set_xticks(sorted(part["pitch_deg"].unique()))
    axes[0].set_ylabel("reports inside the 95 % region (%)")
    axes[0].set_ylim(93.0, 100.3)
    axes[1].legend(fontsize=7, loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure


def draw_first_order(table: pd.DataFrame) -> Figure:
    """Draw the covariance's coverage against ε, where the first order wears off."""
    figure, (ax,) = _panels(1, 1, (5.5, 3.6))
    ax.axhspan(94.0, 96.0, color=GREY, alpha=0.25, linewidth=0, label="94–96 %")
    for n, (orientation, rows) in enumerate(table.groupby("orientation_95_deg")):
        middle = 0.5 * (rows["epsilon_low"] + rows["epsilon_high"])
        error = 196.0 * np.sqrt(0.05 * 0.95 / rows["samples"])
        ax.errorbar(
            middle, rows["percent"], yerr=error, fmt=list(MARKERS.values())[n] + "-",
            color=CYCLE[n], markersize=4, linewidth=0.9, label=f"orientation {orientation:g}°",
        )  # fmt: skip
    ax.set_xlabel("ε = σ of orientation · distance / height (rad)")
    ax.set_ylabel("reports inside the 95 % region (%)")
    ax.set_title("covariance, no report limit (bars: 95 % of sampling)", fontsize=9)
    ax.legend(loc="lower left")
    return figure


def draw_residuals(table: pd.DataFrame) -> Figure:
    """Draw how much of the bound each error leaves: histograms, absolute and relative."""
    figure, axes = _panels(1, 2, (8.0, 3.4))
    words = {"absolute_m": "bound minus error (m)", "relative": "(bound minus error) / bound"}
    for ax, (kind, word) in zip(axes, words.items(), strict=True):
        for model in FORMS:
            rows = table[(table["kind"] == kind) & (table["model"] == model)]
            edges = [*rows["bin_low"], float(rows["bin_high"].iloc[-1])]
            share = 100.0 * rows["count"] / rows["count"].sum()
            ax.stairs(share, edges, color=COLOURS[model], label=model, linewidth=1.2)
        ax.axvline(0.0, color=BLACK, linewidth=0.8)
        ax.set_xlabel(word)
    axes[1].set_xticks([-1.0, -0.5, 0.0, 0.5, 1.0])
    axes[0].set_ylabel("reports per bin (%)")
    axes[0].legend()
    return figure


def draw_components(table: pd.DataFrame) -> Figure:
    """Draw what each component contributes by pitch, one panel a model."""
    figure, axes = _panels(1, 3, (9.5, 3.6), sharey=True)
    for ax, kind in zip(axes, FORMS, strict=True):
        part = table[table["model"] == kind]
        for n, component in enumerate((*COMPONENTS, "total")):
            rows = part[part["component"] == component]
            colour = BLACK if component == "total" else CYCLE[n]
            marker = "osv^D."[n]
            ax.plot(
                rows["pitch_deg"], rows["median_m"], marker + "-", color=colour, markersize=4,
                label=component,
            )  # fmt: skip
        ax.set_title(kind, fontsize=9)
        ax.set_xlabel("pitch below the horizon (°)")
        ax.set_yscale("log")
        ax.set_yticks([0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2])
        ax.minorticks_off()
        ax.yaxis.set_major_formatter(FormatStrFormatter("%g"))
    axes[0].set_ylabel("median 95 % radius (m)")
    axes[-1].legend(fontsize=7, loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure


def draw_algorithm(table: pd.DataFrame) -> Figure:
    """Draw the bound and its coverage against the image algorithm's error."""
    figure, axes = _panels(1, 2, (8.0, 3.4))
    for kind in FORMS:
        rows = table[table["model"] == kind]
        axes[0].plot(
            rows["algorithm_95_px"], rows["median_m"], "o-", color=COLOURS[kind], markersize=3,
            label=kind,
        )  # fmt: skip
        axes[1].plot(
            rows["algorithm_95_px"], rows["percent"], "o-", color=COLOURS[kind], markersize=3
        )
    theirs = table.dropna(subset="dissertation_median_m")
    axes[0].plot(
        theirs["algorithm_95_px"], theirs["dissertation_median_m"], "x", color=BLACK,
        label="dissertation (2018), circle",
    )  # fmt: skip
    axes[0].set_ylabel("median bound at 45° (m)")
    axes[0].set_ylim(bottom=0.0)
    axes[0].legend(fontsize=8)
    axes[1].axhspan(94.0, 96.0, color=GREY, alpha=0.25, linewidth=0)
    axes[1].set_ylabel("reports inside the 95 % region (%)")
    axes[1].set_ylim(93.0, 100.3)
    for ax in axes:
        ax.set_xlabel("image algorithm's error, 95 % (px)")
    return figure


def draw_resolution(table: pd.DataFrame) -> Figure:
    """Draw the mean bound against the resolution at four pitches."""
    figure, axes = _panels(1, 2, (8.0, 3.4), sharey=True)
    for ax, kind in zip(axes, ("radius", "covariance"), strict=True):
        part = table[table["model"] == kind]
        for n, (pitch, rows) in enumerate(part.groupby("pitch_deg")):
            ax.plot(
                rows["resolution_px"], rows["mean_m"], "osv^"[n] + "-", color=CYCLE[n],
                markersize=4, label=f"pitch {pitch:g}°",
            )  # fmt: skip
        ax.axvline(2000, color=GREY, linewidth=0.8, linestyle=":")
        ax.set_title(kind, fontsize=9)
        ax.set_xlabel("resolution (pixels a side)")
        for axis in (ax.xaxis, ax.yaxis):
            axis.axes.set_xscale("log")
            axis.axes.set_yscale("log")
        ax.set_xticks([250, 500, 1000, 2000, 4000, 8000])
        ax.minorticks_off()
        ax.xaxis.set_major_formatter(ScalarFormatter())
        ax.set_yticks([0.1, 0.2, 0.5, 1.0])
        ax.yaxis.set_major_formatter(ScalarFormatter())
    axes[0].set_ylabel("mean bound (m)")
    axes[1].legend()
    return figure


def draw_bounds(table: pd.DataFrame) -> Figure:
    """Draw the circle's radius by pitch: two protocols and the dissertation's table."""
    figure, axes = _panels(1, 3, (9.5, 3.4), sharey=True)
    colours = {"image": BLUE, "road": ORANGE, "dissertation": BLACK}
    words = {"mean_m": "mean", "median_m": "median", "p95_m": "95th percentile"}
    for ax, (column, word) in zip(axes, words.items(), strict=True):
        for (protocol, colour), marker in zip(colours.items(), "osx", strict=True):
            rows = table[table["protocol"] == protocol]
            ax.plot(
                rows["pitch_deg"], rows[column], marker + "-", color=colour, markersize=5,
                linewidth=0.9, label=protocol,
            )  # fmt: skip
        ax.set_title(word, fontsize=9)
        ax.set_xlabel("pitch below the horizon (°)")
        ax.set_yscale("log")
        ax.set_yticks([0.1, 0.2, 0.5, 1.0, 2.0])
        ax.minorticks_off()
        ax.yaxis.set_major_formatter(ScalarFormatter())
    axes[0].set_ylabel("95 % radius of the circle (m)")
    axes[-1].legend()
    return figure


def draw_installation(table: pd.DataFrame) -> Figure:
    """Draw the median bound over both tolerances, and the line of what 0.25 m asks for."""
    cases = list(table.groupby(["model", "pitch_deg"]))
    figure, axes = _panels(2, 2, (8.0, 6.4), sharex=True, sharey=True)
    for ax, ((kind, pitch), rows) in zip(axes, reversed(cases), strict=True):
        grid = rows.pivot_table("median_m", "position_95_m", "orientation_95_deg")
        levels = np.arange(0.05, 0.61, 0.05)
        filled = ax.contourf(
            grid.columns, grid.index, grid, levels=levels, cmap="cividis_r", extend="both"
        )
        line = ax.contour(grid.columns, grid.index, grid, levels=[TARGET_M], colors=VERMILION)
        ax.clabel(line, fmt=f"{TARGET_M:g} m")
        ax.plot(0.5, 0.03, "+", color=BLACK, markersize=9)
        ax.set_title(f"{kind}, pitch {pitch:g}°", fontsize=9)
    figure.colorbar(filled, ax=list(axes), label="median bound (m)")
    for ax in axes[2:]:
        ax.set_xlabel("orientation tolerance, 95 % (°)")
    for ax in axes[::2]:
        ax.set_ylabel("position tolerance, 95 % (m)")
    return figure


def _panels(
    rows: int,
    columns: int,
    size: tuple[float, float],
    *,
    sharex: bool = False,
    sharey: bool = False,
) -> tuple[Figure, list[Axes]]:
    with style():
        figure = Figure(figsize=size)
        grid = figure.subplots(rows, columns, squeeze=False, sharex=sharex, sharey=sharey)
    return figure, list(grid.ravel())
