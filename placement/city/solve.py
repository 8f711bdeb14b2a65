"""A city from end to end: information in chunks, a greedy placement, swaps, and a certificate."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from models.geometry import BoolArray, FloatArray, IntArray
from placement.city.greedy import add_row, first_gains, lazy_greedy, stochastic_greedy
from placement.city.information import ChunkTask, Site, chunk_task, compute_chunk
from placement.city.partitions import partitioned_greedy
from placement.city.prices import RegionPrice, certificate, price_region
from placement.city.regions import region_tasks, whole_task
from placement.city.swaps import swap_cameras, swap_region
from placement.cluster import Serial, Work
from placement.information.chunks import Chunk, ChunkStore, fill, gather
from placement.information.surroundings import Surroundings

Report = Callable[[str, float | None], None]
METHODS = ("lazy", "partitions", "stochastic")
TURN = 100  # cameras of greedy between two looks at the clock
_EPSILON = 0.01  # of stochastic greedy
_STEPS = 150  # of mirror descent for the certificate; 300 gain 0.02 %
# Every price gives a bound; the last camera's gain is a low one, so it is raised while that pays.
_PRICES, _DEARER, _WORTH_IT = 20, 1.04, 1e-4
_ABOVE = 0.9  # candidates that gain less alone than this share of the price are left to the floor


@dataclass(frozen=True, slots=True)
class CityProblem:
    """Hold the candidates of a city that are worth keeping, as CSR rows; `localisation`.

    candidates (c,): their numbers among all poses; group (c,): their mounts, rising.
    """

    rows: Chunk
    group: IntArray
    n_mounts: int
    n_samples: int
    weights: FloatArray
    scale: float

    @property
    def csr(self) -> tuple[Any, Any, Any]:
        """indptr, indices and blocks."""
        return self.rows.indptr, self.rows.indices, self.rows.blocks

    def value(self, selected: IntArray) -> float:
        """Evaluate rows `selected` in plain NumPy, sharing nothing with the kernels."""
        indptr, indices, blocks = self.csr
        entries = np.concatenate(
            [np.arange(indptr[i], indptr[i + 1]) for i in np.sort(selected)] or [np.empty(0, int)]
        )
        seen = indices[entries]
        sums = self.scale * np.column_stack(
            [
                np.bincount(seen, blocks[entries, b].astype(np.float64), self.n_samples)
                for b in range(blocks.shape[1])
            ]
        )
        if blocks.shape[1] == 1:
            return float(2.0 * np.sum(self.weights * np.log1p(sums[:, 0])))
        a, c, b = sums.T
        return float(np.sum(self.weights * np.log1p(a + b + np.maximum(a * b - c * c, 0.0))))


@dataclass(frozen=True, slots=True)
class CitySolution:
    """Hold a placement and what every placement is at most worth.

    selected: candidate numbers among all poses, rising. price: what the last camera is worth.
    """

    selected: IntArray
    rows: IntArray
    value: float
    bound: float
    price: float
    stats: dict[str, Any]

    @property
    def gap(self) -> float:
        """Return (bound − value)/value."""
        return (self.bound - self.value) / self.value if self.value else 0.0


class _Tasks(Sequence[ChunkTask]):
    """Cut each chunk's task only when somebody is about to run it."""

    def __init__(self, site: Site, numbers: list[int]) -> None:
        self.site = site
        self.numbers = numbers
        self.around = Surroundings(site.points, site.obstacles)

    def __len__(self) -> int:
        return len(self.numbers)

    def __getitem__(self, i: Any) -> Any:
        return chunk_task(self.site, self.around, self.numbers[i])


def compute_city(
    site: Site, store: ChunkStore, work: Work | None = None, progress: Report | None = None
) -> int:
    """Compute the chunks that `store` lacks; return how many those were."""
    place = work or Serial()

    def compute(missing: list[int]) -> Iterator[tuple[int, bytes]]:
        for i, content in place.run(compute_chunk, _Tasks(site, missing), "information"):
            yield missing[i], content

    return fill(store, site.n_chunks, compute, progress or _silent)


