"""Losses against dense matrices, and the sieve against brute force."""

from __future__ import annotations

import functools
import itertools
import time
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.synthetic_drives import ROBOT, Samples, random_drive
from models.geometry import FloatArray, IntArray
from placement.constraints import Constraints
from placement.information import Information
from placement.objectives.entropy import Entropy
from placement.objectives.navigation_chain import Drive
from placement.sieve import features, passes, priced
from placement.sieve.features import RANK
from placement.sieve.first import FirstOrder
from placement.sieve.neighbours import IMPOSSIBLE, STEPS
from placement.sieve.sieve import Sieve
from placement.tempered.background import background_of, chains_of, stand_in
from placement.tempered.bound import SecondOrder, Tempered
from placement.tempered.diagram import Diagram
from placement.tempered.line import make_line
from placement.tempered.paths import OutOfTimeError
from placement.tempered.process import cameras_of, take_in
from tests.placement.tempered.test_bound import best_placement, new_run, small_problem
from tests.placement.tempered.test_persistent import Dense

NONE = np.empty(0, dtype=np.int64)
SHARES = (1.0, 0.9, 0.5)


def _sources(order: FirstOrder) -> IntArray:
    return np.repeat(np.arange(len(order.into)), np.diff(order.near.out_of))


def _targets(order: FirstOrder) -> IntArray:
    return order.first.line.candidate[order.near.target]


def _hull(first: Tempered) -> FloatArray:
    """Return the least concave values above the gains of all budgets, up to all cameras."""
    n = first.line.candidate.size
    whole = Tempered(first.objective, first.line, n, first.theta, first.background, first.run)
    gains = np.concatenate([[0.0], np.maximum.accumulate(np.max(whole.F + whole.ends, axis=1))])
    k = np.arange(n + 1)
    return np.array(
        [
            max(
                gains[a] + (gains[b] - gains[a]) * (at - a) / max(b - a, 1)
                for a in range(at + 1)
                for b in range(at, n + 1)
            )
            for at in k
        ]
    )


def first_order(drive: Drive, budget: int, share: float, level: float) -> tuple[Tempered, Dense]:
    """Return the first order over all cameras of a drive, and dense matrices of the same."""
    n = drive.information.n_candidates
    objective = Entropy([drive])
    line = make_line(objective, Constraints(n, budget, np.full(n, -1), NONE, NONE), np.arange(n))
    rng = np.random.default_rng(n)
    y = rng.uniform(0.0, level, n)
    background = chains_of(objective, y) if drive.persistent else background_of(objective, y)
    assert background is not None
    first = Tempered(objective, line, budget, share, background, new_run())
    return first, Dense(drive, background[0], share)


def sieve_of(first: Tempered, beat: float = -np.inf, reserve_s: float = 0.0) -> Sieve:
    return Sieve(FirstOrder(first, beat), reserve_s)


def loss_of(found: Sieve, i: int, j: int, k: int) -> float:
    """Return what k after j loses to i before, in nats; +∞ where it is impossible."""
    near = found.near
    out = np.arange(near.out_of[j], near.out_of[j + 1])
    e = int(out[near.target[out] == k][0])
    into = np.arange(near.into[j], near.into[j + 1])
    return float(found.losses_of(j, e)[near.source[into] == i][0])


