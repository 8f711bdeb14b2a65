"""Cameras that can be: what `Cameras` refuses, and how wide a lens maps rays one to one."""

from __future__ import annotations

import math
import warnings
from dataclasses import fields
from typing import TYPE_CHECKING

import numpy as np

from models.geometry import BoolArray, FloatArray, IntArray
from models.projections import (
    EQUIDISTANT,
    PINHOLE,
    STEREOGRAPHIC,
    Projection,
    angle_limit,
    image_radius,
)

if TYPE_CHECKING:
    from models.cameras import Cameras

BORDER = 1.0 + 1e-9
"""Image borders belong to the image, to this relative tolerance.

Exact ties are common on straight roads and must not flip when a scene is rotated or shifted.
"""

MAX_HEIGHT_M = 100.0
MAX_SIZE_PX = 100_000


def check_cameras(cameras: Cameras) -> None:
    """Raise ValueError naming the first field and camera that is impossible.

    Warns about pinholes wider than 90°, which stretch their corners.
    """
    for field in fields(cameras):
        array = getattr(cameras, field.name)
        bad = ~np.isfinite(array).all(axis=tuple(range(1, array.ndim)))
        if bad.any():
            i = int(np.argmax(bad))
            raise ValueError(f"camera.{field.name}[{i}] must be finite, got {array[i]}")
    degrees, turn = 180.0 / math.pi, 360.0
    kinds = [int(kind) for kind in Projection]
    _require(cameras.projection, np.isin(cameras.projection, kinds), "projection", f"be in {kinds}")
    h = cameras.height_m
    _require(h, (h > 0.0) & (h <= MAX_HEIGHT_M), "height_m", f"lie in (0, {MAX_HEIGHT_M:g}]")
    pitch = cameras.pitch_rad * degrees
    _require(pitch, (pitch > 0.0) & (pitch <= 90.0 * BORDER), "pitch_deg", "lie in (0, 90]")
    for name, size in (("width_px", cameras.width_px), ("height_px", cameras.height_px)):
        _require(size, (size >= 1) & (size <= MAX_SIZE_PX), name, f"lie in [1, {MAX_SIZE_PX}]")
    for name, fov in (("hfov_deg", cameras.hfov_rad), ("vfov_deg", cameras.vfov_rad)):
        for kind, word, end, closed in (
            (PINHOLE, "pinhole", 0.5 * turn, False),
            (STEREOGRAPHIC, "stereographic", turn, False),
            (EQUIDISTANT, "equidistant", turn, True),
        ):
            angle = fov * degrees
            below = angle <= end * BORDER if closed else angle < end
            fine = (cameras.projection != kind) | ((angle > 0.0) & below)
            bracket = "]" if closed else ")"
            _require(angle, fine, name, f"lie in (0, {end:g}{bracket} for a {word} lens")
    _check_folds(cameras)
    widest = np.maximum(cameras.hfov_rad, cameras.vfov_rad) * degrees
    wide = (cameras.projection == PINHOLE) & (widest > 90.0 * BORDER)
    if wide.any():
        i = int(np.argmax(wide))
        warnings.warn(
            f"camera {i}: a pinhole {widest[i]:.4g} degrees wide stretches its corners; "
            "stereographic or equidistant lenses are what is built beyond 90",
            UserWarning,
            stacklevel=4,
        )


def _require(values: FloatArray | IntArray, fine: BoolArray, name: str, wanted: str) -> None:
    if not fine.all():
        i = int(np.argmin(fine))
        raise ValueError(f"camera.{name}[{i}] must {wanted}, got {values[i]:.6g}")


def _check_folds(cameras: Cameras) -> None:
    """Refuse distortions that map two rays of the field of view to one pixel, or none."""
    distorted = np.flatnonzero(cameras.distortion.any(axis=1))
    if distorted.size == 0:
        return
    limits = angle_limits(cameras.projection, cameras.distortion)
    for i in distorted:
        lens, k = Projection(int(cameras.projection[i])), cameras.distortion[i]
        half = 0.5 * max(float(cameras.hfov_rad[i]), float(cameras.vfov_rad[i]))
        limit = float(limits[i])
        whole = limit >= math.pi  # one to one all around: what lies beyond sees nothing, unfolded
        if half < limit and not whole:
            corner = math.hypot(
                image_radius(lens, 0.5 * float(cameras.hfov_rad[i]), k),
                image_radius(lens, 0.5 * float(cameras.vfov_rad[i]), k),
            )
            # Just inside the limit: at the limit itself a pinhole's radius is infinite.
            whole = corner < image_radius(lens, limit * (1.0 - 1e-12), k)
        if not whole:
            raise ValueError(
                f"camera.distortion[{i}] must not fold the image inside the field of view, got "
                f"{[float(x) for x in k]}, one to one up to {math.degrees(limit):.4g} degrees only"
            )


def angle_limits(projection: IntArray, distortion: FloatArray) -> FloatArray:
    """Return the largest angle off the axis [rad] that each lens maps one to one, (c,)."""
    limits = np.where(projection == PINHOLE, 0.5 * math.pi, math.pi)
    distorted = np.flatnonzero(distortion.any(axis=1))
    if distorted.size:  # rare, and sorting the rows costs more than all the rest of a table
        keys = np.column_stack([projection, distortion])[distorted]
        unique, index = np.unique(keys, axis=0, return_inverse=True)
        each = np.array([angle_limit(Projection(int(row[0])), row[1:]) for row in unique])
        limits[distorted] = each[index.reshape(-1)]
    return limits
