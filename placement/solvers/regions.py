"""Lazy greedy over a heap, swaps, and priced cuts region by region: for a million poses.

`localisation` only. What `placement.city` does for a network, for any problem with a count and one
pose a group: the time grows with the matrix, not with candidates × cameras.
"""

from __future__ import annotations

import numpy as np

from placement.city.solve import CityProblem, alone_gains, greedy, prove, residual_bound, swapped
from placement.guarantees import greedy_guarantee
from placement.information.chunks import Chunk
from placement.objectives.localisation import Localisation
from placement.problem import Problem, Run
from placement.solution import Proposal, Status


def solve_regions(problem: Problem, run: Run) -> Proposal:
    """Place by greedy and swaps; bound by mixed cuts at one price a camera.

    Raises:
        ValueError: for another objective than `localisation`.
    """
    objective = problem.objective
    if not isinstance(objective, Localisation):
        raise ValueError(f"method regions takes objective localisation only, got {objective.name}")
    constraints = problem.constraints
    city, order = _by_group(problem, objective)
    place = np.empty(len(order), dtype=np.int64)
    place[order] = np.arange(len(order))
    allowed = constraints.usable()[order]
    required = place[np.unique(constraints.required)]
    alone = alone_gains(city)
    allowed_alone = np.where(allowed, alone, 0.0)

    def go_on(placed: int) -> bool:
        run.progress("greedy", placed / max(constraints.budget, 1))
        return not run.out_of_time()

    chosen, gains = greedy(city, constraints.budget, alone, allowed, required, go_on)
    run.incumbent = order[chosen].tolist()
    last = float(gains[-1]) if len(chosen) == constraints.budget and len(gains) else 0.0
    swaps = 0
    if not run.out_of_time():
        run.progress("swaps", None)
        chosen, swaps = swapped(city, chosen, allowed_alone, last, run.work, required)
        run.incumbent = order[chosen].tolist()
    finished = not run.out_of_time()
    stats = {"swaps": swaps, **greedy_guarantee(problem, finished)}
    room = constraints.budget - len(required)
    residual = residual_bound(city, chosen, allowed, room)
    if not finished:
        return Proposal(run.incumbent, residual, Status.TIME_LIMIT, stats)
    run.progress("certificate", None)
    # Required poses are bounded like the others: with fewer rules the bound only rises.
    bound, price, regions = prove(city, constraints.budget, allowed_alone, chosen, last, run.work)
    stats |= {"price": price, "regions": regions}
    return Proposal(run.incumbent, min(bound, residual), Status.FEASIBLE, stats)


def _by_group(problem: Problem, objective: Localisation) -> tuple[CityProblem, np.ndarray]:
    """Return the problem with its rows sorted by group, and which candidate each row is."""
    group = problem.constraints.group
    c = len(group)
    alone = group < 0
    key = np.where(alone, group.max(initial=-1) + 1 + np.arange(c), group)
    _, numbered = np.unique(key, return_inverse=True)
    order = np.argsort(numbered, kind="stable").astype(np.int64)
    counts = np.diff(objective.indptr)[order]
    indptr = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    entries = np.repeat(objective.indptr[order] - indptr[:-1], counts) + np.arange(indptr[-1])
    rows = Chunk(order, indptr, objective.indices[entries], objective.blocks[entries])
    n_groups = int(numbered.max(initial=-1)) + 1
    city = CityProblem(
        rows,
        numbered[order].astype(np.int64),
        n_groups,
        objective.information.n_samples,
        objective.weights,
        objective.scale,
    )
    return city, order
