"""How good cameras for many drives can be at most: submodular cuts mixed drive by drive.

For every drive d and sets R_0, R_1, … of cameras, diminishing returns give, whatever S is,

    f_d(S) ≤ f_d(R_l) + Σ_{j ∈ S} g_d(j | R_l),    g_d(j | R) = f_d(R ∪ j) − f_d(R)

(Nemhauser & Wolsey 1981). Mixed with any μ_dl ≥ 0, Σ_l μ_dl = 1, and weighted by the drives' w_d,

    f(S) ≤ Σ_dl w_d μ_dl f_d(R_l) + Σ_{j ∈ S} c_j,    c_j = Σ_dl w_d μ_dl g_d(j | R_l),

and the last sum is at most that of the k mounts whose best poses are worth most. Mirror descent
improves μ, as in `placement.city.prices`, where the parts are samples. The first sets are
beginnings of a good placement; then each round draws new ones from the shares that candidates have
at the price (systematic sampling, sparser and denser), where the bound is loosest.

A drive is a coarse part: within one drive every cut says of all places at once whether they hold a
camera. The bound is valid, and some ten to thirty per cent above the value.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from models.geometry import FloatArray, IntArray
from placement.city.mixing import shares, slopes, worths
from placement.city.navigate import Trajectories, TrajectoryProblem
from placement.objectives.windows.filter import add_rows

Report = Callable[[str, float | None], None]
_BEGINNINGS = (0.0, 0.125, 0.25, 0.5, 0.75, 1.0)  # of the placement, by which the library begins
_DENSITIES = (0.6, 1.0, 1.5)  # of the sets that a round draws
_ROUNDS, _STEPS = 5, 60
_RATE, _TEMPERATURE, _COOLING = 2.0, 0.05, 10.0
_FRESH = 0.2  # of a mixture, for the cuts of a new round
_LEAST_LOG = -12.0
_ROUNDING = 1e-9  # relative: a thousand times what float64 loses in these sums


def bound_trajectories(
    problem: TrajectoryProblem,
    budget: int,
    chosen: IntArray,
    *,
    rounds: int = _ROUNDS,
    steps: int = _STEPS,
    seed: int = 0,
    progress: Report | None = None,
) -> float:
    """Bound the value of every placement of at most `budget` cameras, one a mount, from above.

    `chosen` are the rows of a good placement in the order in which they were chosen.
    """
    report = progress or (lambda _text, _fraction: None)
    rng = np.random.default_rng(seed)
    library = _Library(problem)
    for n, part in enumerate(_BEGINNINGS):
        report(f"certificate: cut {n + 1}", None)
        library.add(chosen[: round(part * len(chosen))])
    mixture = np.full((len(problem.drives), len(library)), 1.0 / len(library))
    best = np.inf
    for n in range(rounds + 1):
        report(f"certificate: round {n + 1} of {rounds + 1}", n / (rounds + 1))
        bound, mixture, share = library.mix(mixture, budget, steps)
        best = min(best, bound)
        if n == rounds:
            break
        drawn = [drawn_set(problem, share, density, rng) for density in _DENSITIES]
        for rows in drawn:
            library.add(rows)
        fresh = np.full((len(mixture), len(drawn)), _FRESH / len(drawn))
        mixture = np.column_stack([(1.0 - _FRESH) * mixture, fresh])
    return best * (1.0 + _ROUNDING)


def drawn_set(
    problem: TrajectoryProblem, share: FloatArray, density: float, rng: np.random.Generator
) -> IntArray:
    """Draw rows by their `share` (c,) times `density`, evenly along the rows; one a mount."""
    rows = np.flatnonzero(share > 0.0)
    reached = np.cumsum(share[rows] * density)
    if not len(rows) or reached[-1] <= 0.0:
        return np.empty(0, dtype=np.int64)
    at = np.arange(rng.random(), reached[-1], 1.0)
    picked = rows[np.minimum(np.searchsorted(reached, at), len(rows) - 1)]
    _, first = np.unique(problem.group[picked], return_index=True)
    drawn: IntArray = picked[first]
    return drawn


@dataclass(slots=True)
class _Library:
    """The cuts so far: w_d f_d(R_l), and w_d g_d(j | R_l) of every pair, rounded upwards."""

    problem: TrajectoryProblem
    constants: list[FloatArray] = field(default_factory=list)
    gains: list[NDArray[np.float32]] = field(default_factory=list)
    state: Trajectories = field(init=False)

    def __post_init__(self) -> None:
        self.state = Trajectories(self.problem)

    def __len__(self) -> int:
        return len(self.constants)

    def add(self, rows: IntArray) -> None:
        """Add the cut of the set `rows`."""
        problem, drives = self.problem, self.problem.drives
        total = np.zeros((len(drives.points), 3))
        held = np.sort(rows)
        add_rows(*problem.csr, 1.0, np.ones(len(held)), held, total)
        total *= drives.frames[:, None]
        value = self.state.renew(total)
        gains = self.state.gains()
        inside = np.zeros(len(problem.group), dtype=np.bool_)
        inside[held] = True
        gains[inside[problem.pair_row]] = 0.0
        gains *= drives.weights[problem.pairs[1]]
        stored = np.nextafter(gains.astype(np.float32), np.float32(np.inf))
        self.constants.append(drives.weights * value)
        self.gains.append(stored)

    def mix(
        self, mixture: FloatArray, budget: int, steps: int
    ) -> tuple[float, FloatArray, FloatArray]:
        """Improve the mixture (d, levels); return the bound, its mixture, and shares (c,)."""
        indptr, drive, _ = self.problem.pairs
        group = self.problem.group
        start = np.append(np.flatnonzero(np.diff(group, prepend=-1)), len(group)).astype(np.int64)
        value, gains = np.stack(self.constants, axis=1), np.stack(self.gains, axis=1)
        sets = np.full(len(value), len(self) - 1)
        worth, share = np.zeros(len(group)), np.zeros(len(group))
        slope = np.empty_like(value)
        best, least = (mixture, share.copy()), np.inf
        for step in range(steps):
            worths(indptr, drive, gains, mixture, sets, worth)
            most = np.maximum(np.maximum.reduceat(worth, start[:-1]), 0.0)
            top = np.sort(most)[::-1][:budget]
            bound = float(np.sum(mixture * value)) + float(top.sum())
            price = max(float(top[-1]) if len(top) == budget else 0.0, 1e-9 * float(top[0]))
            temperature = max(price * _TEMPERATURE / (1.0 + step / _COOLING), 1e-300)
            shares(worth, start, price, temperature, share)
            if bound < least:
                least, best = bound, (mixture, share.copy())
            slope[:] = value
            slopes(indptr, drive, gains, share, sets, slope)
            slope -= slope.min(axis=1, keepdims=True)
            rate = _RATE / (1.0 + step / (2.0 * _COOLING))
            rate = rate / np.maximum(slope.max(axis=1, keepdims=True), 1e-300)
            logits = np.log(mixture) - rate * slope
            logits -= logits.max(axis=1, keepdims=True)
            mixture = np.exp(np.maximum(logits, _LEAST_LOG))
            mixture = mixture / mixture.sum(axis=1, keepdims=True)
        return least, *best
