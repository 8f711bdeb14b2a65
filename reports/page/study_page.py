"""The page of a study: every figure and every table that it wrote, in one file."""

from __future__ import annotations

import base64
import html
from collections.abc import Collection
from pathlib import Path

import pandas as pd

from reports.page.document import document, table

MOST_ROWS = 500  # of one table; the CSV file has them all
MOST_BYTES = 2_500_000  # of all figures: past that they are shown as their PNG, or only named


SHOWN = (".svg", ".csv")


def study_page(
    title: str, summary: str, folder: Path, own: Collection[str], note: str | None = None
) -> str:
    """Return a page of the figures (SVG, else PNG) and tables (CSV) of names `own` in `folder`.

    `summary` and `note` are sentences without their full stops.
    """
    sections = [f"<h1>{html.escape(title)}</h1>", f"<p>{html.escape(summary)}.</p>"]
    if note:
        sections.append(f"<p>{html.escape(note)}.</p>")
    room = MOST_BYTES
    for path in sorted(folder / name for name in own if name.endswith(".svg")):
        name = html.escape(path.stem.replace("_", " ").replace("-", " "))
        kinds = (path, path.with_suffix(".png"))
        shown = next((each for each in kinds if each.name in own and _size(each) <= room), None)
        if shown is None:
            sections.append(f"<p>The figure {html.escape(path.name)} lies beside this page.</p>")
            continue
        room -= _size(shown)
        kind = "svg+xml" if shown.suffix == ".svg" else "png"
        data = base64.b64encode(shown.read_bytes()).decode("ascii")
        sections.append(
            f'<figure><img alt="{name}" src="data:image/{kind};base64,{data}">'
            f"<figcaption>{name}</figcaption></figure>"
        )
    for path in sorted(folder / name for name in own if name.endswith(".csv")):
        frame = pd.read_csv(path)
        sections.append(f"<h2>{html.escape(path.stem.replace('_', ' '))}</h2>")
        if len(frame) > MOST_ROWS:
            sections.append(
                f"<p>The first {MOST_ROWS:,} of {len(frame):,} rows; {html.escape(path.name)} "
                "has them all.</p>"
            )
        sections.append(table(frame.head(MOST_ROWS)))
    return document(f"{title} – placement", sections)


def _size(path: Path) -> int:
    """Return the bytes a file takes in the page, where base64 makes four of three."""
    return 4 * path.stat().st_size // 3 if path.exists() else 10 * MOST_BYTES
