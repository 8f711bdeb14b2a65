"""Documents whose tables a command writes: each stands between its mark and `<!-- end -->`."""

from __future__ import annotations

import argparse
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from placement.atomic import write_files


def existing(text: str) -> Path:
    """Take a document's path from a command line, and refuse one that is not there at once."""
    path = Path(text)
    if not path.is_file():
        raise argparse.ArgumentTypeError(f"must be a document that exists, got {text}")
    return path


def fill(path: Path, tables: Mapping[str, str]) -> None:
    """Replace the tables of these names in the document `path`; raises as `replace_table` does."""
    text = path.read_text(encoding="utf-8")
    for name, table in tables.items():
        text = replace_table(text, name, table)
    write_files(path.parent, {path.name: text})


def markdown(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table in Markdown."""
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def replace_table(text: str, name: str, table: str) -> str:
    """Return `text` with what stands between `<!-- table: NAME -->` and its end replaced.

    Raises:
        ValueError: if the text has no such marks.
    """
    pattern = re.compile(rf"(<!-- table: {re.escape(name)} -->\n).*?(<!-- end -->)", re.DOTALL)
    if not pattern.search(text):
        raise ValueError(f"the document must hold the mark <!-- table: {name} -->, found none")
    return pattern.sub(lambda match: f"{match[1]}{table}\n{match[2]}", text)


def table_of(text: str, name: str) -> str:
    """Return what stands between `<!-- table: NAME -->` and its end, as `replace_table` leaves it.

    Raises:
        ValueError: if the text has no such marks.
    """
    found = re.search(
        rf"<!-- table: {re.escape(name)} -->\n(.*?)\n?<!-- end -->", text, flags=re.DOTALL
    )
    if found is None:
        raise ValueError(f"the document must hold the mark <!-- table: {name} -->, found none")
    return found[1]


def replace_tables(text: str, tables: Mapping[str, str]) -> str:
    """Return `text` with every table that it marks replaced by the one of that name.

    Raises:
        ValueError: for a mark whose name is not known.
    """

    def table(match: re.Match[str]) -> str:
        name = match[1]
        if name not in tables:
            raise ValueError(f"table must be one of {', '.join(tables)}, got {name}")
        return f"<!-- table: {name} -->\n{tables[name]}\n<!-- end -->"

    marked = r"<!-- table: ([^\n]+?) -->\n(?:.*?\n)?<!-- end -->"
    return re.sub(marked, table, text, flags=re.DOTALL)