@pytest.mark.parametrize("offsets", [0, 3])
def test_features_have_unit_noise_and_the_covariances_of_dense_matrices(offsets: int) -> None:
    rng = np.random.default_rng([23, offsets])
    drive = random_drive(rng, n_samples=40, n_candidates=6, longest_window=9, offsets=offsets)
    base = rng.uniform(0.0, 5.0, (40, 1)) * np.array([1.0, 0.2, 1.0])
    process = take_in(drive.steps(), drive.initial_covariance(), base)
    cameras, dense = cameras_of(drive, 0.8), Dense(drive, base, 0.8)
    found = features.features_of(process, cameras, RANK)
    prior = dense.dense.prior
    known = np.linalg.solve(np.eye(120) + prior @ dense.y, prior)
    seen_some = False
    for i in range(6):
        entries = np.arange(cameras.indptr[i], cameras.indptr[i + 1])
        size = 2 * len(entries)
        signal, noise = np.empty((size, size)), np.empty((size, size))
        if not (size and features.measured(process, cameras, i, signal, noise)):
            assert not found.usable[i]
            assert not found.weights[i].any()
            continue
        seen_some = True
        assert found.usable[i]
        seen = (3 * cameras.indices[entries].astype(np.int64)[:, None] + [0, 1]).ravel()
        assert signal == pytest.approx(known[np.ix_(seen, seen)], rel=1e-6, abs=1e-12)
        # the noise is that of the dense information
        told = dense.share * dense.cameras[i][np.ix_(seen, seen)]
        weighted = np.linalg.inv(noise)
        assert weighted == pytest.approx(told, rel=1e-4, abs=1e-5 * np.abs(told).max())
        rank = min(RANK, size)
        weights = found.weights[i, :, :size]
        assert weights[:rank] @ noise @ weights[:rank].T == pytest.approx(np.eye(rank), abs=1e-8)
        want = np.eye(RANK) + weights @ signal @ weights.T
        assert found.spread[i] == pytest.approx(want, rel=1e-8, abs=1e-8)
        field = found.field[found.at[i] : found.at[i + 1]]
        for row, t in enumerate(range(found.low[i], found.low[i] + len(field))):
            want = known[3 * t : 3 * t + 3][:, seen] @ weights.T
            assert field[row] == pytest.approx(want, rel=1e-6, abs=1e-10)
        # leading directions: no other projection of that rank tells much more
        values = np.linalg.eigvals(np.linalg.solve(noise, signal)).real
        best = np.sum(np.log1p(np.sort(values)[::-1][:rank]))
        assert np.linalg.slogdet(found.spread[i])[1] > 0.9 * best
    assert seen_some


@pytest.mark.parametrize(
    ("offsets", "window", "wrap", "samples"),
    [(0, 9, False, 40), (3, 9, False, 40), (2, 3, False, 40), (2, 9, True, 40), (2, 9, True, 210)],
)
def test_a_loss_is_never_more_than_the_mutual_information(
    offsets: int, window: int, wrap: bool, samples: int
) -> None:
    hold_losses(offsets, window, wrap, samples)


@pytest.mark.parametrize(("offsets", "weight"), [(0, 10.0), (2, 10.0), (2, 0.1)])
def test_losses_count_as_often_as_the_drive(offsets: int, weight: float) -> None:
    rng = np.random.default_rng([61, offsets])
    kept = 0.0
    for _ in range(4):
        drive = random_drive(
            rng, n_samples=14, n_candidates=9, longest_window=12, offsets=offsets, strength=400.0
        )
        once = sieve_of(first_order(drive, 5, 1.0, 0.1)[0])
        first, dense = first_order(replace(drive, weight=weight), 5, 1.0, 0.1)
        found = sieve_of(first)
        kept += float(found.losses[found.losses < IMPOSSIBLE].sum()) / STEPS
        for i, j, k in itertools.combinations(range(9), 3):
            chosen = [int(first.line.candidate[p]) for p in (i, j, k)]
            gain = weight * (dense.gain(chosen) - dense.gain(chosen[:2]))
            loss = loss_of(found, i, j, k)
            assert loss == np.inf or first.pairs[j, k] - loss >= gain - 1e-8
            if np.isfinite(loss):
                one = loss_of(once, i, j, k)
                assert loss == pytest.approx(weight * one, abs=(2.0 + weight) / STEPS)
    assert kept > 0.1 * weight


