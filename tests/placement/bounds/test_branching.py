"""Splitting a node loses no placement, down to single ones."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from placement.bounds.branching import children, last_placement
from placement.bounds.matroid import Choice


def placements(choice: Choice) -> set[tuple[int, ...]]:
    """List by enumeration what `choice` holds."""
    few = np.flatnonzero(choice.allowed)
    found = set()
    for size in range(choice.budget + 1):
        for chosen in itertools.combinations(few.tolist(), size):
            groups = choice.group[list(chosen)]
            held = np.isin(np.flatnonzero(choice.used), groups).all()
            if held and np.unique(groups).size == size:
                found.add(chosen)
    return found


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("whole", [False, True])
def test_every_placement_that_can_be_best_is_in_some_part(seed: int, whole: bool) -> None:
    rng = np.random.default_rng(seed)
    group = np.sort(rng.integers(0, 4, 8))
    _, group = np.unique(group, return_inverse=True)
    used = np.zeros(int(group.max()) + 1, dtype=np.bool_)
    used[0] = seed % 2 == 0
    waiting, leaves = [Choice(group, rng.random(8) < 0.8, used, 3)], 0
    if not waiting[0].feasible:
        return
    while waiting:
        choice = waiting.pop()
        x = rng.random(8) * choice.allowed
        parts = children(choice, np.round(x) if whole else x)
        here = placements(choice)
        if not parts:
            leaves += 1
            # smaller ones may be left beside it: no objective here falls as cameras join
            last = set(last_placement(choice).tolist())
            assert all(set(chosen) <= last for chosen in here)
            assert tuple(sorted(last)) in here
            continue
        inside = [placements(part) for part in parts]
        assert set().union(*inside) == here
        waiting += parts
    assert leaves > 1
