"""The value of a placement, from the instance alone: samples, sights, and the objective densely."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from models.cameras import Cameras
from models.geometry import FloatArray
from models.obstacles import Obstacles
from models.projections import Projection
from models.roads import Road, RoadPoints
from placement.assemble import build_odometry, build_road
from placement.candidates import Candidates
from placement.instance import Instance
from placement.journeys import journey_roads
from placement.obstacles import build_obstacles
from placement.referee.drive import Filtered, Track, filter_drive
from placement.referee.shadows import unhidden
from placement.referee.sight import Eye, Sight, ground_per_pixel, look


@dataclass(frozen=True, slots=True)
class Scene:
    """One drive of an instance rebuilt: its road sampled anew, and what it weighs.

    `name` is the drive's, `others` the rest of `objective.drives`.
    """

    instance: Instance
    road: Road
    track: Track
    xy: FloatArray
    curvature: FloatArray
    name: str = "forward"
    weight: float = 1.0
    others: tuple[Scene, ...] = ()
    obstacles: Obstacles = field(default_factory=Obstacles)

    def drives(self) -> list[Scene]:
        """Return this drive and the others."""
        return [self, *self.others]


def rebuild(instance: Instance) -> Scene:
    """Build the road of every drive and sample it through `Road.evaluate` alone.

    Raises:
        ValueError: for an instance with something that this referee does not know.
    """
    kind = instance.objective.kind
    if kind not in VALUES:
        raise ValueError(f"verify does not know objective.kind = {kind}: nothing was checked")
    obstacles = build_obstacles(instance)
    roads = journey_roads(instance, build_road(instance))
    total = math.fsum(weight for _, _, weight in roads) if kind in AVERAGED else 1.0
    first, *others = [_drive(instance, name, road, w / total, obstacles) for name, road, w in roads]
    return replace(first, others=tuple(others))


def _drive(instance: Instance, name: str, road: Road, weight: float, obstacles: Obstacles) -> Scene:
    intervals = max(1, math.ceil(road.length_m / instance.road.sample_spacing_m - 1e-9))
    spacing = road.length_m / intervals
    points = road.evaluate(np.arange(intervals + (not road.closed)) * spacing)
    track = track_of(instance, points, spacing)
    xy = np.column_stack([points.x_m, points.y_m])
    return Scene(instance, road, track, xy, points.curvature, name, weight, obstacles=obstacles)


def track_of(instance: Instance, points: RoadPoints, spacing: float) -> Track:
    """Return the drive along `points`, `spacing` metres apart, with the instance's odometry."""
    odometry = build_odometry(instance.vehicle)
    return Track(
        s_m=points.s_m,
        x_m=points.x_m,
        y_m=points.y_m,
        heading_rad=points.heading_rad,
        densities=(
            odometry.heading_rad_per_sqrt_m,
            odometry.along_m_per_sqrt_m,
            odometry.across_m_per_sqrt_m,
        ),
        initial_sigma=instance.vehicle.initial_sigma,
        frames=instance.camera.rate_hz * spacing / instance.vehicle.speed_mps,
    )


def eyes_of(candidates: Candidates, selected: Sequence[int]) -> list[Eye]:
    """Return the selected candidates, one camera each, as this referee sees them."""
    return eyes_through(candidates.cameras, selected)


def eyes_through(c: Cameras, selected: Sequence[int]) -> list[Eye]:
    """Return the selected ones of the cameras `c` as this referee sees them."""
    return [
        Eye(
            float(c.x_m[i]),
            float(c.y_m[i]),
            float(c.height_m[i]),
            float(c.yaw_rad[i]),
            float(c.pitch_rad[i]),
            float(c.hfov_rad[i]),
            float(c.vfov_rad[i]),
            float(c.width_px[i]),
            float(c.height_px[i]),
            Projection(int(c.projection[i])).name.lower(),
            (
                float(c.distortion[i, 0]),
                float(c.distortion[i, 1]),
                float(c.distortion[i, 2]),
                float(c.distortion[i, 3]),
            ),
        )
        for i in selected
    ]


def sights_of(scene: Scene, eyes: Sequence[Eye]) -> list[Sight]:
    """Look along the whole path with each camera, as far as no building stands in between."""
    return [look_past(scene.obstacles, eye, scene.xy, scene.instance) for eye in eyes]


def look_past(obstacles: Obstacles, eye: Eye, xy: FloatArray, instance: Instance) -> Sight:
    """Look at the places `xy` (t, 2) with one camera, as far as no building stands in between."""
    sight = look(eye, xy, instance.errors, instance.camera.max_range_m)
    seen = sight.seen.copy()
    seen[seen] = unhidden(eye, xy[seen], obstacles)
    return replace(sight, seen=seen)