def load_city(
    site: Site, store: ChunkStore, prior_sigma_m: float, weights: FloatArray | None = None
) -> CityProblem:
    """Gather all chunks into one problem; every sample weighs 1 unless `weights` (t,) are given."""
    rows = gather(store, site.n_chunks)
    return CityProblem(
        rows,
        rows.candidates // len(site.mounts.poses),
        len(site.mounts),
        len(site.points),
        np.ones(len(site.points)) if weights is None else weights,
        prior_sigma_m**2,
    )


def solve_city(
    problem: CityProblem,
    budget: int,
    *,
    method: str = "lazy",
    seed: int = 0,
    work: Work | None = None,
    progress: Report | None = None,
    steps: int = _STEPS,
) -> CitySolution:
    """Place `budget` cameras, one a mount, by greedy; prove by priced cuts how good that is.

    method: `lazy`; `partitions`, in two rounds, the first of which runs on `work`; or `stochastic`.

    Raises:
        ValueError: for another method or a budget that is not positive.
    """
    if method not in METHODS:
        raise ValueError(f"method must be one of {', '.join(METHODS)}, got {method}")
    if budget < 1:
        raise ValueError(f"budget.cameras must be at least 1, got {budget}")
    report = progress or _silent
    started = time.monotonic()
    report(f"greedy ({method})", None)
    alone = alone_gains(problem)
    if method == "partitions":
        chosen, gains = partitioned_greedy(problem, budget, work or Serial())
    elif method == "stochastic":
        chosen, gains = sampled(problem, budget, np.random.default_rng(seed))
    else:
        chosen, gains = greedy(problem, budget, alone)
    last = float(gains[-1]) if len(gains) == budget else 0.0
    report("swaps", None)
    chosen, swaps = swapped(problem, chosen, alone, last, work or Serial())
    placed = time.monotonic()
    value = problem.value(chosen)
    report("certificate", None)
    bound, price, regions = prove(problem, budget, alone, chosen, last, work or Serial(), steps)
    return CitySolution(
        selected=np.sort(problem.rows.candidates[chosen]),
        rows=np.sort(chosen),
        value=value,
        bound=max(bound, value),
        price=price,
        stats={
            "method": method,
            "greedy_value": float(np.sum(gains)),
            "swaps": swaps,
            "regions": regions,
            "placement_seconds": placed - started,
            "certificate_seconds": time.monotonic() - placed,
        },
    )


def alone_gains(problem: CityProblem) -> FloatArray:
    """Return what each candidate gains alone, (c,)."""
    c = len(problem.group)
    alone = np.empty(c)
    nothing = np.zeros((problem.n_samples, 3))
    first_gains(*problem.csr, problem.weights, problem.scale, nothing, 0, c, alone)
    return alone


def greedy(
    problem: CityProblem,
    budget: int,
    alone: FloatArray,
    allowed: BoolArray | None = None,
    required: IntArray | None = None,
    go_on: Callable[[int], bool] = lambda _placed: True,
) -> tuple[IntArray, FloatArray]:
    """Return the rows that lazy greedy chooses, `required` first, and the gains of the others.

    `allowed` (c,) marks the candidates that may be chosen. Every TURN cameras `go_on`, which is
    told how many there are, may say that these shall do.
    """
    sums = np.zeros((problem.n_samples, 3))
    taken = np.zeros(problem.n_mounts, np.bool_)
    first = np.empty(0, np.int64) if required is None else required
    for i in first:
        add_row(int(i), 1.0, *problem.csr, sums)
        taken[problem.group[i]] = True
    room = budget - len(first)
    upper, free = alone.copy(), np.ones(len(alone), np.bool_) if allowed is None else allowed
    chosen, gains, added = np.zeros(room, np.int64), np.zeros(room), 0
    while added < room and go_on(added):
        turn = min(TURN, room - added)
        new, gain = np.zeros(turn, np.int64), np.zeros(turn)
        found, _ = lazy_greedy(
            *problem.csr, problem.weights, problem.scale, problem.group, free, taken, turn, 0.0,
            sums, upper, new, gain,
        )  # fmt: skip
        chosen[added : added + found], gains[added : added + found] = new[:found], gain[:found]
        added += found
        if found < turn:
            break
    return np.concatenate([first, chosen[:added]]), gains[:added]


