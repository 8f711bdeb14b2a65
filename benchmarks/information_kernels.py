"""Measure the information kernels: `python -m benchmarks.information_kernels [--json FILE]`.

Three tables on one core, compiled code warm:

- dense: pairs a second of processor time, of the compiled kernel and of its chunked float64 NumPy
  twin, in turns (A B A B …); the ratio of medians is what counts. The twin is an oracle: it is
  chunked to the cache, but spells the formulas out (arctangents; for 2×2 blocks, einsum and
  eigenvalues), so the ratio for the 2×2 models is not what tuned NumPy would lose by;
- assembly: the culled CSR matrix of `winding`, by error model and by threads;
- growth: the same on roads of 1, 4, 16 and 64 km in seconds of processor time, with the exponent
  of a log-log fit, which is 1 where work grows with the visible pairs and 2 where it grows with
  poses × samples.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from models.errors import FORMS, ErrorModel
from models.roads import Piece, Road, RoadPoints, road_from_pieces
from placement.assemble import build_road
from placement.candidates import Candidates, build_candidates
from placement.information import compute_information
from placement.information.kernels import dense_blocks
from placement.information.reference import dense_chunks
from placement.information.sample_tree import build_tree
from placement.instance import load_instance

RANGE_M = 150.0
DENSE_POSES = 16  # at a time: their dense block stays in the cache, as a solver would use it


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure, print the tables as Markdown, and write the numbers as JSON if asked to."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    parser.add_argument("--json", type=Path, help="also write the numbers here")
    parser.add_argument("--repeats", type=int, default=7, help="measurements of each figure")
    options = parser.parse_args(arguments)
    tables = {
        "dense": dense_table(options.repeats),
        "assembly": assembly_table(options.repeats),
        "growth": growth_table(max(1, options.repeats // 2)),
    }
    for name, rows in tables.items():
        sys.stdout.write(f"\n**{name}**\n\n{as_markdown(rows)}\n")
    if options.json is not None:
        options.json.write_text(json.dumps(tables, indent=2) + "\n")


def dense_table(repeats: int = 7) -> list[dict[str, Any]]:
    """Return pairs a second of kernel and twin for each error model, one core, in turns."""
    candidates, points = winding()
    cameras = candidates.cameras.subset(np.arange(0, len(candidates), 9))
    table = cameras.table()
    tree = build_tree(points.x_m, points.y_m, points.heading_rad)
    pairs = len(cameras) * len(points)
    rows = []
    for form in FORMS:
        errors = ErrorModel(form, persistent=False)
        out = np.empty((DENSE_POSES, 1 if errors.isotropic else 3, tree.samples.shape[1]))
        parameters = errors.parameters()

        def by_kernel(
            out: np.ndarray[Any, Any] = out, parameters: np.ndarray[Any, Any] = parameters
        ) -> None:
            for begin in range(0, len(table), DENSE_POSES):
                part = table[begin : begin + DENSE_POSES]
                dense_blocks(part, parameters, RANGE_M, tree.samples, out)

        def by_twin(errors: ErrorModel = errors) -> None:
            for _ in dense_chunks(cameras, points, errors, RANGE_M):
                pass

        kernel, twin = in_turns((by_kernel, by_twin), repeats, clock=time.process_time)
        rows.append(
            {
                "model": form,
                "kernel, M pairs/s": round(pairs / statistics.median(kernel) / 1e6, 1),
                "NumPy twin, M pairs/s": round(pairs / statistics.median(twin) / 1e6, 2),
                "ratio": round(statistics.median(twin) / statistics.median(kernel), 1),
                "least ratio": round(min(twin) / max(kernel), 1),
            }
        )
    return rows


def assembly_table(repeats: int = 7) -> list[dict[str, Any]]:
    """Return the seconds of the culled matrix of `winding`, on one thread and on two."""
    candidates, points = winding()
    cases = [(form, False) for form in FORMS] + [("covariance", True)]
    rows = []
    for form, persistent in cases:
        errors = ErrorModel(form, persistent=persistent)

        def one(errors: ErrorModel = errors) -> None:
            compute_information(candidates.cameras, points, errors, RANGE_M, workers=1)

        def two(errors: ErrorModel = errors) -> None:
            compute_information(candidates.cameras, points, errors, RANGE_M, workers=2)

        single, double = in_turns((one, two), repeats)
        information = compute_information(candidates.cameras, points, errors, RANGE_M)
        rows.append(
            {
                "model": form + (", persistent" if errors.splits else ""),
                "poses": len(candidates),
                "visible pairs": len(information.indices),
                "1 thread, ms": round(1e3 * statistics.median(single), 1),
                "2 threads, ms": round(1e3 * statistics.median(double), 1),
                "slowest, ms": round(1e3 * max(single + double), 1),
            }
        )
    return rows


def growth_table(
    repeats: int = 3, kilometres: Sequence[int] = (1, 4, 16, 64)
) -> list[dict[str, Any]]:
    """Return seconds and visible pairs by length of road, one thread, and the exponents."""
    errors = ErrorModel("radius")
    rows: list[dict[str, Any]] = []
    for length in kilometres:
        road = long_road(length)
        candidates = build_candidates(load_instance("winding"), road)
        points = road.sample(1.0)

        def run(candidates: Candidates = candidates, points: RoadPoints = points) -> None:
            compute_information(candidates.cameras, points, errors, RANGE_M, workers=1)

        (seconds,) = in_turns((run,), repeats, clock=time.process_time)
        information = compute_information(candidates.cameras, points, errors, RANGE_M)
        rows.append(
            {
                "km": length,
                "poses": len(candidates),
                "samples": len(points),
                "visible pairs": len(information.indices),
                "CPU ms": round(1e3 * min(seconds), 1),
            }
        )
    rows.append(
        {
            "km": "exponent",
            "poses": "",
            "samples": "",
            "visible pairs": round(exponent(rows, "visible pairs"), 3),
            "CPU ms": round(exponent(rows, "CPU ms"), 3),
        }
    )
    return rows


def exponent(rows: Sequence[dict[str, Any]], column: str) -> float:
    """Return the slope of log(column) over log(km)."""
    x, y = (np.log([float(row[key]) for row in rows]) for key in ("km", column))
    return float(np.polyfit(x, y, 1)[0])


def winding() -> tuple[Candidates, RoadPoints]:
    """Return the candidates and samples of `winding`."""
    instance = load_instance("winding")
    road = build_road(instance)
    return build_candidates(instance, road), road.sample(instance.road.sample_spacing_m)


def long_road(kilometres: int) -> Road:
    """Repeat `winding`'s pieces, every second time mirrored, up to a length."""
    section = load_instance("winding").road.pieces or ()
    pieces: list[Piece] = []
    left, sign = 1000.0 * kilometres, 1.0
    while left > 0.0:
        for piece in section:
            length = min(piece.length, left)
            if length > 0.0:
                pieces.append(Piece(length, *(sign * k for k in piece.curvature)))
                left -= length
        sign = -sign
    return road_from_pieces(pieces)


def in_turns(
    runs: Sequence[Callable[[], None]],
    repeats: int,
    clock: Callable[[], float] = time.perf_counter,
) -> list[list[float]]:
    """Time each of `runs` `repeats` times, in turns, after one round to compile and warm up."""
    seconds: list[list[float]] = [[] for _ in runs]
    for turn in range(repeats + 1):
        for n, run in enumerate(runs):
            started = clock()
            run()
            if turn:
                seconds[n].append(clock() - started)
    return seconds


def as_markdown(rows: Sequence[dict[str, Any]]) -> str:
    """Lay rows out as a Markdown table."""
    head = list(rows[0])
    lines = ["| " + " | ".join(head) + " |", "|" + " --- |" * len(head)]
    lines += ["| " + " | ".join(str(row[key]) for key in head) + " |" for row in rows]
    return "\n".join(lines)


if __name__ == "__main__":
    for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(variable, "1")
    main()
