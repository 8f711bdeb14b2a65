"""Bare information problems: any D-optimal design, without a road, from one `.npz` file.

    prior (n, n), factors (c, n, r): candidate i adds F_i F_iᵀ     maximise log det
    budget: the most candidates, or where `cost` (c,) is given the most they may cost
    group (c,), optional: at most one candidate of each group; −1 for none

Files are read without pickles, and every array's header is looked at before its data: an object
array, or one that would not fit into memory, is refused unread.
"""

from __future__ import annotations

import math
import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import ArrayLike, NDArray

from models.geometry import FloatArray
from placement.constraints import Constraints
from placement.objectives.log_det import LogDet
from placement.problem import Problem

MOST_BYTES = 4_000_000_000  # of all arrays of a file together
_NEEDED = ("prior", "factors", "budget")
_KNOWN = (*_NEEDED, "cost", "group")


def information_problem(
    prior: ArrayLike,
    factors: ArrayLike,
    budget: float,
    cost: ArrayLike | None = None,
    group: ArrayLike | None = None,
) -> Problem:
    """Make the problem of the module's first lines.

    Raises:
        ValueError: naming the array, for what `LogDet` and `Constraints` refuse, a budget that is
            not a whole number of 0…c (without `cost`), or a group outside −1…c − 1.
    """
    objective = LogDet(np.asarray(prior, dtype=float), np.asarray(factors, dtype=float))
    c = objective.n_candidates
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
        return Problem(objective, Constraints(c, int(budget), groups, none, none))
    prices = np.asarray(cost, dtype=float)
    if not math.isfinite(budget):
        raise ValueError(f"budget must be finite, got {budget:g}")
    return Problem(
        objective, Constraints(c, c, groups, none, none, cost=prices, money=float(budget))
    )


def read_information_problem(path: str | Path) -> Problem:
    """Read a bare information problem from an `.npz` file.

    Raises:
        ValueError: one line naming the file and the array at fault.
    """
    path = Path(path)
    try:
        arrays = _read_arrays(path)
        return information_problem(
            arrays["prior"],
            arrays["factors"],
            arrays["budget"].item(),
            arrays.get("cost"),
            arrays.get("group"),
        )
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def write_information_problem(
    path: str | Path,
    prior: FloatArray,
    factors: FloatArray,
    budget: float,
    cost: FloatArray | None = None,
    group: NDArray[np.int64] | None = None,
) -> None:
    """Write a bare information problem, after checking that it is one."""
    information_problem(prior, factors, budget, cost, group)
    optional: dict[str, Any] = {
        name: array for name, array in (("cost", cost), ("group", group)) if array is not None
    }
    np.savez_compressed(path, prior=prior, factors=factors, budget=budget, **optional)


def read_experiments(path: str | Path) -> FloatArray:
    """Read a matrix of experiments, one a row, as rank-one factors (c, n, 1).

    Numbers separated by commas; a first line that is no numbers, or begins with '#', is a header.

    Raises:
        ValueError: one line naming the file and the line at fault.
    """
    path = Path(path)
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except OSError as error:
        raise ValueError(f"{path}: {error.strerror or error}") from None
    rows: list[list[float]] = []
    for number, line in enumerate(lines, start=1):
        text = line.strip()
        if not text or text.startswith("#"):
            continue
        try:
            row = [float(cell) for cell in text.split(",")]
        except ValueError:
            if number == 1:
                continue
            raise ValueError(f"{path}:{number}: wanted numbers, got {text[:40]!r}") from None
        if rows and len(row) != len(rows[0]):
            raise ValueError(f"{path}:{number}: wanted {len(rows[0])} numbers, got {len(row)}")
        if not all(map(math.isfinite, row)):
            raise ValueError(f"{path}:{number}: wanted finite numbers, got {text[:40]!r}")
        rows.append(row)
    if not rows:
        raise ValueError(f"{path}: holds no experiments")
    return np.array(rows)[:, :, None]


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
    if arrays["budget"].size != 1:
        raise ValueError(f"budget must be one number, got shape {arrays['budget'].shape}")
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
    if dtype.hasobject or dtype.kind not in "fiu":
        raise ValueError(f"{name} must hold real numbers, got {dtype}")
    return math.prod(shape) * dtype.itemsize
