"""The keys of `[road]`: pieces, a file, or a road to be constructed around obstacles."""

from __future__ import annotations

import math
from typing import Annotated, Literal, Self

from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from placement.instance.values import (
    LOOSE,
    NOT_EMPTY_NOR_REPEATING,
    Length,
    NotNegative,
    Pair,
    Reach,
    Section,
    Width,
    as_pair,
    interval,
    refuse,
)

Curvature = Annotated[
    tuple[Annotated[float, interval(-10.0, 10.0)], Annotated[float, interval(-10.0, 10.0)]],
    LOOSE,
    BeforeValidator(as_pair),
]
Polygon = Annotated[tuple[Pair, ...], LOOSE]


def _check_polygons(polygons: tuple[Polygon, ...]) -> tuple[Polygon, ...]:
    for i, polygon in enumerate(polygons):
        if len(set(polygon)) < 3:
            raise refuse(
                "must have at least 3 different corners", at=(i,), got=[list(p) for p in polygon]
            )
    return polygons


Polygons = Annotated[tuple[Polygon, ...], LOOSE, AfterValidator(_check_polygons)]


class PieceSection(Section):
    """One piece of a road: its curvature is one number, or runs linearly from start to end."""

    length: Length
    curvature: Curvature = (0.0, 0.0)


class ConstructSection(Section):
    """A road to be chosen between two poses (x, y, heading_deg), around obstacles.

    Its edges keep `clearance_m` from `obstacles` and from those of `[obstacles]`; both block views.
    Roads of `radius_factors` × `min_radius_m` are looked for in every homotopy class within
    `length_factor` of the shortest, as lines and arcs, with clothoids, or `both`; at most
    `most_roads` are judged with cameras of their own, and `choose` says which of them is built.
    `pieces` are the road chosen, from `start`: `solve` writes them.
    """

    start: Annotated[tuple[float, float, float], LOOSE]
    goal: Annotated[tuple[float, float, float], LOOSE]
    obstacles: Polygons = ()
    min_radius_m: Reach = 20.0
    clearance_m: NotNegative = 1.0
    radius_factors: Annotated[
        tuple[Annotated[float, interval(1.0, 100.0)], ...], LOOSE, NOT_EMPTY_NOR_REPEATING
    ] = (1.0, 2.0)
    bends: Literal["arcs", "clothoids", "both"] = "both"
    clothoid_m: Length | None = None
    length_factor: Annotated[float, interval(1.0, 10.0)] = 1.5
    most_roads: Annotated[int, interval(1, 1000)] = 12
    choose: Literal["error", "length", "cost", "knee"] = "error"
    cost_per_m: NotNegative = 0.0
    time_limit_s: Length = 60.0
    pieces: Annotated[tuple[PieceSection, ...], LOOSE] | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.pieces is not None and not self.pieces:
            raise refuse("must not be empty", at=("pieces",), got=[])
        if self.clothoid_m is not None and self.clothoid_m >= math.pi * self.min_radius_m:
            raise refuse(
                f"must be below {math.pi * self.min_radius_m:g}, a half turn of min_radius_m",
                at=("clothoid_m",),
                got=self.clothoid_m,
            )
        return self


class RoadSection(Section):
    """Where the road runs: exactly one of `pieces`, `file` and `construct`.

    `width_m` is edge to edge, and yields to the widths a file holds. `closed` joins the end to
    the start; left out, pieces are open and a file says it itself, or by its end points.
    """

    pieces: Annotated[tuple[PieceSection, ...], LOOSE] | None = None
    file: str | None = None
    # pydantic's models have a method of the name `construct`; the file's key it is all the same.
    constructed: ConstructSection | None = Field(default=None, alias="construct")
    width_m: Width = 3.0
    sample_spacing_m: Reach = 1.0
    closed: bool | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        ways = {"pieces": self.pieces, "file": self.file, "construct": self.constructed}
        given = [key for key, value in ways.items() if value is not None]
        if len(given) != 1:
            raise refuse(
                "must have exactly one of pieces, file and construct",
                got=" and ".join(given) or "none of them",
            )
        if self.pieces is not None and not self.pieces:
            raise refuse("must not be empty", at=("pieces",), got=[])
        for n, piece in enumerate(self.pieces or ()):
            bend = max(map(abs, piece.curvature))
            if bend * self.width_m >= 2.0:
                raise refuse(
                    f"must be below {2.0 / self.width_m:g} (2/width_m), where the inner edge ends",
                    at=("pieces", n, "curvature"),
                    got=bend,
                )
        return self
