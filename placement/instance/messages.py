"""Say what is wrong with an instance, one line a problem."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from pydantic import BaseModel, ValidationError

WANTED = {
    "float_type": "must be a number",
    "int_type": "must be an integer",
    "string_type": "must be a string",
    "bool_type": "must be true or false",
    "tuple_type": "must be an array",
    "model_type": "must be a table",
    "finite_number": "must be finite",
}


class InstanceError(ValueError):
    """An instance cannot be used; `problems` holds one line each, and so does the message."""

    def __init__(self, problems: Sequence[str], source: str = "") -> None:
        """Join the problems; `source` (a file's name) goes in front of each."""
        self.problems = tuple(f"{source}: {p}" if source else p for p in problems)
        super().__init__("\n".join(self.problems))


def dotted(location: Iterable[str | int]) -> str:
    """Write a place in the file as `camera.pitch_deg[2]`."""
    name = ""
    for part in location:
        name += f"[{part}]" if isinstance(part, int) else f".{part}" if name else part
    return name


def shown(value: Any) -> str:
    """Write a value as TOML would, shortened to fit a line."""
    if isinstance(value, bool):
        text = str(value).lower()
    elif isinstance(value, float):
        text = f"{value:.12g}"
    elif isinstance(value, str):
        text = f'"{value}"'
    elif isinstance(value, list | tuple):
        text = "[" + ", ".join(shown(v) for v in value) + "]"
    elif isinstance(value, Mapping):
        text = "{" + ", ".join(f"{k} = {shown(v)}" for k, v in value.items()) + "}"
    else:
        text = str(value)
    text = " ".join(text.split())
    return text if len(text) <= 80 else text[:77] + "…"


def describe(error: ValidationError, document: type[BaseModel]) -> list[str]:
    """Turn pydantic's findings about a `document` into one line each, in the file's order."""
    lines: list[str] = []
    for found in error.errors(include_url=False):
        line = _describe_one(dict(found), document)
        if line not in lines:
            lines.append(line)
    return lines


def _describe_one(found: dict[str, Any], document: type[BaseModel]) -> str:
    kind, context = found["type"], found.get("ctx", {})
    location = [part for part in found["loc"] if not _is_union_branch(part)]
    if kind == "instance":
        name = dotted([*location, *context["at"]])
        got = context.get("got", found["input"])
        # Words of our own (“none of them”) go in bare; what the file said goes in as TOML.
        text = got if isinstance(got, str) and "got" in context else shown(got)
        return f"{name} {context['wanted']}, got {text}"
    name = dotted(location)
    if kind == "extra_forbidden":
        return _describe_unknown(location, document)
    if kind == "missing":
        if isinstance(location[-1], int):
            return f"{dotted(location[:-1])} must have more entries, got {shown(found['input'])}"
        return f"{name} is missing"
    if kind == "too_long":
        return f"{name} must have {context['max_length']} entries, got {shown(found['input'])}"
    if kind == "literal_error":
        wanted = context["expected"].replace("'", '"')
        return f"{name} must be {wanted}, got {shown(found['input'])}"
    if kind == "int_type" and isinstance(found["input"], float):
        return f"{name} must be an integer, got the decimal number {found['input']!r}"
    wanted = WANTED.get(kind, found["msg"][:1].lower() + found["msg"][1:])
    return f"{name} {wanted}, got {shown(found['input'])}"


def _is_union_branch(part: str | int) -> bool:
    """Tell the tags our unions put into a location from keys of the file."""
    return isinstance(part, str) and part.startswith("<")


def _describe_unknown(location: Sequence[str | int], document: type[BaseModel]) -> str:
    parent: Any = document
    for part in location[:-1]:
        field = parent.model_fields.get(part) if isinstance(part, str) else None
        if field is None or not _is_model(field.annotation):
            parent = None
            break
        parent = field.annotation
    hint = ""
    if parent is not None:
        near = difflib.get_close_matches(str(location[-1]), parent.model_fields, n=1)
        hint = f" (did you mean {dotted([*location[:-1], near[0]])}?)" if near else ""
    return f"{dotted(location)} is not a key of instance files{hint}"


def _is_model(annotation: Any) -> bool:
    return isinstance(annotation, type) and issubclass(annotation, BaseModel)
