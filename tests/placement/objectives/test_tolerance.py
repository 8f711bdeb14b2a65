"""The objective that counts cameras: its refusals, gains, and how far cameras reach."""

import numpy as np
import pytest

from placement.objectives.tolerance import Tolerance
from tests.placement.fewest.tiny_roads import C, tiny, tiny_drive


def test_a_tolerance_beyond_all_candidates_is_refused_with_the_best_and_its_place() -> None:
    drive = tiny_drive(np.random.default_rng(1))
    with pytest.raises(ValueError, match=r"^objective.tolerance_m must be at least \S+, the 2σ"):
        Tolerance([drive], 1e-6)
    try:
        Tolerance([drive], 1e-6)
    except ValueError as error:
        best = float(str(error).split()[5].rstrip(","))
        place = float(str(error).split("s = ")[1].split()[0])
    objective = Tolerance([drive], 1.001 * best)
    lateral = objective.parts[0].lateral(np.arange(C))
    assert drive.points.s_m[int(np.argmax(lateral))] == pytest.approx(place, abs=0.51)


def test_gains_are_changes_of_the_value() -> None:
    for seed in range(8):
        rng = np.random.default_rng([10, seed])
        objective = tiny(rng, seed % 2, offsets=2 * (seed % 3 == 0))
        chosen = rng.permutation(C)[: int(rng.integers(0, 4))]
        state = objective.state(np.sort(chosen))
        gains = state.gains()
        for i in range(C):
            if i not in chosen:
                after = objective.value(np.sort(np.append(chosen, i)))
                assert gains[i] == pytest.approx(objective.value(np.sort(chosen)) - after, rel=1e-9)


def test_reach_with_persistent_offsets_is_that_of_the_whole_filter() -> None:
    for seed in range(20):
        rng = np.random.default_rng([11, seed])
        objective = tiny(rng, offsets=3)
        part = objective.parts[0]
        chosen = np.sort(rng.permutation(C)[: int(rng.integers(0, 4))]).astype(np.int64)
        rows = np.setdiff1d(np.arange(C), chosen)
        _, reach = part.reach(chosen, rows)
        for i, got in zip(rows, reach, strict=True):
            lateral = part.lateral(np.sort(np.append(chosen, i)))
            above = np.flatnonzero(lateral > objective.limit)
            wanted = above[0] if above.size else part.n_samples
            assert int(got) == wanted, seed
