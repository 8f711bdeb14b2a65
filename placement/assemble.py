"""From an instance to a problem: road, candidates, information, objective, constraints."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np

from models.errors import ErrorModel
from models.geometry import BoolArray, FloatArray, IntArray
from models.installation import Installation
from models.obstacles import Obstacles
from models.roads import Road, RoadPoints
from models.vehicle import PROFILES, OdometryNoise, from_alphas
from placement.candidates import Candidates, build_candidates
from placement.cluster import Work
from placement.constraints import Constraints, Infeasible
from placement.information import Information
from placement.information.join import side_by_side
from placement.instance import Instance, PoseSelector, load_instance
from placement.instance.schema import BudgetSection, VehicleSection
from placement.journeys import Journey, build_journeys
from placement.objectives.base import Objective
from placement.objectives.entropy import Entropy
from placement.objectives.final_entropy import FinalEntropy
from placement.objectives.kalman_gain import KalmanGain, kalman_gain
from placement.objectives.localisation import Localisation
from placement.objectives.navigation_chain import Drive
from placement.objectives.tolerance import Tolerance
from placement.objectives.trace import Trace
from placement.obstacles import build_obstacles
from placement.problem import Problem
from placement.roadway import build_road as build_road

# The dissertation's alphas are noise for each step of a filter at 25 Hz.
ALPHAS_HZ = 25.0


@dataclass(frozen=True, slots=True)
class Scene:
    """Hold an instance and all that follows from it; `problem` is what solvers see.

    `road` is the centre line along which mounts stand; `journeys` are the drives along it that the
    objective is about, and `points` and `information` are the first one's. `obstacles` are the
    buildings that block a camera's view.
    """

    instance: Instance
    road: Road
    candidates: Candidates
    journeys: tuple[Journey, ...]
    problem: Problem
    obstacles: Obstacles = field(default_factory=Obstacles)

    @property
    def points(self) -> RoadPoints:
        """The samples of the first journey."""
        return self.journeys[0].points

    @property
    def information(self) -> Information:
        """What the candidates tell about the first journey."""
        return self.journeys[0].information


def load(path_or_name: str | Path) -> Scene:
    """Read an instance file, or a shipped instance by name, and assemble it; raises as both do."""
    return assemble(load_instance(path_or_name))


def assemble(
    instance: Instance,
    work: Work | None = None,
    *,
    keep: Path | None = None,
    progress: Callable[[str, float | None], None] | None = None,
) -> Scene:
    """Turn an instance into a problem; `work` says where its information is computed.

    `keep` is a folder for what is done of a whole city's (`placement.information.quarters`).

    Raises:
        ValueError: one line that names the field at fault, if the instance cannot be built: a road
            file that cannot be read, a closed road that does not close, too many samples or
            candidates, a camera that no lens gives, a budget beyond the mounts, a required pose
            that is none or many, no candidate that sees the road.
        Infeasible: if the constraints contradict each other.
    """
    road = build_road(instance)
    candidates = build_candidates(instance, road)
    constraints = build_constraints(instance.budget, candidates)
    obstacles = build_obstacles(instance)
    journeys = build_journeys(
        instance, road, candidates.cameras, build_errors(instance), obstacles, work,
        keep=keep, progress=progress,
    )  # fmt: skip
    if not any(len(journey.information.indices) for journey in journeys):
        raise ValueError(
            f"none of {len(candidates):,} candidate poses reports a position anywhere on the road: "
            "see camera.pitch_deg, camera.max_range_m and errors.report_limit_m "
            f"({instance.errors.report_limit_m:g} m)"
        )
    problem = Problem(
        (
            KalmanGain(_kalman_gain(candidates, journeys))
            if instance.objective.kind == "kalman_gain"
            else build_objective(instance, journeys, constraints.cost)
        ),
        constraints,
        arc_length_m=candidates.arc_length_m,
        path_length_m=road.length_m,
        cheap_scores=partial(_kalman_gain, candidates, journeys),
    )
    return Scene(instance, road, candidates, tuple(journeys), problem, obstacles)


def _kalman_gain(candidates: Candidates, journeys: Sequence[Journey]) -> FloatArray:
    """Return each candidate's cheap score (c,), summed over the journeys."""
    scores: FloatArray = np.sum(
        [j.weight * kalman_gain(candidates.cameras, j.points, j.information) for j in journeys],
        axis=0,
    )
    return scores


def build_errors(instance: Instance) -> ErrorModel:
    """Make the error model of `[errors]`."""
    section = instance.errors
    return ErrorModel(
        kind=section.model,
        installation=Installation(
            position_95_m=section.position_95_m,
            orientation_95_deg=section.orientation_95_deg,
            algorithm_95_px=section.algorithm_95_px,
        ),
        persistent=section.persistent,
        report_limit_m=section.report_limit_m,
    )


