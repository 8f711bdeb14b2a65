"""The map and the error along the road as Bokeh figures that the page's script moves together."""

from __future__ import annotations

from typing import Any

import numpy as np
from bokeh.models import ColumnDataSource, CustomJS, HoverTool, Range1d, Span
from bokeh.plotting import figure

from models.geometry import FloatArray
from placement.commands import Result
from reports.page.view import View
from reports.style import BLACK, BLUE, GREY, ORANGE, SKY, VERMILION

FAINT = 0.10  # the opacity of a footprint at rest; page.js has that of a camera pointed at
TOOLS = "pan,wheel_zoom,box_zoom,reset,save"


def sources_of(view: View, result: Result) -> dict[str, ColumnDataSource]:
    """Return what both figures draw and the page's script changes, by the sources' names."""
    last = view.steps[-1]
    cameras = result.scene.candidates.cameras.subset(np.array(view.candidates, dtype=np.int64))
    on = np.isin(np.arange(len(view.candidates)), last.members)
    yaw = cameras.yaw_rad
    size = 0.02 * max(float(np.ptp(view.x_m)), float(np.ptp(view.y_m)), 50.0)
    columns: dict[str, Any] = {
        "x": cameras.x_m,
        "y": cameras.y_m,
        "x1": cameras.x_m + size * np.cos(yaw),
        "y1": cameras.y_m + size * np.sin(yaw),
        "alpha": on.astype(np.float64),
        "mount": result.scene.candidates.mount[list(view.candidates)],
        "yaw": np.degrees(yaw) % 360.0,
        "pitch": np.degrees(cameras.pitch_rad),
        "hfov": np.degrees(cameras.hfov_rad),
        "vfov": np.degrees(cameras.vfov_rad),
    }
    ground = {
        "xs": [polygon[:, 0].astype(np.float32) for polygon in view.footprints],
        "ys": [polygon[:, 1].astype(np.float32) for polygon in view.footprints],
        "alpha": FAINT * on,
    }
    along: dict[str, Any] = {
        "s": view.s_m,
        "x": view.x_m,
        "y": view.y_m,
        "error": last.position_sigma_m,
        "lateral": last.lateral_2sigma_m,
    }
    return {
        "cameras": ColumnDataSource(columns, name="cameras"),
        "ground": ColumnDataSource(ground, name="ground"),
        "along": ColumnDataSource(along, name="along"),
        "here": ColumnDataSource({"x": [], "y": []}, name="here"),
    }


def map_figure(view: View, result: Result, sources: dict[str, ColumnDataSource]) -> Any:
    """Draw the road, buildings, cameras and the ground they see; pan and zoom keep the scale."""
    plot = figure(
        height=460, sizing_mode="stretch_width", match_aspect=True, tools=TOOLS,
        active_scroll="wheel_zoom", x_axis_label="east x (m)", y_axis_label="north y (m)",
        output_backend="canvas", name="map",
    )  # fmt: skip
    left, right = view.edges
    surface = _between(left, right)
    plot.patch(*surface.T, fill_color="#dddddd", line_color=None)
    for edge in view.edges:
        plot.line(*edge.T, color=BLACK, line_width=1)
    rings = result.scene.obstacles.rings
    if rings:  # one glyph for all: a city has thousands
        plot.patches(
            [ring[:, 0] for ring in rings], [ring[:, 1] for ring in rings],
            fill_color="#999999", line_color=BLACK, line_width=0.5,
        )  # fmt: skip
    plot.patches(
        "xs", "ys", source=sources["ground"], fill_color=SKY, fill_alpha="alpha",
        line_color=BLUE, line_alpha="alpha",
    )  # fmt: skip
    path = plot.line(
        "x", "y", source=sources["along"], color=GREY, line_width=2, line_dash="dashed"
    )
    plot.segment(
        "x", "y", "x1", "y1", source=sources["cameras"], color=VERMILION, line_width=2,
        line_alpha="alpha",
    )  # fmt: skip
    posts = plot.scatter(
        "x", "y", source=sources["cameras"], size=9, color=VERMILION, fill_alpha="alpha",
        line_alpha="alpha",
    )  # fmt: skip
    plot.scatter("x", "y", source=sources["here"], size=13, marker="circle_x", color=ORANGE,
                 line_color=BLACK)  # fmt: skip
    plot.add_tools(
        HoverTool(
            renderers=[posts],
            tooltips=[
                ("mount", "@mount"),
                ("yaw, pitch", "@yaw{0.#}°, @pitch{0.#}°"),
                ("field of view", "@hfov{0.#}° × @vfov{0.#}°"),
            ],
            callback=CustomJS(code="placementPage.pointAt(cb_data.index.indices)"),
        ),
        HoverTool(
            renderers=[path],
            line_policy="nearest",
            tooltips=None,
            callback=CustomJS(
                code="if (cb_data.index.line_indices.length)"
                " placementPage.standAt(cb_data.index.line_indices[0])"
            ),
        ),
    )
    return plot


