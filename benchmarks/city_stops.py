"""Stop a city and begin again: `python -m benchmarks.city_stops INSTANCE.toml --out DIR`.

`placement solve` runs once without a stop, and then into another folder with three: killed
(SIGKILL) in the middle of information, interrupted (SIGINT) in the middle of what is left of it,
killed during selection, and run to its end. While they run, every chunk's file is looked at: one
that was there must keep its bytes and its time, so that nothing is computed twice; and both must
choose the same cameras.
"""

from __future__ import annotations

import argparse
import json
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from benchmarks.documents import existing, fill, markdown
from placement.commands import INFORMATION

_PATIENCE_S = 0.05
_SELECTING_S = 20.0  # after the last chunk: joined, and choosing or proving
_SAME = ("selected", "value", "upper_bound")


def main(arguments: Sequence[str] | None = None) -> None:
    """Run, stop, resume, compare; exit with 1 if anything differs."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    parser.add_argument("instance", type=existing)
    parser.add_argument("--out", type=Path, required=True, help="a folder for both solutions")
    parser.add_argument("--document", type=existing, help="fill the table of this document")
    options = parser.parse_args(arguments)
    rows, same = stops(options.instance, options.out)
    cells = [[str(item) for item in row.values()] for row in rows]
    table = markdown(list(rows[0]), cells)
    sys.stdout.write(f"{table}\nsame cameras, value and bound: {'yes' if same else 'NO'}\n")
    if options.document is not None:
        fill(options.document, {"city: stops": table})
    if not same or any(row["written again"] for row in rows):
        sys.exit(1)


def stops(instance: Path, out: Path) -> tuple[list[dict[str, Any]], bool]:
    """Return one row a run, and whether the last one found what an unbroken one does."""
    whole, broken = out / "whole", out / "broken"
    for folder in (whole, broken):
        if folder.exists():
            shutil.rmtree(folder)
    rows: list[dict[str, Any]] = []
    kept: dict[str, tuple[int, int]] = {}

    def step(folder: Path, name: str, stop: int | None, when: Callable[[int], bool]) -> None:
        process = _start(instance, folder)
        now = dict(kept)
        again: set[str] = set()
        while process.poll() is None:
            chunks = _chunks(folder)
            again |= {chunk for chunk, state in chunks.items() if now.get(chunk, state) != state}
            now |= chunks
            if stop is not None and when(len(now)):
                process.send_signal(stop)
                process.wait()
                now |= _chunks(folder)
            time.sleep(_PATIENCE_S)
        rows.append(_row(name, process.returncode, len(kept), len(now), len(again)))
        kept.clear()
        kept.update(now)

    step(whole, "never stopped", None, lambda _n: False)
    total = _total(whole)
    kept.clear()
    complete: list[float] = []

    def selecting(chunks: int) -> bool:
        if chunks == total:
            complete.append(time.monotonic())
        return bool(complete) and time.monotonic() - complete[0] > _SELECTING_S

    step(broken, "kill -9 in information", signal.SIGKILL, lambda n: n >= total // 3)
    step(broken, "SIGINT in information", signal.SIGINT, lambda n: n >= 2 * total // 3)
    step(broken, "kill -9 in selection", signal.SIGKILL, selecting)
    step(broken, "to its end", None, lambda _n: False)
    one, other = (json.loads((f / "solution.json").read_text()) for f in (whole, broken))
    return rows, all(one[key] == other[key] for key in _SAME) and len(kept) == total


def _row(name: str, code: int, found: int, now: int, again: int) -> dict[str, Any]:
    ended = f"signal {signal.Signals(-code).name}" if code < 0 else f"exit {code}"
    return {
        "run": name,
        "ended with": ended,
        "chunks found": found,
        "computed": now - found,
        "written again": again,
    }


def _start(instance: Path, folder: Path) -> subprocess.Popen[bytes]:
    """Solve; what is said goes to a log beside the folder."""
    folder.mkdir(parents=True, exist_ok=True)
    code = "from placement.cli import main; main()"
    command = [sys.executable, "-c", code, "solve", str(instance), "--out", str(folder)]
    with folder.with_suffix(".log").open("a") as log:
        return subprocess.Popen(command, stdout=log, stderr=log, preexec_fn=_hear)  # noqa: S603


def _hear() -> None:
    """Let SIGINT be heard, which shells make what they run in the background ignore."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def _total(folder: Path) -> int:
    """Return how many chunks there are, as a run said."""
    said = re.search(r"chunk \d+ of (\d+)", folder.with_suffix(".log").read_text())
    if said is None:
        raise ValueError(f"{folder.with_suffix('.log')} must say how many chunks there are")
    return int(said[1])


def _chunks(folder: Path) -> dict[str, tuple[int, int]]:
    """Return time and size of every chunk whose record counts, by name."""
    found = {}
    for record in (folder / INFORMATION).glob("chunk-*.json"):
        try:
            status = record.with_suffix(".npz").stat()
        except FileNotFoundError:  # the solution is written, and what was kept is going
            continue
        found[record.name] = (status.st_mtime_ns, status.st_size)
    return found


if __name__ == "__main__":
    main()
