"""The drives that an objective is about: either way along the road, in any lane, weighted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from models.cameras import Cameras
from models.errors import ErrorModel
from models.lanes import lane
from models.obstacles import Obstacles
from models.roads import Road, RoadPoints
from models.vehicle import OdometryNoise
from placement.information import Information, compute_information
from placement.instance import Instance
from placement.objectives.navigation_chain import Drive

MOST_SAMPLES = 10_000_000


@dataclass(frozen=True, slots=True)
class Journey:
    """One nominal drive: the road that the car follows, and what every candidate tells about it."""

    name: str
    road: Road
    points: RoadPoints
    information: Information
    weight: float = 1.0

    def drive(self, odometry: OdometryNoise, initial_sigma: Sequence[float]) -> Drive:
        """Return what the navigation objectives make of it."""
        return Drive(
            self.points, self.information, odometry, np.array(initial_sigma), weight=self.weight
        )


def journey_roads(instance: Instance, road: Road) -> list[tuple[str, Road, float]]:
    """Return name, road and weight of each of `objective.drives`; without any, the road itself.

    Raises:
        ValueError: for a lane that passes the centre of a bend, naming the drive.
    """
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
) -> list[Journey]:
    """Sample each drive and compute what all `cameras` tell about it, past `obstacles`.

    Raises:
        ValueError: for too many samples, or a lane that cannot be.
    """
    journeys = []
    for name, driven, weight in journey_roads(instance, road):
        points = sample_road(instance, driven)
        spacing = driven.length_m / (len(points) if driven.closed else len(points) - 1)
        information = compute_information(
            cameras,
            points,
            errors,
            instance.camera.max_range_m,
            obstacles=obstacles,
            frames_per_sample=instance.camera.rate_hz * spacing / instance.vehicle.speed_mps,
        )
        journeys.append(Journey(name, driven, points, information, weight))
    return journeys


def sample_road(instance: Instance, road: Road) -> RoadPoints:
    """Sample the road every `road.sample_spacing_m`, or say that this is too fine."""
    spacing = instance.road.sample_spacing_m
    if road.length_m / spacing > MOST_SAMPLES:
        raise ValueError(
            f"road.sample_spacing_m must give at most {MOST_SAMPLES:,} samples, "
            f"got {spacing:g} on {road.length_m:.0f} m of road"
        )
    return road.sample(spacing)
