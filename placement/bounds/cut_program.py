"""The linear program behind `mip`: cuts as rows, solved by HiGHS, re-solved as the tree grows.

    maximise Σ_t z_t   over x ∈ [0, 1]ᶜ, z ≥ 0
    with z_t − Σ_j coefficient_j x_j ≤ constant for every cut of sample t, Σ_j x_j ≤ budget,
    and Σ_{j ∈ g} x_j ≤ 1 (= 1 where the node must use it) for every group g,
    and the side rows of money and separation.

Nothing HiGHS reports is believed: its x says where to cut and branch, its row duals become the
multipliers of `placement.bounds.cut_bound`.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import highspy as _highspy
import numpy as np

from models.geometry import FloatArray, IntArray
from placement.bounds.cuts import Cuts, joined
from placement.bounds.matroid import Choice
from placement.interrupts import asked_to_stop
from placement.quiet import quiet_stdout

highspy: Any = _highspy  # its stubs lack most of what it has


@dataclass(frozen=True, slots=True)
class Fraction:
    """What the linear program says: choices x (c,), levels z (t,), a multiplier of each cut.

    `price` (r,) are the multipliers of the choice's side rows.
    """

    x: FloatArray
    z: FloatArray
    multiplier: FloatArray
    price: FloatArray = field(default_factory=lambda: np.empty(0))


class CutProgram:
    """Hold the program for the candidates that `choice` allows, and grow it cut by cut."""

    def __init__(self, choice: Choice, cuts: Cuts, n_samples: int, threads: int = 1) -> None:
        """Start with `cuts`, which must include one of every sample that a candidate sees."""
        self.cuts = cuts
        self._n_samples = n_samples
        self.columns = np.flatnonzero(choice.allowed)
        self._column_of = np.full(len(choice.group), -1, dtype=np.int64)
        self._column_of[self.columns] = np.arange(self.columns.size)
        samples = np.unique(cuts.sample)
        self._z_of = np.full(n_samples, -1, dtype=np.int64)
        self._z_of[samples] = self.columns.size + np.arange(samples.size)
        self._samples = samples
        self._groups, members = np.unique(choice.group[self.columns], return_inverse=True)
        self._highs = _quiet_highs(threads)
        self._add_columns(self.columns.size, 1.0, 0.0)
        self._add_columns(samples.size, highspy.kHighsInf, 1.0)
        self._add_matroid_rows(choice.budget, members)
        self._side_rows = len(choice.side_limits)
        self._add_side_rows(choice)
        self._fixed_rows = 1 + self._groups.size + self._side_rows
        self._add_cut_rows(cuts)

    def add(self, cuts: Cuts) -> None:
        """Add rows."""
        self.cuts = joined([self.cuts, cuts])
        self._add_cut_rows(cuts)

    def solve(self, choice: Choice, seconds: float) -> Fraction | None:
        """Solve for a node's `choice`, warm from the last basis; None if that failed or ran out."""
        highs = self._highs
        n = self.columns.size
        upper = choice.allowed[self.columns].astype(np.float64)
        highs.changeColsBounds(n, np.arange(n, dtype=np.int32), np.zeros(n), upper)
        g = self._groups.size
        lower = np.where(choice.used[self._groups], 1.0, -highspy.kHighsInf)
        highs.changeRowsBounds(g, np.arange(1, g + 1, dtype=np.int32), lower, np.ones(g))
        if np.isfinite(seconds):
            highs.setOptionValue("time_limit", highs.getRunTime() + max(seconds, 0.01))
        highs.run()
        if highs.getModelStatus() != highspy.HighsModelStatus.kOptimal:
            return None
        solution = highs.getSolution()
        values = np.array(solution.col_value)
        x = np.zeros(len(choice.group))
        x[self.columns] = np.clip(values[:n], 0.0, 1.0)
        z = np.zeros(self._n_samples)
        z[self._samples] = values[n:]
        dual = np.abs(np.array(solution.row_dual))
        price = dual[self._fixed_rows - self._side_rows : self._fixed_rows]
        return Fraction(x, z, dual[self._fixed_rows :], price)

    def _add_columns(self, count: int, upper: float, cost: float) -> None:
        empty = np.empty(0, dtype=np.int32)
        self._highs.addCols(
            count,
            np.full(count, cost),
            np.zeros(count),
            np.full(count, upper),
            0,
            np.zeros(count, dtype=np.int32),
            empty,
            np.empty(0),
        )

    def _add_matroid_rows(self, budget: int, members: IntArray) -> None:
        n, g = self.columns.size, self._groups.size
        everyone = np.arange(n, dtype=np.int32)
        order = np.argsort(members, kind="stable").astype(np.int32)
        sizes = np.bincount(members, minlength=g)
        self._add_rows(
            np.concatenate([[float(budget)], np.ones(g)]),
            np.concatenate([[0, n], n + np.cumsum(sizes)]),
            np.concatenate([everyone, order]),
            np.ones(2 * n),
        )

    def _add_side_rows(self, choice: Choice) -> None:
        """Add the rows A x ≤ b that are no part of the matroid: money, separation."""
        if self._side_rows:
            matrix = choice.side_matrix[:, self.columns].tocsr()
            self._add_rows(choice.side_limits, matrix.indptr, matrix.indices, matrix.data)

    def _add_cut_rows(self, cuts: Cuts) -> None:
        """Add z_t − Σ coefficient x ≤ constant; candidates without a column are 0."""
        column = self._column_of[cuts.candidate]
        kept = column >= 0
        row = np.repeat(np.arange(len(cuts)), np.diff(cuts.indptr))
        rows = np.concatenate([np.arange(len(cuts)), row[kept]])
        columns = np.concatenate([self._z_of[cuts.sample], column[kept]])
        values = np.concatenate([np.ones(len(cuts)), -cuts.coefficient[kept]])
        order = np.argsort(rows, kind="stable")
        starts = np.concatenate([[0], np.cumsum(np.bincount(rows, minlength=len(cuts)))])
        self._add_rows(cuts.constant, starts, columns[order], values[order])

    def _add_rows(
        self, upper: FloatArray, starts: IntArray, columns: IntArray, values: FloatArray
    ) -> None:
        count = len(upper)
        if not count:
            return
        self._highs.addRows(
            count,
            np.full(count, -highspy.kHighsInf),
            upper,
            len(columns),
            starts[:-1].astype(np.int32),
            columns.astype(np.int32),
            values,
        )


def _quiet_highs(threads: int) -> Any:
    with quiet_stdout():
        highs = highspy.Highs()
    highs.setOptionValue("output_flag", False)
    highs.setOptionValue("threads", threads)
    highs.changeObjectiveSense(highspy.ObjSense.kMaximize)
    highs.cbSimplexInterrupt.subscribe(_stop_if_asked)
    return highs


def _stop_if_asked(event: Any) -> None:
    """End a linear program once Ctrl-C was pressed; being called, Python sees the signal."""
    if asked_to_stop():
        event.interrupt()
