"""Stop a city and begin again: `python -m benchmarks.city_stops NETWORK --store DIR`.

`benchmarks.city` runs once without a stop, and beside it into another store with three: killed
(SIGKILL) in the middle of information, interrupted (SIGINT) in the middle of what is left of it,
killed during selection, and run to its end. After each, every chunk's file is looked at: one that
was there must keep its bytes and its time, so that nothing is computed twice; and both runs must
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

_PATIENCE_S = 0.05
_SELECTING_S = 5.0  # after the last chunk: loaded, and choosing or proving


def main(arguments: Sequence[str] | None = None) -> None:
    """Run, stop, resume, compare; exit with 1 if anything differs."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    parser.add_argument("network", type=Path)
    parser.add_argument("--store", type=Path, required=True, help="a folder for both stores")
    parser.add_argument("--cameras", type=int, default=2000)
    parser.add_argument("--document", type=existing, help="fill the table of this document")
    options = parser.parse_args(arguments)
    rows, same = stops(options.network, options.store, options.cameras)
    sys.stdout.write(markdown(list(rows[0]), [[str(v) for v in row.values()] for row in rows]))
    sys.stdout.write(f"\nsame cameras, value and bound: {'yes' if same else 'NO'}\n")
    if options.document is not None:
        cells = [[str(item) for item in row.values()] for row in rows]
        fill(options.document, {"city: stops": markdown(list(rows[0]), cells)})
    if not same or any(row["written again"] for row in rows):
        sys.exit(1)


def stops(network: Path, store: Path, cameras: int) -> tuple[list[dict[str, Any]], bool]:
    """Return one row a run, and whether the last one found what an unbroken one does."""
    whole, broken = store / "whole", store / "broken"
    for folder in (whole, broken):
        if folder.exists():
            shutil.rmtree(folder)
    unbroken = _start(network, whole, cameras)
    total = _total(whole, unbroken)
    rows: list[dict[str, Any]] = []
    kept: dict[str, tuple[int, int]] = {}

    def step(name: str, stop: int | None, when: Callable[[int], bool]) -> None:
        process = _start(network, broken, cameras)
        while process.poll() is None:
            if stop is not None and when(len(_chunks(broken))):
                process.send_signal(stop)
                process.wait()
            time.sleep(_PATIENCE_S)
        now = _chunks(broken)
        again = sum(now.get(chunk) != old for chunk, old in kept.items())
        rows.append(_row(name, process.returncode, len(kept), len(now), again))
        kept.clear()
        kept.update(now)

    complete: list[float] = []

    def selecting(chunks: int) -> bool:
        if chunks == total:
            complete.append(time.monotonic())
        return bool(complete) and time.monotonic() - complete[0] > _SELECTING_S

    step("kill -9 in information", signal.SIGKILL, lambda n: n >= total // 3)
    step("SIGINT in information", signal.SIGINT, lambda n: n >= 2 * total // 3)
    step("kill -9 in selection", signal.SIGKILL, selecting)
    step("to its end", None, lambda _n: False)
    rows.insert(0, _row("never stopped", unbroken.wait(), 0, len(_chunks(whole)), 0))
    one, other = (json.loads((f.with_suffix(".json")).read_text()) for f in (whole, broken))
    same = all(one[key] == other[key] for key in ("selected sha256", "value", "bound"))
    return rows, same and len(kept) == total


def _row(name: str, code: int, found: int, now: int, again: int) -> dict[str, Any]:
    ended = f"signal {signal.Signals(-code).name}" if code < 0 else f"exit {code}"
    return {
        "run": name,
        "ended with": ended,
        "chunks found": found,
        "computed": now - found,
        "written again": again,
    }


def _start(network: Path, folder: Path, cameras: int) -> subprocess.Popen[bytes]:
    """Run the city; what it says goes to a log beside its store."""
    folder.parent.mkdir(parents=True, exist_ok=True)
    command = [sys.executable, "-m", "benchmarks.city", str(network), "--store", str(folder)]
    command += ["--cameras", str(cameras), "--json", str(folder.with_suffix(".json"))]
    with folder.with_suffix(".log").open("w") as log:
        return subprocess.Popen(command, stdout=log, stderr=log, preexec_fn=_hear)  # noqa: S603


def _hear() -> None:
    """Let SIGINT be heard, which shells make what they run in the background ignore."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def _total(folder: Path, process: subprocess.Popen[bytes]) -> int:
    """Wait until a run says how many chunks there are."""
    while process.poll() is None:
        said = re.search(r"chunk \d+ of (\d+)", folder.with_suffix(".log").read_text())
        if said:
            return int(said[1])
        time.sleep(_PATIENCE_S)
    raise ValueError(f"{folder.with_suffix('.log')}: the city ended before it said its chunks")


def _chunks(folder: Path) -> dict[str, tuple[int, int]]:
    """Return time and size of every chunk whose record counts, by name."""
    found = {}
    for record in folder.glob("*/chunk-*.json"):
        status = record.with_suffix(".npz").stat()
        found[record.name] = (status.st_mtime_ns, status.st_size)
    return found


if __name__ == "__main__":
    main()
