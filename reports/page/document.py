"""The HTML around the figures: one file that needs no network, works by keyboard, and prints."""

from __future__ import annotations

import html
import json
from collections.abc import Sequence
from importlib import resources
from typing import Any

import pandas as pd

from placement.solution import Solution


def document(title: str, sections: Sequence[str], *, scripts: Sequence[str] = ()) -> str:
    """Return a page of `sections` (HTML) under `title` (text), with our style and script inside."""
    script = "\n".join(f"<script>{_inline(code)}</script>" for code in (*scripts, asset("page.js")))
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        '<link rel="icon" href="data:,">'
        f"<title>{html.escape(title)}</title>\n<style>{asset('page.css')}</style>\n"
        f"{script}\n</head>\n<body>\n<main>\n" + "\n".join(sections) + "\n</main>\n</body></html>\n"
    )


def asset(name: str) -> str:
    """Return the text of a file beside this one."""
    return resources.files("reports.page").joinpath(name).read_text(encoding="utf-8")


def table(frame: pd.DataFrame, *, rows: Sequence[str] | None = None, caption: str = "") -> str:
    """Return a table whose headers sort it; `rows` are further attributes of each row."""
    heads = "".join(
        f'<th scope="col"><button type="button">{html.escape(str(name))}</button></th>'
        for name in frame.columns
    )
    attributes = rows if rows is not None else [""] * len(frame)
    lines = [
        f"<tr{f' {extra}' if extra else ''}>{''.join(f'<td>{_cell(v)}</td>' for v in values)}</tr>"
        for extra, values in zip(attributes, frame.itertuples(index=False), strict=True)
    ]
    title = f"<caption>{html.escape(caption)}</caption>" if caption else ""
    return (
        f'<div class="scroll"><table class="sortable">{title}<thead><tr>{heads}</tr></thead>'
        f"<tbody>{''.join(lines)}</tbody></table></div>"
    )


def embedded(identifier: str, content: Any) -> str:
    """Return `content` as JSON inside the page, where a script finds it by its id."""
    text = json.dumps(content, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
    return f'<script type="application/json" id="{html.escape(identifier)}">{text}</script>'


def certificate(solution: Solution) -> str:
    """Return, as HTML, what was found, by what, and how much better anything can be at most."""
    unit = solution.unit.replace("^2", "²")
    text = (
        f"{html.escape(solution.objective)} {solution.value:.6g} {unit}, by "
        f"<code>{html.escape(solution.method)}</code> in {solution.seconds:.1f} s "
        f"({solution.status.replace('_', ' ')}). "
    )
    if solution.bound is None:
        return text + "This method proves no bound."
    side = "more" if solution.maximise else "less"
    text += f"No placement reaches {side} than {solution.bound:.6g} {unit}"
    return text + ("." if solution.gap is None else f": the gap is {100 * solution.gap:.3g} %.")


def _cell(value: Any) -> str:
    if isinstance(value, float):
        return "" if pd.isna(value) else f"{value:.4g}"
    return html.escape(str(value))


def _inline(code: str) -> str:
    return code.replace("</script", "<\\/script")
