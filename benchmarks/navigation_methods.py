"""Greedy and exchange on the navigation objectives of `winding`, white and persistent errors."""

from __future__ import annotations

import numpy as np

from models.vehicle import PROFILES
from placement.assemble import assemble
from placement.instance import load_instance
from placement.objectives.entropy import Entropy
from placement.objectives.navigation import NavigationObjective
from placement.objectives.navigation_chain import Drive
from placement.objectives.trace import Trace
from placement.problem import Problem
from placement.solve import solve

TIME_LIMIT_S = 60.0


def methods_table() -> str:
    """Return value and seconds of greedy and exchange, k = 20, as a table in Markdown."""
    lines = [
        "| errors | profile | objective | greedy | exchange | better by |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    for errors, model in (("white", "radius"), ("persistent", "covariance")):
        changes = {"errors.model": model, "errors.persistent": errors == "persistent"}
        scene = assemble(load_instance("winding").changed(changes))
        for profile, odometry in PROFILES.items():
            drive = Drive(scene.points, scene.information, odometry, np.array([0.1, 0.1, 0.01]))
            objectives: tuple[NavigationObjective, ...] = (
                Entropy([drive]),
                Trace([drive]),
            )
            for objective in objectives:
                objective.state().gains(np.arange(10))  # compiled before the clock starts
                problem = Problem(objective, scene.problem.constraints)
                greedy, exchange = (
                    solve(problem, method, time_limit_s=TIME_LIMIT_S)
                    for method in ("greedy", "exchange")
                )
                better = abs(exchange.value - greedy.value) / greedy.value
                lines.append(
                    f"| {errors} | `{profile}` | `{objective.name}` "
                    f"| {greedy.value:.5g} in {greedy.seconds:.1f} s "
                    f"| {exchange.value:.5g} in {exchange.seconds:.1f} s | {100 * better:.1f} % |"
                )
    return "\n".join(lines)
