"""Tiny roads with a tolerance, and the fewest cameras of all their placements."""

import itertools
import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from benchmarks.synthetic_drives import CAR, ROBOT, random_drive
from placement.constraints import Constraints
from placement.fewest.arrays import Effort
from placement.fewest.bound import Counting
from placement.fewest.course import whole_units
from placement.objectives.navigation_chain import Drive
from placement.objectives.tolerance import Tolerance, white_part
from placement.objectives.windows.offsets import views_of

C = 7
ROUGH = Effort(2, 1, 0.5)
FINE = Effort(200, 8, 1e-3)


def tiny_drive(rng: np.random.Generator, offsets: int = 0) -> Drive:
    return random_drive(
        rng,
        n_samples=int(rng.integers(10, 40)),
        n_candidates=C,
        isotropic=bool(rng.integers(2)),
        offsets=offsets,
        longest_window=int(rng.integers(3, 16)),
        odometry=CAR if rng.integers(2) else ROBOT,
        initial_sigma=(0.02, 0.02, 0.01 * rng.integers(2)),
        strength=float(10.0 ** rng.uniform(1.0, 4.0)),
    )


def tiny(
    rng: np.random.Generator,
    failures: int = 0,
    cost: np.ndarray | None = None,
    offsets: int = 0,
    drives: int = 1,
    draw: Callable[[np.random.Generator, int], Drive] = tiny_drive,
) -> Tolerance:
    """Draw a road and a tolerance between what all cameras reach, one dark, and what none do."""
    roads = [draw(rng, offsets) for _ in range(drives)]
    loose = Tolerance(roads, 1e6, failures, cost)
    worst = [
        max(float(part.lateral(working).max()) for part in loose.parts)
        for chosen in (np.arange(C), np.empty(0, dtype=np.int64))
        for working in (loose.scenarios(chosen) if chosen.size else [chosen])
    ]
    best, none = max(worst[:-1]), worst[-1]
    share = 10.0 ** rng.uniform(-3.0, -0.3)
    return Tolerance(roads, 2.0 * math.sqrt(best + share * (none - best)) * 1.0001, failures, cost)


def seen_twice(rng: np.random.Generator, offsets: int = 0) -> Drive:
    """Draw a road that some of its cameras see twice, with a long blindness between."""
    n = int(rng.integers(24, 48))
    drive = random_drive(
        rng,
        n_samples=n,
        n_candidates=C + 4,
        isotropic=bool(rng.integers(2)),
        offsets=offsets,
        longest_window=int(rng.integers(3, 7)),
        odometry=CAR if rng.integers(2) else ROBOT,
        initial_sigma=(0.02, 0.02, 0.01 * rng.integers(2)),
        strength=float(10.0 ** rng.uniform(1.0, 4.0)),
    )
    info = drive.information
    rows = [np.arange(info.indptr[i], info.indptr[i + 1]) for i in range(C + 4)]
    for i in range(C, C + 4):  # the last four become what the first three see besides
        seen = np.concatenate([rows[i % 3], rows[i]])
        _, once = np.unique(info.indices[seen], return_index=True)
        rows[i % 3] = seen[once]
    order = np.concatenate(rows[:C])
    merged = replace(
        info,
        indptr=np.concatenate([[0], np.cumsum([r.size for r in rows[:C]])]).astype(np.int64),
        indices=info.indices[order],
        blocks=info.blocks[order],
        white=None if info.white is None else info.white[order],
        offsets=None if info.offsets is None else info.offsets[order],
    )
    return replace(drive, information=merged)


def with_lesser_twins(rng: np.random.Generator, offsets: int = 0) -> Drive:
    """Draw a road whose last three cameras each tell no more than one of the first: or the same."""
    drive = tiny_drive(rng, offsets)
    info = drive.information
    rows = [np.arange(info.indptr[i], info.indptr[i + 1]) for i in range(C)]
    blocks = [info.blocks[r] for r in rows]
    for i in range(C - 3, C):
        of = int(rng.integers(0, 2))
        rows[i] = rows[of][int(rng.integers(0, 2)) * (rows[of].size > 1) :]
        blocks[i] = info.blocks[rows[i]] * np.float32(rng.choice([1.0, 1.0, 0.8, 0.3]))
    merged = replace(
        info,
        indptr=np.concatenate([[0], np.cumsum([r.size for r in rows])]).astype(np.int64),
        indices=info.indices[np.concatenate(rows)],
        blocks=np.ascontiguousarray(np.concatenate(blocks)),
    )
    return replace(drive, information=merged)


def subsets(c: int) -> list[np.ndarray]:
    return [
        np.array(s, dtype=np.int64)
        for n in range(c + 1)
        for s in itertools.combinations(range(c), n)
    ]


def best_price(objective: Tolerance, constraints: Constraints | None = None) -> float:
    return min(
        (
            objective.price(s)
            for s in subsets(objective.n_candidates)
            if (constraints is None or not constraints.violations(s)) and objective.feasible(s)
        ),
        default=math.inf,
    )


def counting_of(
    objective: Tolerance, number: int = 0, group: np.ndarray | None = None
) -> tuple[Counting, float]:
    usable = np.ones(C, dtype=np.bool_)
    units, unit = whole_units(objective.cost, usable)
    given = np.flatnonzero(units == 0)
    counting = Counting(
        white_part(objective.drives[number]), objective.limit, units > 0, given, units, C,
        objective.failures,
        views_of(objective.drives[number]) if objective.drives[number].persistent else None, group,
    )  # fmt: skip
    return counting, unit
