"""The kinds of value an instance file may hold: intervals, tuples, and how they refuse."""

from __future__ import annotations

import math
from collections.abc import Hashable, Sequence
from typing import Annotated, Any, TypeVar

from pydantic import AfterValidator, BaseModel, ConfigDict, Field
from pydantic_core import PydanticCustomError

Number = float | int


class Section(BaseModel):
    """Be one table of an instance file: immutable, no unknown keys, no NaN, no guessed types."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)


def refuse(wanted: str, *, at: Sequence[str | int] = (), got: Any = ...) -> PydanticCustomError:
    """Make the error a validator raises: `wanted` reads on from the field's name.

    `at` leads from the validated value to the part at fault, and `got` is that part.
    """
    context: dict[str, Any] = {"wanted": wanted, "at": tuple(at)}
    if got is not ...:
        context["got"] = got
    return PydanticCustomError("instance", "{wanted}", context)


def interval(low: float, high: float, *, ends: str = "[]") -> AfterValidator:
    """Require a number between `low` and `high`; `ends` says which ends belong, as in `(]`."""

    def check(value: Number) -> Number:
        above = value > low or (ends[0] == "[" and value == low)
        below = value < high or (ends[1] == "]" and value == high)
        if above and below:
            return value
        if math.isinf(high):
            raise refuse(f"must be {'at least' if ends[0] == '[' else 'greater than'} {low:g}")
        raise refuse(f"must lie in {ends[0]}{low:g}, {high:g}{ends[1]}")

    return AfterValidator(check)


Item = TypeVar("Item", bound=Hashable)


def _check_list(items: tuple[Item, ...]) -> tuple[Item, ...]:
    if not items:
        raise refuse("must not be empty")
    for i, item in enumerate(items):
        if item in items[:i]:
            shown = list(item) if isinstance(item, tuple) else item
            raise refuse("must differ from the entries before it", at=(i,), got=shown)
    return items


def as_pair(value: Any) -> Any:
    """Take one number for two equal ones."""
    if isinstance(value, int | float) and not isinstance(value, bool):
        return (value, value)
    if not isinstance(value, list | tuple):
        raise refuse("must be a number or an array of two")
    return value


NOT_EMPTY_NOR_REPEATING = AfterValidator(_check_list)
LOOSE = Field(strict=False)  # a TOML array becomes a tuple; its items stay strict
NotNegative = Annotated[float, interval(0.0, math.inf, ends="[)")]
Pair = Annotated[tuple[float, float], LOOSE]


# Beyond what any road, car or camera is, so that no product of them leaves the floats.
Length = Annotated[float, interval(0.0, 1e6, ends="(]")]
Reach = Annotated[float, interval(0.0, 1e4, ends="(]")]
Offset = Annotated[float, interval(0.0, 1e3)]
Width = Annotated[float, interval(0.0, 1e3, ends="(]")]
Speed = Annotated[float, interval(0.0, 200.0, ends="(]")]
Prior = Annotated[float, interval(1e-6, 1e6)]
Alpha = Annotated[float, interval(0.0, 10.0)]
Sigma = Annotated[float, interval(0.0, 1e3)]
HeadingSigma = Annotated[float, interval(0.0, math.pi)]
Density = Annotated[float, interval(0.0, 1e2)]
Cost = Annotated[float, interval(0.0, 1e15)]
