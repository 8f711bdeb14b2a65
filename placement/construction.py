"""Which road to build: each judged with its own best cameras, and what the choice costs."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from models.construction.homotopy import spelled
from models.construction.search import BuiltRoad, Construction
from models.geometry import BoolArray, FloatArray
from placement.assemble import assemble
from placement.constraints import Infeasible
from placement.constructed import roads_of, section_of, with_road
from placement.instance import Instance
from placement.interrupts import asked_to_stop, stop_on_request
from placement.prediction import predict
from placement.solution import Solution, Status
from placement.solve import solve

# What cameras cost decides nothing where the number of cameras is given: then the error does.
FEWEST = "tolerance"
_JUDGE = "search"  # for `auto`: without a proof, which takes minutes a road


@dataclass(frozen=True, slots=True)
class Judged:
    """Hold a road, the instance that builds it, and its best cameras (None: no placement).

    `error_m2` is the mean along the road of the filter's position variance (its trace),
    `lateral_2sigma_m` the worst of twice its lateral sigma; `cost` is of road and cameras.
    """

    road: BuiltRoad
    instance: Instance
    solution: Solution | None
    why: str
    error_m2: float
    lateral_2sigma_m: float
    cost: float

    @property
    def cameras(self) -> int:
        """The number of cameras placed."""
        return 0 if self.solution is None else len(self.solution.selected)


@dataclass(frozen=True, slots=True)
class Choice:
    """Hold every road judged, which are on the Pareto front, and which one is built.

    `measure` names what stands against the length: "error_m2" for a given number of cameras,
    "cameras" where as few as keep a tolerance are placed. `interrupted`: Ctrl-C came before every
    road was judged.
    """

    construction: Construction
    judged: tuple[Judged, ...]
    front: tuple[bool, ...]
    chosen: int
    measure: str
    interrupted: bool = False

    def so_far(self) -> Solution | None:
        """Return what Ctrl-C leaves: the chosen road's placement; None if nobody interrupted."""
        solution = self.judged[self.chosen].solution
        if not self.interrupted or solution is None:
            return None
        stats = {**solution.stats, "stopped_by": "interrupt"}
        return replace(solution, status=Status.TIME_LIMIT, stats=stats)

    @property
    def instance(self) -> Instance:
        """The instance of the road chosen."""
        return self.judged[self.chosen].instance

    def table(self) -> pd.DataFrame:
        """Return `pareto.csv`: a row a road, shortest first."""
        rows = []
        for n, (one, front) in enumerate(zip(self.judged, self.front, strict=True)):
            solution = one.solution
            rows.append(
                {
                    "road": n,
                    "class": spelled(one.road.word),
                    "bends": one.road.kind,
                    "min_radius_m": one.road.min_radius_m,
                    "length_m": one.road.length_m,
                    "clearance_m": one.road.clearance_m,
                    "overlaps_itself": one.road.overlaps_itself,
                    "cameras": one.cameras if solution else math.nan,
                    "error_m2": one.error_m2,
                    "lateral_2sigma_m": one.lateral_2sigma_m,
                    "cost": one.cost,
                    "objective": solution.objective if solution else "",
                    "value": solution.value if solution else math.nan,
                    "method": solution.method if solution else "",
                    "status": str(solution.status) if solution else one.why,
                    "pareto": front,
                    "chosen": n == self.chosen,
                }
            )
        return pd.DataFrame(rows)


def choose_road(
    instance: Instance,
    method: str = "auto",
    *,
    time_limit_s: float = math.inf,
    seed: int = 0,
    progress: Callable[[str, float | None], None] = lambda _text, _fraction: None,
) -> Choice:
    """Find the roads of `[road.construct]`, place cameras along each, and choose one.

    `choose` = "error" takes the least error (or the fewest cameras for a tolerance), "length" the
    shortest, "cost" the cheapest by `cost_per_m` and the cameras' costs, "knee" the one on the
    Pareto front that is nearest to both its ends' best, each scaled to the front's range. Ties go
    to the shorter road. `auto` judges by `search`; the time limit is shared evenly. Ctrl-C while
    roads are judged chooses among those that were.

    Raises:
        ValueError: what is wrong with the site, why there is no road, or that along no road
            cameras can be placed.
        KeyboardInterrupt: for Ctrl-C before there is a road with cameras.
    """
    deadline = time.monotonic() + time_limit_s
    construction = roads_of(instance, progress)
    roads = _picked(construction.roads, section_of(instance).most_roads)
    judged: list[Judged] = []
    with stop_on_request():
        for n, road in enumerate(roads):
            progress(f"placing cameras along road {n + 1} of {len(roads)}", n / len(roads))
            share = max(0.0, deadline - time.monotonic()) / (len(roads) - n)
            one = judge(with_road(instance, road), road, method, time_limit_s=share, seed=seed)
            judged.append(one)
            if asked_to_stop():
                break
        interrupted = asked_to_stop()
    if interrupted and all(one.solution is None for one in judged):
        raise KeyboardInterrupt
    if all(one.solution is None for one in judged):
        raise ValueError(judged[0].why)
    measure = "cameras" if instance.objective.kind == FEWEST else "error_m2"
    length = np.array([one.road.length_m for one in judged])
    second = np.array(
        [math.inf if one.solution is None else float(getattr(one, measure)) for one in judged]
    )
    front = pareto(length, second)
    cost = np.array([one.cost for one in judged])
    chosen = _chosen(section_of(instance).choose, length, second, cost, front)
    return Choice(construction, tuple(judged), tuple(front.tolist()), chosen, measure, interrupted)


