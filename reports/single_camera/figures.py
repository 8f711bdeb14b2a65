"""The figures of the study of one camera."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from reports.style import CYCLE, GREY, style

ANGLES = ("yaw_deg", "pitch_deg", "hfov_deg", "vfov_deg")
LABELS = ("yaw (°), −180 towards traffic", "pitch (°)", "hfov (°)", "vfov (°)")
MARKS = "osD^v"


def draw(tables: Mapping[str, pd.DataFrame]) -> dict[str, Figure]:
    """Draw the best angles over curvature, what each choice loses, and the ranks."""
    with style():
        return {
            "angles_over_curvature": _angles(tables["optima"]),
            "loss_over_curvature": _losses(tables["cross_values"]),
            "cheap_score": _cheap(tables["poses"]),
        }


def _angles(optima: pd.DataFrame) -> Figure:
    """The angles of the best pose for each objective, with arcs; a mirror optimum is not shown."""
    part = optima[(optima["rank"] == 1) & (optima["entry"] == "arc")]
    names = list(dict.fromkeys(part["objective"]))
    figure = Figure(figsize=(7.6, 6.4))
    for axes, angle, label in zip(figure.subplots(2, 2).ravel(), ANGLES, LABELS, strict=True):
        for colour, mark, name in zip(CYCLE, MARKS, names, strict=False):
            line = part[part["objective"] == name].sort_values("curvature")
            shown = line[angle]
            if angle == "yaw_deg":  # on past ±180, where otherwise a turn would look like a jump
                shown = shown.where(shown < 45.0, shown - 360.0)
            axes.plot(line["curvature"], shown, mark, color=colour, label=name, markersize=4,
                      fillstyle="none")  # fmt: skip
        axes.axvline(0.0, color=GREY, linewidth=0.6)
        axes.set_xlabel("curvature κ (1/m): outside < 0 < inside")
        axes.set_ylabel(label)
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=5)
    return figure


def _losses(cross: pd.DataFrame) -> Figure:
    """The lateral variance, and the driven cross-track error, of each objective's best pose."""
    part = cross[cross["entry"] == "arc"]
    figure = Figure(figsize=(7.6, 3.6))
    left, right = figure.subplots(1, 2)
    for colour, mark, name in zip(CYCLE, MARKS, dict.fromkeys(part["placed_for"]), strict=False):
        line = part[part["placed_for"] == name].sort_values("curvature")
        line_style = {"color": colour, "label": f"for {name}", "markersize": 4, "linewidth": 0.8}
        left.plot(line["curvature"], np.sqrt(line["lateral"]), f"{mark}-", **line_style)
        right.plot(line["curvature"], line["cross_track_rms_m"], f"{mark}-", **line_style)
    left.set_ylabel("predicted rms lateral error (m)")
    right.set_ylabel("driven rms cross-track (m)")
    for axes in (left, right):
        axes.set_xlabel("curvature κ (1/m)")
    handles, labels = left.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3)
    return figure


def _cheap(poses: pd.DataFrame) -> Figure:
    """A thousand poses: the cheap score against what driving with that camera gives."""
    curvatures = sorted(poses["curvature"].unique())
    figure = Figure(figsize=(2.9 * max(2, len(curvatures)), 3.2))
    panels = figure.subplots(1, len(curvatures), squeeze=False)[0]
    for axes, curvature in zip(panels, curvatures, strict=True):
        part = poses[poses["curvature"] == curvature]
        axes.scatter(part["kalman_gain"], part["cross_track_rms_m"], s=4, color=CYCLE[0], alpha=0.5)
        axes.set_title(f"κ = {curvature:g} 1/m")
        axes.set_xlabel("kalman_gain (px/m²)")
    panels[0].set_ylabel("driven rms cross-track (m)")
    return figure
