"""Fill the tables of docs/certificates.md: `python -m benchmarks.certificates_document [names]`.

Each table is measured anew, which takes up to an hour and a quarter for each kind of errors of
`entropy`, or is taken from a file that its benchmark wrote before (`--from DIR`: entropy.json,
persistent.json, roads.json, localisation.json, trees.json).
"""

from __future__ import annotations

import argparse
import json
import tempfile
from pathlib import Path
from typing import Any

from benchmarks import chain_bounds, embedded_trees, entropy_bounds
from benchmarks.documents import markdown, replace_table

DOCUMENT = Path(__file__).resolve().parent.parent / "docs" / "certificates.md"
NAMES = ("localisation", "entropy", "persistent", "roads", "trees")
ROADS = ("country-5km", "Norisring", "Spielberg", "Monza")
TARGETS = {  # the most that a gap may be, %, for k = 5, 10, 20, 40, 80
    "dissertation": (1.0, 1.0, 0.1, 0.1, 0.1),
    "car": (0.1, 0.5, 1.5, 1.0, 1.0),
    "robot": (0.1, 0.1, 0.1, 0.5, 2.0),
}


def main() -> None:
    """Measure or read the tables that are asked for, all by default."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("names", nargs="*", default=list(NAMES), help=f"of {', '.join(NAMES)}")
    parser.add_argument("--from", dest="folder", type=Path, help="read the numbers, measure none")
    options = parser.parse_args()
    for name in options.names:
        rows = measured(name) if options.folder is None else read(options.folder / f"{name}.json")
        text = DOCUMENT.read_text(encoding="utf-8")
        DOCUMENT.write_text(replace_table(text, name, table(rows)), encoding="utf-8")


def measured(name: str) -> list[dict[str, Any]]:
    """Run the benchmark behind a table and return its rows."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "rows.json"
        if name == "localisation":
            chain_bounds.main(["--json", str(path)])
        elif name == "trees":
            embedded_trees.main(["--json", str(path)])
        elif name == "roads":
            words = ["--roads", *ROADS, "--profiles", "car", "robot", "--budgets", "40"]
            entropy_bounds.main(["--json", str(path), *words])
        else:
            persistent = ["--persistent"] if name == "persistent" else []
            entropy_bounds.main(["--json", str(path), *persistent])
        return read(path)


def read(path: Path) -> list[dict[str, Any]]:
    """Read the rows that a benchmark wrote."""
    rows: list[dict[str, Any]] = json.loads(path.read_text(encoding="utf-8"))
    if not rows:
        raise ValueError(f"{path} must hold rows, found none")
    return rows


def table(rows: list[dict[str, Any]]) -> str:
    """Return a table in Markdown; gaps on `winding` stand beside what they should be at most."""
    columns = list(rows[0])
    if "profile" in columns and "road" not in columns:
        columns.insert(columns.index("gap, %") + 1, "wanted, %")
        for row in rows:
            at = entropy_bounds.BUDGETS.index(row["k"])
            row["wanted, %"] = f"≤ {TARGETS[row['profile']][at]:g}"
    cells = [[cell(row.get(column)) for column in columns] for row in rows]
    return markdown(columns, cells)


def cell(value: object) -> str:
    """Return one cell; whatever is missing is a dash, and `optimal` stands out."""
    if value is None:
        return "–"
    return "**optimal**" if value == "optimal" else str(value)


if __name__ == "__main__":
    main()