def swapped(
    problem: CityProblem,
    chosen: IntArray,
    alone: FloatArray,
    last: float,
    work: Work,
    required: IntArray | None = None,
) -> tuple[IntArray, int]:
    """Swap cameras while that helps, among candidates worth one: rows anew, and how many swaps.

    `required` rows stay; then nothing is done in parallel.
    """
    parts, _ = region_tasks(problem, alone, chosen, _ABOVE * last, last, 0)
    if not parts:
        return chosen, 0
    rows = np.unique(np.concatenate([chosen, *(rows for _, rows in parts)]))
    whole = whole_task(problem, rows, chosen)
    inside = np.isin(chosen, np.concatenate([own for _, own in parts])).all()
    if not inside or (required is not None and len(required)):
        # Some camera is in no region: regions by themselves would not know what it sees.
        fixed = np.empty(0, np.int64) if required is None else required
        found, swaps = swap_region(whole, np.isin(rows, fixed))
    else:
        cut = [(task, np.searchsorted(rows, own)) for task, own in parts]
        found, swaps = swap_cameras(whole, cut, work)
    return rows[found], swaps


def sampled(
    problem: CityProblem, budget: int, rng: np.random.Generator
) -> tuple[IntArray, FloatArray]:
    """Return the rows that stochastic greedy chooses, in order, and their gains."""
    chosen, gains = np.zeros(budget, np.int64), np.zeros(budget)
    sample = math.ceil(len(problem.group) / budget * math.log(1.0 / _EPSILON))
    added = stochastic_greedy(
        *problem.csr,
        problem.weights,
        problem.scale,
        problem.group,
        np.zeros(problem.n_mounts, np.bool_),
        budget,
        sample,
        rng,
        np.zeros((problem.n_samples, 3)),
        chosen,
        gains,
    )
    return chosen[:added], gains[:added]


def prove(
    problem: CityProblem,
    budget: int,
    alone: FloatArray,
    chosen: IntArray,
    last: float,
    work: Work,
    steps: int = _STEPS,
) -> tuple[float, float, int]:
    """Bound every placement: (bound, price, number of regions).

    `alone` (c,) is what each candidate gains alone, `chosen` a good placement, `last` what its last
    camera gains.
    """
    floor = _ABOVE * last
    price = max(1.005 * last, 1e-9 * float(alone.max(initial=0.0)), 1e-300)
    tasks, mounts = region_tasks(problem, alone, chosen, floor, price, steps)
    best = (math.inf, price)
    for _ in range(_PRICES):
        found: dict[int, RegionPrice] = dict(
            work.run(price_region, [replace(task, price=price) for task, _ in tasks], "region")
        )
        prices = [found[i] for i in range(len(tasks))]
        bound, met = certificate(prices, budget, floor, problem.n_mounts - mounts)
        if not bound < best[0] * (1.0 - _WORTH_IT):
            best = min(best, (bound, met))
            break
        best = (bound, met)
        price *= _DEARER
    return *best, len(tasks)


def residual_bound(problem: CityProblem, chosen: IntArray, allowed: BoolArray, room: int) -> float:
    """Bound placements of `chosen`'s required cameras and `room` others: f(S) + the best gains.

    The data-dependent bound of greedy, which is tight where all that helps has been chosen.
    """
    c = len(problem.group)
    sums = np.zeros((problem.n_samples, 3))
    for i in chosen:
        add_row(int(i), 1.0, *problem.csr, sums)
    gains = np.zeros(c)
    first_gains(*problem.csr, problem.weights, problem.scale, sums, 0, c, gains)
    gains[~allowed] = 0.0
    gains[chosen] = 0.0
    best = np.zeros(problem.n_mounts)
    np.maximum.at(best, problem.group, gains)
    return problem.value(chosen) + float(np.sort(best)[::-1][:room].sum())


def open_store(folder: Path, site: Site, key: dict[str, Any]) -> ChunkStore:
    """Return the folder's store for this site; `key` says what the site was made from."""
    return ChunkStore(
        folder,
        {
            **key,
            "candidates": site.mounts.n_candidates,
            "samples": len(site.points),
            "obstacles": len(site.obstacles),
            "errors": repr(site.errors),
            "max_range_m": site.max_range_m,
            "poses": site.mounts.poses.tolist(),
            "lens": [
                *site.mounts.size_px,
                site.mounts.projection.name,
                *site.mounts.distortion,
            ],
        },
    )


def _silent(_text: str, _fraction: float | None) -> None:
    """Say nothing."""
