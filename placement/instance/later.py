"""What the schema knows and the program does not do yet: refused by name.

Whoever builds one of these deletes its row. Nothing else keeps a list.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from placement.instance.messages import shown
from placement.instance.schema import Document


@dataclass(frozen=True, slots=True)
class Later:
    """A value that is refused for now: the key, a test on its value, what to do instead."""

    key: str
    refuses: Callable[[object], bool]
    instead: str


LATER: tuple[Later, ...] = ()


def refusals(document: Document) -> list[str]:
    """List, one line each, what `document` asks for that is not built yet."""
    found = []
    values = document.model_dump(by_alias=True)
    for row in LATER:
        section, key = row.key.split(".")
        value = values[section][key]
        if value is not None and row.refuses(value):
            what = f" = {shown(value)}" if isinstance(value, str | float | int) else ""
            found.append(f"{row.key}{what} is not supported yet: {row.instead}")
    return found
