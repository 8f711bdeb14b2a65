"""The priced diagram's bound against every placement of tiny roads, of any size."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.synthetic_drives import CAR, ROBOT, random_drive
from models.geometry import IntArray
from placement.constraints import Constraints
from placement.diagram.moves import most_starting
from placement.diagram.priced import PricedDiagram
from placement.objectives.trace import Trace
from placement.problem import Problem
from placement.solvers.diagram import free_choice, offset_drives, white_parts

CANDIDATES = 8
LOOSE = 1.5  # times the best: a threshold as poor placements give it


def tiny(seed: int, offsets: int = 0) -> tuple[Trace, IntArray]:
    """Return a tiny road and its groups, of one to three cameras, many of which start together."""
    rng = np.random.default_rng([9, seed])
    drive = random_drive(
        rng,
        n_samples=int(rng.integers(3, 16)),
        n_candidates=CANDIDATES,
        isotropic=bool(rng.integers(2)),
        longest_window=int(rng.integers(2, 14)),
        wrap=seed % 4 == 3,
        odometry=CAR if rng.integers(2) else ROBOT,
        initial_sigma=(0.1, 0.1, 0.01 * rng.integers(2)),
        strength=float(10.0 ** rng.uniform(0.0, 4.0)),
        offsets=offsets,
    )
    group = np.sort(rng.integers(0, 8, CANDIDATES)) if rng.integers(2) else np.full(CANDIDATES, -1)
    return Trace([drive], ("position", "lateral")[int(rng.integers(2))]), group


def values(objective: Trace, group: IntArray, most: int) -> list[tuple[float, int]]:
    """Return the values and sizes of all placements of at most `most` cameras."""
    found = []
    for size in range(most + 1):
        for chosen in itertools.combinations(range(CANDIDATES), size):
            held = [group[i] for i in chosen if group[i] >= 0]
            if len(set(held)) == len(held):
                found.append((objective.value(np.array(chosen, dtype=np.int64)), size))
    return found


def check_block(block: int, roads: int, offsets: int = 0) -> tuple[int, int]:
    """Sweep tiny roads at a price each; return how many were tight, and how many gave a rest."""
    tight = given = 0
    for seed in range(roads * block, roads * block + roads):
        objective, group = tiny(seed, offsets)
        rng = np.random.default_rng(seed)
        budget = int(rng.integers(1, 6))
        problem = Problem(
            objective,
            Constraints(CANDIDATES, budget, group, np.empty(0, np.int64), np.empty(0, np.int64)),
        )
        worth = values(objective, group, budget)
        nothing = worth[0][0]
        price = nothing * 10.0 ** rng.uniform(-3.0, 0.0)
        best = min(value + price * size for value, size in worth)
        most = min(budget, int(LOOSE * best / price * (1.0 + 1e-9)))
        persistent = offset_drives(problem)[0]
        (_, part) = white_parts(replace(problem, objective=objective.offsets_known()))[0]
        n = part.drive.n_samples
        usable, required, _ = free_choice(problem)
        diagram = PricedDiagram(
            part.drive,
            (part.w_tt, part.w_nn),
            usable,
            required,
            price * n,
            most=most,
            starting=most_starting(part.drive, usable, group),
            together=int(rng.integers(2, 5)),
            typical=2,
            persistent=persistent,
        )
        given += bool(diagram.views.rest_length.any())
        for probing, width, coarse, slots, limit in (
            (True, 5, 1, 1, np.inf),
            (False, 1, 1, 1, np.inf),
            # what is pruned shows only where the threshold, which caps the bound, is above the best
            (False, 3, 2, 1, LOOSE * best * n),
            (False, 10, 4, 2, 1.1 * best * n),
            (False, 40, 40, 8, 1.02 * best * n),
        ):
            outcome = diagram.sweep(
                width, limit, lambda: False, probing=probing, coarse_width=coarse, slots=slots
            )
            assert outcome is not None
            assert diagram.bound / n <= best * (1.0 + 1e-9), (seed, width)
        tight += diagram.bound / n >= 0.99 * best
    return tight, given


@pytest.mark.parametrize("block", range(4))
def test_no_sweep_bounds_above_the_best_of_all_placements_at_a_price(block: int) -> None:
    tight, given = check_block(block, 75)
    assert tight >= 30  # the bound is no empty promise
    assert given >= 5


def test_no_sweep_bounds_above_the_best_at_a_price_where_offsets_persist() -> None:
    found = [check_block(100 + offsets, 40, offsets)[0] for offsets in (1, 2, 3)]
    assert min(found) >= 8


@pytest.mark.slow
@pytest.mark.parametrize("block", range(4, 64))
def test_no_sweep_bounds_above_the_best_on_thousands_of_roads(block: int) -> None:
    check_block(block, 75)
    check_block(1000 + block, 25, 1 + block % 3)


def test_most_starting_counts_groups_where_their_stand_ins_start() -> None:
    for seed in range(60):
        objective, group = tiny(seed)
        (_, part) = white_parts(Problem(objective, count(group)))[0]
        drive = part.drive
        most = most_starting(drive, np.ones(CANDIDATES, dtype=np.bool_), group)
        first = drive.indices[drive.indptr[:-1].clip(max=drive.indices.size - 1)]
        seeing = np.diff(drive.indptr) > 0
        # whoever is no move starts no earlier than who stands in: from the end on there is room
        own = np.where(group >= 0, group, 100 + np.arange(CANDIDATES))
        for t in range(drive.n_samples):
            earlier = np.unique(own[seeing & (first <= t)])
            assert most[: t + 1].sum() >= earlier.size
        assert most.max() <= np.unique(own[seeing]).size


def count(group: IntArray) -> Constraints:
    nobody = np.empty(0, dtype=np.int64)
    return Constraints(CANDIDATES, 4, group, nobody, nobody)