@pytest.mark.parametrize("flat", [0.0, 1e-12])
def test_nobody_loses_to_a_camera_that_is_blind_to_an_axis_nor_after_it(flat: float) -> None:
    drive = random_drive(np.random.default_rng(67), n_samples=30, n_candidates=6, longest_window=8)
    blocks = drive.information.blocks.copy()
    begin, end = int(drive.information.indptr[2]), int(drive.information.indptr[3])
    blocks[begin:end] = np.array([1e5, 0.0, flat * 1e5], dtype=blocks.dtype)
    drive = replace(drive, information=replace(drive.information, blocks=blocks))
    first, dense = first_order(drive, 4, 0.9, 0.1)
    found = sieve_of(first)
    at = int(np.flatnonzero(first.line.candidate == 2)[0])
    for i, j, k in itertools.combinations(range(6), 3):
        chosen = [int(first.line.candidate[p]) for p in (i, j, k)]
        loss = loss_of(found, i, j, k)
        assert first.pairs[j, k] - loss >= dense.gain(chosen) - dense.gain(chosen[:2]) - 1e-7
        if j == at:
            assert loss == pytest.approx(0.0, abs=2e-5)


def hold_losses(offsets: int, window: int, wrap: bool, samples: int) -> None:
    rng = np.random.default_rng([29, offsets, window, samples])
    n = 9
    drive = random_drive(
        rng, n_samples=samples, n_candidates=n, longest_window=window, wrap=wrap, offsets=offsets
    )
    parted = 0
    for share, level in ((1.0, 0.3), (0.8, 0.1)):
        first, dense = first_order(drive, 5, share, level)
        found = sieve_of(first)

        @functools.cache
        def score(*positions: int, dense: Dense = dense, first: Tempered = first) -> float:
            return dense.gain([int(first.line.candidate[p]) for p in positions])

        d, near = first.drives[0], found.near
        usable = features.features_of(d.process, d.narrow, RANK).usable
        lost = told = 0.0
        for i, j, k in itertools.combinations(range(n), 3):
            loss = loss_of(found, i, j, k)
            if loss == np.inf:
                continue
            gain = score(i, j, k) - score(i, j)
            exact = score(j, k) - score(j) - gain
            assert first.pairs[j, k] - loss >= gain - 1e-9
            if not usable[[i, j, k]].all():
                continue
            lost, told = lost + loss, told + float(first.pairs[j, k]) - gain
            out = np.arange(near.out_of[j], near.out_of[j + 1])
            ahead = near.ahead[out[near.target[out] == k][0]]
            far = not near.near[near.into[j] + i]
            if far and not ahead and not d.extra[[i, j, k]].any():
                # nothing but a state between them: six numbers of each are all there is to them
                assert loss == pytest.approx(exact, abs=1e-4, rel=1e-4)
                parted += 1
            elif window <= 3 and (ahead or far):
                # windows of three samples are all there is to them: nothing is left out
                assert loss == pytest.approx(exact, abs=2.0 / STEPS, rel=1e-3)
        assert lost >= 0.5 * told  # and they tell most of it
    assert parted > 0 or window > 3 or wrap


@pytest.mark.parametrize("seed", range(4))
def test_priced_paths_equal_those_of_an_enumeration(seed: int) -> None:
    rng = np.random.default_rng([31, seed])
    drive = random_drive(rng, n_samples=30, n_candidates=7, longest_window=8, offsets=seed % 3)
    first, _ = first_order(drive, 4, 0.9, 0.2)
    found = sieve_of(first)
    price = float(rng.uniform(0.0, 0.3))
    m = len(found.near.target)
    through = np.full(m, -np.inf)
    best = -np.inf
    best_path: tuple[int, ...] = ()
    for r in range(2, 8):
        for path in itertools.combinations(range(7), r):
            value = float(first.alone[path[0]] + first.pairs[path[0], path[1]]) - r * price
            for i, j, k in zip(path, path[1:], path[2:], strict=False):
                value += float(first.pairs[j, k]) - loss_of(found, i, j, k)
            if value > best:
                best, best_path = value, path
            for j, k in itertools.pairwise(path):
                out = np.arange(found.near.out_of[j], found.near.out_of[j + 1])
                e = out[found.near.target[out] == k][0]
                through[e] = max(through[e], value)
    rest = found.order.beyond_at(price)
    given = found.order.gain, first.alone, found.near, found.told, found.losses, 1.0, price, rest
    for need in (-np.inf, best - 1.0, best - 1e-3):
        ahead, behind = np.full(m, -np.inf), np.full(m, -np.inf)
        priced.forward(*given, need, ahead)
        priced.backward(given[0], first.ends, *given[2:], need, ahead, behind)
        assert ahead.max() == pytest.approx(best, abs=1e-4)
        # whoever is worth it is left with what is its own
        good = through >= need + 1e-4
        assert good.any()
        assert (ahead + behind)[good] == pytest.approx(through[good], abs=1e-4)
        assert np.all((ahead + behind)[through >= need] >= through[through >= need] - 1e-9)
        assert tuple(found._trace(ahead, price)) == best_path


