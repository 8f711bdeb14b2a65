"""Every study, one after another: each in a folder of its own, none done twice."""

from __future__ import annotations

import html
import json
from collections.abc import Callable, Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from placement.atomic import prepare_folder, write_files
from reports.page.document import document

if TYPE_CHECKING:
    from reports.commands import Study

FINISHED = "study.json"


def run_all(
    studies: Mapping[str, Study],
    out: Path,
    *,
    quick: bool,
    seed: int,
    progress: Callable[[str, float | None], None],
) -> None:
    """Run what is not finished under `out`, and write `index.html` that leads to each study.

    A study is finished when its folder says so for the same seed, effort and version; its files
    are then left as they are.
    """
    from reports.commands import run_study

    for n, name in enumerate(studies):
        folder = out / name
        mark = {"study": name, "quick": quick, "seed": seed, "version": _version()}
        if _read(folder / FINISHED) == mark:
            progress(f"{name}: finished before", n / len(studies))
            continue
        prepare_folder(folder)
        (folder / FINISHED).unlink(missing_ok=True)

        def part(text: str, share: float | None, n: int = n) -> None:
            progress(text, (n + (share or 0.0)) / len(studies))

        run_study(name, folder, quick=quick, seed=seed, progress=part)
        write_files(folder, {FINISHED: json.dumps(mark, indent=2) + "\n"})
    links = [
        f'<li><a href="{html.escape(name)}/index.html">{html.escape(name)}</a>: '
        f"{html.escape(study.summary)}</li>"
        for name, study in studies.items()
    ]
    page = document("Studies – placement", ["<h1>Studies</h1>", f"<ul>{''.join(links)}</ul>"])
    write_files(out, {"index.html": page})


def _read(path: Path) -> Any:
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None


def _version() -> str:
    try:
        return version("roadside-placement")
    except PackageNotFoundError:
        return "unknown"