def build_odometry(vehicle: VehicleSection) -> OdometryNoise:
    """Make the odometry noise of `[vehicle]`: alphas, or the profile with densities replaced."""
    if vehicle.alphas is not None:
        return from_alphas(vehicle.alphas, vehicle.speed_mps / ALPHAS_HZ)
    profile = PROFILES[vehicle.profile]
    heading, along, across = (
        vehicle.heading_deg_per_sqrt_m,
        vehicle.along_m_per_sqrt_m,
        vehicle.across_m_per_sqrt_m,
    )
    return OdometryNoise(
        heading_rad_per_sqrt_m=(
            profile.heading_rad_per_sqrt_m if heading is None else math.radians(heading)
        ),
        along_m_per_sqrt_m=profile.along_m_per_sqrt_m if along is None else along,
        across_m_per_sqrt_m=profile.across_m_per_sqrt_m if across is None else across,
    )


def build_objective(
    instance: Instance, journeys: Sequence[Journey], cost: FloatArray | None = None
) -> Objective:
    """Make the objective of `[objective]` over all `journeys`; `cost` (c,) prices candidates."""
    section, failures = instance.objective, instance.budget.failures
    if section.kind == "tolerance":
        return Tolerance(build_drives(instance, journeys), section.tolerance_m, failures, cost)
    if failures:
        raise ValueError(
            f"budget.failures must be 0 unless objective.kind = tolerance, got {failures} with "
            f"{section.kind}"
        )
    return OBJECTIVES[instance.objective.kind](instance, journeys)


def _localisation(instance: Instance, journeys: Sequence[Journey]) -> Objective:
    section = instance.objective
    information = side_by_side([journey.information for journey in journeys])
    weights = np.repeat([j.weight for j in journeys], [len(j.points) for j in journeys])
    if section.weights is not None:
        if len(journeys) > 1:
            raise ValueError("objective.weights must be left out with several objective.drives")
        if len(section.weights) != len(weights):
            raise ValueError(
                f"objective.weights must have one number for each of {len(weights)} path samples, "
                f"got {len(section.weights)}"
            )
        weights = weights * np.array(section.weights)
    return Localisation(information, section.prior_sigma_m, weights)


def _entropy(instance: Instance, journeys: Sequence[Journey]) -> Objective:
    return Entropy(build_drives(instance, journeys))


def _trace(instance: Instance, journeys: Sequence[Journey]) -> Objective:
    return Trace(build_drives(instance, journeys, mean=True), instance.objective.weight)


def _final_entropy(instance: Instance, journeys: Sequence[Journey]) -> Objective:
    return FinalEntropy(build_drives(instance, journeys, mean=True))


def build_drives(
    instance: Instance, journeys: Sequence[Journey], *, mean: bool = False
) -> list[Drive]:
    """Make what the navigation objectives filter: each journey with the instance's odometry.

    With `mean` their weights sum to one, so that the objective is an average over the drives.
    """
    if instance.objective.weights is not None:
        raise ValueError(
            f"objective.weights must be left out for objective.kind = {instance.objective.kind}: "
            "only localisation weighs samples"
        )
    vehicle = instance.vehicle
    odometry = build_odometry(vehicle)
    total = sum(journey.weight for journey in journeys) if mean else 1.0
    return [
        replace(drive, weight=drive.weight / total)
        for drive in (journey.drive(odometry, vehicle.initial_sigma) for journey in journeys)
    ]


# What each objective.kind is made of.
OBJECTIVES: Mapping[str, Callable[[Instance, Sequence[Journey]], Objective]] = {
    "entropy": _entropy,
    "final_entropy": _final_entropy,
    "localisation": _localisation,
    "trace": _trace,
}


