"""Placements that sweeps find on tiny roads: in tolerance, and often the fewest."""

import numpy as np

from placement.fewest.finding import find
from tests.placement.fewest.tiny_roads import (
    FINE,
    C,
    best_price,
    counting_of,
    seen_twice,
    tiny,
    tiny_drive,
)


def test_what_sweeps_find_is_in_tolerance_and_often_the_fewest() -> None:
    found_fewest, several = 0, 0
    for seed in range(60):
        rng = np.random.default_rng([19, seed])
        objective = tiny(rng, failures=seed % 2, draw=seen_twice if seed % 3 == 0 else tiny_drive)
        best = best_price(objective)
        if not 2 <= best <= C:
            continue
        several += 1
        counting, _ = counting_of(objective)
        found = find(counting, int(best), FINE, lambda: False)
        if found is not None and objective.feasible(np.array(found)):
            found_fewest += len(found) == best
    assert several >= 20
    assert found_fewest >= 0.6 * several
