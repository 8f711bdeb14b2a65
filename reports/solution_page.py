"""One self-contained HTML file a solution: certificate, picture, cameras, and the simulation."""

from __future__ import annotations

import html
import io
from typing import TYPE_CHECKING

import pandas as pd
from matplotlib.figure import Figure

from placement.output import cameras_table
from reports.solution_map import draw_map, draw_profile
from reports.style import style

if TYPE_CHECKING:
    from placement.atomic import Content
    from placement.commands import Result

_CSS = """
:root { color-scheme: light dark; }
body { font: 15px/1.5 system-ui, sans-serif; max-width: 60rem; margin: 2rem auto; padding: 0 1rem; }
svg { width: 100%; height: auto; background: #fff; }
table { border-collapse: collapse; margin: 1rem 0; font-variant-numeric: tabular-nums; }
th, td { padding: .2rem .7rem; border-bottom: 1px solid #8885; text-align: right; }
th:first-child, td:first-child { text-align: left; }
.scroll { overflow-x: auto; }
"""


def write(result: Result) -> dict[str, Content]:
    """Write `index.html`: no network, no script, the figure inside it as SVG."""
    solution = result.solution
    name = html.escape(result.scene.instance.name)
    bound = (
        "This method proves no bound."
        if solution.bound is None
        else f"No placement reaches {'more' if solution.maximise else 'less'} than "
        f"{solution.bound:.6g} {solution.unit}"
        + ("." if solution.gap is None else f": the gap is {100 * solution.gap:.3g} %.")
    )
    sections = [
        f"<h1>{name}: {len(solution.selected)} cameras</h1>",
        f"<p>{html.escape(solution.objective)} {solution.value:.6g} {solution.unit}, by "
        f"<code>{html.escape(solution.method)}</code> in {solution.seconds:.1f} s "
        f"({solution.status}). {bound}</p>",
        _figure(result),
        "<h2>Cameras</h2>",
        _table(cameras_table(result.scene, solution)),
    ]
    if result.validation is not None:
        filters = result.validation.summary["filters"]
        sections += [
            f"<h2>Closed loop, {result.validation.summary['runs']} runs</h2>",
            _table(pd.DataFrame(filters).T.rename_axis("filter").reset_index()),
        ]
    body = "\n".join(sections)
    page = (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{name} – placement</title><style>{_CSS}</style></head>\n"
        f"<body>\n{body}\n</body></html>\n"
    )
    return {"index.html": page}


def _figure(result: Result) -> str:
    with style():
        figure = Figure(figsize=(9.0, 9.0))
        upper, lower = figure.subplots(2, 1, height_ratios=(2.2, 1.0))
        draw_map(upper, result)
        draw_profile(lower, result)
        buffer = io.StringIO()
        figure.savefig(buffer, format="svg", metadata={"Date": None})
    text = buffer.getvalue()
    return text[text.index("<svg") :].replace(
        "<svg", '<svg role="img" aria-label="Map of the road and cameras, error along the road"', 1
    )


def _table(table: pd.DataFrame) -> str:
    rows = table.to_html(index=False, border=0, float_format=lambda v: f"{v:.4g}", escape=True)
    return f'<div class="scroll">{rows}</div>'