def build_constraints(budget: BudgetSection, candidates: Candidates) -> Constraints:
    """Make the constraints of `[budget]` on `candidates`.

    A budget that is left out is the default, or with `budget.money` no limit, or as many as fit;
    one that is given must fit.
    """
    c = len(candidates)
    group = _groups(budget, candidates)
    most = int(np.unique(group[group >= 0]).size + np.sum(group < 0))
    given = "cameras" in budget.model_fields_set
    if budget.cameras > most and given:
        what = "mounts, one camera each" if budget.one_per_mount else "candidate poses"
        raise ValueError(
            f"budget.cameras must be at least 1 and at most {most}, the number of {what}, "
            f"got {budget.cameras}"
        )
    unlimited = budget.money is not None and not given
    constraints = Constraints(
        n=c,
        budget=most if unlimited else min(budget.cameras, most),
        group=group,
        required=_choose("budget.required", budget.required, candidates, only_one=True),
        forbidden=_choose("budget.forbidden", budget.forbidden, candidates, only_one=False),
        cost=_costs(budget, candidates),
        money=math.inf if budget.money is None else budget.money,
        place_m=(
            np.column_stack([candidates.mount_x_m, candidates.mount_y_m])[candidates.mount]
            if budget.separation_m
            else None
        ),
        separation_m=budget.separation_m,
    )
    if constraints.cost is not None and constraints.limits_money and not constraints.usable().any():
        raise Infeasible(
            f"budget.money must pay for one camera, the cheapest of which costs "
            f"{constraints.cost.min():.10g}, got {constraints.money:.10g}"
        )
    if not constraints.usable().any():
        raise Infeasible(
            f"budget.forbidden must leave one pose to choose, and forbids all {c}; "
            f"budget.cameras = {budget.cameras} asks for some"
        )
    return constraints


def _groups(budget: BudgetSection, candidates: Candidates) -> IntArray:
    """Number each candidate's group (c,): its mount's, or that of `budget.groups`; −1 for none."""
    m = candidates.n_mounts
    of_mount = np.arange(m) if budget.one_per_mount else np.full(m, -1)
    seen: dict[int, int] = {}
    for g, mounts in enumerate(budget.groups):
        for at, mount in enumerate(mounts):
            if mount >= m:
                raise ValueError(f"budget.groups[{g}][{at}] must be a mount 0…{m - 1}, got {mount}")
            if mount in seen:
                raise ValueError(
                    f"budget.groups[{g}][{at}] must be in no other group, got mount {mount}, "
                    f"which is in budget.groups[{seen[mount]}]"
                )
            seen[mount] = g
            of_mount[mount] = m + g
    group: IntArray = of_mount[candidates.mount]
    return group


def _costs(budget: BudgetSection, candidates: Candidates) -> FloatArray | None:
    """Return what each candidate costs (c,), or None where nothing has a price."""
    cost = candidates.cost.copy()
    for n, extra in enumerate(budget.costs):
        fits = _fits(extra, candidates)
        if not fits.any():
            raise ValueError(f"budget.costs[{n}] must fit a candidate, got one that fits none")
        cost[fits] += extra.cost
    return cost if budget.money is not None or cost.any() else None


def _choose(
    name: str,
    choices: Sequence[int | PoseSelector],
    candidates: Candidates,
    *,
    only_one: bool,
) -> IntArray:
    chosen: list[int] = []
    for n, choice in enumerate(choices):
        if isinstance(choice, int):
            if choice >= len(candidates):
                raise ValueError(
                    f"{name}[{n}] must be a candidate 0…{len(candidates) - 1}, got {choice}"
                )
            chosen.append(choice)
            continue
        fitting = np.flatnonzero(_fits(choice, candidates))
        if not fitting.size or (only_one and fitting.size > 1):
            wanted = "exactly one candidate" if only_one else "a candidate"
            given = ", ".join(
                f"{k} = {v}" for k, v in choice.model_dump(exclude_unset=True).items()
            )
            raise ValueError(
                f"{name}[{n}] must fit {wanted}, got {{{given}}}, which fits {fitting.size}"
            )
        chosen += fitting.tolist()
    return np.unique(np.array(chosen, dtype=np.int64))


def _fits(selector: PoseSelector, candidates: Candidates) -> BoolArray:
    """Mark the candidates that have all the values a selector gives, angles to 1e-6 degrees."""
    cameras = candidates.cameras
    fits = np.ones(len(candidates), dtype=np.bool_)
    if selector.mount is not None:
        fits &= candidates.mount == selector.mount
    if selector.height_m is not None:
        fits &= np.abs(cameras.height_m - selector.height_m) <= 1e-9
    if selector.yaw_deg is not None:
        turn = (candidates.yaw_deg - selector.yaw_deg + 180.0) % 360.0 - 180.0
        fits &= np.abs(turn) <= 1e-6
    if selector.pitch_deg is not None:
        fits &= np.abs(np.degrees(cameras.pitch_rad) - selector.pitch_deg) <= 1e-6
    if selector.fov_deg is not None:
        for fov, wanted in zip((cameras.hfov_rad, cameras.vfov_rad), selector.fov_deg, strict=True):
            fits &= np.abs(np.degrees(fov) - wanted) <= 1e-6
    if selector.type is not None:
        named = np.array([kind.name == selector.type for kind in candidates.kinds])
        fits &= named[candidates.kind]
    return fits
