"""SCIP through PySCIPOpt: the problem as a convex MINLP, and with this project's cuts.

As a MINLP, `localisation` with isotropic blocks is Σ z_t with z_t ≤ 2 w log(1 + s Σ x J), which
SCIP's own outer approximation handles; 2×2 blocks are 2 w log u under u² + q² ≤ p r. `coverage` is
its textbook MIP. A log det of n states has no such form that SCIP knows to be convex.

With cuts, SCIP gets levels z and a constraint handler: at every solution of a relaxation it adds
the violated cuts of `placement.bounds` (per sample), or for a log det the tangent of the concave
extension, and at whole x the submodular cut besides.
"""

from __future__ import annotations

import importlib
from typing import Any

import numpy as np

from benchmarks.rivals.registry import Answer, CannotSayError, Limits
from benchmarks.runner.subjects import Subject
from models.geometry import FloatArray
from placement.bounds.coverage_cuts import CoverageCuts
from placement.bounds.cuts import CutMaker, Cuts
from placement.constraints import Constraints
from placement.objectives.coverage import Coverage
from placement.objectives.localisation import Localisation
from placement.objectives.log_det import LogDet

pyscipopt: Any = importlib.import_module("pyscipopt")
quicksum, SCIP_RESULT = pyscipopt.quicksum, pyscipopt.SCIP_RESULT

LARGEST_MINLP = 400_000  # entries: beyond, building the expressions alone takes minutes
VIOLATION = 1e-6


def solve_plain(subject: Subject, limits: Limits) -> Answer:
    """Hand SCIP the whole problem and let it work."""
    f, constraints = subject.problem.objective, subject.problem.constraints
    if isinstance(f, LogDet):
        raise CannotSayError("a log det has no form that SCIP knows to be convex")
    if not isinstance(f, Localisation | Coverage):
        raise CannotSayError(f"{f.name} is a recursion along the whole drive")
    if len(f.indices) > LARGEST_MINLP:
        raise CannotSayError(f"{len(f.indices):,} entries are too many expressions")
    model, x = _model(constraints, limits)
    if isinstance(f, Coverage):
        _coverage_rows(model, f, x)
    else:
        _localisation_rows(model, f, x)
    model.optimize()
    return _answer(model, x)


def solve_with_cuts(subject: Subject, limits: Limits) -> Answer:
    """Give SCIP levels, and cuts where they are violated."""
    f, constraints = subject.problem.objective, subject.problem.constraints
    model, x = _model(constraints, limits)
    if isinstance(f, LogDet):
        handler: _Handler = _WholeHandler(f)
        levels = 1
    elif isinstance(f, Localisation):
        handler = _SampleHandler(CutMaker(f))
        levels = f.information.n_samples
    elif isinstance(f, Coverage):
        handler = _SampleHandler(CoverageCuts(f))
        levels = f.information.n_samples
    else:
        raise CannotSayError(f"{f.name} has no cuts to give")
    first = handler.first(constraints.n)
    cut = set(np.concatenate([cuts.sample for cuts in first]).tolist())  # the others nobody sees
    z = [model.addVar(lb=0.0, ub=None if t in cut else 0.0) for t in range(levels)]
    handler.x, handler.z = x, z
    model.includeConshdlr(
        handler,
        "cuts",
        "levels lie below every cut",
        sepapriority=1,
        enfopriority=-1_000_000,
        chckpriority=-1_000_000,
        sepafreq=1,
        needscons=False,
    )
    for cuts in first:
        for row in _rows_of(cuts, x, z):
            model.addCons(row)
    model.setObjective(quicksum(z), "maximize")
    model.setParam("misc/allowstrongdualreds", False)
    model.setParam("misc/allowweakdualreds", False)
    model.optimize()
    return _answer(model, x)


