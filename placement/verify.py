"""The referee: everything a solution folder claims, checked again by slower and plainer means.

Rebuilt from the instance: the road, the candidates, the rules. Derived anew in plain NumPy
(`placement.referee`): what each selected camera sees and how well, the value, the error along the
path, and where it is cheap a bound. What is left on trust is said.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from models.geometry import FloatArray
from placement.assemble import build_constraints, build_road
from placement.candidates import Candidates, build_candidates
from placement.constraints import Constraints
from placement.output import Stored, read_folder
from placement.referee.bounds import Knapsack, score_bound
from placement.referee.checks import Check, is_number, near, none_of, same
from placement.referee.claims import VALUE_TOLERANCE, certificate_checks, curve_checks
from placement.referee.construction import construct_checks
from placement.referee.nearby import information_nearby, localisation_nearby
from placement.referee.rules import camera_checks, form_check, rule_checks
from placement.referee.sight import Eye
from placement.referee.tables import maybe, number, read_csv, whole
from placement.referee.tolerance import tolerance_value
from placement.referee.values import (
    MAXIMISED,
    UNITS,
    Scene,
    eyes_of,
    filtered,
    lateral_variance,
    rebuild,
    sights_of,
    whole_value,
)
from placement.referee.views import pairs_within_reach
from placement.roadway import STREETS

PATH_TOLERANCE = 1e-5
# Pairs of pose and sample within reach up to which a bound is derived, one by one in plain NumPy.
MOST_PAIRS = 250_000_000
# Bounds that are taken on trust, and why.
NOT_DERIVED = {
    "tolerance": "its labels are not followed here",
    "kalman_gain": "a sum of the best single scores, of which only the selected are recomputed",
}


@dataclass(frozen=True, slots=True)
class Verification:
    """What the referee found: the checks, what was taken on trust, and its own bound."""

    checks: list[Check]
    trusted: list[str] = field(default_factory=list)
    bound: dict[str, Any] = field(default_factory=dict)

    @property
    def passed(self) -> bool:
        """Whether every check holds."""
        return all(check.passed for check in self.checks)

    def record(self) -> dict[str, Any]:
        """Return the content of `verification.json`."""
        return {
            "passed": self.passed,
            "checks": [check.record() for check in self.checks],
            "trusted": self.trusted,
            "bound": self.bound,
        }

    def summary(self) -> str:
        """Return one line: verified, or what is wrong."""
        failed = [check for check in self.checks if not check.passed]
        if failed:
            first = failed[0]
            more = f", and {len(failed) - 1} more" if len(failed) > 1 else ""
            return (
                f"NOT verified: {first.name} must be {_short(first.expected)}, "
                f"got {_short(first.got)}{more}"
            )
        trust = f"; on trust: {'; '.join(self.trusted)}" if self.trusted else ""
        return f"verified: all {len(self.checks)} checks hold{trust}"


def verify_folder(
    folder: Path, progress: Callable[[str, float | None], None] | None = None
) -> Verification:
    """Check what `solve` wrote into `folder`.

    Raises:
        ValueError: if there is no placement to check, a file is damaged, or the instance holds
            something the referee does not know.
    """
    tell = progress or (lambda _text, _fraction: None)
    if (folder / "problem.npz").exists():
        from placement.referee.dense import dense_checks, read_record

        tell("recomputing densely", None)
        return Verification(*dense_checks(folder, read_record(folder), certificate_checks))
    stored = read_folder(folder, check_hash=False)
    tell("rebuilding the instance", None)
    scene = rebuild(stored.instance)
    road = build_road(stored.instance)
    candidates = build_candidates(stored.instance, road)
    constraints = build_constraints(stored.instance.budget, candidates)
    record = stored.record
    checks = [
        same("instance_sha256", stored.instance.sha256(), record.get("instance_sha256")),
        form_check(record.get("selected"), len(candidates)),
        *_headings(stored, candidates, constraints),
        *construct_checks(stored.instance, road),
    ]
    selected = sorted({i for i in stored.selected if 0 <= i < len(candidates)})
    checks += rule_checks(stored.instance, candidates, constraints, selected)
    checks += camera_checks(candidates, constraints, selected, record.get("cameras"), "cameras")
    checks += camera_checks(
        candidates, constraints, selected, _placements(folder), "placements.csv"
    )
    tell("looking through every camera", None)
    eyes = eyes_of(candidates, selected)
    if scene.instance.objective.kind == "tolerance":
        value, more = tolerance_value(scene, eyes, selected, constraints)
        checks += more
    elif scene.instance.objective.kind == "localisation":
        value = localisation_nearby(scene, eyes)
    else:
        value = whole_value(scene, eyes)
    checks.append(near("value", value, record.get("value"), VALUE_TOLERANCE * abs(value)))
    checks += _path_checks(folder, scene, eyes)
    checks += certificate_checks(record, value, scene.instance.objective.kind in MAXIMISED)
    if (folder / "budget_curve.csv").exists():
        tell("checking the budget curve", None)
        checks += curve_checks(folder / "budget_curve.csv", scene, candidates, constraints)
    tell("deriving a bound", None)
    trusted, bound = _bound(scene, candidates, constraints, selected, value, record, checks)
    return Verification(checks, trusted, bound)


def _headings(stored: Stored, candidates: Candidates, constraints: Constraints) -> list[Check]:
    kind, record = stored.instance.objective.kind, stored.record
    seconds, seed = record.get("seconds"), record.get("seed")
    good_seed = isinstance(seed, int) and not isinstance(seed, bool) and seed >= 0
    return [
        same("instance", stored.instance.name, record.get("instance")),
        same("objective", kind, record.get("objective")),
        same("unit", _unit(kind, constraints), record.get("unit")),
        same("budget", constraints.budget, record.get("budget")),
        same("candidates", len(candidates), record.get("candidates")),
        Check("seconds", is_number(seconds) and seconds >= 0.0, "a number of at least 0", seconds),
        Check("seed", good_seed, "a whole number of at least 0", seed),
        *_money(stored, constraints),
    ]


def _unit(kind: str, constraints: Constraints) -> str:
    return "money" if kind == "tolerance" and constraints.cost is not None else UNITS[kind]


def _money(stored: Stored, constraints: Constraints) -> list[Check]:
    if constraints.cost is None:
        return []
    chosen = [i for i in stored.selected if 0 <= i < constraints.n]
    spent = math.fsum(constraints.cost[i] for i in chosen)
    return [
        near("cost", spent, stored.record.get("cost"), 1e-9 * spent),
        same("money", stored.instance.budget.money, stored.record.get("money")),
    ]


def _path_checks(folder: Path, scene: Scene, eyes: Sequence[Eye]) -> list[Check]:
    """Check every column of `along_path.csv` against the drives filtered here."""
    table = read_csv(folder / "along_path.csv")
    lengths = [len(drive.xy) for drive in scene.drives()]
    checks = [same("along_path.csv.rows", sum(lengths), len(table))]
    if len(table) != sum(lengths):
        return checks
    for drive, stop in zip(scene.drives(), np.cumsum(lengths), strict=True):
        rows = table[stop - len(drive.xy) : stop]
        if scene.others:
            names = [row.get("drive") for row in rows]
            wrong = [f"{name!r}, wanted {drive.name!r}" for name in names if name != drive.name]
            checks.append(none_of("along_path.csv.drive", wrong[:1]))
        checks += _drive_checks(rows, drive, eyes)
    return checks


def _drive_checks(table: list[dict[str, str]], scene: Scene, eyes: Sequence[Eye]) -> list[Check]:
    checks = []
    P, seeing = _standing(scene, eyes) if scene.name == STREETS else _driving(scene, eyes)
    columns: dict[str, tuple[FloatArray, float]] = {
        "s_m": (scene.track.s_m, 1e-6),
        "x_m": (scene.track.x_m, 1e-6),
        "y_m": (scene.track.y_m, 1e-6),
        "curvature": (scene.curvature, 1e-9),
        "position_sigma_m": (np.sqrt(P[:, 0, 0] + P[:, 1, 1]), 1e-9),
        "lateral_2sigma_m": (2.0 * np.sqrt(lateral_variance(scene, P)), 1e-9),
        "cameras_seeing": (seeing, 0.0),
    }
    for name, (expected, absolute) in columns.items():
        relative = 0.0 if name == "cameras_seeing" else PATH_TOLERANCE
        got = np.array([number(row.get(name)) for row in table])
        off = ~(np.abs(got - expected) <= absolute + relative * np.abs(expected))
        faults = [f"row {n} is {got[n]:.9g}, wanted {expected[n]:.9g}" for n in np.flatnonzero(off)]
        checks.append(none_of(f"along_path.csv.{name}", faults))
    return checks


def _standing(scene: Scene, eyes: Sequence[Eye]) -> tuple[FloatArray, FloatArray]:
    """Return the covariance (t, 2, 2) of a car that stands, and how many cameras see it."""
    information, seeing = information_nearby(scene, eyes)
    return np.linalg.inv(information).astype(np.float64), seeing.astype(np.float64)


def _driving(scene: Scene, eyes: Sequence[Eye]) -> tuple[FloatArray, FloatArray]:
    """Return the covariance (t, 3, 3) of a car that drives, and how many cameras see it."""
    sights = sights_of(scene, eyes)
    seeing = np.sum([sight.seen for sight in sights], axis=0) if sights else np.zeros(len(scene.xy))
    return filtered(scene, sights).covariance, np.asarray(seeing, dtype=np.float64)


def _bound(
    scene: Scene,
    candidates: Candidates,
    constraints: Constraints,
    selected: list[int],
    value: float,
    record: Mapping[str, Any],
    checks: list[Check],
) -> tuple[list[str], dict[str, Any]]:
    """Derive a bound, compare it with the recorded one, and say what is left on trust."""
    maximise = scene.instance.objective.kind in MAXIMISED
    side = "upper_bound" if maximise else "lower_bound"
    recorded = record.get(side)
    found: dict[str, Any] = {"recorded": recorded, "derived": None}
    if not is_number(recorded):
        return [], found
    if scene.instance.objective.kind in NOT_DERIVED:
        why = NOT_DERIVED[scene.instance.objective.kind]
        return [f"{side} {recorded:.6g} ({why})"], found
    if sum(pairs_within_reach(drive, candidates) for drive in scene.drives()) > MOST_PAIRS:
        why = f"{len(candidates):,} poses are too many to look through one by one"
        return [f"{side} {recorded:.6g} ({why})"], found
    # Left out of the knapsack: separation and required poses, which only lower the bound.
    knapsack = Knapsack(
        constraints.usable(),
        constraints.group,
        constraints.budget,
        constraints.cost,
        constraints.purse,
    )
    bound = _weighted_bound(scene, candidates, knapsack, selected)
    if bound is None:
        why = "its cameras' persistent errors couple all their frames"
        return [f"{side} {recorded:.6g} ({why})"], found
    sign = 1.0 if maximise else -1.0
    derived = sign * bound
    found |= {"derived": derived}
    if value:
        found["derived_gap"] = abs(derived - value) / abs(value)
    slack = VALUE_TOLERANCE * abs(value)
    checks.append(
        Check("bound.derived", bound >= sign * value - slack, f"beyond {value!r}", derived, slack)
    )
    if sign * recorded >= bound - slack:
        return [], found
    return [f"{side} {recorded:.6g}, tighter than the {derived:.6g} derived here"], found


def _weighted_bound(
    scene: Scene, candidates: Candidates, knapsack: Knapsack, selected: list[int]
) -> float | None:
    """Sum the bounds of the drives: a bound on the sum; None where one has none."""
    total = 0.0
    for drive in scene.drives():
        part = score_bound(drive, candidates, knapsack, selected)
        if part is None:
            return None
        total += drive.weight * part
    return total


def _placements(folder: Path) -> list[dict[str, Any]]:
    rows = read_csv(folder / "placements.csv")
    return [
        {
            key: whole(text) if key == "mount" else text if key == "type" else maybe(text)
            for key, text in row.items()
        }
        for row in rows
    ]


def _short(value: Any) -> str:
    text = value if isinstance(value, str) else json.dumps(value, default=str)
    return text if len(text) <= 120 else text[:117] + "…"