def filtered(scene: Scene, sights: Sequence[Sight]) -> Filtered:
    """Filter the drive with these cameras, offsets carried where errors persist."""
    return filter_drive(scene.track, sights)


def whole_value(scene: Scene, eyes: Sequence[Eye]) -> float:
    """Return the value of the instance's objective, all drives of it."""
    if scene.instance.objective.kind == "kalman_gain":
        return math.fsum(d.weight * pixels(d, e) for d in scene.drives() for e in eyes)
    return math.fsum(
        drive.weight * value_of(drive, sights_of(drive, eyes)) for drive in scene.drives()
    )


def value_of(scene: Scene, sights: Sequence[Sight]) -> float:
    """Return the value of the instance's objective for one drive, unweighted."""
    return VALUES[scene.instance.objective.kind](scene, sights)


def _localisation(scene: Scene, sights: Sequence[Sight]) -> float:
    section = scene.instance.objective
    information = np.tile(np.eye(2) / section.prior_sigma_m**2, (len(scene.xy), 1, 1))
    for sight in sights:
        information[sight.seen] += np.linalg.inv(sight.whole[sight.seen])
    return localised(scene, information)


def localised(scene: Scene, information: FloatArray) -> float:
    """Return what a drive is worth where prior and cameras tell `information` (t, 2, 2)."""
    section = scene.instance.objective
    gain = np.linalg.slogdet(information)[1] + 4.0 * math.log(section.prior_sigma_m)
    weights = np.ones(len(gain)) if section.weights is None else np.array(section.weights)
    return math.fsum(weights * gain)


def _entropy(scene: Scene, sights: Sequence[Sight]) -> float:
    return filtered(scene, sights).log_det


def _trace(scene: Scene, sights: Sequence[Sight]) -> float:
    P = filtered(scene, sights).covariance
    if scene.instance.objective.weight == "lateral":
        return float(np.mean(lateral_variance(scene, P)))
    return float(np.mean(P[:, 0, 0] + P[:, 1, 1]))


def _final_entropy(scene: Scene, sights: Sequence[Sight]) -> float:
    log_det = np.linalg.slogdet(filtered(scene, sights).covariance[-1])[1]
    return float(0.5 * (3.0 * math.log(2.0 * math.pi * math.e) + log_det))


def pixels(scene: Scene, eye: Eye) -> float:
    """Return the score of `kalman_gain` of one camera: mean of (1/A) / (1 + (r/3)²) over samples.

    A is the ground that a pixel covers, r two standard deviations in the worst direction.
    """
    sight = sights_of(scene, [eye])[0]
    to = scene.xy[sight.seen] - np.array([eye.x_m, eye.y_m])
    area = np.abs(np.linalg.det(ground_per_pixel(eye, to)))
    worst = np.linalg.eigvalsh(sight.whole[sight.seen])[:, -1]
    return math.fsum(1.0 / area / (1.0 + 4.0 * worst / 9.0)) / len(scene.xy)


def _worst(scene: Scene, sights: Sequence[Sight]) -> float:
    """Return the largest 2σ across the road; `referee.tolerance` makes a value of it."""
    P = filtered(scene, sights).covariance
    return 2.0 * math.sqrt(float(np.max(lateral_variance(scene, P))))


def lateral_variance(scene: Scene, P: FloatArray) -> FloatArray:
    """Return the variance across the road (t,) of world covariances P (t, 3, 3)."""
    heading = scene.track.heading_rad
    left = np.column_stack([-np.sin(heading), np.cos(heading)])
    variance: FloatArray = np.einsum("ti,tij,tj->t", left, P[:, :2, :2], left)
    return variance


# What the value of each objective.kind is; a kind without a row is not verified.
VALUES: Mapping[str, Callable[[Scene, Sequence[Sight]], float]] = {
    "localisation": _localisation,
    "entropy": _entropy,
    "trace": _trace,
    "final_entropy": _final_entropy,
    "tolerance": _worst,
    "kalman_gain": _worst,  # not asked: see `whole_value`
}
# The objectives that are means over the drives; the others are sums.
AVERAGED = frozenset({"trace", "final_entropy"})
# The objectives that are maximised; the others are minimised.
MAXIMISED = frozenset({"localisation", "entropy", "kalman_gain"})
UNITS = {
    "localisation": "nats",
    "entropy": "nats",
    "trace": "m^2",
    "final_entropy": "nats",
    "tolerance": "cameras",
    "kalman_gain": "px/m^2",
}