class _Handler(pyscipopt.Conshdlr):  # type: ignore[misc]
    """Add cuts at whatever SCIP proposes; a proposal that violates none is right."""

    x: list[Any]
    z: list[Any]

    def first(self, c: int) -> list[Cuts]:
        raise NotImplementedError

    def violated(self, x: FloatArray, z: FloatArray) -> list[Cuts]:
        raise NotImplementedError

    def at(self, solution: Any) -> tuple[FloatArray, FloatArray]:
        value = self.model.getSolVal
        x = np.array([value(solution, v) for v in self.x])
        return np.clip(x, 0.0, 1.0), np.array([value(solution, v) for v in self.z])

    def conscheck(self, _constraints: Any, solution: Any, *_how: Any) -> dict[str, Any]:
        x, z = self.at(solution)
        found = any(len(c) for c in self.violated(np.round(x), z))
        return {"result": SCIP_RESULT.INFEASIBLE if found else SCIP_RESULT.FEASIBLE}

    def consenfolp(self, *_arguments: Any) -> dict[str, Any]:
        return {"result": SCIP_RESULT.CONSADDED if self.cut() else SCIP_RESULT.FEASIBLE}

    def consenfops(self, *_arguments: Any) -> dict[str, Any]:
        return {"result": SCIP_RESULT.SOLVELP}

    def conssepalp(self, *_arguments: Any) -> dict[str, Any]:
        return {"result": SCIP_RESULT.CONSADDED if self.cut() else SCIP_RESULT.DIDNOTFIND}

    def conslock(self, _constraint: Any, _kind: Any, nlockspos: int, nlocksneg: int) -> None:
        for v in self.x:
            self.model.addVarLocks(v, nlockspos, nlocksneg)
        for v in self.z:
            self.model.addVarLocks(v, nlocksneg, nlockspos)

    def cut(self) -> int:
        """Add every violated cut at the current relaxation; return how many."""
        x, z = self.at(None)
        rows = [row for cuts in self.violated(x, z) for row in _rows_of(cuts, self.x, self.z)]
        for row in rows:
            self.model.addCons(row)
        return len(rows)


class _SampleHandler(_Handler):
    """Cuts a sample: `placement.bounds.cuts`, `placement.bounds.coverage_cuts`."""

    def __init__(self, maker: CutMaker | CoverageCuts) -> None:
        self.maker = maker

    def first(self, c: int) -> list[Cuts]:
        del c
        return [self.maker.submodular(np.empty(0, dtype=np.int64))]

    def violated(self, x: FloatArray, z: FloatArray) -> list[Cuts]:
        by = VIOLATION * max(1.0, float(np.sum(z))) / max(len(z), 1)
        return [self.maker.separate(x, z, by)]


class _WholeHandler(_Handler):
    """One level for all: the tangent at x, and at whole x the submodular cut of the set."""

    def __init__(self, objective: LogDet) -> None:
        self.objective = objective

    def first(self, c: int) -> list[Cuts]:
        return [self._tangent(np.full(c, 1.0)), self._gains(np.empty(0, dtype=np.int64))]

    def violated(self, x: FloatArray, z: FloatArray) -> list[Cuts]:
        cuts = [self._tangent(x)]
        if np.all(np.minimum(x, 1.0 - x) < 1e-6):
            cuts.append(self._gains(np.flatnonzero(x > 0.5)))
        by = VIOLATION * max(1.0, abs(float(z[0])))
        return [c for c in cuts if z[0] > c.at(x)[0] + by]

    def _tangent(self, x: FloatArray) -> Cuts:
        score, slope = self.objective.relaxed(x)
        return _single(score - float(slope @ x), slope)

    def _gains(self, selected: Any) -> Cuts:
        state = self.objective.state(selected)
        gains = state.gains()
        gains[selected] = 0.0
        return _single(state.score, gains)


def _single(constant: float, coefficient: FloatArray) -> Cuts:
    n = len(coefficient)
    return Cuts(
        np.zeros(1, dtype=np.int64),
        np.array([constant]),
        np.array([0, n]),
        np.arange(n, dtype=np.int32),
        coefficient,
    )


