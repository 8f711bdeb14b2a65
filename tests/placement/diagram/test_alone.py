"""A camera alone with its offsets unknown, as one map of the covariance."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.synthetic_drives import CAR, ROBOT, random_drive
from models.geometry import FloatArray
from placement.diagram.alone import alone_moves, covariance_after
from placement.objectives.navigation_chain import Drive

UPPER = np.triu_indices(3)


def drive_of(seed: int, offsets: int = 2) -> Drive:
    rng = np.random.default_rng([5, seed])
    return random_drive(
        rng,
        n_samples=24,
        n_candidates=6,
        longest_window=9,
        offsets=offsets,
        isotropic=bool(seed % 2),
        odometry=(CAR, ROBOT)[seed % 2],
        wrap=seed % 3 == 2,
        strength=10.0 ** (1 + seed % 4),
    )


def any_covariance(rng: np.random.Generator) -> FloatArray:
    root = rng.normal(size=(3, 3)) * np.array([0.5, 0.3, 0.02])[:, None]
    return np.asarray(root @ root.T)


def filtered(
    drive: Drive, i: int, base: FloatArray, p: FloatArray, longest: int
) -> list[FloatArray]:
    """Filter the car and camera i's offsets from its first sample on; the car's covariances."""
    info = drive.information
    assert info.white is not None
    assert info.offsets is not None
    size = info.offsets.shape[2]
    m = np.zeros((3 + size, 3 + size))
    m[:3, :3], m[3:, 3:] = p, np.eye(size)
    entries = range(int(info.indptr[i]), int(info.indptr[i + 1]))
    first = int(info.indices[entries[0]])
    seen = {int(info.indices[e]): e for e in entries if info.indices[e] < first + longest}
    found = []
    for t in range(first, max(seen) + 1):
        if t > first:
            c, s, y, x, *q = drive.steps()[t]
            f = np.eye(3 + size)
            f[:3, :3] = [[c, s, y], [-s, c, x], [0.0, 0.0, 1.0]]
            m = f @ m @ f.T
            m[:3, :3] += np.array([[q[0], q[1], q[2]], [q[1], q[3], q[4]], [q[2], q[4], q[5]]])
        told = [(base[t], np.zeros((2, size)))]
        if t in seen:
            white = info.frames_per_sample * info.white[seen[t]].astype(np.float64)
            tt, tn, nn = (white[0], 0.0, white[0]) if white.size == 1 else white
            known = len(seen) < len(entries)  # the rest is given to everybody
            told.append((np.array([tt, tn, nn]), (0.0 if known else 1.0) * info.offsets[seen[t]]))
        for (tt, tn, nn), offsets in told:
            h = np.hstack([np.eye(2, 3), offsets])
            j = np.array([[tt, tn], [tn, nn]])
            m = m - m @ h.T @ np.linalg.solve(np.eye(2) + j @ h @ m @ h.T, j @ h @ m)
        found.append(m[:3, :3])
    return found


@pytest.mark.parametrize("longest", [24, 4])
@pytest.mark.parametrize("seed", range(8))
def test_a_view_as_one_map_is_the_filter_with_the_offsets_as_states(
    seed: int, longest: int
) -> None:
    drive = drive_of(seed, 1 + seed % 3)
    rng = np.random.default_rng(seed)
    base = np.zeros((24, 3))
    base[::3] = np.array([3.0, 0.5, 2.0]) * rng.uniform(0.0, 2.0)
    alone = alone_moves(drive, np.ones(6, dtype=np.bool_), base, longest)
    assert sorted(alone.candidate) == list(np.flatnonzero(np.diff(drive.information.indptr)))
    for v, i in enumerate(alone.candidate):
        first = int(drive.information.indices[drive.information.indptr[i]])
        assert alone.at[first] <= v < alone.at[first + 1]
        for p in (any_covariance(rng), np.diag([0.01, 0.01, 0.0]), 1e4 * any_covariance(rng)):
            want = filtered(drive, int(i), base, p, longest)
            rows = alone.rows[alone.ptr[v] : alone.ptr[v + 1]]
            assert len(want) == len(rows)
            for cov, row in zip(want, rows, strict=True):
                got = np.array(covariance_after(tuple(p[UPPER]), row))
                # heads of longer views may stand in for others, and are better by a hair
                hair = 1e-7 if longest == 24 else 5e-6
                assert got == pytest.approx(cov[UPPER], rel=10.0 * hair, abs=hair * np.trace(cov))


def test_what_is_forbidden_is_no_move() -> None:
    usable = np.array([True, False, True, True, False, True])
    alone = alone_moves(drive_of(0), usable, np.zeros((24, 3)), 24)
    assert usable[alone.candidate].all()


def test_the_map_is_monotone_and_no_more_than_proportional() -> None:
    rng = np.random.default_rng(3)
    for seed in range(6):
        alone = alone_moves(drive_of(seed), np.ones(6, dtype=np.bool_), np.zeros((24, 3)), 24)
        for row in alone.rows[::3]:
            p = any_covariance(rng)
            more = p + any_covariance(rng)
            share = rng.uniform(0.1, 1.0)
            after, larger, less = (
                np.array(covariance_after(tuple(q[UPPER]), row)) for q in (p, more, share * p)
            )
            for lower, upper in ((after, larger), (share * after, less)):
                difference = np.zeros((3, 3))
                difference[UPPER] = difference.T[UPPER] = upper - lower
                assert np.linalg.eigvalsh(difference).min() >= -1e-10 * np.trace(more)
