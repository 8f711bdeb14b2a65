"""Progress on stderr: what is being done, how far, and for how long; and when kernels compile."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from placement.interrupts import held_back

Report = Callable[[str, float | None], None]

# A pipe or a log file gets a plain line at most this often, a terminal a live bar.
PLAIN_EVERY_S = 5.0
COMPILING = "compiling, once per installation"


@contextmanager
def watch(quiet: bool = False) -> Iterator[Report]:
    """Give a function `report(text, fraction)` that shows progress until the block ends.

    `fraction` is in [0, 1], or None where the end cannot be foretold. While a kernel is compiled,
    which may take a minute when a method is first used, what is reported says so.
    """
    if quiet:
        yield lambda _text, _fraction: None
    elif sys.stderr.isatty():
        with _bar() as report, _compiling(report) as told:
            yield told
    else:
        with _compiling(_plain()) as told:
            yield told


@contextmanager
def _compiling(report: Report) -> Iterator[Report]:
    """Give `report`, and say by it when kernels are compiled; then again what was said before."""
    with held_back():
        from numba.core import event
    said: list[tuple[str, float | None]] = [("", None)]
    depth = 0

    class Listener(event.Listener):
        def on_start(self, _event: Any) -> None:
            nonlocal depth
            depth += 1
            text, share = said[0]
            report(f"{text} ({COMPILING})" if text else COMPILING, share)

        def on_end(self, _event: Any) -> None:
            nonlocal depth
            depth -= 1
            if not depth and said[0][0]:
                report(*said[0])

    def told(text: str, fraction: float | None) -> None:
        said[0] = (text, fraction)
        report(text, fraction)

    with event.install_listener("numba:compile", Listener()):
        yield told


@contextmanager
def _bar() -> Iterator[Report]:
    from rich.console import Console
    from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    columns = (SpinnerColumn(), TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task("", total=None)

        def report(text: str, fraction: float | None) -> None:
            total = None if fraction is None else 1.0
            progress.update(task, description=text, total=total, completed=fraction or 0.0)

        yield report


def _plain() -> Report:
    started = time.monotonic()
    last = started - PLAIN_EVERY_S + 1.0  # silent for commands that end within a second

    def report(text: str, fraction: float | None) -> None:
        nonlocal last
        now = time.monotonic()
        if now - last < PLAIN_EVERY_S:
            return
        last = now
        share = "" if fraction is None else f" {100 * fraction:.0f} %"
        print(f"[{now - started:6.1f} s] {text}{share}", file=sys.stderr, flush=True)  # noqa: T201

    return report
