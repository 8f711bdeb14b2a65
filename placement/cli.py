"""The command line: parse, call, print. Other rooms add their commands through entry points."""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from importlib.metadata import entry_points
from itertools import pairwise
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Annotated

import typer

from placement.interrupts import held_back, interrupts_by_name

if TYPE_CHECKING:
    from placement.solution import Solution

EXIT_BAD_INPUT = 2
EXIT_UNSOLVED = 3
_PARSER_INTERRUPTED = 130  # what the parser returns after Ctrl-C
NOTHING = "nothing was written"

app = typer.Typer(
    name="placement",
    help="Decide where roadside cameras go, prove how good it is, and check it in simulation.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)

Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="No progress, no summary.")]
Seed = Annotated[int, typer.Option(min=0, help="Seed of everything random.")]
Runs = Annotated[int, typer.Option(min=1, max=1_000_000, help="Closed-loop Monte Carlo runs.")]
Workers = Annotated[
    int | None, typer.Option(min=1, max=1024, help="Processes of this machine that share the work.")
]
Cluster = Annotated[
    str | None, typer.Option(help="A Dask scheduler to share the work: tcp://… or tls://…")
]
Plant = Annotated[str, typer.Option(help="The simulated car: kinematic or single-track.")]


@contextmanager
def interruptible(
    out: Path | None = None, result: str = "solution.json", nothing: str = NOTHING
) -> Iterator[None]:
    """Turn Ctrl-C outside a solver into one line and an exit code; inside, solvers see to it.

    The line says what is left: the file `result` in the folder `out` if the block wrote it, else
    what the same command goes on from, else `nothing`.
    """
    file = None if out is None else out / result
    before = _written_at(file)
    try:
        with interrupts_by_name():
            yield
    except KeyboardInterrupt:
        from placement.commands import INFORMATION

        left = nothing
        if _written_at(file) != before:
            left = f"{file} is written whole, the figures beside it are not"
        elif out is not None and any((out / INFORMATION).glob("*")):
            left = "the same command goes on from here"
        typer.echo(f"placement: interrupted; {left}", err=True)
        raise typer.Exit(EXIT_UNSOLVED) from None


def _written_at(file: Path | None) -> tuple[int, int] | None:
    try:
        found = None if file is None else file.stat()
    except OSError:
        found = None
    return None if found is None else (found.st_mtime_ns, found.st_ino)


def main() -> None:
    """Run the command line; bad input is one line a problem on stderr and exit code 2."""
    warnings.showwarning = lambda message, *_where, **_more: _complain(f"warning: {message}")
    for word, value in pairwise(sys.argv[1:]):
        if word.startswith("--") and not value:  # a variable of the shell that is not set
            _complain(f"{word} must not be empty")
            sys.exit(EXIT_BAD_INPUT)
    try:
        with interrupts_by_name():
            with held_back():
                _add_commands()
            code = app(standalone_mode=False) or 0
        if code == _PARSER_INTERRUPTED:
            _complain(f"interrupted; {NOTHING}")
            code = EXIT_UNSOLVED
        sys.exit(code)
    except typer.Abort:
        sys.exit(EXIT_UNSOLVED)
    except (ValueError, OSError, ArithmeticError, RecursionError) as error:
        if os.environ.get("PLACEMENT_DEBUG"):
            raise
        for problem in getattr(error, "problems", None) or [str(error)]:
            _complain(problem)
        sys.exit(EXIT_BAD_INPUT)
    except KeyboardInterrupt:
        _complain(f"interrupted; {NOTHING}")
        sys.exit(EXIT_UNSOLVED)
    except Exception as error:  # the parser's own errors have no base class that stays in one place
        if not hasattr(error, "format_message"):
            raise
        if type(error).__name__ == "NoArgsIsHelpError":
            error.show()  # type: ignore[attr-defined]
        else:
            _complain(" ".join(error.format_message().split()))
        sys.exit(EXIT_BAD_INPUT)


@cache
def _add_commands() -> None:
    """Let other rooms add their commands: once, however often a process calls `main`."""
    for entry in entry_points(group="placement.commands"):
        entry.load()(app)


def _commands() -> ModuleType:
    """Import what commands do: here, so that `--help` does not wait for it."""
    with held_back():
        from placement import commands
    return commands


