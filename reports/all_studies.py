"""Every study, one after another: each in a folder of its own, none done twice."""

from __future__ import annotations

import hashlib
import html
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from placement.atomic import write_files
from placement.cluster import Serial, Work
from reports.page.document import document

if TYPE_CHECKING:
    from reports.commands import Study

FINISHED = "study.json"


@dataclass(frozen=True, slots=True)
class Given:
    """What a run of studies was given: effort, seed, files of further roads, and processes."""

    quick: bool = False
    seed: int = 0
    roads: tuple[Path, ...] = ()
    work: Work = field(default_factory=Serial)

    def mark(self, name: str, roads: tuple[Path, ...]) -> dict[str, Any]:
        """Return what decides the results of the study `name`, which takes `roads`.

        Raises:
            ValueError: for a road that cannot be read.
        """
        mark = {"study": name, "quick": self.quick, "seed": self.seed, "version": _version()}
        if roads:
            mark["roads"] = {road.name: _digest(road) for road in roads}
        return mark


def run_all(
    studies: Mapping[str, Study],
    out: Path,
    given: Given,
    progress: Callable[[str, float | None], None],
) -> list[Path]:
    """Run what is not finished under `out`, and write `index.html` that leads to each study.

    A study is finished when its folder says so for the same seed, effort, roads and version; its
    files are then left as they are. Return the files that are on no page of the studies run.
    """
    from reports.commands import run_study

    foreign: list[Path] = []
    for n, (name, study) in enumerate(studies.items()):
        folder = out / name
        mark = given.mark(name, given.roads if study.takes_roads else ())
        if _read(folder / FINISHED) == mark:
            progress(f"{name}: finished before", n / len(studies))
            continue

        def part(text: str, share: float | None, n: int = n) -> None:
            progress(text, (n + (share or 0.0)) / len(studies))

        foreign += run_study(name, folder, given, part)
    links = [
        f'<li><a href="{html.escape(name)}/index.html">{html.escape(name)}</a>: '
        f"{html.escape(study.summary)}</li>"
        for name, study in studies.items()
    ]
    page = document("Studies – placement", ["<h1>Studies</h1>", f"<ul>{''.join(links)}</ul>"])
    write_files(out, {"index.html": page})
    return foreign


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


def _digest(road: Path) -> str:
    try:
        return hashlib.sha256(road.read_bytes()).hexdigest()
    except OSError as error:
        raise ValueError(
            f"--road must be a file that can be read, got {road} ({error.strerror or error})"
        ) from None
