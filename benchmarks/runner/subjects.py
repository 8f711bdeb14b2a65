"""What is solved: a case is a few words that travel to another process and become a problem there.

A `Subject` is the problem together with a referee that shares nothing with the solvers: it
recounts the rules and recomputes the value from the instance, by slower and plainer means.
"""

from __future__ import annotations

import importlib
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from models.geometry import FloatArray, IntArray
from placement.candidates import build_candidates
from placement.constraints import Constraints, count_only
from placement.information import Information
from placement.information_problem import InformationProblem
from placement.instance import Instance, instance_from_dict, load_instance
from placement.objectives.coverage import Coverage
from placement.objectives.localisation import Localisation
from placement.problem import Problem

DATA_VARIABLE = "PLACEMENT_DATA"
REAL = Path(__file__).resolve().parent.parent / "instances" / "real"


@dataclass(frozen=True, slots=True)
class Case:
    """One instance of a suite: its name, its kind (a row of `KINDS`), and what the kind needs."""

    name: str
    kind: str
    spec: Mapping[str, Any] = field(default_factory=dict)

    def record(self) -> dict[str, Any]:
        """Return the case as JSON carries it."""
        return {"name": self.name, "kind": self.kind, "spec": dict(self.spec)}


@dataclass(frozen=True, slots=True)
class Verdict:
    """What the referee derived: the value, and every rule that is broken."""

    value: float
    faults: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Subject:
    """A case made ready: what solvers see, what rivals may need besides, and the referee."""

    case: Case
    problem: Problem
    referee: Callable[[Sequence[int]], Verdict]
    sha256: str | None = None  # of the instance file, where there is one


class MissingDataError(ValueError):
    """A case refers to a file of the user's that is not there."""


def load_subject(case: Case) -> Subject:
    """Make the problem of `case`.

    Raises:
        MissingDataError: if it needs data that the user has not supplied.
        ValueError: for an unknown kind, or whatever the instance is refused for.
    """
    if case.kind not in KINDS:
        raise ValueError(f"kind must be one of {', '.join(KINDS)}, got {case.kind!r}")
    return KINDS[case.kind](case)


def tiny_subject(case: Case) -> Subject:
    """Return a problem like that of `case` with a dozen candidates, to load code on, untimed."""
    kind = case.kind
    if kind == "design":
        spec: dict[str, Any] = {"generator": "benchmarks.instances.generators:gaussian"}
        arguments = {"n": 3, "c": 12, "budget": 3, "prior": 1.0, "seed": 0}
        return load_subject(Case("tiny", "design", {**spec, "arguments": arguments}))
    if kind == "synthetic":
        sizes = {"candidates": 12, "samples": 30, "window": 5, "budget": 3, "seed": 0}
        return load_subject(Case("tiny", "synthetic", sizes))
    like = read_instance(case.spec)
    changes = {
        "objective.kind": like.objective.kind,
        "objective.weight": like.objective.weight,
        "errors.model": like.errors.model,
        "errors.persistent": like.errors.persistent,
        "budget.one_per_mount": False,  # which some rivals have no word for
        "road.pieces": [{"length": 40.0}],
        "road.sample_spacing_m": 2.0,
        "camera.yaw_deg": [180.0, 210.0],
        "camera.pitch_deg": [28.0],
        "camera.fov_deg": [[60.0, 60.0]],
        "budget.cameras": 2,
    }
    spec = {"instance": "straight-80", "changes": changes, "times": case.spec.get("times", 1)}
    return load_subject(Case("tiny", kind, spec))


def read_instance(spec: Mapping[str, Any]) -> Instance:
    """Read the instance that `spec` names: shipped, a file, or a road of the user's.

    `spec["real"]` names a file of `benchmarks/instances/real`, whose `road.file` lies in the user's
    data folder: `spec["data"]`, or else what the environment variable PLACEMENT_DATA names.

    Raises:
        MissingDataError: if that folder or the road in it is not there.
    """
    if "real" in spec:
        import tomllib

        folder = spec.get("data") or os.environ.get(DATA_VARIABLE)
        path = REAL / f"{spec['real']}.toml"
        data = tomllib.loads(path.read_text(encoding="utf-8"))
        road = data["road"]["file"]
        if not folder or not (Path(folder) / road).is_file():
            raise MissingDataError(
                f"needs {road} in the folder that --data or {DATA_VARIABLE} names, got {folder}"
            )
        instance = instance_from_dict(data, folder=folder, name=path.stem)
    else:
        instance = load_instance(str(spec["instance"]))
    changes = spec.get("changes") or {}
    return instance.changed(changes) if changes else instance


def _road(case: Case) -> Subject:
    from placement.assemble import assemble

    instance = read_instance(case.spec)
    scene = assemble(instance)
    return Subject(case, scene.problem, _road_referee(instance, None), sha256=instance.sha256())


def _coverage(case: Case) -> Subject:
    from placement.assemble import assemble

    instance = read_instance(case.spec)
    times = int(case.spec.get("times", 1))
    scene = assemble(instance)
    problem = replace(scene.problem, objective=Coverage(scene.information, times))
    return Subject(case, problem, _road_referee(instance, times), sha256=instance.sha256())


