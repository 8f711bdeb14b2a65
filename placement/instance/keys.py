"""Every key of an instance file as a file that says what it is: for `placement keys`."""

from __future__ import annotations

import inspect
from collections.abc import Iterator
from typing import Annotated, Any, Literal, get_args, get_origin

from pydantic.fields import FieldInfo

from placement.instance.messages import shown
from placement.instance.schema import Document, PoseSelector
from placement.instance.values import Section

# What is said of keys that hold tables, or nothing by default.
EXAMPLES = {
    "road.pieces": "[{length = 200}, {length = 60, curvature = [0.0, 0.02]}]",
    "road.file": '"road.csv"',
    "road.construct": "{start = [0, 0, 0], goal = [300, 0, 0]}  # docs/construction.md",
    "road.closed": "true",
    "mounts.file": '"poles.geojson"',
    "camera.catalogue": '"types.csv"',
    "obstacles.file": '"buildings.geojson"',
    "vehicle.heading_deg_per_sqrt_m": "0.1",
    "vehicle.along_m_per_sqrt_m": "0.05",
    "vehicle.across_m_per_sqrt_m": "0.02",
    "vehicle.alphas": "[0.01, 0.01, 0.01, 0.01]",
    "objective.weights": "[1.0, 2.0, 1.0]",
    "objective.drives": '[{direction = "backward", offset_m = -1.5, weight = 1.0}]',
    "traffic.demand": '"trips.csv"',
    "budget.money": "15000.0",
    "budget.required": "[{mount = 3, yaw_deg = 90, pitch_deg = 35, fov_deg = [60, 45]}]",
    "budget.forbidden": "[{mount = 4}, {height_m = 6.0}]",
    "budget.costs": "[{mount = 3, cost = 500.0}]",
    "budget.groups": "[[0, 1, 2], [7, 8]]",
    "obstacles.polygons": "[[[10, 5], [20, 5], [20, 9]]]",
}


def key_lines() -> Iterator[str]:
    """Yield a TOML file of all defaults; keys that have none are comments with an example."""
    for table, field in Document.model_fields.items():
        section = field.annotation
        assert isinstance(section, type)  # noqa: S101 - for the type checker
        assert issubclass(section, Section)  # noqa: S101
        yield ""
        for line in (inspect.getdoc(section) or "").splitlines():
            yield f"# {line}".rstrip()
        yield f"[{table}]"
        for name, key in section.model_fields.items():
            yield from _key(f"{table}.{key.alias or name}", key)
    yield ""
    yield "# Poses in budget.required, forbidden and costs are named by any of these:"
    yield f"# {', '.join(PoseSelector.model_fields)}"


def _key(name: str, field: FieldInfo) -> Iterator[str]:
    key = name.partition(".")[2]
    words = _literals(field.annotation)
    choices = f"  # {' | '.join(map(shown, words))}" if words else ""
    if name in EXAMPLES:
        yield f"# {key} = {EXAMPLES[name]}"
    else:
        yield f"{key} = {_value(field.default)}{choices}"


def _literals(kind: Any) -> tuple[str, ...]:
    """List the words that a key may hold, where it holds one or some of a few."""
    if get_origin(kind) is Literal:
        return tuple(get_args(kind))
    inner = get_args(kind)
    if get_origin(kind) is Annotated or (get_origin(kind) is tuple and len(inner) == 2):
        return _literals(inner[0])
    return ()


def _value(value: Any) -> str:
    """Write a default as TOML, whatever its length."""
    if isinstance(value, tuple):
        return f"[{', '.join(map(_value, value))}]"
    return shown(value)
