"""The picture of a solution: the road with its cameras, and the error along it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from models.footprints import footprint_polygon
from placement.roadway import network_of
from reports.streets import jumps
from reports.style import BLACK, BLUE, GREY, ORANGE, SKY, VERMILION, saved, style

if TYPE_CHECKING:
    from placement.atomic import Content
    from placement.commands import Result

# A footprint may reach the horizon; the picture cuts it where the car is no longer placed well.
DRAWN_RANGE_M = 60.0
_MARGIN_M = 100.0  # buildings are drawn this far beyond the road


def draw(result: Result) -> dict[str, Content]:
    """Draw the map and the error profile of `result`: `map.png` and `map.svg`."""
    if not result.scene.journeys[0].drivable:
        from reports.streets_map import draw_streets

        return draw_streets(result)
    with style():
        figure = Figure(figsize=(8.0, 9.0))
        upper, lower = figure.subplots(2, 1, height_ratios=(2.2, 1.0))
        draw_map(upper, result)
        draw_profile(lower, result)
    return {"map.png": saved(figure, "png"), "map.svg": saved(figure, "svg")}


def draw_map(axes: Axes, result: Result) -> None:
    """Draw the road's edges, the buildings, each camera, and the ground in its field of view."""
    scene = result.scene
    points = scene.road.sample(scene.instance.road.sample_spacing_m)
    left, right = scene.road.half_widths(points.s_m)
    normal = np.column_stack((-np.sin(points.heading_rad), np.cos(points.heading_rad)))
    edges = (points.xy + left[:, None] * normal, points.xy - right[:, None] * normal)
    breaks = np.flatnonzero(jumps(points.xy, points.s_m)) + 1
    for edge in edges:
        ring = np.vstack((edge, edge[:1])) if scene.road.closed else edge
        # All streets of a network are one road, which jumps: no line from one to the next.
        ring = np.insert(ring, breaks, np.nan, axis=0)
        axes.plot(ring[:, 0], ring[:, 1], color=BLACK, linewidth=0.6)
    if len(scene.journeys) > 1:
        for n, journey in enumerate(scene.journeys):
            driven = journey.points.xy
            label = None if n else "drives"
            axes.plot(*driven.T, color=GREY, linewidth=0.5, linestyle="--", label=label)
    limits = points.xy.min(axis=0) - _MARGIN_M, points.xy.max(axis=0) + _MARGIN_M
    near = [
        ring
        for ring in scene.obstacles.rings
        if np.all(ring.max(axis=0) > limits[0]) and np.all(ring.min(axis=0) < limits[1])
    ]
    axes.add_collection(PolyCollection(near, facecolors=GREY, alpha=0.5, linewidths=0))
    chosen = np.array(sorted(result.solution.selected), dtype=np.int64)
    cameras = scene.candidates.cameras.subset(chosen)
    reach = min(scene.instance.camera.max_range_m, DRAWN_RANGE_M)
    for i in range(len(chosen)):
        outline = footprint_polygon(cameras, i, reach)
        if len(outline):
            axes.fill(outline[:, 0], outline[:, 1], color=SKY, alpha=0.25, linewidth=0)
    axes.plot(
        cameras.x_m, cameras.y_m, "o", color=VERMILION, markersize=3.5, label="camera", zorder=3
    )
    start = scene.points
    axes.plot(start.x_m[0], start.y_m[0], ">", color=BLACK, markersize=5, label="start")
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("east x (m)")
    axes.set_ylabel("north y (m)")
    axes.legend(loc="best")
    solution = result.solution
    gap = "" if solution.gap is None else f", gap {100 * solution.gap:.2g} %"
    unit, status = solution.unit.replace("^2", "²"), solution.status.replace("_", " ")
    axes.set_title(
        f"{_plain(scene.instance.name)}: {len(chosen)} cameras by {solution.method}, "
        f"{solution.objective} {solution.value:.5g} {unit} ({status}{gap})",
        fontsize=9,
    )


def draw_profile(axes: Axes, result: Result) -> None:
    """Draw predicted and simulated rms position error along the road, and where cameras stand.

    The objective's prediction is the best filter's, which learns each camera's offset; the
    Schmidt filter only allows for it, so it has a prediction of its own.
    """
    s = result.scene.points.s_m
    axes.plot(s, result.prediction.position_sigma_m, color=BLUE, label="predicted, best filter")
    if result.validation is not None:
        profile = result.validation.profile
        for (name, errors), colour in zip(
            profile.position_rms_m.items(), (ORANGE, VERMILION), strict=False
        ):
            axes.plot(profile.s_m, errors, color=colour, linewidth=0.9, label=f"simulated, {name}")
        schmidt = profile.predicted_rms_m["schmidt"]
        axes.plot(profile.s_m, schmidt, color=BLACK, linewidth=0.7, label="predicted, schmidt")
    scene = result.scene
    chosen = np.array(sorted(result.solution.selected), dtype=np.int64)
    mounts = scene.candidates.mount_s_m[scene.candidates.mount[chosen]]
    if scene.journeys[0].drivable and network_of(scene.instance) is not None:
        mounts = mounts[:0]  # they are counted along all streets, not along this drive
    for k, at in enumerate(mounts):
        axes.axvline(
            at, color=GREY, linewidth=0.5, linestyle=":", label="camera" if not k else None
        )
    axes.set_xlabel("arc length s (m)")
    axes.set_ylabel("rms position error (m)")
    axes.set_xlim(0.0, result.scene.journeys[0].road.length_m)
    axes.set_ylim(bottom=0.0)
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=5, fontsize=8)


def _plain(text: str) -> str:
    """Keep matplotlib from reading a name as a formula."""
    return text.replace("$", r"\$")
