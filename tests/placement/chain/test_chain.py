"""The chain against enumeration, on small roads whose windows overlap three and four deep."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
import pytest

from models.geometry import FloatArray
from placement.chain import backtracking, first_order, second_order
from placement.chain.label_kernel import excess
from placement.chain.pairs import pair_arcs
from placement.chain.segments import conditioned
from placement.chain.stages import eliminated, first_path, first_stage, label_pass, priced
from placement.chain.windows import Windows, ordered_windows
from placement.constraints import Constraints
from placement.information import Information
from placement.objectives.localisation import Localisation


@dataclass(frozen=True)
class Road:
    """A small problem and the score of every placement of it."""

    objective: Localisation
    constraints: Constraints
    windows: Windows
    scores: dict[tuple[int, ...], float]

    @property
    def best(self) -> float:
        return max(self.scores.values())


def draw_road(seed: int, *, closed: bool = False, isotropic: bool | None = None) -> Road:
    """Draw up to 10 windows over 12 samples, each about a third of the road: 3–4 deep."""
    rng = np.random.default_rng([40, seed, closed])
    n, t = int(rng.integers(1, 11)), 12
    indptr, indices = [0], []
    for _ in range(n):
        length = int(rng.integers(2, 6))
        start = int(rng.integers(0, t if closed else t - length + 1))
        window = (start + np.arange(length)) % t
        indices += sorted(window[rng.uniform(size=length) < 0.9].tolist())
        indptr.append(len(indices))
    nnz, scale = len(indices), 10.0 ** rng.uniform(-1, 3)
    if seed % 2 if isotropic is None else isotropic:
        blocks = scale * rng.lognormal(0.0, 1.5, (nnz, 1))
    else:
        a, b = scale * rng.lognormal(0.0, 1.5, (2, nnz))
        blocks = np.column_stack([a, rng.uniform(-0.999, 0.999, nnz) * np.sqrt(a * b), b])
    info = Information(
        t, np.array(indptr), np.array(indices, dtype=np.int32), blocks.astype(np.float32)
    )
    weights = rng.uniform(0.0, 2.0, t) if seed % 3 == 0 else np.ones(t)
    objective = Localisation(info, 0.5, weights)
    order = rng.permutation(n)
    group = np.arange(n) // 2 if seed % 4 < 2 else np.full(n, -1)
    constraints = Constraints(
        n,
        int(rng.integers(1, 6)),
        group[rng.permutation(n)],
        order[:1] if seed % 5 == 0 else order[:0],
        order[1:2] if seed % 7 == 0 else order[:0],
    )
    scores = {
        chosen: objective.value(np.array(chosen, dtype=np.int64))
        for size in range(min(constraints.budget, n) + 1)
        for chosen in itertools.combinations(range(n), size)
        if not constraints.violations(chosen)
    }
    return Road(objective, constraints, ordered_windows(objective, constraints), scores)


def check_road(road: Road) -> None:
    """Hold every bound against every placement, and the exact search against the best."""
    best, windows = road.best, road.windows
    budget = min(road.constraints.budget, len(windows))
    slack = 1e-11 * (1.0 + best)
    stage = first_stage(windows, budget)
    assert stage.bound >= best - slack
    for node, limit in enumerate(first_order.through(stage.F, stage.B)):
        holding = [v for s, v in road.scores.items() if windows.candidate[node] in s]
        assert limit >= max(holding, default=-np.inf) - slack
    for price in (0.0, 0.3 * best / budget, best / budget):
        values = second_order.price_paths(windows, stage.arcs, price)
        assert values.best + budget * price >= best - slack
        forward, start, arc = second_order.forward_best(windows, stage.arcs, price)
        assert forward == pytest.approx(values.best, rel=1e-12, abs=1e-12)
        path = backtracking.decode(windows, stage.arcs, start, arc)
        assert np.all(np.diff(path) > 0)
    beat = 0.8 * best
    stage = eliminated(stage, beat)
    stage = eliminated(priced(stage, [0.0, best / budget]), beat)
    winner = max(road.scores, key=lambda s: road.scores[s])
    seen = np.isin(winner, windows.candidate)
    assert np.all(np.isin(np.array(winner, dtype=np.int64)[seen], windows.candidate[stage.nodes]))
    stage = priced(stage, [0.0, best / budget])
    for width in (1, 2, 100):
        found = label_pass(stage, beat, 0.0, width)
        assert max(found.given_up, found.score) >= best - slack
        chosen = stage.windows.candidate[found.path]
        if not windows.wraps and found.path.size:
            assert found.score == pytest.approx(road.objective.value(chosen), rel=1e-10)
    assert found.given_up == first_order.NONE  # nothing was given up at width 100
    if not windows.wraps:
        assert found.score == pytest.approx(best, rel=1e-10)


def worth_checking(road: Road) -> bool:
    return road.best > 0.0 and len(road.windows) > 0


@pytest.mark.parametrize("closed", [False, True])
def test_no_chain_bound_is_below_any_placement_and_labels_find_the_best(closed: bool) -> None:
    for seed in range(150):
        road = draw_road(seed, closed=closed)
        if worth_checking(road):
            check_road(road)


@pytest.mark.slow
def test_chain_bounds_and_labels_on_3000_roads() -> None:
    for seed in range(1000, 4000):
        road = draw_road(seed, closed=bool(seed % 3 == 0))
        if worth_checking(road):
            check_road(road)


@pytest.mark.parametrize("isotropic", [True, False])
def test_arcs_hold_the_pairs_gain(isotropic: bool) -> None:
    road = draw_road(58, isotropic=isotropic)
    arcs, f, w = pair_arcs(road.windows), road.objective, road.windows
    assert len(arcs) > 2
    for i, j, gain in zip(arcs.source, arcs.target, arcs.gain, strict=True):
        first, both = w.candidate[[i]], w.candidate[[i, j]]
        assert gain == pytest.approx(f.value(both) - f.value(first), rel=1e-10)


@pytest.mark.parametrize("isotropic", [True, False])
def test_third_gains_are_those_of_the_objective(isotropic: bool) -> None:
    road = draw_road(58, isotropic=isotropic)
    f, w = road.objective, road.windows
    for h, i, j in itertools.combinations(range(len(w)), 3):
        pair = f.value(w.candidate[[i, j]]) - f.value(w.candidate[[i]])
        third = f.value(w.candidate[[h, i, j]]) - f.value(w.candidate[[h, i]])
        found = backtracking.triple_gain(w, h, i, j, pair)
        assert found == pytest.approx(third, rel=1e-9, abs=1e-12)


def test_the_kernel_agrees_with_the_plain_third_gains() -> None:
    # Three mutually overlapping windows and a price of 0: the best path is all three.
    for seed in range(200):
        road = draw_road(seed)
        w = road.windows
        if len(w) < 3 or np.any(w.mandatory):
            continue
        three = w.subset(np.arange(len(w)) < 3)
        three = three.subset(np.ones(3, dtype=bool))
        arcs = pair_arcs(three)
        if len(arcs) < 3:
            continue
        best, start, arc = second_order.forward_best(three, arcs, 0.0)
        pair = {
            (int(s), int(t)): g for s, t, g in zip(arcs.source, arcs.target, arcs.gain, strict=True)
        }
        full = three.alone[0] + pair[0, 1]
        full += backtracking.triple_gain(three, 0, 1, 2, pair[1, 2])
        options = [full, *(three.alone[i] + pair[i, j] for i, j in pair)]
        assert best == pytest.approx(max(options), rel=1e-10)
        assert len(backtracking.decode(three, arcs, start, arc)) >= 2


def random_information(rng: np.random.Generator) -> FloatArray:
    G = rng.normal(size=(2, 2)) * 10.0 ** rng.uniform(-1, 1)
    return np.asarray(G @ G.T)


def test_excess_bounds_what_more_can_be_gained_over_less_information() -> None:
    rng = np.random.default_rng(41)
    eye = np.eye(2)

    def log_det(M: FloatArray) -> float:
        return float(np.linalg.slogdet(M)[1])

    for _ in range(2000):
        A, B, R = random_information(rng), random_information(rng), random_information(rng)
        if rng.uniform() < 0.2:
            B = A + random_information(rng)
        more = log_det(eye + B + R) - log_det(eye + B) - log_det(eye + A + R) + log_det(eye + A)
        found = excess(A[0, 0], A[0, 1], A[1, 1], B[0, 0], B[0, 1], B[1, 1])
        assert found >= more - 1e-10
        assert found >= 0.0


def test_excess_is_nothing_where_the_other_knows_more() -> None:
    assert excess(1.0, 0.2, 1.0, 2.0, 0.2, 3.0) == 0.0
    assert excess(1.0, 0.0, 1.0, 0.5, 0.0, 0.5) == pytest.approx(2.0 * np.log(2.0 / 1.5))


def test_conditioning_on_cameras_gives_their_gains() -> None:
    for seed in range(20):
        road = draw_road(seed, isotropic=bool(seed % 2))
        f, w = road.objective, road.windows
        if len(w) < 3:
            continue
        fixed, free = w.candidate[:1], w.candidate[1:]
        x = np.zeros(f.n_candidates)
        x[fixed] = 1.0
        part = conditioned(w, (f.scale * f.sums(x))[w.sample])
        for node in range(1, len(w)):
            gain = f.value(np.append(fixed, w.candidate[node])) - f.value(fixed)
            assert part.alone[node] == pytest.approx(gain, rel=1e-9, abs=1e-12)
        arcs = pair_arcs(part)
        for i, j, g in zip(arcs.source, arcs.target, arcs.gain, strict=True):
            if i == 0 or w.candidate[j] not in free:
                continue
            with_i = np.append(fixed, w.candidate[i])
            assert g == pytest.approx(
                f.value(np.append(with_i, w.candidate[j])) - f.value(with_i), rel=1e-8, abs=1e-11
            )


def test_a_closed_road_is_cut_where_nothing_crosses_if_it_can_be() -> None:
    # Windows 10…13 and 13…2 (around the end) and 4…7 on a circuit of 14: the cut is at 8, 9 or 3.
    rows = [[10, 11, 12, 13], [0, 1, 2, 13], [4, 5, 6, 7]]
    info = Information(
        14,
        np.array([0, 4, 8, 12]),
        np.concatenate(rows).astype(np.int32),
        np.ones((12, 1), np.float32),
    )
    constraints = Constraints(3, 2, np.full(3, -1), np.empty(0, int), np.empty(0, int))
    windows = ordered_windows(Localisation(info, 0.5), constraints)
    assert not windows.wraps
    assert np.all(windows.last - windows.first == 3)


def test_the_first_orders_own_path_is_a_placement_of_the_right_size() -> None:
    road = draw_road(58)
    stage = first_stage(road.windows, 3)
    path = first_path(stage)
    assert 1 <= len(path) <= 3
    assert np.all(np.diff(path) > 0)
