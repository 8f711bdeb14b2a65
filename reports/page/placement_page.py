"""The page of a placement: certificate, map, error along the road, cameras, simulation."""

from __future__ import annotations

import html
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from models.geometry import FloatArray
from placement.output import cameras_table
from reports.page.document import certificate, document, embedded, table
from reports.page.view import View, view_of

if TYPE_CHECKING:
    from placement.atomic import Content
    from placement.commands import Result


def write(result: Result) -> dict[str, Content]:
    """Write `index.html`: one file that asks for nothing else, the figures by Bokeh.

    Where the objective is about all streets of a network, it is `city_page`'s.
    """
    if not result.scene.journeys[0].drivable:
        from reports.page.city_page import city_page

        return {"index.html": city_page(result)}
    from bokeh.embed import components
    from bokeh.resources import Resources

    from reports.page.charts import map_figure, profile_figure, sources_of

    view = view_of(result)
    sources = sources_of(view, result)
    plots = (map_figure(view, result, sources), profile_figure(view, result, sources))
    script, (map_div, profile_div) = components(plots, wrap_script=False)
    library = Resources(mode="inline", components=["bokeh"], minified=True).js_raw
    solution, scene = result.solution, result.scene
    count = len(solution.selected)
    title = f"{scene.instance.name}: {count} camera{'' if count == 1 else 's'}"
    sections = [
        f"<h1>{html.escape(title)}</h1>",
        f"<p>{certificate(result.solution)}</p>",
        _controls(view),
        f'<figure aria-label="Map of the road and its cameras">{map_div}<figcaption>Drag to pan, '
        "wheel to zoom. Point at a camera, or at its row below, for the ground it sees within "
        "60 m; point along the road to find the same place in the curve.</figcaption></figure>",
        f'<figure aria-label="Error along the road">{profile_div}<figcaption>Predicted by the '
        "covariance recursion on the nominal drive; the dotted line is the tolerance of "
        f"{scene.instance.objective.tolerance_m:g} m.</figcaption></figure>",
        "<h2>Cameras</h2>",
        _cameras(view, result),
    ]
    if result.validation is not None:
        summary = result.validation.summary
        sections += [
            f"<h2>Closed loop, {summary['runs']} runs</h2>",
            table(pd.DataFrame(summary["filters"]).rename_axis("figure").reset_index()),
        ]
    sections += [embedded("steps", _steps(view)), f"<script>{script}</script>"]
    return {"index.html": document(f"{title} – placement", sections, scripts=library)}


def _controls(view: View) -> str:
    last = len(view.steps) - 1
    what = (
        "cameras, in the order of what each adds" if view.nested else "cameras, each k at its best"
    )
    return (
        f'<div class="steps"><label for="step">{what}</label>'
        f'<input id="step" type="range" min="0" max="{last}" value="{last}" step="1" '
        'aria-describedby="step-text"><output id="step-text" for="step" aria-live="polite">'
        f"{_text(view, last)}</output></div>"
    )


def _text(view: View, n: int) -> str:
    step = view.steps[n]
    mean = float(np.sqrt(np.mean(step.position_sigma_m**2)))
    worst = float(step.lateral_2sigma_m.max())
    return f"k = {step.k}: rms error {mean:.3f} m, worst 2σ lateral {worst:.3f} m"


def _steps(view: View) -> list[dict[str, object]]:
    def short(values: FloatArray) -> list[float]:
        return [float(f"{value:.4g}") for value in values]

    return [
        {
            "text": _text(view, n),
            "members": step.members,
            "error": short(step.position_sigma_m),
            "lateral": short(step.lateral_2sigma_m),
        }
        for n, step in enumerate(view.steps)
    ]


def _cameras(view: View, result: Result) -> str:
    """Return the table of the cameras; a row that is pointed at or focused shows its ground."""
    row = {candidate: n for n, candidate in enumerate(view.candidates)}
    chosen = sorted(result.solution.selected)
    frame = cameras_table(result.scene, result.solution)
    frame.insert(0, "camera", np.arange(1, len(frame) + 1))
    return table(frame, rows=[f'tabindex="0" data-camera="{row[i]}"' for i in chosen])
