"""Every key of an instance file, with its default and what is impossible for it."""

from __future__ import annotations

import math
import warnings
from typing import Annotated, Literal, Self

from pydantic import AfterValidator, BeforeValidator, Discriminator, Field, Tag, model_validator

from models.cameras import make_camera
from placement.instance.road_schema import Polygons, RoadSection
from placement.instance.values import (
    LOOSE,
    NOT_EMPTY_NOR_REPEATING,
    Alpha,
    Cost,
    Density,
    HeadingSigma,
    Length,
    NotNegative,
    Offset,
    Pair,
    Prior,
    Reach,
    Section,
    Sigma,
    Speed,
    interval,
    refuse,
)

Side = Literal["left", "right"]
ProjectionName = Literal["pinhole", "stereographic", "equidistant"]
ErrorModelName = Literal["radius", "ellipse", "covariance"]
ProfileName = Literal["dissertation", "car", "robot"]
WeightName = Literal["position", "lateral"]
ObjectiveKind = Literal[
    "localisation", "entropy", "trace", "final_entropy", "tolerance", "kalman_gain"
]

YawDeg = Annotated[float, interval(-360.0, 360.0)]
PitchDeg = Annotated[float, interval(0.0, 90.0, ends="(]")]
HeightM = Annotated[float, interval(0.0, 100.0, ends="(]")]
FieldDeg = Annotated[float, interval(0.0, 360.0, ends="(]")]
FieldsDeg = Annotated[tuple[FieldDeg, FieldDeg], LOOSE]
PixelCount = Annotated[int, interval(1, 100_000)]
MountNumber = Annotated[int, interval(0, math.inf)]


class MountsSection(Section):
    """Where cameras may be put: poles every `spacing_m` on `sides`, or those of a file.

    `file` is GeoJSON with points in the road's frame (where `road.file` lies on the Earth, by
    longitude and latitude or the `crs` it names), whose heights and costs come before these;
    `cost` is that of a camera put on a pole, whatever camera.
    """

    spacing_m: Length = 10.0
    side_offset_m: Offset = 1.5
    sides: Annotated[tuple[Side, ...], LOOSE, NOT_EMPTY_NOR_REPEATING] = ("left", "right")
    height_m: Annotated[tuple[HeightM, ...], LOOSE, NOT_EMPTY_NOR_REPEATING] = (6.0,)
    cost: Cost = 0.0
    file: str | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        grid = sorted(self.model_fields_set & {"spacing_m", "side_offset_m", "sides"})
        if self.file is not None and grid:
            raise refuse("must not have both file and the grid's keys", got=", ".join(grid))
        return self


class CameraSection(Section):
    """The camera, and the poses a mount may give it: every yaw × pitch × field of view.

    A `catalogue` (CSV) of camera types takes the place of resolution, fields of view and price:
    then the type is chosen as well as the pose.
    """

    projection: ProjectionName = "pinhole"
    resolution_px: Annotated[tuple[PixelCount, PixelCount], LOOSE] = (2000, 1500)
    yaw_deg: Annotated[tuple[YawDeg, ...], LOOSE, NOT_EMPTY_NOR_REPEATING] = tuple(
        45.0 * i for i in range(8)
    )
    pitch_deg: Annotated[tuple[PitchDeg, ...], LOOSE, NOT_EMPTY_NOR_REPEATING] = (20.0, 35.0, 50.0)
    fov_deg: Annotated[tuple[FieldsDeg, ...], LOOSE, NOT_EMPTY_NOR_REPEATING] = (
        (45.0, 34.0),
        (60.0, 45.0),
        (90.0, 68.0),
    )
    distortion: Annotated[tuple[float, float, float, float], LOOSE] = (0.0, 0.0, 0.0, 0.0)
    rate_hz: Reach = 10.0
    max_range_m: Reach = 150.0
    price: Cost = 0.0
    catalogue: str | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        own = sorted(self.model_fields_set & {"resolution_px", "fov_deg", "price"})
        if self.catalogue is not None and own:
            raise refuse("must not have both catalogue and its columns", got=", ".join(own))
        limit = {"pinhole": 180.0, "stereographic": 360.0, "equidistant": math.inf}[self.projection]
        for i, fields in enumerate(self.fov_deg):
            for j, angle in enumerate(fields):
                if angle >= limit:
                    raise refuse(
                        f"must lie in (0, {limit:g}) for a {self.projection} camera",
                        at=("fov_deg", i, j),
                        got=angle,
                    )
        if any(self.distortion):
            self._check_lenses()
        return self

    def _check_lenses(self) -> None:
        """Refuse distortions that fold the image inside some field of view."""
        for fields in self.fov_deg:
            try:
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore")  # the candidates' cameras will say it
                    make_camera(
                        fov_deg=fields,
                        size_px=self.resolution_px,
                        projection=self.projection,
                        distortion=self.distortion,
                    )
            except ValueError as error:
                wanted, _, got = (
                    str(error).removeprefix("camera.distortion[0] ").partition(", got ")
                )
                raise refuse(wanted, at=("distortion",), got=got) from None