def profile_figure(view: View, result: Result, sources: dict[str, ColumnDataSource]) -> Any:
    """Draw predicted and simulated error along the road; pointing at it marks the map."""
    plot = figure(
        height=300, sizing_mode="stretch_width", tools=TOOLS, active_scroll="wheel_zoom",
        x_axis_label="arc length s (m)", y_axis_label="error (m)", name="profile",
        x_range=Range1d(float(view.s_m[0]), float(view.s_m[-1]), bounds="auto"),
    )  # fmt: skip
    along = sources["along"]
    predicted = plot.line("s", "error", source=along, color=BLUE, line_width=2,
                          legend_label="predicted position (1σ)")  # fmt: skip
    plot.line("s", "lateral", source=along, color=VERMILION, line_width=1, line_dash="dashed",
              legend_label="predicted lateral (2σ)")  # fmt: skip
    tolerance = result.scene.instance.objective.tolerance_m
    plot.add_layout(
        Span(location=tolerance, dimension="width", line_dash="dotted", line_color=GREY)
    )
    if result.validation is not None:
        profile = result.validation.profile
        for (name, errors), colour in zip(
            profile.position_rms_m.items(), (ORANGE, BLACK), strict=False
        ):
            plot.line(profile.s_m, errors, color=colour, line_width=1,
                      legend_label=f"simulated rms, {name}")  # fmt: skip
    plot.y_range.start = 0.0
    plot.add_tools(
        HoverTool(
            renderers=[predicted],
            mode="vline",
            tooltips=[("s", "@s{0.0} m"), ("1σ", "@error{0.000} m"), ("2σ", "@lateral{0.000} m")],
            callback=CustomJS(
                code="if (cb_data.index.line_indices.length)"
                " placementPage.standAt(cb_data.index.line_indices[0])"
            ),
        )
    )
    plot.add_layout(
        Span(location=None, dimension="height", line_color=ORANGE, line_width=2, name="cursor")
    )
    plot.legend.location = "top_left"
    plot.legend.click_policy = "hide"
    plot.add_layout(plot.legend[0], "above")
    plot.legend.orientation = "horizontal"
    plot.legend.label_text_font_size = "9pt"
    return plot


def _between(left: FloatArray, right: FloatArray) -> FloatArray:
    """Return the outlines (q, 2) of what lies between edges; NaN rows part one from the next."""
    cuts = np.flatnonzero(np.isnan(left[:, 0]))
    rings = []
    for a, b in zip(np.split(left, cuts), np.split(right, cuts), strict=True):
        inner = slice(1, None) if np.isnan(a[0, 0]) else slice(None)
        rings += [a[inner], b[inner][::-1], np.full((1, 2), np.nan)]
    return np.concatenate(rings[:-1])
