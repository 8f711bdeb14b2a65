"""Each job is a row, whatever becomes of it; a run goes on where it was killed."""

from __future__ import annotations

import csv
import json
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.rivals.registry import RIVALS, Answer
from benchmarks.runner import worker
from benchmarks.runner.journal import Journal
from benchmarks.runner.results import TIMES, merge_repeats, to_csv
from benchmarks.runner.runner import Job, jobs_of, run_job
from benchmarks.runner.subjects import Case, load_subject
from benchmarks.runner.suites import SUITES, Suite, make_suite
from benchmarks.runner.summary import solver_table

DESIGN = Case(
    "tiny",
    "design",
    {
        "generator": "benchmarks.instances.generators:gaussian",
        "arguments": {"n": 3, "c": 12, "budget": 3, "prior": 0.1, "seed": 1},
    },
)
ROAD = Case("arc-50", "road", {"instance": "arc-50", "changes": {"budget.cameras": 2}})
TRACED = Case(
    "traced",
    "design",
    {"generator": "benchmarks.doptimal:traced", "arguments": {"c": 20, "k": 6, "seed": 0}},
)
SPARSE = Case(
    "sparse",
    "synthetic",
    {"candidates": 50, "samples": 80, "window": 6, "budget": 5, "seed": 0},
)
ONCE = Case("once", "coverage", {"instance": "arc-50", "times": 1})
TOY = Suite("toy", "a toy", (DESIGN,), {"design": ("greedy", "exchange")}, (0, 1), 2, 10.0)


def perform(case: Case, solver: str, seed: int = 0) -> dict[str, Any]:
    words = {"case": case.record(), "solver": solver, "seed": seed, "time_limit_s": 10.0}
    return worker.perform(words)


def test_jobs_go_round_the_solvers_before_they_repeat() -> None:
    keys = [(job.repeat, job.seed, job.solver) for job in jobs_of(TOY)]
    assert keys[:4] == [(0, 0, "greedy"), (0, 0, "exchange"), (0, 1, "greedy"), (0, 1, "exchange")]
    assert keys[4:] == [(1, *rest) for _, *rest in keys[:4]]


@pytest.mark.parametrize("case", [DESIGN, TRACED, ROAD, ONCE, SPARSE], ids=lambda case: case.name)
def test_one_seed_gives_one_value_and_the_referee_agrees(case: Case) -> None:
    first, second = perform(case, "exchange"), perform(case, "exchange")
    assert first["value"] == second["value"]
    assert first["selected"] == second["selected"]
    assert first["verified"]
    assert first["referee_value"] == pytest.approx(first["value"], rel=1e-6)


@pytest.mark.parametrize(
    ("answer", "status", "verified"),
    [
        (Answer([0, 1, 2, 3]), "broken_rules", False),
        (Answer([0, 0]), "broken_rules", False),
        (Answer([0, 99]), "broken_rules", False),
        (Answer([0, 1], bound=0.0), "wrong_bound", True),
        (Answer([0, 1], bound=float("inf")), "feasible", True),
        (Answer([0, 1], bound=1e9), "feasible", True),
    ],
)
def test_claims_are_judged_not_believed(answer: Answer, status: str, verified: bool) -> None:
    row = worker._judged(load_subject(DESIGN), answer, None)
    assert row["status"] == status
    assert row["verified"] is verified
    assert ("value" in row) == (status != "broken_rules")


def test_a_value_that_the_referee_does_not_find_is_denied() -> None:
    subject = load_subject(DESIGN)
    wrong = replace(subject, referee=lambda selected: replace(subject.referee(selected), value=1.0))
    assert not worker._judged(wrong, Answer([0, 1]), None)["verified"]


def test_what_cannot_be_said_is_a_row_that_says_so() -> None:
    row = perform(DESIGN, "chain")
    assert row["status"] == "cannot_say"
    assert "localisation" in row["note"]


