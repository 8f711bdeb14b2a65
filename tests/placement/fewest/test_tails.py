"""What is asked from the end of the road backward is needed by every placement of tiny roads."""

import numpy as np
import pytest

from placement.constraints import Constraints
from placement.fewest.arrays import Effort
from placement.fewest.tails import Pass, ask_tails
from tests.placement.fewest.tiny_roads import (
    C,
    best_price,
    counting_of,
    seen_twice,
    tiny,
    tiny_drive,
    with_lesser_twins,
)

ROUGH, FINE = Effort(2, 1, 0.5), Effort(60, 8, 1e-3)
PASSES = (Pass(3, 2, ROUGH), Pass(5, 9, ROUGH), Pass(4, 6, FINE), Pass(7, 30, FINE))
DRAWS = (tiny_drive, seen_twice, with_lesser_twins)


def check_tails(seeds: range, failures: int, offsets: int) -> None:
    draws = DRAWS[:2] if offsets else DRAWS
    none = np.empty(0, dtype=np.int64)
    several, raised, tight = 0, 0, 0
    for seed in seeds:
        rng = np.random.default_rng([23, failures, offsets, seed])
        cost = rng.choice([1.0, 2.0], C) if seed % 4 == 3 else None
        objective = tiny(rng, failures, cost, offsets, draw=draws[seed % len(draws)])
        group = rng.permutation(np.arange(C) // 2) if seed % 5 == 0 else None
        constraints = None if group is None else Constraints(C, C, group, none, none)
        best = best_price(objective, constraints)
        counting, unit = counting_of(objective, group=group)
        start = counting.need
        for how in PASSES:
            ask_tails(counting, how, lambda: False)
            assert unit * counting.need <= best * (1.0 + 1e-9), (seed, how)
        raised += counting.need > start
        counting.prove(5 * C, lambda: False, efforts=(FINE,))  # with what the tails taught
        assert unit * counting.need <= best * (1.0 + 1e-9), seed
        several += 2 <= best < np.inf
        tight += unit * counting.need >= best * (1.0 - 1e-9)
    assert several >= 0.3 * len(seeds)
    assert raised >= 0.1 * len(seeds)
    assert tight >= 0.3 * len(seeds)


def test_what_tails_need_every_placement_needs() -> None:
    check_tails(range(24), 1, 0)


@pytest.mark.slow
@pytest.mark.parametrize("offsets", [0, 2])
@pytest.mark.parametrize("failures", [0, 1])
def test_what_tails_need_on_thousands_of_roads(failures: int, offsets: int) -> None:
    # without a failure, and with offsets, kernels take half a minute to compile: here only
    check_tails(range(1000, 2500 if not offsets else 1500), failures, offsets)


def test_stopped_midway_what_was_learned_is_kept_and_holds() -> None:
    for seed in range(8):
        objective = tiny(np.random.default_rng([29, seed]), failures=1)
        counting, _ = counting_of(objective)
        calls = iter(range(1000))
        counting.prove(C, lambda calls=calls, seed=seed: next(calls) > 3 + 2 * seed)
        assert counting.need <= best_price(objective), seed