def test_priced_paths_are_those_of_a_plain_program_where_there_are_many_cameras() -> None:
    rng = np.random.default_rng(97)
    drive = random_drive(rng, n_samples=90, n_candidates=60, longest_window=5, offsets=2)
    first, _ = first_order(drive, 9, 0.95, 0.1)
    found = sieve_of(first)
    near, price = found.near, 0.5 * found.price
    m = len(near.target)
    want, behind = np.full(m, -np.inf), np.full(m, -np.inf)
    for j in range(60):
        into = near.place[near.into[j] : near.into[j + 1]]
        for e in range(near.out_of[j], near.out_of[j + 1]):
            via = want[into] - found.losses_of(j, e)
            most = max(first.alone[j] - price, float(np.max(via, initial=-np.inf)))
            want[e] = most + first.pairs[j, near.target[e]] - price
    for j in range(59, -1, -1):
        into = near.place[near.into[j] : near.into[j + 1]]
        behind[into] = first.ends[j]
        for e in range(near.out_of[j], near.out_of[j + 1]):
            value = first.pairs[j, near.target[e]] - price + behind[e]
            behind[into] = np.maximum(behind[into], value - found.losses_of(j, e))
    rest = found.order.beyond_at(price)
    given = found.order.gain, first.alone, near, found.told, found.losses, 1.0, price, rest, -np.inf
    ahead, after = np.full(m, -np.inf), np.full(m, -np.inf)
    priced.forward(*given, ahead)
    priced.backward(given[0], first.ends, *given[2:], ahead, after)
    assert ahead == pytest.approx(want, abs=1e-4)
    assert after == pytest.approx(behind, abs=1e-4)
    assert np.all(ahead >= want - 1e-9)


def windows(spans: list[tuple[int, int]], samples: int, strength: float) -> Drive:
    """Return a straight road of a robot whose cameras see from one sample to another."""
    rows = [np.arange(a, b + 1) for a, b in spans]
    indptr = np.concatenate([[0], np.cumsum([len(row) for row in rows])]).astype(np.int64)
    blocks = np.full((int(indptr[-1]), 1), strength, dtype=np.float32)
    info = Information(samples, indptr, np.concatenate(rows).astype(np.int32), blocks)
    points = Samples(1.5 * np.arange(samples), np.zeros(samples))
    return Drive(points, info, ROBOT, np.array([0.1, 0.1, 0.0]))


@pytest.mark.parametrize(
    ("spans", "samples", "group", "budget"),
    [
        # the best before the middle camera shares a mount with the last
        ([(0, 139), (70, 97), (98, 265)], 280, [0, -1, 0], 2),
        ([(0, 139), (70, 97), (15, 160), (175, 200)], 220, [0, -1, 0, -1], 3),
    ],
)
def test_paths_far_below_an_impossible_one_are_not_lost_to_rounding(
    spans: list[tuple[int, int]], samples: int, group: list[int], budget: int
) -> None:
    objective = Entropy([windows(spans, samples, 1e3)])
    n = len(spans)
    constraints = Constraints(n, budget, np.array(group), NONE, NONE)
    line = make_line(objective, constraints, np.arange(n))
    first = Tempered(objective, line, budget, 1.0, [np.zeros((samples, 3))], new_run())
    placements = [
        (objective.value(np.array(chosen, dtype=np.int64)), chosen)
        for r in range(2, budget + 1)
        for chosen in itertools.combinations(range(n), r)
        if not constraints.violations(np.array(chosen))
    ]
    best = max(placements)[0]
    for beat in (-np.inf, 0.9 * best, best * (1.0 - 1e-9)):
        found = sieve_of(first, beat)
        assert max(found.bound(), beat) >= best * (1.0 - 1e-9)
        for value, chosen in placements:
            if value > beat:
                left = found.survivors(value * (1.0 - 1e-9) if value > beat else beat)
                order = [c for c in line.candidate.tolist() if c in chosen]
                at = [left.candidate.tolist().index(c) for c in order]
                assert all(left.alive[a, b] for a, b in itertools.pairwise(at))


