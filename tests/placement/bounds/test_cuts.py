"""Cuts against enumeration: every placement satisfies every cut, tight where that is promised."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from models.geometry import FloatArray
from placement.bounds.cuts import CutMaker, Cuts
from placement.objectives.localisation import Localisation

Make = Callable[..., Any]


def term_by_sample(objective: Localisation, chosen: tuple[int, ...]) -> FloatArray:
    """Evaluate each sample's term by NumPy's own determinant."""
    J = np.tile(np.eye(2), (objective.information.n_samples, 1, 1))
    for i in chosen:
        for e in range(objective.indptr[i], objective.indptr[i + 1]):
            block = objective.scale * objective.blocks[e].astype(float)
            a, c, b = (block[0], 0.0, block[0]) if len(block) == 1 else block
            J[objective.indices[e]] += [[a, c], [c, b]]
    return np.asarray(objective.weights * np.linalg.slogdet(J)[1])


def check_every_subset(objective: Localisation, cuts: Cuts) -> None:
    n = objective.n_candidates
    for size in range(n + 1):
        for chosen in itertools.combinations(range(n), size):
            x = np.zeros(n)
            x[list(chosen)] = 1.0
            term = term_by_sample(objective, chosen)[cuts.sample]
            assert np.all(term <= cuts.at(x) + 1e-12 * (1.0 + term))


def draw(seed: int, new_information: Make) -> tuple[Localisation, np.random.Generator]:
    rng = np.random.default_rng([20, seed])
    info = new_information(
        rng,
        int(rng.integers(1, 7)),
        4,
        isotropic=bool(seed % 2),
        scale=10.0 ** rng.uniform(-3, 4),
        spread=float(rng.uniform(0, 3)),
    )
    return Localisation(info, 0.5, rng.uniform(0.0, 3.0, 4)), rng


def kinds_of_cuts(objective: Localisation, rng: np.random.Generator) -> list[Cuts]:
    """Draw one family of cuts of each kind."""
    n = objective.n_candidates
    maker = CutMaker(objective)
    x = rng.uniform(0.0, 1.0, n) * (rng.uniform(size=n) < 0.7)
    chosen = np.flatnonzero(rng.uniform(size=n) < 0.4)
    return [
        maker.submodular(chosen),
        maker.tangent(x),
        maker.separate(x, np.full(objective.information.n_samples, 1e9), 1e-9),
    ]


@pytest.mark.parametrize("seed", range(60))
def test_no_cut_removes_a_placement(seed: int, new_information: Make) -> None:
    objective, rng = draw(seed, new_information)
    for cuts in kinds_of_cuts(objective, rng):
        check_every_subset(objective, cuts)


@pytest.mark.slow
def test_no_cut_removes_a_placement_on_2000_problems(new_information: Make) -> None:
    for seed in range(100, 2100):
        objective, rng = draw(seed, new_information)
        for cuts in kinds_of_cuts(objective, rng):
            check_every_subset(objective, cuts)


@pytest.mark.parametrize("isotropic", [True, False])
def test_a_submodular_cut_is_tight_at_its_own_set(isotropic: bool, new_information: Make) -> None:
    rng = np.random.default_rng(21)
    objective = Localisation(new_information(rng, 8, 20, isotropic=isotropic), 0.5)
    chosen = (1, 4, 6)
    cuts = CutMaker(objective).submodular(np.array(chosen))
    x = np.zeros(8)
    x[list(chosen)] = 1.0
    assert cuts.at(x) == pytest.approx(term_by_sample(objective, chosen)[cuts.sample], rel=1e-12)


@pytest.mark.parametrize("isotropic", [True, False])
def test_a_tangent_touches_the_concave_extension(isotropic: bool, new_information: Make) -> None:
    rng = np.random.default_rng(22)
    objective = Localisation(new_information(rng, 8, 20, isotropic=isotropic), 0.5)
    x = rng.uniform(size=8)
    cuts = CutMaker(objective).tangent(x)
    level = objective.sample_scores(objective.sums(x))[cuts.sample]
    assert cuts.at(x) == pytest.approx(level, rel=1e-12)


def test_separation_finds_the_best_set_among_few(new_information: Make) -> None:
    rng = np.random.default_rng(23)
    for _ in range(20):
        objective = Localisation(new_information(rng, 5, 6, isotropic=False), 0.5)
        x = rng.uniform(size=5)
        t = objective.information.n_samples
        found = CutMaker(objective).separate(x, np.full(t, 1e9), 1e-9)
        least = np.full(t, np.inf)
        subsets = (s for n in range(6) for s in itertools.combinations(range(5), n))
        for chosen in subsets:
            cuts = CutMaker(objective).submodular(np.array(chosen, dtype=np.int64))
            least[cuts.sample] = np.minimum(least[cuts.sample], cuts.at(x))
        # A heuristic, but on five candidates it should hardly ever miss.
        assert np.all(found.at(x) <= least[found.sample] * 1.02 + 1e-12)


def test_separation_leaves_levels_alone_that_no_cut_reaches(new_information: Make) -> None:
    objective = Localisation(new_information(np.random.default_rng(24), 6, 10), 0.5)
    x = np.full(6, 0.5)
    assert len(CutMaker(objective).separate(x, np.zeros(10), 1e-9)) == 0


def test_cuts_survive_renumbering(new_information: Make) -> None:
    objective = Localisation(new_information(np.random.default_rng(25), 6, 10), 0.5)
    cuts = CutMaker(objective).submodular(np.array([2]))
    keep = np.array([0, 2, 5])
    position = np.full(6, -1)
    position[keep] = np.arange(3)
    x = np.zeros(6)
    x[keep] = [0.3, 1.0, 0.7]
    assert cuts.renumbered(position).at(x[keep]) == pytest.approx(cuts.at(x), rel=1e-14)
