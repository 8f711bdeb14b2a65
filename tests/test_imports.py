"""Imports run one way: models ← placement ← benchmarks, reports."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
MAY_IMPORT = {
    "models": {"models"},
    "placement": {"models", "placement"},
    "benchmarks": {"models", "placement", "benchmarks"},
    "reports": {"models", "placement", "benchmarks", "reports"},
}


def imported_packages(source: str) -> set[str]:
    """Return our top-level packages that `source` imports, at any depth of the file."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            names |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            names.add(node.module.split(".")[0])
    return names & MAY_IMPORT.keys()


@pytest.mark.parametrize(
    "path",
    [
        p.relative_to(ROOT).as_posix()
        for package in MAY_IMPORT
        for p in (ROOT / package).rglob("*.py")
    ],
)
def test_a_module_imports_only_from_rooms_below_it(path: str) -> None:
    allowed = MAY_IMPORT[path.split("/")[0]]
    assert imported_packages((ROOT / path).read_text()) <= allowed


def test_the_check_sees_an_import_against_the_grain() -> None:
    source = "def f():\n    from placement.solve import solve\n    return solve\n"
    assert not imported_packages(source) <= MAY_IMPORT["models"]
