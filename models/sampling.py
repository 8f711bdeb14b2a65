"""Samples of what badly installed cameras report: the truth that the error models must bound.

Each sample installs its camera anew with random offsets (see `installation`), lets the *displaced*
camera see a car, perturbs the pixel by the image algorithm's error, rounds it to the centre of a
pixel, and back-projects it through the *nominal* camera. Nothing else enters.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit

from models.cameras import (
    HEIGHT,
    HEIGHT_PX,
    N_COLUMNS,
    WIDTH,
    Cameras,
    X,
    Y,
    ground_from_pixel,
    offset_from_pixel,
    pixel_from_ground,
)
from models.geometry import BoolArray, FloatArray, IntArray
from models.installation import N_OFFSETS, Installation, displace_camera


@dataclass(frozen=True, slots=True)
class Samples:
    """Hold n samples. Positions are of the car on the ground, in world axes.

    camera (n,): which camera. truth_m, reported_m (n, 2). pixel (n, 2): as reported, a pixel's
    centre. offsets (n, 6): that sample's installation, in m and rad. seen (n,): the car lay inside
    the displaced camera's image and the reported pixel's nominal ray hits the ground; elsewhere
    the positions may be NaN.
    """

    camera: IntArray
    truth_m: FloatArray
    reported_m: FloatArray
    pixel: FloatArray
    offsets: FloatArray
    seen: BoolArray

    def errors_m(self) -> FloatArray:
        """Return reported minus true positions (n, 2)."""
        difference: FloatArray = self.reported_m - self.truth_m
        return difference


def sample_image(
    cameras: Cameras,
    camera: IntArray,
    installation: Installation,
    rng: np.random.Generator,
    *,
    share: tuple[float, float, float, float] = (0.0, 0.0, 1.0, 1.0),
) -> Samples:
    """Sample cars whose pixels are uniform over the image: one car for each entry of `camera`.

    `share` (left, top, right, bottom) limits them to a part of the image; (0.5, 0.5, 0.5, 0.5) is
    its middle. Cars above the horizon are not `seen`.
    """
    nowhere = np.empty((0, 2))
    return _sample(cameras, camera, nowhere, np.array(share), installation, rng)


def sample_vehicles(
    cameras: Cameras,
    camera: IntArray,
    xy_m: FloatArray,
    installation: Installation,
    rng: np.random.Generator,
) -> Samples:
    """Sample reports of cars at xy_m[n] by camera[n]; those outside the image are not `seen`."""
    if len(xy_m) != len(camera):
        raise ValueError(f"xy_m must have one point for each of {len(camera)}, got {len(xy_m)}")
    return _sample(cameras, camera, np.asarray(xy_m, np.float64), np.zeros(4), installation, rng)


def _sample(
    cameras: Cameras,
    camera: IntArray,
    xy: FloatArray,
    share: FloatArray,
    installation: Installation,
    rng: np.random.Generator,
) -> Samples:
    index = np.array(camera, dtype=np.int64)
    n = len(index)
    offsets, truth, reported, pixel = (np.empty((n, m)) for m in (N_OFFSETS, 2, 2, 2))
    seen = np.empty(n, dtype=np.bool_)
    sigmas, noise = installation.sigmas(), installation.algorithm_sigma_px
    table = cameras.table()
    _fill(table, index, xy, share, sigmas, noise, rng, offsets, truth, reported, pixel, seen)
    for array in (index, truth, reported, pixel, offsets, seen):
        array.flags.writeable = False
    return Samples(index, truth, reported, pixel, offsets, seen)


@njit(cache=True)
def perturbed_pixel(
    u_px: float, v_px: float, noise_u: float, noise_v: float
) -> tuple[float, float]:
    """Return the centre of the pixel that holds (u, v) plus noise [px]."""
    return math.floor(u_px + noise_u) + 0.5, math.floor(v_px + noise_v) + 0.5


@njit(cache=True)
def _fill(
    table: FloatArray,
    camera: IntArray,
    xy: FloatArray,
    share: FloatArray,
    sigmas: FloatArray,
    noise: float,
    rng: np.random.Generator,
    offsets: FloatArray,
    truth: FloatArray,
    reported: FloatArray,
    pixel: FloatArray,
    seen: BoolArray,
) -> None:
    actual = np.empty(N_COLUMNS)
    over_image = len(xy) == 0
    for n in range(len(camera)):
        nominal = table[camera[n]]
        for j in range(N_OFFSETS):
            offsets[n, j] = sigmas[j] * rng.standard_normal()
        displace_camera(nominal, offsets[n], actual)
        noise_u, noise_v = noise * rng.standard_normal(), noise * rng.standard_normal()
        if over_image:
            u = nominal[WIDTH] * (share[0] + (share[2] - share[0]) * rng.random())
            v = nominal[HEIGHT_PX] * (share[1] + (share[3] - share[1]) * rng.random())
            dx, dy, inside = offset_from_pixel(actual, u, v)
            truth[n, 0], truth[n, 1] = actual[X] + dx, actual[Y] + dy
        else:
            truth[n, 0], truth[n, 1] = xy[n, 0], xy[n, 1]
            u, v, inside = pixel_from_ground(actual, xy[n, 0], xy[n, 1])
        # A position offset beyond the height would bury the camera; it then sees nothing.
        seen[n] = inside and actual[HEIGHT] > 0.0
        if not seen[n]:
            reported[n] = math.nan
            pixel[n] = math.nan
            continue
        pixel[n, 0], pixel[n, 1] = perturbed_pixel(u, v, noise_u, noise_v)
        reported[n, 0], reported[n, 1], seen[n] = ground_from_pixel(
            nominal, pixel[n, 0], pixel[n, 1]
        )