def test_covariances_through_a_state_hold_far_from_where_the_car_is_known() -> None:
    drive = windows([(4950, 4957), (4960, 4971), (4975, 4980), (4981, 4990)], 5000, 1e4)
    process = take_in(drive.steps(), drive.initial_covariance(), np.zeros((5000, 3)))
    cameras = cameras_of(drive, 1.0)
    found = features.features_of(process, cameras, RANK)
    for i, k in itertools.combinations(range(4), 2):
        t = cameras.last[i]
        rows = slice(int(found.at[i]), int(found.at[i + 1]))
        want = np.empty((RANK, RANK))
        features.covariance_of(cameras, k, found.weights[k], found.field[rows], found.low[i], want)
        got = (
            found.field[found.at[i] + t - found.low[i]].T
            @ found.pull[found.at[k] + t - found.low[k]]
        )
        scale = np.sqrt(np.outer(np.diag(found.spread[k]), np.diag(found.spread[i])))
        assert np.abs(got.T - want).max() / scale.max() < 1e-13


def test_a_single_camera_may_be_the_best() -> None:
    drive = random_drive(np.random.default_rng(101), n_samples=40, n_candidates=6, offsets=2)
    objective = Entropy([drive])
    constraints = Constraints(6, 2, np.zeros(6, dtype=np.int64), NONE, NONE)
    line = make_line(objective, constraints, np.arange(6))
    first = Tempered(objective, line, 2, 1.0, [np.zeros((40, 3))], new_run())
    found = sieve_of(first)
    best = int(np.argmax(first.alone))
    assert found.bound() >= first.alone[best] - 1e-9
    assert line.candidate[best] in found.survivors(0.999 * first.alone[best]).candidate
    assert found.path().tolist() == [line.candidate[best]]


def hold_sieves_against_brute_force(seed: int, offsets: int) -> None:
    objective, constraints = small_problem(seed, offsets)
    if len(objective.drives) > 1:
        objective = Entropy(objective.drives[:1])
    if constraints.budget < 2:
        return
    best, placement = best_placement(objective, constraints)
    beat = best * (1.0 - 1e-9)
    line = make_line(objective, constraints, np.flatnonzero(constraints.usable()))
    rng = np.random.default_rng([seed, 2])
    for share in SHARES:
        y = rng.uniform(0.0, rng.uniform(0.0, 1.0), constraints.n)
        background = chains_of(objective, y) if seed % 3 else None
        background = background or background_of(stand_in(objective), y)
        first = Tempered(objective, line, constraints.budget, share, background, new_run())
        whole = sieve_of(first)
        assert whole.bound() >= best * (1.0 - 1e-9) - 1e-9
        if (constraints.group < 0).all():  # else it knows that a mount bears one camera
            assert whole.bound() >= SecondOrder(first, -np.inf).bound() - 1e-6
        assert set(placement) <= set(whole.survivors(beat).candidate)
        left = sieve_of(first, beat)
        assert max(left.bound(), beat) >= best * (1.0 - 1e-9) - 1e-9
        # what may come beyond a camera lets a diagram leave out what leads nowhere
        diagram = Diagram(first, 3, beat, price=left.price, beyond=left.beyond)
        assert max(diagram.bound(), beat) >= best * (1.0 - 1e-9)
        assert set(placement) <= set(diagram.survivors(beat).candidate)
        line_left = left.survivors(beat)
        assert set(placement) <= set(line_left.candidate)
        if len(line_left.candidate) > 1:
            again = sieve_of(
                Tempered(objective, line_left, constraints.budget, share, background, new_run()),
                beat,
            )
            assert max(again.bound(), beat) >= best * (1.0 - 1e-9) - 1e-9