class ErrorsSection(Section):
    """How well a camera measures: the 95 % figures are two standard deviations."""

    model: ErrorModelName = "covariance"
    position_95_m: Annotated[float, interval(0.0, 10.0)] = 0.03
    orientation_95_deg: Annotated[float, interval(0.0, 45.0)] = 0.5
    algorithm_95_px: Annotated[float, interval(0.0, 1000.0)] = 4.0
    persistent: bool = True
    report_limit_m: Reach = 2.0


class ObstaclesSection(Section):
    """What blocks a camera's view: prisms of one height, given here or in a file."""

    polygons: Polygons = ()
    height_m: Reach = 10.0
    file: str | None = None


class VehicleSection(Section):
    """The car: its odometry by profile, by densities, or by the dissertation's four alphas.

    Densities left out are those of `profile`.
    """

    profile: ProfileName = "car"
    heading_deg_per_sqrt_m: Density | None = None
    along_m_per_sqrt_m: Density | None = None
    across_m_per_sqrt_m: Density | None = None
    alphas: Annotated[tuple[Alpha, Alpha, Alpha, Alpha], LOOSE] | None = None
    speed_mps: Speed = 20.0
    initial_sigma: Annotated[tuple[Sigma, Sigma, HeadingSigma], LOOSE] = (0.1, 0.1, 0.01)

    @model_validator(mode="after")
    def _check(self) -> Self:
        densities = {"heading_deg_per_sqrt_m", "along_m_per_sqrt_m", "across_m_per_sqrt_m"}
        given = sorted(self.model_fields_set & (densities | {"profile"}))
        if self.alphas is not None and given:
            raise refuse("must not have both alphas and others", got=", ".join(["alphas", *given]))
        return self


class DriveSection(Section):
    """One way to drive the road: forward or backward, `offset_m` to the left of that way.

    In right-hand traffic the right lane has a negative offset in either direction. `weight` is the
    drive's share of the objective, as of the traffic.
    """

    direction: Literal["forward", "backward"] = "forward"
    offset_m: Annotated[float, interval(-100.0, 100.0)] = 0.0
    weight: NotNegative = 1.0

    def label(self) -> str:
        """Return a short name, as tables and files show it."""
        return self.direction + (f"{self.offset_m:+g}m" if self.offset_m else "")


def _check_drives(drives: tuple[DriveSection, ...]) -> tuple[DriveSection, ...]:
    if not any(drive.weight > 0.0 for drive in drives):
        raise refuse("must have a drive of positive weight", got=[d.weight for d in drives])
    return drives


