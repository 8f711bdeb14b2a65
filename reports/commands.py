"""`placement report STUDY`: the studies by name."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer


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
    "closed-loop": Study(
        "reports.closed_loop:run",
        "how far dead reckoning drifts, and which filter's covariance tells the truth",
    ),
}


def register(app: typer.Typer) -> None:
    """Add `report` to the command line."""
    app.command()(report)


def report(
    study: Annotated[str, typer.Argument(help=f"One of {', '.join(STUDIES)}.")],
    out: Annotated[Path, typer.Option(help="The folder the CSV files and figures go to.")],
    quick: Annotated[bool, typer.Option("--quick", help="Fewer samples, the same files.")] = False,
    seed: Annotated[int, typer.Option(min=0, help="Seed of everything random.")] = 0,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="No progress.")] = False,
) -> None:
    """Run one study: CSV files and figures into --out."""
    from placement.atomic import prepare_folder
    from placement.watch import watch

    if study not in STUDIES:
        raise ValueError(f"study must be one of {', '.join(STUDIES)}, got {study!r}")
    prepare_folder(out)
    with watch(quiet) as progress:
        STUDIES[study].load()(out, quick=quick, seed=seed, progress=progress)
    if not quiet:
        typer.echo(f"results in {out}")