def test_a_rival_that_is_not_installed_is_a_row_that_says_so(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    absent = replace(RIVALS["apricot"], needs=("no-such-distribution",))
    monkeypatch.setattr(worker, "RIVALS", {**RIVALS, "apricot": absent})
    row = perform(DESIGN, "apricot")
    assert (row["status"], row["note"]) == (
        "not_installed",
        "no-such-distribution is not installed",
    )


def test_a_rival_that_throws_is_a_row_that_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    broken = replace(RIVALS["highs"], target="benchmarks.rivals.highs:no_such", needs=())
    monkeypatch.setattr(worker, "RIVALS", {**RIVALS, "highs": broken})
    row = perform(DESIGN, "highs")
    assert row["status"] == "failed"
    assert "no_such" in row["note"]


def test_real_roads_that_are_not_there_are_a_row(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("PLACEMENT_DATA", raising=False)
    row = perform(Case("norisring", "road", {"real": "norisring"}), "greedy")
    assert row["status"] == "no_data"
    assert "tracks/Norisring.csv" in row["note"]


def test_a_job_over_its_hard_limit_is_killed_and_a_crash_is_told() -> None:
    killed = run_job(Job(DESIGN, "greedy", 0, 0), 10.0, 0.05)
    assert killed["status"] == "killed"
    assert killed["peak_memory_mb"] > 0.0
    crashed = run_job(Job(Case("x", "nonsense"), "greedy", 0, 0), 10.0, 60.0)
    assert crashed["status"] == "failed"
    assert "nonsense" in crashed["note"]


def _benchmark(out: Path) -> list[str]:
    start = "from placement.cli import main; main()"
    solvers = ["--solver", "greedy", "--solver", "exchange"]
    few = ["--instance", "legendre-5", *solvers, "--seeds", "4", "-q"]
    return [sys.executable, "-c", start, "benchmark", "smoke", "--out", str(out), *few]


def _told(out: Path) -> list[dict[str, str]]:
    """Return the rows of `results.csv` without what differs from run to run."""
    with (out / "results.csv").open() as file:
        return [{k: v for k, v in row.items() if k not in TIMES} for row in csv.DictReader(file)]


@pytest.mark.slow
def test_a_run_killed_again_and_again_loses_and_doubles_no_row(tmp_path: Path) -> None:
    killed, whole = tmp_path / "killed", tmp_path / "whole"
    journal = killed / "journal.jsonl"
    rng, kills, before = np.random.default_rng(0), 0, b""
    while kills < 40:
        process = subprocess.Popen(_benchmark(killed))  # noqa: S603
        lines = before.count(b"\n")
        # let it get one row further, so that it comes to an end, then kill at any moment
        while process.poll() is None and not (
            journal.exists() and journal.read_bytes().count(b"\n") > lines
        ):
            time.sleep(0.01)
        time.sleep(rng.uniform(0.0, 1.5))
        process.kill()
        if process.wait() == 0:
            break
        kills += 1
        after = journal.read_bytes()
        assert after.startswith(before[: before.rfind(b"\n") + 1])
        before = after
    assert kills > 4
    subprocess.run(_benchmark(killed), check=True)  # noqa: S603
    rows = [json.loads(line) for line in journal.read_bytes().splitlines()][1:]
    keys = [row["job"] for row in rows]
    assert sorted(keys) == sorted(
        f"legendre-5 {solver} {seed} 0" for solver in ("greedy", "exchange") for seed in range(4)
    )
    assert {"summary.csv", "summary.md", "gap_time.png", "scaling.svg"} <= {
        path.name for path in killed.iterdir()
    }
    # another run with the same seeds, never killed, tells the same
    subprocess.run(_benchmark(whole), check=True)  # noqa: S603
    assert _told(killed) == _told(whole)
    assert all(row["verified"] == "yes" for row in _told(whole))


def test_rows_of_repeats_become_one_with_every_second(tmp_path: Path) -> None:
    journal = Journal(tmp_path / "j", {})
    row = {"instance": "a", "solver": "s", "seed": 0, "value": 1.0, "verified": True}
    rows = [{**row, "seconds": s, "gap": None, "sense": "max"} for s in (0.3, 0.1, 0.2)]
    merged = merge_repeats("toy", rows)
    assert merged[0]["seconds"] == [0.3, 0.1, 0.2]
    assert merged[0]["seconds_median"] == 0.2
    text = to_csv(merged)
    assert "0.3 0.1 0.2" in text
    assert set(TIMES) <= set(text.splitlines()[0].split(","))
    other = merge_repeats("toy", [*rows, {**rows[0], "value": 2.0}])
    assert "repeats differ" in other[0]["note"]
    journal.close()


def test_the_summary_counts_best_and_proven() -> None:
    base = {"instance": "a", "seed": 0, "sense": "min", "verified": True, "status": "feasible"}
    rows = [
        {**base, "solver": "p", "value": 1.0, "gap": 0.0, "seconds_median": 2.0},
        {**base, "solver": "q", "value": 1.1, "gap": None, "seconds_median": 1.0},
        {**base, "solver": "r", "value": None, "gap": None, "seconds_median": None},
    ]
    p, q, r = solver_table(rows)
    assert (p["best"], p["proven"], p["slower_than_fastest"]) == (1, 1, 1.0)
    assert (q["best"], q["median_behind"]) == (0, pytest.approx(0.1))
    assert (r["solved"], r["best"]) == (0, 0)


@pytest.mark.parametrize("name", list(SUITES))
def test_every_suite_names_solvers_that_exist(name: str) -> None:
    from placement.solve import METHODS

    suite = make_suite(name)
    known = {*METHODS, *RIVALS}
    assert {solver for case in suite.cases for solver in suite.solvers_of(case)} <= known
    assert len({job.key for job in jobs_of(suite)}) == len(list(jobs_of(suite)))


def test_bad_arguments_are_named() -> None:
    with pytest.raises(ValueError, match="suite must be one of smoke"):
        make_suite("none")
    with pytest.raises(ValueError, match="--solver must be one of"):
        TOY.changed(solvers=["nobody"])
    with pytest.raises(ValueError, match="--instance must be one of tiny, got other"):
        TOY.changed(instances=["other"])
