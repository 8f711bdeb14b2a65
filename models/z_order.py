"""A space-filling curve through the plane: neighbours along it are neighbours in space."""

from __future__ import annotations

import numpy as np

from models.geometry import FloatArray, IntArray

_BITS = 20  # of each axis


def z_order(points: FloatArray) -> IntArray:
    """Return each point's place (n,) on the Z-order curve through the box round all (n, 2)."""
    code = np.zeros(len(points), dtype=np.int64)
    if not len(points):
        return code
    low, high = points.min(axis=0), points.max(axis=0)
    scaled = (points - low) / max(float((high - low).max()), 1e-9) * (2**_BITS - 1)
    for bit in range(_BITS):
        for axis in range(2):
            code |= ((scaled[:, axis].astype(np.int64) >> bit) & 1) << (2 * bit + axis)
    return code
