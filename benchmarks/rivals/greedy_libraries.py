"""Greedy by two libraries for submodular functions, in the form each runs fastest.

Neither knows groups, required poses or 2×2 blocks: `localisation` can be said where blocks are
isotropic, as Σ_t log(1 + Σ_i x_it), and where a count is all that limits the choice.
"""

from __future__ import annotations

import importlib
from typing import Any

import numpy as np
from scipy import sparse

from benchmarks.rivals.registry import Answer, CannotSayError, Limits
from benchmarks.runner.subjects import Subject
from placement.constraints import Constraints
from placement.objectives.coverage import Coverage
from placement.objectives.localisation import Localisation
from placement.objectives.log_det import LogDet

LARGEST_KERNEL = 6_000  # submodlib wants c × c numbers as nested Python lists


def solve_apricot(subject: Subject, limits: Limits) -> Answer:
    """Run apricot's lazy greedy on the fitting selection."""
    apricot: Any = importlib.import_module("apricot")
    f, k = subject.problem.objective, count_alone(subject.problem.constraints)
    options: dict[str, Any] = {"n_samples": k, "random_state": limits.seed, "n_jobs": 1}
    if isinstance(f, LogDet):
        root = np.linalg.cholesky(np.linalg.inv(f.prior))
        if f.rank != 1:
            raise CannotSayError("a sample of apricot's is one row, so factors of rank one only")
        whitened = np.ascontiguousarray(f.columns.T @ root)
        identity = np.eye(f.n_states)

        def log_det(numbers: Any) -> float:
            rows = whitened[np.asarray(numbers, dtype=np.int64).reshape(-1)]
            return float(np.linalg.slogdet(identity + rows.T @ rows)[1])

        # It refuses negative features, so a sample's feature is its number.
        selection = apricot.CustomSelection(function=log_det, optimizer="lazy", **options)
        selection.fit(np.arange(f.n_candidates, dtype=np.float64)[:, None])
    elif isinstance(f, Coverage):
        if f.times > 1 and not f.partial:
            raise CannotSayError("apricot knows shares of looks, not samples seen twice")
        selection = apricot.MaxCoverageSelection(
            threshold=float(f.times), optimizer="two-stage", **options
        )
        selection.fit(_writable(sparse.csr_matrix(f.seen)))
    else:
        features, weights = _features(f)
        selection = apricot.FeatureBasedSelection(
            concave_func="log", optimizer="two-stage", **options
        )
        if not np.all(weights == weights[0]):
            raise CannotSayError("apricot's feature weights are all one")
        selection.fit(_writable(features))
    return Answer([int(i) for i in selection.ranking], note="greedy: proves nothing")


def solve_submodlib(subject: Subject, limits: Limits) -> Answer:
    """Run submodlib's lazy greedy (written in C++) on the fitting function."""
    submodlib: Any = importlib.import_module("submodlib")

    del limits  # it knows neither time limits nor seeds
    f, k = subject.problem.objective, count_alone(subject.problem.constraints)
    c = subject.problem.constraints.n
    if isinstance(f, LogDet):
        if f.rank != 1:
            raise CannotSayError("a kernel has one row a candidate, so factors of rank one only")
        if c > LARGEST_KERNEL:
            raise CannotSayError(f"a kernel of {c:,} × {c:,} as Python lists")
        kernel = f.columns.T @ np.linalg.solve(f.prior, f.columns)
        function = submodlib.LogDeterminantFunction(
            n=c, mode="dense", lambdaVal=1.0, sijs=np.ascontiguousarray(kernel)
        )
    elif isinstance(f, Coverage):
        if f.times > 1:
            raise CannotSayError("submodlib's set cover is seen or not, never twice")
        rows = sparse.csr_matrix(f.seen)
        cover = [
            {int(t) for t in rows.indices[rows.indptr[i] : rows.indptr[i + 1]]} for i in range(c)
        ]
        t = f.information.n_samples
        function = submodlib.SetCoverFunction(
            n=c, cover_set=cover, num_concepts=t, concept_weights=f.weights.tolist()
        )
    else:
        features, weights = _features(f)
        pairs = [
            [
                (int(t), float(v))
                for t, v in zip(
                    features.indices[features.indptr[i] : features.indptr[i + 1]],
                    features.data[features.indptr[i] : features.indptr[i + 1]],
                    strict=True,
                )
            ]
            for i in range(c)
        ]
        function = _feature_based(pairs, weights.tolist())
    chosen = function.maximize(
        budget=k,
        optimizer="LazyGreedy",
        stopIfZeroGain=False,
        stopIfNegativeGain=False,
        verbose=False,
        show_progress=False,
    )
    return Answer([int(i) for i, _ in chosen], note="greedy: proves nothing")


def _feature_based(features: list[list[tuple[int, float]]], weights: list[float]) -> Any:
    """Call submodlib's C++ core: its Python class rescales every feature to 0…1.

    That would be another function; and it fails on sparse rows with NumPy 2.
    """
    base: Any = importlib.import_module("submodlib.functions.setFunction")
    core: Any = importlib.import_module("submodlib_cpp").FeatureBased

    class Features(base.SetFunction):  # type: ignore[misc]
        def __init__(self) -> None:
            self.n = len(features)
            self.effective_ground = set(range(self.n))
            self.cpp_obj = core(self.n, core.logarithmic, features, len(weights), weights)

    return Features()


def _writable(matrix: Any) -> Any:
    """Return a copy, as apricot's kernels are compiled for arrays that may be written."""
    copied = matrix.copy()
    for name in ("data", "indices", "indptr"):
        setattr(copied, name, np.array(getattr(copied, name)))
    return copied


def count_alone(constraints: Constraints) -> int:
    """Return the budget, where it is all that limits the choice."""
    grouped = constraints.group[constraints.group >= 0]
    if np.unique(grouped).size < grouped.size:
        raise CannotSayError("no word for at most one of a group")
    if constraints.required.size or constraints.forbidden.size:
        raise CannotSayError("no word for required or forbidden candidates")
    if constraints.beyond_matroid():
        raise CannotSayError(f"no word for {' and '.join(constraints.beyond_matroid())}")
    return min(constraints.budget, constraints.n)


def _features(f: Any) -> tuple[Any, Any]:
    """Return X (c, t) and weights (t,) with f(S) = Σ_t w_t log(1 + Σ_i X_it)."""
    if not isinstance(f, Localisation):
        raise CannotSayError(f"{f.name} is no sum of concave functions of sums")
    if f.blocks.shape[1] != 1:
        raise CannotSayError("blocks of 2×2 are no sums of features")
    values = f.scale * f.blocks[:, 0].astype(np.float64)
    shape = (f.n_candidates, f.information.n_samples)
    matrix = sparse.csr_matrix((values, f.indices, f.indptr), shape=shape)
    return matrix, 2.0 * np.asarray(f.weights)
