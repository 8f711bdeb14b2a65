"""What `placement keys` prints is a file that may be used, example by example."""

from __future__ import annotations

import re
import tomllib

import pytest

from placement.instance.keys import EXAMPLES, key_lines
from placement.instance.schema import Document

ROAD = {"pieces": [{"length": 60}]}


def test_the_defaults_are_those_of_an_empty_file() -> None:
    printed = tomllib.loads("\n".join(key_lines()))
    assert set(printed) == set(Document.model_fields)
    printed["road"] |= ROAD
    assert Document.model_validate(printed) == Document.model_validate({"road": ROAD})


def test_every_key_is_there() -> None:
    text = "\n".join(key_lines())
    for table, field in Document.model_fields.items():
        keys = re.split(r"^\[", text, flags=re.MULTILINE)
        (section,) = [part for part in keys if part.startswith(f"{table}]")]
        for name, key in field.annotation.model_fields.items():  # type: ignore[union-attr]
            assert re.search(rf"^(# )?{key.alias or name} = ", section, re.MULTILINE), name


@pytest.mark.parametrize("name", EXAMPLES)
def test_every_example_is_accepted(name: str) -> None:
    table, _, key = name.partition(".")
    value = tomllib.loads(f"x = {EXAMPLES[name]}")["x"]
    instead = key in ("pieces", "file", "construct")
    tables = {"road": {} if table == "road" and instead else dict(ROAD)}
    tables.setdefault(table, {})[key] = value
    Document.model_validate(tables)