# A drive may be given by its direction alone.
DriveChoice = Annotated[
    DriveSection,
    BeforeValidator(lambda value: {"direction": value} if isinstance(value, str) else value),
]
Drives = Annotated[tuple[DriveChoice, ...], LOOSE, AfterValidator(_check_drives)]


class ObjectiveSection(Section):
    """What is to be optimised; `weights` weigh the path's samples, one number each.

    `drives` are those that it is about, by default once forward along the centre line.
    """

    kind: ObjectiveKind = "trace"
    weight: WeightName = "position"
    weights: Annotated[tuple[NotNegative, ...], LOOSE] | None = None
    tolerance_m: Reach = 0.29
    prior_sigma_m: Prior = 0.5
    drives: Drives | None = None


class TrafficSection(Section):
    """Who drives over a network: `drives` fastest routes between random places, or `demand`.

    `demand` is CSV with the columns `from, to[, trips]`, names of edges or of nodes; of more than
    `drives` rows, as many are drawn by their trips. `seed` draws.
    """

    drives: Annotated[int, interval(1, 100_000)] = 100
    seed: Annotated[int, interval(0, 2**63 - 1)] = 0
    demand: str | None = None


class PoseSelector(Section):
    """Name poses by what is given: all poses of a mount, or those with this yaw, and so on."""

    mount: Annotated[int, interval(0, math.inf)] | None = None
    height_m: float | None = None
    yaw_deg: float | None = None
    pitch_deg: float | None = None
    fov_deg: Pair | None = None
    type: str | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        if not self.model_fields_set - {"cost"}:
            raise refuse(
                "must give at least one of mount, height_m, yaw_deg, pitch_deg, fov_deg, type"
            )
        return self


class PoseCost(PoseSelector):
    """What the poses that a selector fits cost beyond mount and camera."""

    cost: Cost


def _choice_kind(value: object) -> str:
    return "<selector>" if isinstance(value, dict | PoseSelector) else "<index>"


# Tagged by hand so that a bad entry gives one error, not one for each branch of the union.
PoseChoice = Annotated[
    Annotated[int, interval(0, math.inf), Tag("<index>")]
    | Annotated[PoseSelector, Tag("<selector>")],
    Discriminator(_choice_kind),
]


class BudgetSection(Section):
    """How many cameras, and which poses must or must not be among them.

    `required` and `forbidden` hold candidate indices or pose selectors. A required selector must
    fit exactly one pose; a forbidden one forbids every pose it fits. `money` is the most that all
    cameras may cost: mount, type, and whatever `costs` add. Each of `groups` lists mounts of which
    one camera at most may be chosen. `separation_m` keeps cameras on different mounts apart.
    """

    cameras: Annotated[int, interval(1, math.inf)] = 20
    one_per_mount: bool = True
    required: Annotated[tuple[PoseChoice, ...], LOOSE] = ()
    forbidden: Annotated[tuple[PoseChoice, ...], LOOSE] = ()
    separation_m: NotNegative = 0.0
    money: NotNegative | None = None
    costs: Annotated[tuple[PoseCost, ...], LOOSE] = ()
    groups: Annotated[tuple[Annotated[tuple[MountNumber, ...], LOOSE], ...], LOOSE] = ()
    failures: Annotated[int, interval(0, 1)] = 0


class Document(Section):
    """An instance file as a whole: every table has defaults but `road`."""

    road: RoadSection
    mounts: MountsSection = Field(default_factory=MountsSection)
    camera: CameraSection = Field(default_factory=CameraSection)
    errors: ErrorsSection = Field(default_factory=ErrorsSection)
    obstacles: ObstaclesSection = Field(default_factory=ObstaclesSection)
    vehicle: VehicleSection = Field(default_factory=VehicleSection)
    objective: ObjectiveSection = Field(default_factory=ObjectiveSection)
    traffic: TrafficSection = Field(default_factory=TrafficSection)
    budget: BudgetSection = Field(default_factory=BudgetSection)