def judge(
    instance: Instance,
    road: BuiltRoad,
    method: str = "auto",
    *,
    time_limit_s: float = math.inf,
    seed: int = 0,
) -> Judged:
    """Place cameras along one road and predict the error of a car that drives it."""
    try:
        scene = assemble(instance)
        solver = _JUDGE if method == "auto" and instance.objective.kind != FEWEST else method
        solution = solve(scene.problem, solver, time_limit_s=time_limit_s, seed=seed)
    except (Infeasible, ValueError) as error:
        return Judged(road, instance, None, str(error), math.nan, math.nan, math.inf)
    if not solution.status.has_placement:
        return Judged(road, instance, None, str(solution.status), math.nan, math.nan, math.inf)
    prediction = predict(scene, solution.selected)
    selected = np.array(solution.selected, dtype=np.int64)
    constraints = scene.problem.constraints
    paid = 0.0 if constraints.cost is None else constraints.total_cost(selected)
    return Judged(
        road,
        instance,
        solution,
        "",
        float(np.mean(prediction.position_sigma_m**2)),
        float(2.0 * prediction.lateral_sigma_m.max()),
        section_of(instance).cost_per_m * road.length_m + paid,
    )


def pareto(first: FloatArray, second: FloatArray) -> BoolArray:
    """Mark what nothing else beats: (n,), (n,) both to be small; infinite is never marked.

    Of equals, the first is marked.
    """
    order = np.lexsort((np.arange(len(first)), second, first))
    marked = np.zeros(len(first), dtype=np.bool_)
    best = math.inf
    for n in order:
        if second[n] < best:
            marked[n] = True
            best = float(second[n])
    return marked


def _picked(roads: Sequence[BuiltRoad], most: int) -> list[BuiltRoad]:
    """Return at most `most` roads, short ones and few of a class first.

    A class's n-th road counts as 5 n % longer than it is: so every class that is not much longer
    than the shortest is judged, and the short classes with other radii and bends, too. Roads that
    overlap themselves are judged only where there are no others.
    """
    roads = [road for road in roads if not road.overlaps_itself] or list(roads)
    by_class: dict[tuple[int, ...], list[BuiltRoad]] = {}
    for road in roads:
        by_class.setdefault(road.word, []).append(road)
    ranked = [
        (road.length_m * (1.0 + 0.05 * rank), number, rank, road)
        for number, group in enumerate(by_class.values())
        for rank, road in enumerate(_spread(group))
    ]
    ranked.sort(key=lambda entry: entry[:3])
    return sorted((entry[3] for entry in ranked[:most]), key=lambda road: road.length_m)


def _spread(group: list[BuiltRoad]) -> list[BuiltRoad]:
    """Order a class's roads: the shortest, then those of other radii and bends by turns."""
    seen: set[tuple[str, float]] = set()
    first: list[BuiltRoad] = []
    later: list[BuiltRoad] = []
    for road in group:
        key = (road.kind, road.least_radius_m)
        (later if key in seen else first).append(road)
        seen.add(key)
    return first + later


def _chosen(
    how: str, length: FloatArray, second: FloatArray, cost: FloatArray, front: BoolArray
) -> int:
    placed = np.isfinite(second)
    if how == "length":
        ranked = np.where(placed, length, math.inf)
    elif how == "cost":
        ranked = np.where(placed, cost, math.inf)
    elif how == "error":
        ranked = second
    else:
        scaled = [_scaled(values, front) for values in (length, second)]
        ranked = np.where(front, np.hypot(*scaled), math.inf)
    # roads come shortest first, so the first of the best is the shortest of them
    return int(np.argmin(ranked))


def _scaled(values: FloatArray, front: BoolArray) -> FloatArray:
    low, high = values[front].min(), values[front].max()
    scaled: FloatArray = (values - low) / (high - low) if high > low else np.zeros(len(values))
    return scaled
