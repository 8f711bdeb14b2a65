"""`placement benchmark SUITE --out DIR`: run, resume, and sum up."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from benchmarks.runner.suites import Suite
    from placement.cluster import Work
    from placement.watch import Report

SUITE_NAMES = "smoke, camera, doptimal, greedy, coverage"


def register(app: typer.Typer) -> None:
    """Add `benchmark` to the command line."""
    app.command()(benchmark)


def benchmark(
    suite: Annotated[str, typer.Argument(help=f"One of {SUITE_NAMES}.")],
    out: Annotated[Path, typer.Option(help="The folder of the journal, the tables, the figures.")],
    time_limit: Annotated[
        float | None, typer.Option(min=0.1, max=1e6, help="Seconds a solver may take.")
    ] = None,
    seeds: Annotated[
        int | None, typer.Option(min=1, max=1000, help="How many seeds, from --seed on.")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="The first seed.")] = 0,
    repeats: Annotated[int | None, typer.Option(min=1, max=1000, help="Times each job.")] = None,
    solver: Annotated[list[str] | None, typer.Option(help="Only this solver; repeatable.")] = None,
    instance: Annotated[
        list[str] | None, typer.Option(help="Only this instance; repeatable.")
    ] = None,
    data: Annotated[
        Path | None, typer.Option(help="Where your roads lie; else PLACEMENT_DATA says it.")
    ] = None,
    workers: Annotated[
        int | None, typer.Option(min=1, help="Jobs at a time on this machine; seconds suffer.")
    ] = None,
    cluster: Annotated[
        str | None, typer.Option(help="Jobs go to the Dask cluster at this address.")
    ] = None,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="No progress.")] = False,
) -> None:
    """Run solvers side by side; killed at any moment, the same command goes on where it was."""
    from placement.interrupts import held_back

    with held_back():
        from benchmarks.runner.suites import make_suite
        from placement.atomic import prepared_folder
        from placement.cluster import working
        from placement.watch import watch

    if data is not None and not data.is_dir():
        raise ValueError(f"--data must be a folder of road files, got {data}")
    chosen = make_suite(suite, str(data.resolve()) if data is not None else None).changed(
        time_limit_s=time_limit,
        seeds=range(seed, seed + seeds) if seeds is not None else [seed],
        repeats=repeats,
        solvers=solver,
        instances=instance,
    )
    try:
        with (
            prepared_folder(out),
            working(workers, cluster) as work,
            watch(quiet) as report,
        ):
            rows = run_and_write(chosen, out, report, work)
    except KeyboardInterrupt:
        typer.echo("placement: interrupted; the same command goes on from here", err=True)
        raise typer.Exit(3) from None
    if not quiet:
        solved = sum(row.get("value") is not None for row in rows)
        denied = sum(row.get("value") is not None and not row["verified"] for row in rows)
        typer.echo(f"{len(rows)} rows, {solved} with a value, {denied} denied by the referee")
        typer.echo(f"results in {out}")


def run_and_write(
    suite: Suite, out: Path, report: Report, work: Work | None = None
) -> list[dict[str, Any]]:
    """Run what is left of `suite`, then write every table and figure anew."""
    from benchmarks.runner.figures import figures
    from benchmarks.runner.results import merge_repeats, to_csv
    from benchmarks.runner.runner import run_suite
    from benchmarks.runner.summary import summary_csv, summary_markdown
    from placement.atomic import write_files

    rows = merge_repeats(suite.name, run_suite(suite, out, report, work))
    report("summing up", None)
    write_files(
        out,
        {
            "results.csv": to_csv(rows),
            "summary.csv": summary_csv(rows),
            "summary.md": summary_markdown(suite.name, suite.about, rows),
            **figures(rows),
        },
    )
    return rows
