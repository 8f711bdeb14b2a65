"""Stop a city and begin again: `python -m benchmarks.city_stops NETWORK --store DIR`.

`benchmarks.city` runs once without a stop, then into another store with four: killed (SIGKILL) in
the middle of information, interrupted (SIGINT) in the middle of what is left of it, killed during
selection, and run to its end. After each, every chunk's file is looked at: one that is there keeps
its bytes and its time, so nothing is computed twice; and both runs must choose the same cameras.
"""

from __future__ import annotations

import argparse
import json
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from benchmarks.documents import markdown, replace_table
from placement.atomic import write_files

_PATIENCE_S = 0.05
_SELECTING_S = 5.0  # after the last chunk: loaded, and choosing or proving


def main(arguments: Sequence[str] | None = None) -> None:
    """Run, stop, resume, compare; exit with 1 if anything differs."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    parser.add_argument("network", type=Path)
    parser.add_argument("--store", type=Path, required=True, help="a folder for both stores")
    parser.add_argument("--cameras", type=int, default=2000)
    parser.add_argument("--document", type=Path, help="fill the table of this document")
    options = parser.parse_args(arguments)
    rows, same = stops(options.network, options.store, options.cameras)
    sys.stdout.write(markdown(list(rows[0]), [[str(v) for v in row.values()] for row in rows]))
    sys.stdout.write(f"\nsame cameras, value and bound: {'yes' if same else 'NO'}\n")
    if options.document is not None:
        cells = [[str(item) for item in row.values()] for row in rows]
        text = options.document.read_text(encoding="utf-8")
        text = replace_table(text, "city: stops", markdown(list(rows[0]), cells))
        write_files(options.document.parent, {options.document.name: text})
    if not same or any(row["written again"] for row in rows):
        sys.exit(1)


def stops(network: Path, store: Path, cameras: int) -> tuple[list[dict[str, Any]], bool]:
    """Return one row a run, and whether the last one found what an unbroken one does."""
    whole, broken = store / "whole", store / "broken"
    for folder in (whole, broken):
        if folder.exists():
            shutil.rmtree(folder)
    rows: list[dict[str, Any]] = []
    before: dict[str, tuple[int, int]] = {}

    def step(name: str, folder: Path, stop: int | None, when: Callable[[int], bool]) -> None:
        seen = before if folder == broken else {}
        ended = _run(network, folder, cameras, stop, when)
        now = _chunks(folder)
        again = sum(now[name] != old for name, old in seen.items())
        rows.append(
            {
                "run": name,
                "ended with": ended,
                "chunks found": len(seen),
                "computed": len(now) - len(seen),
                "written again": again,
            }
        )
        before.clear()
        before.update(now)

    step("never stopped", whole, None, _never)
    total = len(before)
    before.clear()
    step("kill -9 in information", broken, signal.SIGKILL, lambda n: n >= total // 3)
    step("SIGINT in information", broken, signal.SIGINT, lambda n: n >= 2 * total // 3)
    complete: list[float] = []

    def selecting(chunks: int) -> bool:
        if chunks == total:
            complete.append(time.monotonic())
        return bool(complete) and time.monotonic() - complete[0] > _SELECTING_S

    step("kill -9 in selection", broken, signal.SIGKILL, selecting)
    step("to its end", broken, None, _never)
    one, other = (json.loads((f.with_suffix(".json")).read_text()) for f in (whole, broken))
    same = all(one[key] == other[key] for key in ("selected sha256", "value", "bound"))
    return rows, same and len(before) == total


def _run(
    network: Path,
    folder: Path,
    cameras: int,
    stop: int | None,
    when: Callable[[int], bool],
) -> str:
    """Run the city; send `stop` once `when(chunks there)`; say how it ended."""
    said = folder.with_suffix(".log")
    folder.parent.mkdir(parents=True, exist_ok=True)
    command = [sys.executable, "-m", "benchmarks.city", str(network), "--store", str(folder)]
    command += ["--cameras", str(cameras), "--json", str(folder.with_suffix(".json"))]
    with said.open("w") as log:
        process = subprocess.Popen(command, stdout=log, stderr=log)  # noqa: S603
        while process.poll() is None:
            if stop is not None and when(len(_chunks(folder))):
                process.send_signal(stop)
                process.wait()
                break
            time.sleep(_PATIENCE_S)
    code = process.returncode
    return f"signal {signal.Signals(-code).name}" if code < 0 else f"exit {code}"


def _never(_chunks: int) -> bool:
    return False


def _chunks(folder: Path) -> dict[str, tuple[int, int]]:
    """Return time and size of every chunk whose record counts, by name."""
    found = {}
    for record in folder.glob("*/chunk-*.json"):
        status = record.with_suffix(".npz").stat()
        found[record.name] = (status.st_mtime_ns, status.st_size)
    return found


if __name__ == "__main__":
    main()
