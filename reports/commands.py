"""`placement report STUDY`: the studies by name."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from reports.roads import register as register_roads

if TYPE_CHECKING:
    from reports.all_studies import Given


@dataclass(frozen=True, slots=True)
class Study:
    """Say where a study lives (`module:function`) and what it answers.

    `without_roads` is what its page says where no `--road` was given; None: it takes none.
    """

    target: str
    summary: str
    without_roads: str | None = None

    @property
    def takes_roads(self) -> bool:
        """Whether the study takes further roads from files."""
        return self.without_roads is not None

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
        "Without --road, only roads of our own: a race track such as the Norisring was left out",
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
        "Without --road, only the shipped instances were driven",
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
    road: Annotated[
        list[Path] | None,
        typer.Option(help="A file of one more road, for camera-sets and closed-loop; repeatable."),
    ] = None,
    workers: Annotated[
        int | None, typer.Option(min=1, help="Parts computed at a time; one a core by default.")
    ] = None,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="No progress.")] = False,
) -> None:
    """Run one study, or all: CSV files, figures and a page into --out.

    `all` gives each study a folder. After Ctrl-C the same command goes on where it was stopped;
    studies that an earlier run finished are left as they are.
    """
    from placement.interrupts import held_back

    with held_back():
        from placement.atomic import prepared_folder
        from placement.cli import EXIT_UNSOLVED
        from placement.cluster import cores
        from placement.watch import watch
        from reports.all_studies import Given, run_all
        from reports.parts import work_for

    if study not in STUDIES and study != "all":
        raise ValueError(f"study must be one of {', '.join([*STUDIES, 'all'])}, got {study!r}")
    chosen = STUDIES if study == "all" else {study: STUDIES[study]}
    roads = tuple(road or ())
    if roads and not any(each.takes_roads for each in chosen.values()):
        raise ValueError(f"--road is for {', '.join(_with_roads())}, got the study {study}")
    _check_roads(roads)
    work = work_for(workers or cores())
    try:
        with prepared_folder(out), watch(quiet) as progress:
            given = Given(quick=quick, seed=seed, roads=roads, work=work)
            if study == "all":
                foreign = run_all(STUDIES, out, given, progress)
            else:
                foreign = run_study(study, out, given, progress)
    except KeyboardInterrupt:
        typer.echo("placement: interrupted; the same command goes on from here", err=True)
        raise typer.Exit(EXIT_UNSOLVED) from None
    finally:
        work.close()
    if foreign:
        names = ", ".join(map(str, foreign))
        typer.echo(f"placement: not of the study, so not on its page: {names}", err=True)
    if not quiet:
        typer.echo(f"results in {out}")


def _check_roads(roads: tuple[Path, ...]) -> None:
    """Read the files of `--road` before anything long begins, and tell them apart by their names.

    Raises:
        ValueError: one line that names the file and what is wrong.
    """
    if not roads:
        return
    from placement.roadway import build_road, network_of
    from reports.camera_sets import ROADS, instances_of

    taken = dict.fromkeys(ROADS, "a road of the study")
    for road in roads:
        if not road.is_file():
            raise ValueError(f"--road must be a file that can be read, got {road} (No such file)")
        for name, instance in instances_of([], [road]).items():
            if name in taken:
                raise ValueError(
                    f"--road must be files whose names differ up to the first dot, got {road} "
                    f"beside {taken[name]}"
                )
            taken[name] = str(road)
            build_road(instance)
            if network_of(instance) is not None:
                raise ValueError(f"--road must hold one road, got a network of streets in {road}")


def _with_roads() -> list[str]:
    return [name for name, study in STUDIES.items() if study.takes_roads]


def run_study(
    name: str, out: Path, given: Given, progress: Callable[[str, float | None], None]
) -> list[Path]:
    """Run the study `name` into `out` and write its page over what it wrote.

    Return the tables and figures in `out` that it did not write, which are not on the page. Its
    parts are kept in `out/parts` until it is finished, so that a run that was stopped goes on.
    """
    import json
    import shutil

    from placement.atomic import write_files
    from reports.all_studies import FINISHED
    from reports.page.study_page import SHOWN, study_page
    from reports.parts import Parts, folder_for
    from reports.study_files import stamps, written_since

    study = STUDIES[name]
    roads = given.roads if study.takes_roads else ()
    mark = given.mark(name, roads)
    (out / FINISHED).unlink(missing_ok=True)
    parts = Parts(given.work, folder_for(out / "parts", mark))
    more: dict[str, Any] = {"roads": roads} if study.takes_roads else {}
    before = stamps(out)
    study.load()(out, quick=given.quick, seed=given.seed, parts=parts, progress=progress, **more)
    own = written_since(out, before)
    page = study_page(name, study.summary, out, own, None if roads else study.without_roads)
    write_files(out, {"index.html": page, FINISHED: json.dumps(mark, indent=2) + "\n"})
    shutil.rmtree(out / "parts", ignore_errors=True)
    return [out / each for each in sorted(before) if each.endswith(SHOWN) and each not in own]
