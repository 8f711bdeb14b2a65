"""Other people's programs by name: where each is called, what it needs, what it is.

A rival is a function `(subject, limits) -> Answer`. It raises `CannotSayError` where the problem
cannot be put to it, and whatever else goes wrong is a row of the table as well.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib.metadata import PackageNotFoundError, version
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from benchmarks.runner.subjects import Subject


class CannotSayError(ValueError):
    """The rival has no words for this problem; the message says which are missing."""


@dataclass(frozen=True, slots=True)
class Limits:
    """What a solver is given besides the problem."""

    time_limit_s: float
    seed: int


@dataclass(frozen=True, slots=True)
class Answer:
    """What a rival claims: a selection, and its own bound on the value of any (None: no bound).

    `evaluations` and `nodes` where it counts them; `note` for what a reader should know.
    """

    selected: list[int]
    bound: float | None = None
    evaluations: int | None = None
    nodes: int | None = None
    note: str = ""
    stats: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Rival:
    """Say where a rival is called (`module:function`), and which distributions it stands on."""

    target: str
    needs: tuple[str, ...]
    summary: str

    def missing(self) -> str | None:
        """Return the first distribution that is not installed, None if all are."""
        for name in self.needs:
            try:
                version(name)
            except PackageNotFoundError:
                return name
        return None

    def load(self) -> Callable[[Subject, Limits], Answer]:
        """Import the adapter, and the rival with it."""
        module, function = self.target.split(":")
        solver: Callable[[Subject, Limits], Answer] = getattr(
            importlib.import_module(module), function
        )
        return solver


RIVALS: Mapping[str, Rival] = {
    "cvxpy-clarabel": Rival(
        "benchmarks.rivals.conic:solve_clarabel",
        ("cvxpy-base", "clarabel"),
        "the textbook concave relaxation by an interior point, rounded, swapped (Joshi & Boyd)",
    ),
    "cvxpy-scs": Rival(
        "benchmarks.rivals.conic:solve_scs",
        ("cvxpy-base", "scs"),
        "the same by operator splitting",
    ),
    "scip": Rival(
        "benchmarks.rivals.scip:solve_plain",
        ("pyscipopt",),
        "SCIP on the convex MINLP, or on the textbook MIP where that says it all",
    ),
    "scip-cuts": Rival(
        "benchmarks.rivals.scip:solve_with_cuts",
        ("pyscipopt",),
        "SCIP with this project's cuts, added where violated",
    ),
    "highs": Rival(
        "benchmarks.rivals.highs:solve_plain",
        ("highspy",),
        "HiGHS on the textbook MIP",
    ),
    "apricot": Rival(
        "benchmarks.rivals.greedy_libraries:solve_apricot",
        ("apricot-select",),
        "greedy by apricot: feature-based, coverage, or log det as a function of its user's",
    ),
    "submodlib": Rival(
        "benchmarks.rivals.greedy_libraries:solve_submodlib",
        ("submodlib-py",),
        "greedy by submodlib: log det of a kernel, feature-based, or set cover",
    ),
    "chama": Rival(
        "benchmarks.rivals.chama_coverage:solve_chama",
        ("chama", "pyomo", "highspy"),
        "Chama's coverage formulation, through Pyomo to HiGHS",
    ),
    "pysensors": Rival(
        "benchmarks.rivals.pysensors_pivots:solve_pysensors",
        ("python-sensors",),
        "PySensors: pivoted QR of the experiments, or its two-point greedy",
    ),
}
