"""The suites: which solvers meet on which instances, with which seeds, for how long."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from benchmarks.instances.library import LIBRARY
from benchmarks.runner.subjects import Case

ROAD_RIVALS = ("cvxpy-clarabel", "cvxpy-scs", "scip", "scip-cuts", "apricot", "submodlib")


@dataclass(frozen=True, slots=True)
class Suite:
    """Solvers × cases × seeds × repeats. `solvers` gives those of each kind of case by name.

    A process is ended at `hard_limit_s`: beyond the time limit there are building, compiling,
    warming up and the referee.
    """

    name: str
    about: str
    cases: tuple[Case, ...]
    solvers: Mapping[str, tuple[str, ...]]
    seeds: tuple[int, ...] = (0,)
    repeats: int = 1
    time_limit_s: float = 60.0

    @property
    def hard_limit_s(self) -> float:
        """Seconds after which a job's process is killed."""
        return 2.0 * self.time_limit_s + 120.0

    def solvers_of(self, case: Case) -> tuple[str, ...]:
        """Return the solvers that are tried on `case`: by its name, else by its kind."""
        return self.solvers[case.name] if case.name in self.solvers else self.solvers[case.kind]

    def heading(self) -> dict[str, Any]:
        """Return what makes two runs the same run."""
        return {
            "suite": self.name,
            "cases": [case.record() for case in self.cases],
            "solvers": [list(self.solvers_of(case)) for case in self.cases],
            "seeds": list(self.seeds),
            "repeats": self.repeats,
            "time_limit_s": self.time_limit_s,
        }

    def changed(
        self,
        *,
        time_limit_s: float | None = None,
        seeds: Sequence[int] | None = None,
        repeats: int | None = None,
        solvers: Sequence[str] | None = None,
        instances: Sequence[str] | None = None,
    ) -> Suite:
        """Return the suite with what the command line asks for.

        Raises:
            ValueError: naming what does not exist.
        """
        suite = self
        if time_limit_s is not None:
            suite = replace(suite, time_limit_s=time_limit_s)
        if seeds is not None:
            suite = replace(suite, seeds=tuple(seeds))
        if repeats is not None:
            suite = replace(suite, repeats=repeats)
        if instances:
            known = {case.name: case for case in suite.cases}
            unknown = [name for name in instances if name not in known]
            if unknown:
                raise ValueError(f"--instance must be one of {', '.join(known)}, got {unknown[0]}")
            suite = replace(suite, cases=tuple(known[name] for name in instances))
        if solvers:
            known_solvers = {s for case in suite.cases for s in suite.solvers_of(case)}
            odd = [name for name in solvers if name not in known_solvers]
            if odd:
                wanted = ", ".join(sorted(known_solvers))
                raise ValueError(f"--solver must be one of {wanted}, got {odd[0]}")
            kept = {
                key: tuple(s for s in row if s in solvers) for key, row in suite.solvers.items()
            }
            suite = replace(suite, solvers=kept)
        return suite


def make_suite(name: str, data: str | None = None) -> Suite:
    """Return the suite `name`; `data` is where the user's road files lie.

    Raises:
        ValueError: for an unknown name.
    """
    if name not in SUITES:
        raise ValueError(f"suite must be one of {', '.join(SUITES)}, got {name!r}")
    return SUITES[name](data)


def _cases(names: str, data: str | None = None) -> tuple[Case, ...]:
    return tuple(LIBRARY[name].case(data) for name in names.split())


def _coverage_case(name: str, times: int, label: str = "", **changes: Any) -> Case:
    base = LIBRARY[name].case(None, **changes)
    # localisation carries no drive to filter, so the scene is quick to make
    spec = {**base.spec, "times": times}
    return Case(f"{label or name}-seen-{'once' if times == 1 else 'twice'}", "coverage", spec)


def _smoke(data: str | None) -> Suite:
    del data
    once = _coverage_case("arc-50", 1)
    return Suite(
        "smoke",
        "a few small instances of every kind: seconds",
        (*_cases("arc-50 straight-200 trace-persistent legendre-5"), once),
        {
            "road": ("greedy", "search", "auto"),
            "design": ("greedy", "exchange", "auto"),
            "coverage": ("greedy", "mip", "highs"),
        },
        time_limit_s=5.0,
    )


