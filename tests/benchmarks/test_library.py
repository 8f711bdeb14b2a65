"""Every instance of the library loads, and what is said to be known of it holds."""

from __future__ import annotations

import math
from importlib import resources
from pathlib import Path

import numpy as np
import pytest

from benchmarks import best_known, post
from benchmarks.instances import generators
from benchmarks.instances.library import LIBRARY
from benchmarks.runner.subjects import DATA_VARIABLE, load_subject
from placement.solve import METHODS, solve
from placement.verify import verify_folder

SHARED = Path(__file__).resolve().parents[3] / "shared" / "data"
BEST = best_known.read_best()
LARGE = {"country-5km", "winding", "circuit", "dense-2000"}


def test_there_are_thirty_or_more_of_graded_difficulty() -> None:
    assert len(LIBRARY) >= 30
    assert {entry.difficulty for entry in LIBRARY.values()} == {1, 2, 3, 4, 5}
    files = {f.name for f in resources.files("benchmarks.instances").iterdir()}
    shipped = {name.removesuffix(".toml") for name in files if name.endswith(".toml")}
    assert shipped == {e.name for e in LIBRARY.values() if e.source == "road"}


@pytest.mark.parametrize("name", list(LIBRARY))
def test_it_loads_and_its_best_known_value_is_what_its_placement_has(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    entry = LIBRARY[name]
    monkeypatch.setenv(DATA_VARIABLE, str(SHARED))
    if entry.source == "real" and not (SHARED / "tracks").is_dir():
        pytest.skip("needs the road files that the user supplies")
    subject = load_subject(entry.case())
    objective, constraints = subject.problem.objective, subject.problem.constraints
    assert name in BEST, "run python -m benchmarks.best_known"
    best = BEST[name]
    assert (best.objective, int(best.candidates)) == (objective.name, constraints.n)
    assert best.sense == ("max" if objective.maximise else "min")
    assert best.instance_sha256 == (subject.sha256 or "")
    selected = [int(i) for i in best.selected.split()]
    assert constraints.violations(selected) == []
    value = objective.value(np.array(selected, dtype=np.int64))
    assert value == pytest.approx(float(best.value), rel=1e-9)
    if name not in LARGE and entry.source != "real":
        verdict = subject.referee(selected)
        assert verdict.faults == ()
        assert verdict.value == pytest.approx(value, rel=1e-6)


def test_no_value_beats_its_bound_and_gaps_are_theirs() -> None:
    for name, best in BEST.items():
        assert name in LIBRARY
        assert int(best.difficulty) == LIBRARY[name].difficulty
        assert best.value_by
        assert best.reproduce.startswith("placement benchmark")
        if not best.bound:
            assert best.gap == ""
            continue
        sign = 1.0 if best.sense == "max" else -1.0
        value, bound = float(best.value), float(best.bound)
        assert sign * bound >= sign * value - 1e-9 * abs(value)
        assert float(best.gap) == pytest.approx(
            abs(bound - value) / abs(value), rel=0.01, abs=1e-12
        )
        assert METHODS[best.bound_by].proves_bound


def test_quick_methods_do_not_beat_what_is_known() -> None:
    for name in ("arc-50", "hairpin", "legendre-5", "trees-9", "required", "priced"):
        problem = load_subject(LIBRARY[name].case()).problem
        best = float(BEST[name].value)
        assert solve(problem, "exchange").value <= best * (1.0 + 1e-9)


def test_spanning_trees_are_counted() -> None:
    # Kirchhoff: K4 has 16 trees, and its cycle of four edges has four.
    arrays = generators.spanning_tree(nodes=4, edges=4, prior=1e-9)
    factors = arrays["factors"][:, :, 0]
    assert np.linalg.det(factors.T @ factors) == pytest.approx(16.0)
    assert float(BEST["trees-10"].value) == pytest.approx(
        math.log(10.0) + 9.0 * math.log(1e6), abs=1e-4
    )


def test_a_better_row_replaces_the_value_and_a_tighter_one_the_bound() -> None:
    row = {
        "instance": "arc-50", "objective": "localisation", "sense": "max", "candidates": "132",
        "budget": "3", "value": "10.0", "bound": "12.0", "solver": "greedy", "verified": "yes",
        "selected": "1 2", "instance_sha256": "x", "status": "feasible", "kind": "road",
        "seed": "0", "suite": "camera", "time_limit_s": "5.0",
    }  # fmt: skip
    first = best_known.merged({}, [row])
    assert first["arc-50"].gap == "0.2"
    worse = best_known.merged(first, [{**row, "value": "9.0", "bound": "13.0", "solver": "mip"}])
    assert worse == first
    both = best_known.merged(first, [{**row, "value": "11.0", "bound": "11.0", "solver": "mip"}])
    assert (both["arc-50"].value_by, both["arc-50"].bound_by) == ("mip", "mip")
    rival = best_known.merged(first, [{**row, "bound": "10.0", "solver": "scip"}])
    assert rival["arc-50"].bound == "12.0"  # a rival's bound is its word
    denied = best_known.merged(first, [{**row, "value": "99.0", "verified": "no"}])
    assert denied == first


def test_a_posted_placement_is_judged(tmp_path: Path) -> None:
    solution = post.post("arc-50", [100, 3, 40], tmp_path / "good", by="somebody")
    assert solution.selected == (3, 40, 100)
    assert verify_folder(tmp_path / "good").passed
    post.post("arc-50", [100, 3, 40], tmp_path / "boast", bound=-1.0)
    assert not verify_folder(tmp_path / "boast").passed
    with pytest.raises(ValueError, match="selected must be a placement"):
        post.post("arc-50", [0, 1, 2, 3, 4], tmp_path / "bad")
    assert not (tmp_path / "bad").exists()
