"""Bare information problems: any optimal design, without a road, from one `.npz` file or a table.

    prior (n, n), factors (c, n, r): candidate i adds F_i F_iᵀ
    budget: the most candidates, or where `cost` (c,) is given the most they may cost
    group (c,), optional: at most one candidate of each group; −1 for none
    objective, optional: "log_det" (maximised; the default) or "trace_inverse" (minimised)

Files are read without pickles, and every array's header is looked at before its data: an object
array, or one that would not fit into memory, is refused unread.
"""

from __future__ import annotations

import hashlib
import math
import zipfile
import zlib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import ArrayLike, NDArray

from models.geometry import FloatArray, IntArray
from placement.constraints import Constraints
from placement.objectives.log_det import LogDet
from placement.objectives.trace_inverse import TraceInverse
from placement.problem import Problem

MOST_BYTES = 4_000_000_000  # of all arrays of a file together
OBJECTIVES: dict[str, type[LogDet] | type[TraceInverse]] = {
    "log_det": LogDet,
    "trace_inverse": TraceInverse,
}
_NEEDED = ("prior", "factors", "budget")
_KNOWN = (*_NEEDED, "cost", "group", "objective")


@dataclass(frozen=True, slots=True)
class InformationProblem:
    """The arrays of the module's first lines, as they were given; `problem` checks them."""

    prior: FloatArray
    factors: FloatArray
    budget: float
    cost: FloatArray | None = None
    group: IntArray | None = None
    objective: str = "log_det"
    name: str = "problem"

    def problem(self) -> Problem:
        """Return what solvers take; see `information_problem` for what is refused."""
        return information_problem(
            self.prior, self.factors, self.budget, self.cost, self.group, self.objective
        )

    def changed(
        self, budget: float | None = None, objective: str | None = None
    ) -> InformationProblem:
        """Return this problem with another budget or objective."""
        return replace(
            self,
            budget=self.budget if budget is None else budget,
            objective=self.objective if objective is None else objective,
        )

    def sha256(self) -> str:
        """Hash what the problem means: its numbers and shapes, whatever the file's layout."""
        digest = hashlib.sha256(f"{self.objective} {float(self.budget)!r}".encode())
        for array in (self.prior, self.factors, self.cost, self.group):
            if array is not None:
                numbers = np.ascontiguousarray(array, dtype="<f8")
                digest.update(repr(numbers.shape).encode() + numbers.tobytes())
            digest.update(b";")
        return digest.hexdigest()

    def write(self, path: str | Path) -> None:
        """Write the problem as `.npz`, after checking that it is one."""
        self.problem()
        optional: dict[str, Any] = {
            name: array
            for name, array in (("cost", self.cost), ("group", self.group))
            if array is not None
        }
        with Path(path).open("wb") as file:
            np.savez_compressed(
                file,
                prior=self.prior,
                factors=self.factors,
                budget=np.asarray(self.budget),
                objective=np.asarray(self.objective),
                **optional,
            )


def information_problem(
    prior: ArrayLike,
    factors: ArrayLike,
    budget: float,
    cost: ArrayLike | None = None,
    group: ArrayLike | None = None,
    objective: str = "log_det",
) -> Problem:
    """Make the problem of the module's first lines.

    Raises:
        ValueError: naming the array, for what `DenseDesign` and `Constraints` refuse, a budget
            that is not a whole number of 0…c (without `cost`), a group outside −1…c − 1, or an
            unknown objective.
    """
    if objective not in OBJECTIVES:
        names = " or ".join(OBJECTIVES)
        raise ValueError(f"objective must be {names}, got {str(objective)[:40]!r}")
    design = OBJECTIVES[objective](prior, factors)
    c = design.n_candidates
    none = np.empty(0, dtype=np.int64)
    groups = np.full(c, -1) if group is None else np.asarray(group)
    if groups.shape != (c,) or not np.issubdtype(groups.dtype, np.integer):
        raise ValueError(
            f"group must hold {c} whole numbers, got shape {groups.shape} of {groups.dtype}"
        )
    if c and (groups.min() < -1 or groups.max() >= c):
        at = int(np.argmax((groups < -1) | (groups >= c)))
        raise ValueError(f"group[{at}] must lie in -1…{c - 1}, got {groups[at]}")
    groups = groups.astype(np.int64)
    if cost is None:
        if not (math.isfinite(budget) and budget == int(budget) and 0 <= budget <= c):
            raise ValueError(f"budget must be a whole number of 0…{c}, got {budget:g}")
        return Problem(design, Constraints(c, int(budget), groups, none, none))
    prices = np.asarray(cost, dtype=float)
    if not (math.isfinite(budget) and budget >= 0.0):
        raise ValueError(f"budget must be finite and at least 0, got {budget:g}")
    return Problem(design, Constraints(c, c, groups, none, none, cost=prices, money=float(budget)))


