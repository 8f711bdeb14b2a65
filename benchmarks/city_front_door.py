"""A city as a user solves it: `python -m benchmarks.city_front_door INSTANCE.toml --out DIR`.

Runs `placement solve` and `placement verify`, each a process whose seconds, processor time and peak
memory are measured, and opens the page in Chromium, as far as it and playwright are there: how long
until the map can be used, and how long a frame takes while a hand drags it, whole and close by.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from benchmarks.documents import existing, fill, markdown

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
FLAGS = ("--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run")
STEPS = 100  # of 6 by 3 pixels: past what is drawn beyond the frame
SHOWN = ("candidates", "budget", "objective", "value", "upper_bound", "gap", "method", "status")
FILES = ("index.html", "map.png", "map.svg", "coverage.png", "coverage.svg", "cameras.geojson",
         "cameras.add.xml", "bill_of_materials.csv", "placements.csv", "along_path.csv",
         "solution.json")  # fmt: skip
# Notes the time of every frame until `placementFrames.stop`.
_FRAMES = """() => { const f = { times: [], on: true, last: performance.now() };
  window.placementFrames = f;
  const tick = (now) => { f.times.push(now - f.last); f.last = now;
    if (f.on) requestAnimationFrame(tick); };
  requestAnimationFrame(tick); }"""
_SETTLED = "() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))"


def main(arguments: Sequence[str] | None = None) -> None:
    """Solve, verify, open, print, and fill the tables of a document."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    parser.add_argument("instance", type=existing)
    parser.add_argument("--out", type=Path, required=True, help="the folder of the solution")
    parser.add_argument("--document", type=existing, help="fill the tables of this document")
    options = parser.parse_args(arguments)
    if options.out.exists():
        shutil.rmtree(options.out)
    commands = [
        measured("placement solve", "solve", str(options.instance), "--out", str(options.out)),
        measured("placement verify", "verify", str(options.out)),
    ]
    found = {
        "city: front door": _table(commands),
        "city: found": _table(result(options.out)),
        "city: files": _table(files(options.out)),
    }
    pans = page(options.out / "index.html")
    if pans:
        found["city: page"] = _table(pans)
    for name, table in found.items():
        sys.stdout.write(f"{name}\n{table}\n\n")
    if options.document is not None:
        fill(options.document, found)


def measured(name: str, *words: str) -> dict[str, Any]:
    """Run the command line with `words`: seconds, processor time, peak of memory, last words."""
    started = time.monotonic()
    code = "from placement.cli import main; main()"
    process = subprocess.Popen(  # noqa: S603 - our own module, by our own interpreter
        [sys.executable, "-c", code, *words], stdout=subprocess.PIPE
    )
    said = process.stdout.read().decode() if process.stdout is not None else ""
    _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise SystemExit(f"error: {name} ended with {process.returncode}")
    return {
        "command": f"`{name}`",
        "seconds": round(time.monotonic() - started, 1),
        "processor s": round(used.ru_utime + used.ru_stime, 1),
        "peak GiB": round(used.ru_maxrss / 2**20, 2),
        "says": said.strip().splitlines()[0].split("; on trust")[0].split(" (at most")[0],
    }


def result(out: Path) -> list[dict[str, Any]]:
    """Return what the solution says of itself."""
    record = json.loads((out / "solution.json").read_text(encoding="utf-8"))
    rows = [{"": key, "nats, counts": record[key]} for key in SHOWN if key in record]
    chosen = record["stats"].get("chosen", record["method"])
    return [*rows, {"": "chosen", "nats, counts": chosen}]


def files(out: Path) -> list[dict[str, Any]]:
    """Return the files of the folder and their sizes."""
    return [
        {"file": name, "MB": f"{(out / name).stat().st_size / 1e6:.2f}"}
        for name in FILES
        if (out / name).exists()
    ]


def page(path: Path) -> list[dict[str, Any]]:
    """Open the page and drag its map: one row a zoom; none without a browser to do it."""
    browser = next((found for name in BROWSERS if (found := shutil.which(name))), None)
    if browser is None or not path.exists():
        return []
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        return []
    with sync_playwright() as driver:
        opened = driver.chromium.launch(executable_path=browser, args=list(FLAGS))
        tab = opened.new_page(viewport={"width": 1400, "height": 1000})
        started = time.monotonic()
        tab.goto(path.as_uri())
        tab.wait_for_selector("body[data-ready=yes]", timeout=120_000)
        tab.evaluate(_SETTLED)
        ready = round(time.monotonic() - started, 2)
        rows = [{"map": "the whole city", "ready after s": ready, **_drag(tab)}]
        for _ in range(8):
            tab.mouse.wheel(0, -240)
            tab.wait_for_timeout(150)
        tab.wait_for_timeout(500)
        rows.append({"map": "a quarter, streets apart", "ready after s": "", **_drag(tab)})
        opened.close()
    return rows


def _drag(tab: Any) -> dict[str, Any]:
    """Drag from the middle of the map in small steps, and return how long its frames took."""
    box = tab.locator("#map").bounding_box()
    x, y = box["x"] + 0.5 * box["width"], box["y"] + 0.5 * box["height"]
    tab.mouse.move(x, y)
    tab.mouse.down()
    tab.evaluate(_FRAMES)
    for n in range(1, STEPS + 1):
        tab.mouse.move(x + 6 * n, y + 3 * n)
    tab.evaluate(_SETTLED)
    times = sorted(
        tab.evaluate("() => { placementFrames.on = false; return placementFrames.times; }")[1:]
    )
    tab.mouse.up()
    tab.mouse.move(x, y)
    tab.wait_for_timeout(500)
    return {
        "frames": len(times),
        "median ms": round(times[len(times) // 2], 1),
        "worst ms": round(times[-1], 1),
    }


def _table(rows: list[dict[str, Any]]) -> str:
    return markdown(list(rows[0]), [[str(item) for item in row.values()] for row in rows])


if __name__ == "__main__":
    main()
