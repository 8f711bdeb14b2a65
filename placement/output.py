"""The folder of a solution: what `solve` writes and `validate`, `verify` and reports read."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from models.projections import Projection
from placement.assemble import Scene
from placement.atomic import Content
from placement.information import Information
from placement.instance import Instance, InstanceError, instance_from_dict
from placement.journeys import Journey
from placement.prediction import Prediction, predict
from placement.problem import Problem
from placement.solution import Solution, Status
from placement.validation import Validation

PACKAGES = ("roadside-placement", "numpy", "scipy", "numba", "cvxpy-base", "clarabel", "highspy")


@dataclass(frozen=True, slots=True)
class Stored:
    """What a solution folder holds: the instance as it was solved, and the selected candidates."""

    instance: Instance
    selected: tuple[int, ...]
    record: Mapping[str, Any]

    def solution(self, problem: Problem) -> Solution:
        """Return the stored solution, its value recomputed; its bound is as recorded.

        Raises:
            ValueError: if the selection is not a placement of `problem`.
        """
        broken = problem.constraints.violations(self.selected)
        if broken:
            raise ValueError(f"solution.json: selected is not a placement: {'; '.join(broken)}")
        objective = problem.objective
        bound = self.record.get("upper_bound" if objective.maximise else "lower_bound")
        try:
            return Solution(
                objective=objective.name,
                unit=objective.unit,
                maximise=objective.maximise,
                method=str(self.record["method"]),
                status=Status(self.record["status"]),
                selected=self.selected,
                value=objective.value(np.array(self.selected, dtype=np.int64)),
                bound=None if bound is None else float(bound),
                seconds=float(self.record["seconds"]),
                seed=int(self.record["seed"]),
                stats=dict(self.record["stats"]),
            )
        except (KeyError, TypeError, ValueError, OverflowError) as error:
            raise ValueError(f"solution.json: a field is missing or damaged ({error!r})") from None


def solution_files(
    scene: Scene, solution: Solution, prediction: Prediction | None
) -> dict[str, Content]:
    """Lay out the files of a solution; the tables only if there is a placement."""
    files: dict[str, Content] = {
        "instance.json": to_json(_instance_record(scene.instance)),
        "solution.json": to_json(solution_record(scene, solution)),
    }
    if prediction is not None:
        files["placements.csv"] = to_csv(cameras_table(scene, solution))
        files["along_path.csv"] = to_csv(path_table(scene, solution, prediction))
    return files


def validation_files(validation: Validation) -> dict[str, Content]:
    """Lay out the files of a validation."""
    return {
        "validation.csv": to_csv(validation.rows),
        "validation_summary.json": to_json(validation.summary),
    }


def solution_record(scene: Scene, solution: Solution) -> dict[str, Any]:
    """Return the content of `solution.json`; the bound is named for the side it is on."""
    cameras = cameras_table(scene, solution).to_dict(orient="records")
    name, sha256 = scene.instance.name, scene.instance.sha256()
    return record_of(name, scene.problem, solution, cameras, sha256)


def record_of(
    name: str, problem: Problem, solution: Solution, cameras: list[Any], sha256: str
) -> dict[str, Any]:
    """Return what is recorded of a solution, of a road or of a bare information problem."""
    return {
        "instance": name,
        "objective": solution.objective,
        "unit": solution.unit,
        "method": solution.method,
        "status": str(solution.status),
        "value": solution.value,
        "upper_bound" if solution.maximise else "lower_bound": solution.bound,
        "gap": solution.gap,
        "seconds": solution.seconds,
        "budget": problem.constraints.budget,
        "candidates": problem.constraints.n,
        **_money(problem, solution),
        "selected": sorted(solution.selected),
        "cameras": cameras,
        "stats": solution.stats,
        "seed": solution.seed,
        "versions": versions(),
        "instance_sha256": sha256,
    }


def solution_lines(
    solution: Solution, chosen: str, out: Path, digits: int = 6, took: str | None = None
) -> list[str]:
    """Say what was found: `chosen` says how many of what, numbers have so many digits.

    `took` says how long that was where it was not the solution's own seconds.
    """
    if not solution.status.has_placement:
        reason = solution.stats.get("reason") or solution.stats.get("error") or "no reason given"
        return [f"{solution.method}: {solution.status} ({reason}); recorded in {out}"]
    side = "at most" if solution.maximise else "at least"
    bound = f"{side} {solution.bound:.{digits}g} for any" if solution.bound is not None else ""
    gap = "" if solution.gap is None else f", gap {100 * solution.gap:.3g} %"
    return [
        f"{solution.method}: {solution.status}, {chosen}, {solution.objective} "
        f"{solution.value:.{digits}g} {solution.unit} ({bound or 'no bound'}{gap}) "
        f"in {took or f'{solution.seconds:.1f} s'}",
        f"results in {out}",
    ]


def cameras_table(scene: Scene, solution: Solution) -> pd.DataFrame:
    """Return one row a selected camera: where it stands, where it looks, how wide.

    With a catalogue also its `type`, and where anything has a price its `cost`.
    """
    chosen = np.array(sorted(solution.selected), dtype=np.int64)
    cameras = scene.candidates.cameras.subset(chosen)
    degrees = {
        "yaw_deg": np.degrees(cameras.yaw_rad) % 360.0,
        "pitch_deg": np.degrees(cameras.pitch_rad),
        "hfov_deg": np.degrees(cameras.hfov_rad),
        "vfov_deg": np.degrees(cameras.vfov_rad),
    }
    table = pd.DataFrame(
        {
            "mount": scene.candidates.mount[chosen],
            "x_m": cameras.x_m,
            "y_m": cameras.y_m,
            "height_m": cameras.height_m,
            **{name: np.round(values, 9) for name, values in degrees.items()},
            "projection": [Projection(int(kind)).name.lower() for kind in cameras.projection],
        }
    )
    kinds = scene.candidates.kinds
    if any(kind.name for kind in kinds):
        table["type"] = [kinds[kind].name for kind in scene.candidates.kind[chosen]]
    if scene.problem.constraints.cost is not None:
        table["cost"] = scene.problem.constraints.cost[chosen]
    return table


def _money(problem: Problem, solution: Solution) -> dict[str, Any]:
    """Return what the cameras cost and what there was, where anything has a price."""
    constraints = problem.constraints
    if constraints.cost is None:
        return {}
    spent = constraints.total_cost(np.array(solution.selected, dtype=np.int64))
    return {"cost": spent, "money": constraints.money if constraints.limits_money else None}


def path_table(scene: Scene, solution: Solution, prediction: Prediction) -> pd.DataFrame:
    """Return one row a path sample: where it is, and the error predicted for a car there.

    `prediction` is of the first journey. With several, each has its rows, in order, and a column
    `drive` tells them apart.
    """
    if len(scene.journeys) == 1:
        return _path_rows(scene.journeys[0], solution, prediction)
    tables = []
    for n, journey in enumerate(scene.journeys):
        along = prediction if n == 0 else predict(scene, solution.selected, n)
        table = _path_rows(journey, solution, along)
        table.insert(0, "drive", journey.name)
        tables.append(table)
    return pd.concat(tables, ignore_index=True)


def _path_rows(journey: Journey, solution: Solution, prediction: Prediction) -> pd.DataFrame:
    points = journey.points
    return pd.DataFrame(
        {
            "s_m": points.s_m,
            "x_m": points.x_m,
            "y_m": points.y_m,
            "curvature": points.curvature,
            "position_sigma_m": prediction.position_sigma_m,
            "lateral_2sigma_m": 2.0 * prediction.lateral_sigma_m,
            "cameras_seeing": cameras_seeing(journey.information, solution.selected),
        }
    )


def cameras_seeing(
    information: Information, selected: Sequence[int]
) -> np.ndarray[tuple[int], Any]:
    """Count the selected cameras that see each path sample, (t,)."""
    rows = [
        information.indices[information.indptr[i] : information.indptr[i + 1]] for i in selected
    ]
    seen = np.concatenate(rows) if rows else np.empty(0, dtype=np.int64)
    counts: np.ndarray[tuple[int], Any] = np.bincount(seen, minlength=information.n_samples)
    return counts


def placements_by_budget(
    folder: Path, n_candidates: int, selected: Sequence[int]
) -> dict[int, tuple[int, ...]]:
    """Return the placements of `budget_curve.csv` by k; none if there is no such file, or damage.

    The last of them is `selected`, the folder's own. Whether they are what they claim to be is for
    `placement verify` to say.
    """
    path = folder / "budget_curve.csv"
    if not path.exists():
        return {}
    try:
        table = pd.read_csv(path, dtype={"selected": str}, keep_default_na=False)
        curve = {
            int(k): tuple(int(i) for i in str(words).split())
            for k, words in zip(table["k"], table["selected"], strict=True)
        }
    except (OSError, KeyError, TypeError, ValueError):
        return {}
    whole = all(0 <= i < n_candidates for chosen in curve.values() for i in chosen)
    ends = bool(curve) and set(curve[max(curve)]) == set(selected)
    return curve if whole and ends else {}


def left_behind(folder: Path, names: Sequence[str], files: Mapping[str, Content]) -> list[str]:
    """List those of `names` that an older solution left in `folder`, but the new `files`.

    Where there is no solution, files of these names are a stranger's: none is listed.
    """
    if not (folder / "solution.json").exists():
        return []
    return [name for name in names if name not in files]


def read_folder(folder: Path, *, check_hash: bool = True) -> Stored:
    """Read back what `solve` wrote into `folder`, and check that its files still mean the same.

    `check_hash = False` leaves the instance's hash to the caller.

    Raises:
        ValueError: if there is no solution, it holds no placement, a file is damaged, or a file
            that the instance refers to has changed since.
    """
    record = _read_json(folder / "solution.json", "what `placement solve --out` writes")
    if (folder / "problem.npz").exists():
        raise ValueError(f"{folder} holds a bare information problem, and no road to drive along")
    source = _read_json(folder / "instance.json", "what `placement solve --out` writes")
    try:
        instance = instance_from_dict(
            source["instance"], folder=source["folder"], name=source["name"]
        )
        selected = tuple(map(_index if check_hash else int, record["selected"]))
        claimed = record["instance_sha256"]
    except InstanceError as error:
        raise ValueError(f"{folder / 'instance.json'}: {error}") from None
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise ValueError(f"{folder}: not a solution folder ({error!r})") from None
    if check_hash and instance.sha256() != claimed:
        raise ValueError(
            f"{folder}: the instance or a file it refers to changed since it was solved"
        )
    if str(record.get("status")) not in {str(s) for s in Status if s.has_placement}:
        raise ValueError(f"{folder}: status is {record.get('status')}, so there is no placement")
    return Stored(instance, selected, record)


def to_json(record: Mapping[str, Any]) -> str:
    """Write strict JSON: NumPy numbers as numbers, what is not finite as null."""
    return json.dumps(_plain(record), indent=2, allow_nan=False) + "\n"


def to_csv(table: pd.DataFrame) -> str:
    """Write a table as CSV with enough digits to read back 1e-9 relative."""
    text: str = table.to_csv(index=False, float_format="%.10g", lineterminator="\n")
    return text


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, np.generic):
        return _plain(value.item())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def _read_json(path: Path, wanted: str) -> dict[str, Any]:
    try:
        content = json.loads(path.read_text(encoding="utf-8"), parse_int=_whole)
    except OSError as error:
        raise ValueError(f"{path} must be {wanted}; cannot be read ({error.strerror})") from None
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{path} must be {wanted}; not JSON ({error})") from None
    if not isinstance(content, dict):
        raise ValueError(f"{path} must be {wanted}; got a {type(content).__name__}")
    return content


def _index(value: Any) -> int:
    if not isinstance(value, int) or isinstance(value, bool):
        raise ValueError(f"selected must be whole numbers, got {value!r}")
    if not -(2**63) <= value < 2**63:
        raise ValueError("selected must be candidates, got a number of more than 63 bits")
    return value


def _whole(digits: str) -> int | float:
    """Read a whole number; one that no float holds becomes infinite, and is refused as such."""
    return int(digits) if len(digits) <= 300 else float(digits)


def _instance_record(instance: Instance) -> dict[str, Any]:
    return {
        "name": instance.name,
        "folder": str(instance.folder),
        "instance": instance.as_dict(),
    }


def versions(packages: Sequence[str] = PACKAGES) -> dict[str, str]:
    """Return the versions of what a solution rests on, of those that are installed."""
    found = {}
    for name in packages:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found
