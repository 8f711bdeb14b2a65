"""Progress on stderr: what is being done, how far, and for how long."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

Report = Callable[[str, float | None], None]

# A pipe or a log file gets a plain line at most this often, a terminal a live bar.
PLAIN_EVERY_S = 5.0


@contextmanager
def watch(quiet: bool = False) -> Iterator[Report]:
    """Give a function `report(text, fraction)` that shows progress until the block ends.

    `fraction` is in [0, 1], or None where the end cannot be foretold.
    """
    if quiet:
        yield lambda _text, _fraction: None
    elif sys.stderr.isatty():
        yield from _bar()
    else:
        yield _plain()


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