def _road_referee(instance: Instance, times: int | None) -> Callable[[Sequence[int]], Verdict]:
    """Judge by `placement.referee`; `times` asks for coverage instead of the instance's objective.

    Everything is rebuilt when asked, not before: a solver is not charged for it.
    """

    def judge(selected: Sequence[int]) -> Verdict:
        from placement.assemble import build_constraints
        from placement.referee.checks import Check
        from placement.referee.rules import form_check, rule_checks
        from placement.referee.values import eyes_of, rebuild, sights_of, value_of

        scene = rebuild(instance)
        candidates = build_candidates(instance, scene.road)
        constraints = build_constraints(instance.budget, candidates)
        checks: list[Check] = [form_check(list(selected), len(candidates))]
        if checks[0].passed:
            checks += rule_checks(instance, candidates, constraints, selected)
        faults = tuple(f"{c.name}: {c.got}" for c in checks if not c.passed)
        if not checks[0].passed:
            return Verdict(float("nan"), faults)
        sights = sights_of(scene, eyes_of(candidates, list(selected)))
        if times is None:
            return Verdict(value_of(scene, sights), faults)
        looks = np.zeros(len(scene.xy))
        for sight in sights:
            looks += np.asarray(sight.seen, dtype=np.float64)
        return Verdict(float(np.count_nonzero(looks >= times)), faults)

    return judge


def _design(case: Case) -> Subject:
    module, function = str(case.spec["generator"]).split(":")
    make = getattr(importlib.import_module(module), function)
    made = make(**case.spec.get("arguments", {}))
    design = made if isinstance(made, InformationProblem) else InformationProblem(**made)
    return Subject(case, design.problem(), _design_referee(design))


def _design_referee(design: InformationProblem) -> Callable[[Sequence[int]], Verdict]:
    """Judge a bare problem from its arrays: by QR of stacked roots, and rules by counting."""

    def judge(selected: Sequence[int]) -> Verdict:
        prior = np.asarray(design.prior, dtype=float)
        factors = np.asarray(design.factors, dtype=float)
        faults = _set_faults(selected, len(factors))
        if faults:
            return Verdict(float("nan"), tuple(faults))
        cost, group = design.cost, design.group
        spent = float(len(selected)) if cost is None else float(np.sum(np.asarray(cost)[selected]))
        if spent > float(design.budget) * (1.0 + 1e-9):
            faults.append(f"budget: {spent:.10g} spent of {design.budget:g}")
        if group is not None:
            held = [int(g) for g in np.asarray(group)[list(selected)] if g >= 0]
            if len(set(held)) < len(held):
                faults.append("group: one holds two")
        root = np.linalg.cholesky(prior).T
        stacked = np.vstack([root, *(factors[i].T for i in selected)])
        R = np.linalg.qr(stacked, mode="r")
        if design.objective == "trace_inverse":
            inverse = np.linalg.solve(R, np.eye(len(R)))
            return Verdict(float(np.sum(inverse * inverse)), tuple(faults))
        diagonal = np.abs(np.diag(R))
        gain = 2.0 * float(np.sum(np.log(diagonal)) - np.sum(np.log(np.diag(root))))
        return Verdict(gain, tuple(faults))

    return judge


def _synthetic(case: Case) -> Subject:
    """`localisation` by random windows along a line: no road, so a million candidates are quick."""
    spec = case.spec
    rng = np.random.default_rng(int(spec["seed"]))
    c, t, window = int(spec["candidates"]), int(spec["samples"]), int(spec["window"])
    start = rng.integers(0, t - window + 1, c)
    indices = (start[:, None] + np.arange(window)).astype(np.int32).reshape(-1)
    blocks = rng.lognormal(2.0, 1.0, (c * window, 1)).astype(np.float32)
    information = Information(t, np.arange(0, c * window + 1, window), indices, blocks)
    budget = int(spec["budget"])
    constraints: Constraints = count_only(c, budget)
    problem = Problem(Localisation(information, 0.5), constraints)

    def judge(selected: Sequence[int]) -> Verdict:
        faults = _set_faults(selected, c)
        if faults:
            return Verdict(float("nan"), tuple(faults))
        if len(selected) > budget:
            faults.append(f"budget: {len(selected)} of {budget}")
        total: FloatArray = np.full(t, 4.0)
        for i in selected:
            seen: IntArray = np.arange(start[i], start[i] + window)
            total[seen] += blocks[i * window : (i + 1) * window, 0]
        return Verdict(float(2.0 * np.sum(np.log(total) - np.log(4.0))), tuple(faults))

    return Subject(case, problem, judge)


def _set_faults(selected: Sequence[int], n: int) -> list[str]:
    faults = []
    if len(set(selected)) < len(selected):
        faults.append("a candidate comes twice")
    if any(not 0 <= i < n for i in selected):
        faults.append(f"a candidate lies outside 0…{n - 1}")
    return faults


KINDS: Mapping[str, Callable[[Case], Subject]] = {
    "road": _road,
    "coverage": _coverage,
    "design": _design,
    "synthetic": _synthetic,
}
