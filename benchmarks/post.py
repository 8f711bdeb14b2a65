"""Turn somebody's list of candidates into a solution folder, for `placement verify` to judge.

`python -m benchmarks.post INSTANCE --selected "3 17 40" --by "Our solver 1.2" --out DIR` writes
what `placement solve` would have written; `--bound` is the poster's own. `placement verify DIR`
then recomputes everything from the instance.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

from benchmarks.instances.library import LIBRARY
from benchmarks.runner.subjects import read_instance
from placement.assemble import assemble
from placement.atomic import write_files
from placement.instance import load_instance
from placement.output import solution_files
from placement.prediction import predict
from placement.solution import OPTIMAL_GAP, Solution, Status


def post(
    source: str,
    selected: list[int],
    out: Path,
    *,
    bound: float | None = None,
    by: str = "posted",
    data: str | None = None,
) -> Solution:
    """Write a solution folder for the placement `selected` of the instance `source`.

    Raises:
        ValueError: if the instance is none of the library's roads and no file, or `selected`
            breaks its rules; nothing is written then.
    """
    if source in LIBRARY and LIBRARY[source].source == "generated":
        raise ValueError(
            f"instance must be a road, got {source}: post the row of results.csv for designs"
        )
    if source in LIBRARY:
        instance = read_instance(LIBRARY[source].case(data).spec)
    else:
        instance = load_instance(source)
    scene = assemble(instance)
    problem = scene.problem
    chosen = sorted(selected)
    broken = problem.constraints.violations(chosen)
    if broken:
        raise ValueError(f"selected must be a placement: {'; '.join(broken)}")
    objective = problem.objective
    value = objective.value(np.array(chosen, dtype=np.int64))
    proven = bound is not None and abs(bound - value) <= OPTIMAL_GAP * abs(value)
    solution = Solution(
        objective=objective.name,
        unit=objective.unit,
        maximise=objective.maximise,
        method=by,
        status=Status.OPTIMAL if proven else Status.FEASIBLE,
        selected=tuple(chosen),
        value=value,
        bound=bound,
        seconds=0.0,
        seed=0,
        stats={"posted": True},
    )
    write_files(out, solution_files(scene, solution, predict(scene, solution.selected)))
    return solution


def main() -> None:
    """Write a solution folder from a list of candidates."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("instance", help="a road of the library, or a TOML file")
    parser.add_argument("--selected", required=True, help="candidate numbers, with spaces")
    parser.add_argument("--bound", type=float, help="your bound on the value of any placement")
    parser.add_argument("--by", default="posted", help="who found it")
    parser.add_argument("--data", help="where your roads lie, for the real ones")
    parser.add_argument("--out", type=Path, required=True)
    given = parser.parse_args()
    try:
        selected = [int(word) for word in given.selected.split()]
        solution = post(
            given.instance, selected, given.out, bound=given.bound, by=given.by, data=given.data
        )
    except ValueError as error:
        sys.stderr.write(f"post: {error}\n")
        sys.exit(2)
    sys.stdout.write(
        f"{solution.objective} {solution.value!r}; now: placement verify {given.out}\n"
    )


if __name__ == "__main__":
    main()