def _camera(data: str | None) -> Suite:
    localisation = (
        "straight-80 bend-20 arc-50 straight-200 hairpin straight-free required grouped s-bend "
        "s-bend-ellipse s-bend-covariance fisheye narrow two-heights mixed-free dense-mounts "
        "priced separated winding country-5km norisring ims budapest spielberg"
    )
    coupled = (
        "entropy-robot entropy-car entropy-car-20 entropy-dissertation zandvoort "
        "trace-robot trace-car trace-lateral trace-persistent final-car circuit monza"
    )
    ours = ("auto", "greedy", "exchange", "search", "relaxation", "mip")
    baselines = ("uniform", "hill-climb", "cascade")
    cases = _cases(f"{localisation} {coupled}", data)
    everybody: tuple[str, ...] = (*ours, *ROAD_RIVALS)
    solvers = dict.fromkeys(localisation.split(), everybody)
    solvers |= {
        name: ("auto", "greedy", "exchange", "search", *extra, *baselines, *ROAD_RIVALS)
        for name in coupled.split()
        for extra in [_extra(name)]
    }
    about = "roads: every method and rival that can say them"
    return Suite("camera", about, cases, solvers, time_limit_s=20.0)


def _extra(name: str) -> tuple[str, ...]:
    """Return the methods made for what a coupled instance optimises."""
    if name.startswith("entropy") or name == "zandvoort":
        return ("relaxation", "tempered")
    return ("diagram",) if name.startswith("trace") or name in ("circuit", "monza") else ()


def _doptimal(data: str | None) -> Suite:
    del data
    names = (
        "trees-9 trees-10 trees-11 legendre-5 gauss-10-50 gauss-10-100 gauss-10-300 "
        "gauss-grouped gauss-rank-3 fusion-40 fusion-200"
    )
    return Suite(
        "doptimal",
        "log-det designs and data fusion",
        (*_cases(names), *_published_designs()),
        {
            "design": (
                "branch",
                "greedy",
                "exchange",
                "relaxation",
                "cvxpy-clarabel",
                "cvxpy-scs",
                "scip-cuts",
                "apricot",
                "submodlib",
                "pysensors",
            )
        },
        time_limit_s=20.0,
    )


def _published_designs() -> tuple[Case, ...]:
    """Return the families of `benchmarks.doptimal`: the grid of published sizes, and others.

    The grid is rank one, n = 10, prior 1e-6·I; five seeds each, of the others two.
    """
    grid = [
        _drawn("gaussian", c, k, seed)
        for c in (100, 200, 300, 500)
        for k in (10, 15, 20)
        for seed in range(5)
    ]
    sizes = (("correlated", 100, 10), ("fusion", 60, 8), ("traced", 50, 10))
    return (*grid, *(_drawn(*size, seed) for size in sizes for seed in range(2)))


def _drawn(family: str, c: int, k: int, seed: int) -> Case:
    spec = {
        "generator": f"benchmarks.doptimal:{family}",
        "arguments": {"c": c, "k": k, "seed": seed},
    }
    return Case(f"{family}-{c}-{k}-{seed}", "design", spec)


def _greedy(data: str | None) -> Suite:
    del data
    million = {"candidates": 1_000_000, "samples": 200_000, "window": 20, "budget": 1000}
    return Suite(
        "greedy",
        "throughput: a dense log det, and a million sparse candidates",
        (
            *_cases("dense-2000 mixed-free"),
            Case("sparse-100k", "synthetic", {**million, "candidates": 100_000, "seed": 0}),
            Case("sparse-million", "synthetic", {**million, "seed": 0}),
        ),
        {
            "design": ("greedy", "apricot", "submodlib", "pysensors"),
            "road": ("greedy", "apricot", "submodlib"),
            "synthetic": ("greedy", "apricot", "submodlib"),
        },
        repeats=2,
        time_limit_s=60.0,
    )


def _coverage(data: str | None) -> Suite:
    del data
    return Suite(
        "coverage",
        "samples seen at least once or twice: the objective that everybody has",
        (
            _coverage_case("arc-50", 1),
            _coverage_case("straight-free", 1),
            _coverage_case("s-bend", 1, budget__cameras=4),
            _coverage_case("fisheye", 1, budget__cameras=3),
            _coverage_case("dense-mounts", 1, budget__cameras=4),
            _coverage_case("mixed-free", 1, budget__cameras=6),
            _coverage_case("winding", 1, budget__cameras=12),
            _coverage_case(
                "winding", 1, "winding-free", budget__cameras=8, budget__one_per_mount=False
            ),
            _coverage_case("priced", 1, budget__money=12.0),
            _coverage_case("arc-50", 2),
            _coverage_case("straight-free", 2),
            _coverage_case("s-bend", 2, budget__cameras=6),
            _coverage_case("fisheye", 2, budget__cameras=4),
            _coverage_case("winding", 2, budget__cameras=8),
        ),
        {
            "coverage": (
                "mip",
                "greedy",
                "exchange",
                "highs",
                "chama",
                "scip",
                "apricot",
                "submodlib",
                "cvxpy-clarabel",
            )
        },
        repeats=2,
    )


SUITES: Mapping[str, Callable[[str | None], Suite]] = {
    "smoke": _smoke,
    "camera": _camera,
    "doptimal": _doptimal,
    "greedy": _greedy,
    "coverage": _coverage,
}
