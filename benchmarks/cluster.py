"""Two Dask workers against one: `python -m benchmarks.cluster NETWORK`.

The information of a sixteenth of a city, the first round of greedy by partitions, and its
certificate, on clusters of one and of two worker processes of this machine in turns (A B A B).
What counts is the ratio of the seconds by the clock; the results must be the same to the byte.
Workers compile once before anything is measured. Needs the extra `cluster`.
"""

from __future__ import annotations

import argparse
import hashlib
import importlib
import json
import statistics
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

from benchmarks.city import PRIOR_SIGMA_M, build_site
from benchmarks.documents import existing, fill, markdown
from models.files.roadfile import read_road_file
from placement.city.information import Site
from placement.city.solve import compute_city, load_city, open_store, solve_city
from placement.cluster import DaskCluster, Work

PART = (16, 6)
CAMERAS = 125


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure, print, and write the numbers as JSON if asked to."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    parser.add_argument("network", type=Path)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--json", type=Path, help="also write the numbers here")
    parser.add_argument("--document", type=existing, help="fill the table of this document")
    options = parser.parse_args(arguments)
    site = build_site(read_road_file(options.network), PART, 25.0)
    times: dict[int, list[dict[str, float]]] = {1: [], 2: []}
    results: set[str] = set()
    with ExitStack() as stack:
        places = {n: stack.enter_context(_cluster(n)) for n in times}
        for n, place in places.items():
            results.add(_once(site, place)[1])  # compiles in every worker
            sys.stdout.write(f"{n} worker{'s' * (n > 1)} ready\n")
        for _ in range(options.repeats):
            for n, place in places.items():
                seconds, digest = _once(site, place)
                times[n].append(seconds)
                results.add(digest)
    found: dict[str, Any] = {"results": len(results)}
    for stage in times[1][0]:
        one, two = (statistics.median(t[stage] for t in times[n]) for n in (1, 2))
        found[stage] = {
            "1 worker, s": round(one, 2),
            "2 workers, s": round(two, 2),
            "ratio": round(one / two, 2),
        }
    sys.stdout.write(json.dumps(found, indent=2) + "\n")
    if options.json is not None:
        options.json.write_text(json.dumps(found, indent=2) + "\n")
    if options.document is not None:
        fill(options.document, {"two workers": table(found)})
    if len(results) > 1:
        sys.exit(1)


def table(found: dict[str, Any]) -> str:
    """Lay out the document's table."""
    stages = [(name, row) for name, row in found.items() if isinstance(row, dict)]
    head = ["", *stages[0][1], "different results"]
    cells = [[name, *map(str, row.values()), str(found["results"] - 1)] for name, row in stages]
    return markdown(head, cells)


def _once(site: Site, work: Work) -> tuple[dict[str, float], str]:
    """Run everything once; return seconds a stage and a digest of all results."""
    with tempfile.TemporaryDirectory() as folder:
        store = open_store(Path(folder), site, {})
        started = time.perf_counter()
        compute_city(site, store, work)
        informed = time.perf_counter()
        problem = load_city(site, store, PRIOR_SIGMA_M)
        loaded = time.perf_counter()
        solution = solve_city(problem, CAMERAS, method="partitions", work=work)
        solved = time.perf_counter()
    digest = hashlib.sha256(problem.rows.as_bytes())
    digest.update(solution.selected.tobytes() + repr((solution.value, solution.bound)).encode())
    return {"information": informed - started, "solve": solved - loaded}, digest.hexdigest()


@contextmanager
def _cluster(workers: int) -> Iterator[DaskCluster]:
    distributed: Any = importlib.import_module("distributed")
    with distributed.LocalCluster(
        n_workers=workers, threads_per_worker=1, processes=True, dashboard_address=None
    ) as local:
        place = DaskCluster(local.scheduler_address)
        try:
            yield place
        finally:
            place.close()


if __name__ == "__main__":
    main()
