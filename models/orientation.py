"""On which side of a line does a point lie? Answered exactly, in compiled code.

    orient(a, b, c) = sign((a − c) × (b − c)):  +1 where a → b → c turns left, 0 on a line

Rounded arithmetic decides where its error bound allows (all but ties, in practice); else the six
products are summed without any error as an expansion (Shewchuk 1997, sections 2 and 4).
"""

from __future__ import annotations

import numpy as np
from numba import njit

from models.geometry import FloatArray

_EPSILON = 2.0**-53
_BOUND = (3.0 + 16.0 * _EPSILON) * _EPSILON  # Shewchuk's ccwerrboundA
_SPLIT = 2.0**27 + 1.0


@njit(cache=True, error_model="numpy", nogil=True)
def orient(ax: float, ay: float, bx: float, by: float, cx: float, cy: float) -> int:
    """Return +1 where a, b, c turn left, −1 where they turn right, 0 where they lie on a line.

    Exact for finite coordinates below 1e150 whose products do not underflow.
    """
    left = (ax - cx) * (by - cy)
    right = (ay - cy) * (bx - cx)
    det = left - right
    bound = _BOUND * (abs(left) + abs(right))
    if det > bound:
        return 1
    if det < -bound:
        return -1
    return _orient_exactly(ax, ay, bx, by, cx, cy)


@njit(cache=True, error_model="numpy", nogil=True)
def _orient_exactly(ax: float, ay: float, bx: float, by: float, cx: float, cy: float) -> int:
    """Sum ax·by − ax·cy − cx·by − ay·bx + ay·cx + cy·bx without rounding; return its sign."""
    sums = np.zeros(12)
    n = 0
    n = _add_product(sums, n, ax, by)
    n = _add_product(sums, n, -ax, cy)
    n = _add_product(sums, n, -cx, by)
    n = _add_product(sums, n, -ay, bx)
    n = _add_product(sums, n, ay, cx)
    n = _add_product(sums, n, cy, bx)
    for i in range(n - 1, -1, -1):  # the last that is not 0 outweighs the others together
        if sums[i] > 0.0:
            return 1
        if sums[i] < 0.0:
            return -1
    return 0


@njit(cache=True, error_model="numpy", nogil=True)
def _add_product(sums: FloatArray, n: int, a: float, b: float) -> int:
    """Add a·b to the expansion sums[:n]; return its new length."""
    product = a * b
    a_high, a_low = _split(a)
    b_high, b_low = _split(b)
    low = a_low * b_low - (((product - a_high * b_high) - a_low * b_high) - a_high * b_low)
    return _grow(sums, _grow(sums, n, low), product)


@njit(cache=True, error_model="numpy", nogil=True)
def _split(a: float) -> tuple[float, float]:
    """Return a's upper and lower half, 26 bits each (Dekker 1971)."""
    c = _SPLIT * a
    high = c - (c - a)
    return high, a - high


@njit(cache=True, error_model="numpy", nogil=True)
def _grow(sums: FloatArray, n: int, b: float) -> int:
    """Add b to a nonoverlapping expansion of n numbers, in place (Shewchuk's Grow-Expansion)."""
    q = b
    for i in range(n):
        total = q + sums[i]
        rest = total - q
        sums[i] = (q - (total - rest)) + (sums[i] - rest)
        q = total
    sums[n] = q
    return n + 1