def read_problem(path: str | Path) -> InformationProblem:
    """Read a bare information problem from an `.npz` file, as arrays; `problem()` checks them.

    Raises:
        ValueError: one line naming the file and the array at fault.
    """
    path = Path(path)
    try:
        arrays = _read_arrays(path)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
    return InformationProblem(
        arrays["prior"],
        arrays["factors"],
        arrays["budget"].item(),
        arrays.get("cost"),
        arrays.get("group"),
        str(arrays["objective"].item()) if "objective" in arrays else "log_det",
        path.stem,
    )


def read_information_problem(path: str | Path) -> Problem:
    """Read a bare information problem from an `.npz` file.

    Raises:
        ValueError: one line naming the file and the array at fault.
    """
    found = read_problem(path)
    try:
        return found.problem()
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def write_information_problem(
    path: str | Path,
    prior: FloatArray,
    factors: FloatArray,
    budget: float,
    cost: FloatArray | None = None,
    group: NDArray[np.int64] | None = None,
    objective: str = "log_det",
) -> None:
    """Write a bare information problem, after checking that it is one."""
    InformationProblem(prior, factors, budget, cost, group, objective).write(path)


def _read_arrays(path: Path) -> dict[str, NDArray[Any]]:
    """Read the arrays of the file once their headers promise numbers of a bearable size."""
    try:
        with zipfile.ZipFile(path) as archive:
            total = 0
            for entry in archive.namelist():
                name = entry.removesuffix(".npy")
                if name not in _KNOWN or name == entry:
                    raise ValueError(f"holds {entry!r}, wanted arrays named {', '.join(_KNOWN)}")
                total += _checked_bytes(archive, entry, name)
            if total > MOST_BYTES:
                raise ValueError(f"arrays must take at most {MOST_BYTES:,} bytes, got {total:,}")
        with np.load(path, allow_pickle=False) as stored:
            arrays = {name: stored[name] for name in stored.files}
    except OSError as error:
        raise ValueError(error.strerror or str(error)) from None
    except (zipfile.BadZipFile, zlib.error, EOFError) as error:
        raise ValueError(f"is no whole .npz file ({error})") from None
    for name in _NEEDED:
        if name not in arrays:
            raise ValueError(f"lacks the array {name!r}")
    for name in ("budget", "objective"):
        if name in arrays and arrays[name].size != 1:
            what = "number" if name == "budget" else "word"
            raise ValueError(f"{name} must be one {what}, got shape {arrays[name].shape}")
    return arrays


def _checked_bytes(archive: zipfile.ZipFile, entry: str, name: str) -> int:
    """Return how many bytes the array takes, from its header alone; refuse what is no number."""
    with archive.open(entry) as stream:
        version = npy.read_magic(stream)
        if version == (1, 0):
            shape, _, dtype = npy.read_array_header_1_0(stream)
        elif version == (2, 0):
            shape, _, dtype = npy.read_array_header_2_0(stream)
        else:
            raise ValueError(f"{name} must be stored in version 1 or 2 of .npy, got {version}")
    if name == "objective" and dtype.kind == "U":
        return math.prod(shape) * dtype.itemsize
    if dtype.hasobject or dtype.kind not in "fiu":
        raise ValueError(f"{name} must hold real numbers, got {dtype}")
    return math.prod(shape) * dtype.itemsize