@pytest.mark.parametrize("block", range(2))
def test_no_sieve_is_below_the_best_placement_of_60_small_roads(block: int) -> None:
    for seed in range(30 * block, 30 * (block + 1)):
        hold_sieves_against_brute_force(seed, seed % 4)


@pytest.mark.slow
@pytest.mark.parametrize("block", range(20))
def test_no_sieve_is_below_the_best_placement_of_2000_more(block: int) -> None:
    for seed in range(5000 + 100 * block, 5000 + 100 * (block + 1)):
        hold_sieves_against_brute_force(seed, seed % 7)


def test_what_a_sieve_has_no_time_for_stays_first_order() -> None:
    drive = random_drive(
        np.random.default_rng(37), n_samples=60, n_candidates=20, isotropic=True, offsets=2
    )
    first, _ = first_order(drive, 6, 0.95, 0.1)
    order = FirstOrder(first, -np.inf)
    whole = Sieve(order)
    first.run.deadline = time.monotonic() + 1e3
    hasty = Sieve(order, 1e9)  # passes would take for ever
    assert not hasty.losses.any()
    assert not hasty.told.before.any()
    assert whole.bound() < hasty.bound()
    assert hasty.bound() == pytest.approx(order.bound(), rel=1e-3)
    assert hasty.bound() >= first.bound() - 1e-9


def test_rows_have_a_place_for_each_near_camera() -> None:
    drive = random_drive(np.random.default_rng(41), n_samples=50, n_candidates=12, offsets=0)
    near = sieve_of(first_order(drive, 4, 1.0, 0.1)[0]).near
    width = np.diff(near.row_at)
    source = np.repeat(np.arange(12), np.diff(near.out_of))
    assert np.all(width[near.ahead] == near.many[source[near.ahead]])
    assert not width[~near.ahead].any()


@pytest.mark.parametrize("seed", range(6))
def test_the_first_order_at_its_best_price_holds_all_that_tables_hold(seed: int) -> None:
    rng = np.random.default_rng([71, seed])
    drive = random_drive(rng, n_samples=50, n_candidates=14, offsets=seed % 3)
    first, _ = first_order(drive, 2 + seed, 0.9, 0.2)
    order = FirstOrder(first, -np.inf)
    bounds = first.bounds()
    assert order.bound() >= first.bound() - 1e-9
    # no price is better than the concave hull of all budgets
    k = first.budget
    curve = np.array([first.as_bound(np.array([g]))[0] for g in _hull(first)])
    assert order.bound() == pytest.approx(curve[k], rel=2e-3)
    assert order.bound() <= bounds[-1] * 1.2
    beat = 0.999 * first.bound()
    line = first.survivors(beat)
    left = FirstOrder(first, beat)
    kept = set(zip(first.line.candidate[_sources(left)], _targets(left), strict=True))
    for a, b in np.argwhere(line.alive):
        assert (line.candidate[a], line.candidate[b]) in kept
    assert left.arcs < order.arcs


def test_there_is_room_for_a_sieve_or_not() -> None:
    run = new_run()
    run.deadline = time.monotonic() + 100.0
    assert passes.room_for(1000, 1000, run)
    assert passes.room_for(10**7, 10**8, run)
    assert not passes.room_for(10**8, 10**7, run)
    run.deadline = np.inf
    assert not passes.room_for(10**8, 10**8, run)  # no room
    run.deadline = time.monotonic() + 1.0
    assert not passes.room_for(10**7, 10**7, run)


def test_a_sieve_out_of_time_stops() -> None:
    drive = random_drive(np.random.default_rng(59), n_samples=40, n_candidates=10, offsets=2)
    first, _ = first_order(drive, 4, 0.95, 0.1)
    order = FirstOrder(first, -np.inf)
    first.run.deadline = time.monotonic() - 1.0
    with pytest.raises(OutOfTimeError):
        Sieve(order)
