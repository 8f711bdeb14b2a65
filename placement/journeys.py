"""The drives that an objective is about: either way along the road, in any lane, weighted."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from models.cameras import Cameras
from models.errors import ErrorModel
from models.lanes import lane
from models.obstacles import Obstacles
from models.roads import Road, RoadPoints
from models.vehicle import OdometryNoise
from placement.cluster import Work
from placement.information import Information, compute_information
from placement.information.join import split_samples
from placement.information.quarters import quarter_information
from placement.information.spread import spread_information
from placement.instance import Instance
from placement.objectives.navigation_chain import Drive
from placement.roadway import STREETS, network_drives, network_of

MOST_SAMPLES = 10_000_000


@dataclass(frozen=True, slots=True)
class Journey:
    """One nominal drive: the road that the car follows, and what every candidate tells about it."""

    name: str
    road: Road
    points: RoadPoints
    information: Information
    weight: float = 1.0

    @property
    def drivable(self) -> bool:
        """Whether a car could drive it: not all streets of a network, which jumps."""
        return self.name != STREETS

    def drive(self, odometry: OdometryNoise, initial_sigma: Sequence[float]) -> Drive:
        """Return what the navigation objectives make of it."""
        return Drive(
            self.points, self.information, odometry, np.array(initial_sigma), weight=self.weight
        )


def journey_roads(instance: Instance, road: Road) -> list[tuple[str, Road, float]]:
    """Return name, road and weight of each of `objective.drives`; without any, the road itself.

    Over a network they are those of `[traffic]` (`placement.roadway.network_drives`).

    Raises:
        ValueError: for a lane that passes the centre of a bend, naming the drive.
    """
    network = network_of(instance)
    if network is not None:
        return network_drives(instance, network)
    if instance.objective.drives is None:
        return [("forward", road, 1.0)]
    roads = []
    for n, section in enumerate(instance.objective.drives):
        try:
            driven = lane(road, section.offset_m, backward=section.direction == "backward")
        except ValueError as error:
            raise ValueError(f"objective.drives[{n}].offset_m: {error}") from None
        roads.append((section.label(), driven, section.weight))
    return roads


def build_journeys(
    instance: Instance,
    road: Road,
    cameras: Cameras,
    errors: ErrorModel,
    obstacles: Obstacles | None = None,
    work: Work | None = None,
    *,
    keep: Path | None = None,
    progress: Callable[[str, float | None], None] | None = None,
) -> list[Journey]:
    """Sample each drive and compute what all `cameras` tell about it, past `obstacles`.

    `work` says where, if not here; `keep` is a folder for what is done of a whole city.

    Raises:
        ValueError: for too many samples, or a lane that cannot be.
    """
    roads = journey_roads(instance, road)
    _refuse_too_many(instance, roads)
    points = [sample_road(instance, driven) for _, driven, _ in roads]
    counts = [len(each) for each in points]
    spacings = [
        driven.length_m / (count if driven.closed else count - 1)
        for (_, driven, _), count in zip(roads, counts, strict=True)
    ]
    frames = [instance.camera.rate_hz * d / instance.vehicle.speed_mps for d in spacings]
    compute: Callable[..., Information]
    if network_of(instance) is not None:
        compute = partial(quarter_information, work=work, keep=keep, progress=progress)
    else:
        compute = compute_information if work is None else partial(spread_information, work)
    if roads[0][0] == STREETS:  # nobody drives there: only what one frame tells is ever asked for
        errors = replace(errors, persistent=False)
    whole = compute(
        cameras,
        points[0] if len(points) == 1 else _one_after_another(points),
        errors,
        instance.camera.max_range_m,
        obstacles=obstacles,
        frames_per_sample=frames[0],
    )
    parts = [whole] if len(points) == 1 else split_samples(whole, counts, frames)
    return [
        Journey(name, driven, at, information, weight)
        for (name, driven, weight), at, information in zip(roads, points, parts, strict=True)
    ]


def _one_after_another(points: Sequence[RoadPoints]) -> RoadPoints:
    columns = (
        np.concatenate([getattr(each, name) for each in points])
        for name in ("s_m", "x_m", "y_m", "heading_rad", "curvature")
    )
    return RoadPoints(*columns)


def _refuse_too_many(instance: Instance, roads: Sequence[tuple[str, Road, float]]) -> None:
    total = sum(driven.length_m for _, driven, _ in roads)
    if len(roads) > 1 and total / instance.road.sample_spacing_m > MOST_SAMPLES:
        raise ValueError(
            f"the drives must have at most {MOST_SAMPLES:,} samples, got {total / 1000:,.0f} km "
            f"every {instance.road.sample_spacing_m:g} m: raise road.sample_spacing_m or lower "
            "traffic.drives"
        )


def sample_road(instance: Instance, road: Road) -> RoadPoints:
    """Sample the road every `road.sample_spacing_m`, or say that this is too fine."""
    spacing = instance.road.sample_spacing_m
    if road.length_m / spacing > MOST_SAMPLES:
        raise ValueError(
            f"road.sample_spacing_m must give at most {MOST_SAMPLES:,} samples, "
            f"got {spacing:g} on {road.length_m:.0f} m of road"
        )
    return road.sample(spacing)
