"""Small synthetic problems, built without a road, and an objective that is not submodular."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np
import pytest

from models.geometry import FloatArray, IntArray
from placement.constraints import Constraints
from placement.information import Information
from placement.information.chunks import ChunkStore
from placement.objectives.base import State
from placement.objectives.localisation import Localisation
from placement.problem import Problem


def make_information(
    rng: np.random.Generator,
    n_candidates: int,
    n_samples: int,
    *,
    isotropic: bool = True,
    scale: float = 10.0,
    spread: float = 1.0,
) -> Information:
    """Draw windows of random length and log-normal blocks (median `scale`) in a random CSR."""
    indptr, indices = [0], []
    for _ in range(n_candidates):
        length = int(rng.integers(1, max(2, n_samples // 2)))
        start = int(rng.integers(0, n_samples - length + 1))
        indices += [t for t in range(start, start + length) if rng.uniform() < 0.9]
        indptr.append(len(indices))
    nnz = len(indices)
    if isotropic:
        blocks = scale * rng.lognormal(0.0, spread, (nnz, 1))
    else:
        a, b = scale * rng.lognormal(0.0, spread, (2, nnz))
        blocks = np.column_stack([a, 0.95 * rng.uniform(-1.0, 1.0, nnz) * np.sqrt(a * b), b])
    return Information(
        n_samples,
        np.array(indptr, dtype=np.int64),
        np.array(indices, dtype=np.int32),
        blocks.astype(np.float32),
    )


def make_problem(
    rng: np.random.Generator,
    *,
    n_candidates: int = 10,
    n_samples: int = 30,
    budget: int = 3,
    groups: bool = False,
    isotropic: bool = True,
    required: tuple[int, ...] = (),
    forbidden: tuple[int, ...] = (),
    scale: float = 10.0,
    spread: float = 1.0,
) -> Problem:
    """Draw a `localisation` problem; with `groups`, three poses a mount."""
    info = make_information(
        rng, n_candidates, n_samples, isotropic=isotropic, scale=scale, spread=spread
    )
    mount = np.arange(n_candidates) // 3
    constraints = Constraints(
        n_candidates,
        budget,
        mount if groups else np.full(n_candidates, -1),
        np.array(required, dtype=np.int64),
        np.array(forbidden, dtype=np.int64),
    )
    return Problem(Localisation(info, 0.5), constraints, mount * 3.0, float(n_samples))


def placements(constraints: Constraints) -> Iterator[tuple[int, ...]]:
    """Enumerate every placement."""
    for size in range(min(constraints.budget, constraints.n) + 1):
        for chosen in itertools.combinations(range(constraints.n), size):
            if not constraints.violations(chosen):
                yield chosen


def best_by_enumeration(problem: Problem) -> tuple[float, tuple[int, ...]]:
    """Return the best value and a placement that has it."""
    f = problem.objective
    sign = 1.0 if f.maximise else -1.0
    scored = ((f.value(np.array(s, dtype=np.int64)), s) for s in placements(problem.constraints))
    return max(scored, key=lambda pair: sign * pair[0])


@dataclass
class RiccatiToy:
    """A scalar filter along the path: P ← 1/(1/(P + q) + J_t); the value is the mean P, in m².

    Minimised, monotone, and not submodular: two cameras can be worth more together.
    """

    information: Information
    name: str = "toy"
    unit: str = "m^2"
    maximise: bool = False
    submodular: bool = False
    evaluations: int = 0

    @property
    def n_candidates(self) -> int:
        return self.information.n_candidates

    def value(self, selected: IntArray) -> float:
        info = self.information
        self.evaluations += 1
        J = np.zeros(info.n_samples)
        for i in selected:
            row = slice(info.indptr[i], info.indptr[i + 1])
            J[info.indices[row]] += info.blocks[row, 0]
        P, total = 0.01, 0.0
        for t in range(info.n_samples):
            P = 1.0 / (1.0 / (P + 0.1) + J[t])
            total += P
        return total / info.n_samples

    def state(self, selected: IntArray | None = None) -> State:
        return ToyState(self, [] if selected is None else [int(i) for i in selected])


@dataclass
class ToyState:
    """The plainest state there can be: every gain from scratch."""

    objective: RiccatiToy
    selected: list[int] = field(default_factory=list)

    @property
    def score(self) -> float:
        return -self.objective.value(np.array(self.selected, dtype=np.int64))

    def gains(self, candidates: IntArray | None = None) -> FloatArray:
        rows = range(self.objective.n_candidates) if candidates is None else candidates
        here = self.score
        with_each = [
            -self.objective.value(np.array([*self.selected, int(i)], dtype=np.int64))
            if int(i) not in self.selected
            else here
            for i in rows
        ]
        return np.array(with_each) - here

    def add(self, candidate: int) -> None:
        self.selected = [*self.selected, candidate]

    def remove(self, candidate: int) -> None:
        self.selected = [i for i in self.selected if i != candidate]


@pytest.fixture(scope="session")
def new_information() -> Callable[..., Information]:
    """Give `make_information(rng, n_candidates, n_samples, …)`."""
    return make_information


@pytest.fixture(scope="session")
def new_problem() -> Callable[..., Problem]:
    """Give `make_problem(rng, …)`."""
    return make_problem


@pytest.fixture(scope="session")
def brute_force() -> Callable[[Problem], tuple[float, tuple[int, ...]]]:
    """Give `best_by_enumeration(problem)`."""
    return best_by_enumeration


@pytest.fixture(scope="session")
def new_toy() -> Callable[[Information], RiccatiToy]:
    """Give the minimised objective that is not submodular."""
    return RiccatiToy


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave out the figures beside a solution, where another test draws the same ones.

    Drawing takes ten times as long as solving so small an instance.
    """
    monkeypatch.setattr("placement.commands.entry_points", lambda group: [])


@pytest.fixture
def stop_writing_after(monkeypatch: pytest.MonkeyPatch) -> Callable[[int], list[int]]:
    """List the chunks that are written from the call on; the n-th is followed by Ctrl-C."""

    def begin(n: int) -> list[int]:
        numbers: list[int] = []
        write = ChunkStore.write

        def note(store: ChunkStore, number: int, content: bytes) -> None:
            write(store, number, content)
            numbers.append(number)
            if len(numbers) == n:
                raise KeyboardInterrupt

        monkeypatch.setattr(ChunkStore, "write", note)
        return numbers

    return begin
