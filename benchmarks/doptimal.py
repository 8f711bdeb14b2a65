"""Prove optimal designs and say how long it took: `python -m benchmarks.doptimal`.

The generators have fixed seeds, so that anybody can make the same instances; `--save DIR` writes
them as bare problems for `placement solve`. The tables of docs/doptimal.md are written by this
command. Seconds are this process's processor time, the compiled code being warm.
"""

from __future__ import annotations

import argparse
import itertools
import math
import statistics
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.documents import replace_table
from placement.information_problem import InformationProblem
from placement.solution import Solution
from placement.solve import solve

DOCUMENT = Path(__file__).resolve().parent.parent / "docs" / "doptimal.md"
SEEDS = range(5)
PROVEN_NATS = 1e-4


def gaussian(c: int, k: int, seed: int, n: int = 10) -> InformationProblem:
    """Return c standard normal experiments in n dimensions, prior 1e-6·I, at most once each."""
    rng = np.random.default_rng([n, c, k, seed])
    factors = rng.normal(size=(c, n, 1))
    return InformationProblem(1e-6 * np.eye(n), factors, k, name=f"gaussian-{c}-{k}-{seed}")


def correlated(c: int, k: int, seed: int, n: int = 10) -> InformationProblem:
    """Return c normal experiments whose dimensions are correlated (Wishart), prior 1e-6·I."""
    rng = np.random.default_rng([1, n, c, k, seed])
    mix = rng.normal(size=(n, n))
    factors = (rng.normal(size=(c, n)) @ mix)[:, :, None]
    return InformationProblem(1e-6 * np.eye(n), factors, k, name=f"correlated-{c}-{k}-{seed}")


def fusion(c: int, k: int, seed: int, n: int = 10, r: int = 2) -> InformationProblem:
    """Return c sensors of rank r over a prior that is full and conditioned at 1e8."""
    rng = np.random.default_rng([2, n, r, c, k, seed])
    axes = np.linalg.qr(rng.normal(size=(n, n)))[0]
    prior = (axes * np.logspace(-6, 2, n)) @ axes.T
    factors = rng.normal(size=(c, n, r))
    return InformationProblem(
        0.5 * (prior + prior.T), factors, k, name=f"fusion-{n}-{r}-{c}-{k}-{seed}"
    )


def traced(c: int, k: int, seed: int, n: int = 5) -> InformationProblem:
    """Return normal experiments under the trace of the inverse."""
    return gaussian(c, k, seed, n).changed(objective="trace_inverse")


def spanning_trees(edges: int, nodes: int = 10) -> InformationProblem:
    """Return the edges of a complete graph; log det − log det Λ counts spanning trees.

    One node is grounded, so that the information is the reduced Laplacian (Kirchhoff).
    """
    pairs = list(itertools.combinations(range(nodes), 2))
    factors = np.zeros((len(pairs), nodes, 1))
    for i, (a, b) in enumerate(pairs):
        factors[i, a, 0], factors[i, b, 0] = 1.0, -1.0
    n = nodes - 1
    return InformationProblem(1e-6 * np.eye(n), factors[:, 1:], edges, name=f"trees-{edges}")


@dataclass(frozen=True, slots=True)
class Family:
    """Instances of one kind and size, a seed each."""

    label: str
    make: Callable[[int], InformationProblem]


GAUSSIAN = [
    Family(f"{c} | {k}", lambda seed, c=c, k=k: gaussian(c, k, seed))  # type: ignore[misc]
    for k in (10, 15, 20)
    for c in (100, 200, 300, 500)
]
OTHERS = [
    Family("log det, correlated, n = 10, c = 100, k = 10", lambda s: correlated(100, 10, s)),
    Family("log det, correlated, n = 10, c = 100, k = 15", lambda s: correlated(100, 15, s)),
    Family("log det, fusion, n = 10, r = 2, c = 60, k = 8", lambda s: fusion(60, 8, s)),
    Family("log det, fusion, n = 12, r = 3, c = 60, k = 6", lambda s: fusion(60, 6, s, 12, 3)),
    Family("log det, fusion, n = 20, r = 3, c = 40, k = 10", lambda s: fusion(40, 10, s, 20, 3)),
    Family("trace of the inverse, n = 5, c = 50, k = 10", lambda s: traced(50, 10, s)),
    Family("trace of the inverse, n = 5, c = 100, k = 10", lambda s: traced(100, 10, s)),
]


