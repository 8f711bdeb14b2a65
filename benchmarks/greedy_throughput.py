"""Time greedy where there is much to choose from: `python -m benchmarks.greedy_throughput`.

Two sizes: dense log det (2,000 candidates of 50 dimensions, 50 chosen) and a million sparse
candidates (`localisation`: each sees a few of the path's samples). Processor time of this process,
the compiled code being warm; `--profile` says where it goes.
"""

from __future__ import annotations

import argparse
import cProfile
import io
import pstats
import statistics
import sys
import time
from collections.abc import Callable

import numpy as np

from placement.constraints import count_only
from placement.information import Information
from placement.objectives.localisation import Localisation
from placement.objectives.log_det import LogDet
from placement.problem import Problem
from placement.solution import Solution
from placement.solve import solve


def dense(c: int = 2_000, n: int = 50, k: int = 50, seed: int = 0) -> Problem:
    """Return standard normal experiments with the prior I."""
    factors = np.random.default_rng([3, c, n, k, seed]).normal(size=(c, n, 1))
    return Problem(LogDet(np.eye(n), factors), count_only(c, k))


def sparse(c: int = 1_000_000, k: int = 100, seed: int = 0, seen: int = 20) -> Problem:
    """Return c candidates along a path, each of which sees `seen` consecutive samples of c / 100.

    Blocks are 2×2 of random size and direction, in 1/m², as float32.
    """
    rng = np.random.default_rng([4, c, k, seed])
    samples = max(c // 100, seen)
    first = rng.integers(0, samples - seen + 1, c)
    indices = (first[:, None] + np.arange(seen)).astype(np.int32).ravel()
    size = rng.exponential(20.0, c)[:, None] * np.linspace(1.0, 0.1, seen)
    angle = rng.uniform(0.0, np.pi, c)[:, None] + np.linspace(0.0, 0.5, seen)
    cos, sin = np.cos(angle), np.sin(angle)
    blocks = np.stack(
        [size * (0.2 + cos * cos), size * cos * sin, size * (0.2 + sin * sin)], axis=-1
    )
    information = Information(
        samples, np.arange(c + 1) * seen, indices, blocks.reshape(-1, 3).astype(np.float32)
    )
    return Problem(Localisation(information, 0.5), count_only(c, k))


def measure(make: Callable[[], Problem], repeats: int) -> tuple[float, float, float, Solution]:
    """Return median and greatest seconds of greedy, those of laying out the problem, the last."""
    laying, seconds = [], []
    for _ in range(repeats):
        started = time.process_time()
        problem = make()  # anew each time: nothing is left over from the run before
        laying.append(time.process_time() - started)
        started = time.process_time()
        solution = solve(problem, "greedy")
        seconds.append(time.process_time() - started)
    return statistics.median(seconds), max(seconds), statistics.median(laying), solution


def main() -> None:
    """Print the table, and on request the profiles."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--million", type=int, default=1_000_000, help="Sparse candidates.")
    parser.add_argument("--profile", action="store_true")
    options = parser.parse_args()
    solve(dense(200, 50, 5), "greedy")  # compile
    solve(sparse(1_000, 5), "greedy")
    sizes: list[tuple[str, Callable[[], Problem], int]] = [
        ("dense log det, c = 2,000, n = 50, k = 50", dense, options.repeats),
        (
            f"localisation, c = {options.million:,}, k = 100",
            lambda: sparse(options.million),
            max(1, options.repeats // 3),
        ),
    ]
    sys.stdout.write(
        "| problem | seconds, median | seconds, most | laid out in, s | gains computed | value |\n"
        "| --- | --- | --- | --- | --- | --- |\n"
    )
    for label, make, repeats in sizes:
        median, most, laid, solution = measure(make, repeats)
        sys.stdout.write(
            f"| {label} | {median:.4g} | {most:.4g} | {laid:.4g} "
            f"| {solution.stats['gains_computed']} | {solution.value:.6f} |\n"
        )
        sys.stdout.flush()
        if options.profile:
            sys.stdout.write(profiled(make) + "\n")


def profiled(make: Callable[[], Problem]) -> str:
    """Return where one run of greedy spends its time."""
    problem = make()
    profile = cProfile.Profile()
    profile.enable()
    solve(problem, "greedy")
    profile.disable()
    text = io.StringIO()
    pstats.Stats(profile, stream=text).sort_stats("tottime").print_stats(12)
    return text.getvalue()


if __name__ == "__main__":
    main()
