"""`placement report STUDY`: the studies by name."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from reports.roads import register as register_roads


@dataclass(frozen=True, slots=True)
class Study:
    """Say where a study lives (`module:function`) and what it answers."""

    target: str
    summary: str

    def load(self) -> Callable[..., None]:
        """Import the study: only now, so that no command pays for what it does not use."""
        module, function = self.target.split(":")
        study: Callable[..., None] = getattr(importlib.import_module(module), function)
        return study


STUDIES: dict[str, Study] = {
    "error-model": Study(
        "reports.error_model:run",
        "how accurate one camera is: coverage, components, resolution, installation",
    ),
    "single-camera": Study(
        "reports.single_camera.study:run",
        "which way one camera should look, and how wide, over the curvature of the road",
    ),
    "camera-sets": Study(
        "reports.camera_sets:run",
        "what each method finds for 1 to 20 cameras, and which objective foretells the car",
    ),
    "construction": Study(
        "reports.construction:run",
        "which road to build round obstacles, each judged with its own best cameras",
    ),
    "camera-count": Study(
        "reports.camera_count:run",
        "cameras per kilometre for a tolerance, over bends, poles, installation, failures",
    ),
    "intersection": Study(
        "reports.intersection:run",
        "cameras for a four-way crossing: every way through it in one objective",
    ),
    "closed-loop": Study(
        "reports.closed_loop:run",
        "how far dead reckoning drifts, and which filter's covariance tells the truth",
    ),
}


def register(app: typer.Typer) -> None:
    """Add `report` and `roads` to the command line."""
    app.command()(report)
    register_roads(app)


def report(
    study: Annotated[str, typer.Argument(help=f"One of {', '.join(STUDIES)}, or all.")],
    out: Annotated[Path, typer.Option(help="The folder the CSV files and figures go to.")],
    quick: Annotated[bool, typer.Option("--quick", help="Fewer samples, the same files.")] = False,
    seed: Annotated[int, typer.Option(min=0, help="Seed of everything random.")] = 0,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="No progress.")] = False,
) -> None:
    """Run one study, or all: CSV files, figures and a page into --out.

    `all` gives each study a folder, and skips those that an earlier run finished.
    """
    from placement.atomic import prepare_folder
    from placement.watch import watch

    if study not in STUDIES and study != "all":
        raise ValueError(f"study must be one of {', '.join([*STUDIES, 'all'])}, got {study!r}")
    prepare_folder(out)
    with watch(quiet) as progress:
        if study == "all":
            from reports.all_studies import run_all

            run_all(STUDIES, out, quick=quick, seed=seed, progress=progress)
        else:
            run_study(study, out, quick=quick, seed=seed, progress=progress)
    if not quiet:
        typer.echo(f"results in {out}")


def run_study(
    name: str,
    out: Path,
    *,
    quick: bool,
    seed: int,
    progress: Callable[[str, float | None], None],
) -> None:
    """Run the study `name` into `out` and write its page over what it wrote."""
    from placement.atomic import write_files
    from reports.page.study_page import study_page

    study = STUDIES[name]
    study.load()(out, quick=quick, seed=seed, progress=progress)
    write_files(out, {"index.html": study_page(name, study.summary, out)})
