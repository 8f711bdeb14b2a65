"""The tables of docs/certificates.md, and what measures them, on small cases."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from benchmarks import chain_bounds, embedded_trees, entropy_bounds
from benchmarks.certificates_document import DOCUMENT, NAMES, read, table
from benchmarks.hostile import KINDS, as_problem, hostile_problem
from placement.constraints import Infeasible


def test_the_document_has_a_place_for_every_table() -> None:
    text = DOCUMENT.read_text(encoding="utf-8")
    assert all(f"<!-- table: {name} -->" in text for name in NAMES)


def test_gaps_stand_beside_what_is_wanted_and_what_is_missing_is_a_dash() -> None:
    row = {"profile": "car", "k": 20, "bound": None, "gap, %": 0.7, "status": "optimal"}
    lines = table([row]).splitlines()
    assert lines[0] == "| profile | k | bound | gap, % | wanted, % | status |"
    assert lines[2] == "| car | 20 | – | 0.7 | ≤ 1.5 | **optimal** |"


def test_a_file_without_rows_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "trees.json"
    path.write_text("[]")
    with pytest.raises(ValueError, match=r"trees\.json must hold rows, found none"):
        read(path)


def test_the_chain_is_measured_where_the_road_is_there(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "rows.json"
    words = ["--json", str(path), "--roads", "winding", "nowhere", "--budgets", "2"]
    chain_bounds.main([*words, "--tracks", str(tmp_path)])
    (row,) = json.loads(path.read_text())
    assert row["status"] == "optimal"
    assert row["bound"] == pytest.approx(row["value"], rel=1e-5)
    assert "nowhere: no file" in capsys.readouterr().err


def test_entropy_is_measured_on_other_roads(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "rows.json"
    words = ["--json", str(path), "--roads", "straight-80", "nowhere", "--budgets", "2"]
    entropy_bounds.main([*words, "--profiles", "car", "--tracks", str(tmp_path)])
    (row,) = json.loads(path.read_text())
    assert (row["road"], row["k"], row["status"]) == ("straight-80", 2, "optimal")
    assert row["poses"] > 2
    assert row["bound"] == pytest.approx(row["value"], rel=1e-5)
    assert "wanted" not in table([row])
    assert "nowhere: no file" in capsys.readouterr().err


def test_both_trees_find_the_same_optimum(tmp_path: Path) -> None:
    pytest.importorskip("pyscipopt")
    path = tmp_path / "rows.json"
    embedded_trees.main(["--json", str(path), "--cases", "straight-200"])
    ours, scip = json.loads(path.read_text())
    assert ours["value"] == pytest.approx(scip["value"], abs=1e-3)
    assert ours["gap, %"] == pytest.approx(0.0, abs=1e-4)


def test_hostile_problems_are_of_every_kind_and_repeat() -> None:
    contradictions = 0
    for seed in range(80):
        objective, rules = hostile_problem(seed)
        again, _ = hostile_problem(seed)
        assert objective.name == again.name == KINDS[seed % 4]
        try:
            as_problem(objective, rules)
        except Infeasible:
            contradictions += 1
    assert 2 <= contradictions <= 20