def _exit_unless_placed(solution: Solution) -> None:
    """End with the exit code of what was not found; where time was up for it, say so."""
    if solution.empty_handed:
        _complain("stopped before the first camera was placed; nothing is placed")
    if solution.empty_handed or not solution.status.has_placement:
        raise typer.Exit(EXIT_UNSOLVED)


def _complain(problem: str) -> None:
    line = " ".join(problem.split())
    shown = "".join(c if c.isprintable() else f"\\x{ord(c):02x}" for c in line)
    print(f"placement: {shown}", file=sys.stderr)  # noqa: T201


@app.command()
def solve(
    instance: Annotated[
        str, typer.Argument(help="A TOML file, a shipped name, an .npz or a table.")
    ],
    out: Annotated[Path, typer.Option(help="The folder the results go to.")],
    method: Annotated[str, typer.Option(help="How to solve; `placement methods` lists them.")] = (
        "auto"
    ),
    objective: Annotated[str | None, typer.Option(help="Instead of objective.kind.")] = None,
    budget: Annotated[
        str | None, typer.Option(help="Instead of budget.cameras: K, or A:B for a curve.")
    ] = None,
    time_limit: Annotated[float, typer.Option(help="Seconds the solver may take.")] = float("inf"),
    seed: Seed = 0,
    workers: Workers = None,
    cluster: Cluster = None,
    quiet: Quiet = False,
) -> None:
    """Choose cameras for INSTANCE and prove how good the choice is."""
    with interruptible(out):
        commands = _commands()
        solution = commands.solve_into(
            out,
            instance,
            method=method,
            objective=objective,
            budget=budget,
            time_limit_s=time_limit,
            seed=seed,
            workers=workers,
            cluster=cluster,
            quiet=quiet,
        )
    _exit_unless_placed(solution)


@app.command()
def validate(
    folder: Annotated[Path, typer.Argument(help="What `placement solve --out` wrote.")],
    runs: Runs = 200,
    seed: Seed = 0,
    plant: Plant = "kinematic",
    latency: Annotated[float, typer.Option(help="Seconds a measurement comes late.")] = 0.0,
    missed: Annotated[float, typer.Option(help="Share of detections that fail.")] = 0.0,
    false: Annotated[float, typer.Option(help="Share of frames with a false position.")] = 0.0,
    workers: Workers = None,
    cluster: Cluster = None,
    quiet: Quiet = False,
) -> None:
    """Drive the placement in FOLDER in a closed loop, many times, and record what happens."""
    with interruptible(folder, "validation_summary.json"):
        commands = _commands()
        commands.validate_in(
            folder,
            runs=runs,
            seed=seed,
            plant=plant,
            latency_s=latency,
            missed=missed,
            false=false,
            workers=workers,
            cluster=cluster,
            quiet=quiet,
        )


@app.command()
def verify(
    folder: Annotated[Path, typer.Argument(help="What `placement solve --out` wrote.")],
    quiet: Quiet = False,
) -> None:
    """Check what FOLDER claims by slower, plainer means: value, rules, bound, every file."""
    with interruptible():
        holds = _commands().verify_in(folder, quiet=quiet)
    if not holds:
        raise typer.Exit(EXIT_UNSOLVED)


@app.command()
def demo(
    out: Annotated[Path, typer.Option(help="The folder the results go to.")] = Path("out/demo"),
    runs: Runs = 200,
    seed: Seed = 0,
    quiet: Quiet = False,
) -> None:
    """Solve and validate the embedded circuit, end to end."""
    with interruptible(out):
        commands = _commands()
        solution = commands.solve_into(out, "circuit", time_limit_s=60.0, seed=seed, quiet=quiet)
    _exit_unless_placed(solution)
    with interruptible(out, "validation_summary.json", "the placement is there, no drive is"):
        commands.validate_in(out, runs=runs, seed=seed, plant="kinematic", quiet=quiet)


@app.command()
def methods() -> None:
    """List the solution methods."""
    from placement.solve import METHODS

    for name, method in METHODS.items():
        typer.echo(f"{name:12} {method.summary}")


@app.command()
def keys() -> None:
    """Print every key of an instance file, with its default or an example."""
    from placement.instance.keys import key_lines

    for line in key_lines():
        typer.echo(line)
