"""Thousands of lines in a few characters each: steps of whole decimetres, two bytes a step.

What `city.js` unpacks: the number of corners of each line, and for every corner the step from the
one before, the first from the corner before that in the list, whose line it does not matter.
"""

from __future__ import annotations

import base64
from collections.abc import Sequence
from typing import Any

import numpy as np

from models.geometry import FloatArray

UNIT_M = 0.1
_STEP = 32_000  # units: what two bytes hold, with something to spare


def packed(lines: Sequence[FloatArray], origin: FloatArray) -> dict[str, Any]:
    """Pack `lines` (m, 2), m ≥ 1, in metres from `origin`: corners a line, and steps.

    `far` lists (corner, x, y) of the few steps that two bytes do not hold, as places.
    """
    if not lines:
        return {"counts": "", "steps": "", "far": []}
    counts = np.array([len(line) for line in lines], dtype=np.uint32)
    places = np.rint((np.concatenate(lines) - origin) / UNIT_M).astype(np.int64)
    steps = np.diff(places, axis=0, prepend=np.zeros((1, 2), np.int64))
    far = np.flatnonzero(np.abs(steps).max(axis=1) > _STEP)
    steps[far] = 0
    return {
        "counts": _text(counts.astype("<u4")),
        "steps": _text(steps.astype("<i2")),
        "far": [[int(i), *places[i].tolist()] for i in far],
    }


def _text(array: np.ndarray[Any, Any]) -> str:
    return base64.b64encode(np.ascontiguousarray(array).tobytes()).decode("ascii")