def _rows_of(cuts: Cuts, x: list[Any], z: list[Any]) -> list[Any]:
    rows = []
    for r in range(len(cuts)):
        span = slice(cuts.indptr[r], cuts.indptr[r + 1])
        terms = zip(cuts.candidate[span].tolist(), cuts.coefficient[span].tolist(), strict=True)
        side = quicksum(a * x[j] for j, a in terms) + float(cuts.constant[r])
        rows.append(z[int(cuts.sample[r])] <= side)
    return rows


def _model(constraints: Constraints, limits: Limits) -> tuple[Any, list[Any]]:
    """Return a quiet model with a binary for each candidate and the rules of placements."""
    model = pyscipopt.Model()
    model.hideOutput()
    model.setParam("limits/time", limits.time_limit_s)
    model.setParam("randomization/randomseedshift", limits.seed)
    model.setParam("limits/gap", 1e-7)
    usable = constraints.usable()
    required = set(constraints.required.tolist())
    x = [
        model.addVar(vtype="B", lb=float(i in required), ub=float(usable[i]), name=f"x{i}")
        for i in range(constraints.n)
    ]
    matrix, limits_ = constraints.linear_rows()
    for r in range(matrix.shape[0]):
        span = slice(matrix.indptr[r], matrix.indptr[r + 1])
        terms = zip(matrix.indices[span].tolist(), matrix.data[span].tolist(), strict=True)
        model.addCons(quicksum(a * x[j] for j, a in terms) <= float(limits_[r]))
    return model, x


def _coverage_rows(model: Any, f: Coverage, x: list[Any]) -> None:
    seen_by = f.seen.tocsc()
    levels = []
    for t, weight in enumerate(f.weights.tolist()):
        members = seen_by.indices[seen_by.indptr[t] : seen_by.indptr[t + 1]].tolist()
        if members:
            z = model.addVar(vtype="B" if f.times > 1 else "C", lb=0.0, ub=1.0)
            model.addCons(f.times * z <= quicksum(x[i] for i in members))
            levels.append(weight * z)
    model.setObjective(quicksum(levels), "maximize")


def _localisation_rows(model: Any, f: Localisation, x: list[Any]) -> None:
    """Give every sample a level below its concave term."""
    order = np.argsort(f.indices, kind="stable")
    levels = []
    for t, weight in enumerate(f.weights.tolist()):
        entries = order[f.sample_indptr[t] : f.sample_indptr[t + 1]]
        if not entries.size:
            continue
        members = f.sample_candidates[f.sample_indptr[t] : f.sample_indptr[t + 1]].tolist()
        sums = []
        for column in range(f.blocks.shape[1]):
            values = (f.scale * f.blocks[entries, column].astype(np.float64)).tolist()
            side = quicksum(v * x[i] for v, i in zip(values, members, strict=True))
            level = model.addVar(lb=None, ub=None)
            model.addCons(level == side)
            sums.append(level)
        z = model.addVar(lb=0.0, ub=None)
        if len(sums) == 1:
            model.addCons(z <= 2.0 * weight * pyscipopt.log(1.0 + sums[0]))
        else:
            p, q, r = sums
            u = model.addVar(lb=1.0, ub=None)
            model.addCons(u * u + q * q <= (1.0 + p) * (1.0 + r))
            model.addCons(z <= 2.0 * weight * pyscipopt.log(u))
        levels.append(z)
    model.setObjective(quicksum(levels), "maximize")


def _answer(model: Any, x: list[Any]) -> Answer:
    if model.getNSols() == 0:
        raise RuntimeError(f"SCIP ended with {model.getStatus()} and no solution")
    best = model.getBestSol()
    selected = [i for i, v in enumerate(x) if model.getSolVal(best, v) > 0.5]
    bound = float(model.getDualbound())
    claimed = str(model.getStatus())
    return Answer(
        selected,
        bound if abs(bound) < 1e19 else None,
        nodes=int(model.getNTotalNodes()),
        note="" if claimed in ("optimal", "gaplimit") else f"SCIP: {claimed}",
    )