def main() -> None:
    """Measure the tables that are asked for and write them into the document."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("tables", nargs="*", default=["gaussian", "others", "trees"])
    parser.add_argument("--time-limit", type=float, default=600.0)
    parser.add_argument("--seeds", type=int, default=len(SEEDS))
    parser.add_argument("--save", type=Path, help="Write the instances there and solve nothing.")
    options = parser.parse_args()
    if options.save is not None:
        save(options.save)
        return
    solve(gaussian(30, 10, 0).problem(), "branch")  # compile
    solve(traced(20, 6, 0).problem(), "branch")
    text = DOCUMENT.read_text(encoding="utf-8")
    for name in options.tables:
        if name == "trees":
            table = trees_table(options.time_limit)
        else:
            families = GAUSSIAN if name == "gaussian" else OTHERS
            first = "c | k" if name == "gaussian" else "instances"
            table = families_table(families, first, options.time_limit, options.seeds)
        text = replace_table(text, name, table)
        DOCUMENT.write_text(text, encoding="utf-8")


def instances() -> Iterator[InformationProblem]:
    """Yield every instance of every table."""
    for family in [*GAUSSIAN, *OTHERS]:
        yield from (family.make(seed) for seed in SEEDS)
    yield from (spanning_trees(edges) for edges in (9, 10, 11))


def save(folder: Path) -> None:
    """Write every instance as a bare problem."""
    folder.mkdir(parents=True, exist_ok=True)
    for instance in instances():
        word = "-trace" if instance.objective == "trace_inverse" else ""
        instance.write(folder / f"{instance.name}{word}.npz")


def families_table(
    families: list[Family], first: str, time_limit_s: float, seeds: int = len(SEEDS)
) -> str:
    """Return a row a family: the share proven, the worst gap, nodes and seconds."""
    lines = [
        f"| {first} | proven | largest gap | root gap, median | nodes, median | nodes, most "
        "| seconds, median | seconds, most |",
        "| --- |" + " --- |" * (first.count("|") + 7),
    ]
    for family in families:
        runs = [timed(family.make(seed), time_limit_s) for seed in range(seeds)]
        gaps = [gap_of(solution) for solution, _ in runs]
        proven = sum(is_proven(solution) for solution, _ in runs)
        roots = [float(solution.stats.get("root_gap", math.nan)) for solution, _ in runs]
        nodes = [int(solution.stats["nodes"]) for solution, _ in runs]
        seconds = [spent for _, spent in runs]
        lines.append(
            f"| {family.label} | {proven} of {len(runs)} | {max(gaps):.1g} "
            f"| {statistics.median(roots):.3g} "
            f"| {statistics.median(nodes):.0f} | {max(nodes)} "
            f"| {statistics.median(seconds):.2f} | {max(seconds):.2f} |"
        )
        sys.stderr.write(lines[-1] + "\n")
    return "\n".join(lines)


def trees_table(time_limit_s: float) -> str:
    """Return a row for 9, 10 and 11 edges of ten nodes: the trees found, and the bound's."""
    lines = [
        "| edges | spanning trees | bound | status | nodes | seconds |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    for edges in (9, 10, 11):
        instance = spanning_trees(edges)
        solution, spent = timed(instance, time_limit_s)
        offset = len(instance.prior) * math.log(1e-6)
        bound = math.inf if solution.bound is None else math.exp(solution.bound + offset)
        lines.append(
            f"| {edges} | {math.exp(solution.value + offset):.3f} | {bound:.3f} "
            f"| {solution.status} | {solution.stats['nodes']} | {spent:.1f} |"
        )
        sys.stderr.write(lines[-1] + "\n")
    return "\n".join(lines)


def timed(instance: InformationProblem, time_limit_s: float) -> tuple[Solution, float]:
    """Solve by `branch`; return the solution and the processor time it took, s."""
    problem = instance.problem()
    started = time.process_time()
    solution = solve(problem, "branch", time_limit_s=time_limit_s)
    return solution, time.process_time() - started


def gap_of(solution: Solution) -> float:
    """Return |bound − value|, in nats; relative for the trace."""
    if solution.bound is None:
        return math.inf
    gap = abs(solution.bound - solution.value)
    return gap if solution.maximise else gap / abs(solution.value)


def is_proven(solution: Solution) -> bool:
    """Whether the gap is at most 1e-4 nats; for the trace, whether the status is optimal."""
    if solution.maximise:
        return gap_of(solution) <= PROVEN_NATS
    return str(solution.status) == "optimal"


if __name__ == "__main__":
    main()
