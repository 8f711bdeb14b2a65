"""The sparse information of every candidate pose about every path sample, precomputed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from models.geometry import IntArray


@dataclass(frozen=True, slots=True)
class Information:
    """Hold what each candidate tells about each path sample it sees, as CSR rows.

    Row i spans `indptr[i]:indptr[i + 1]` of the arrays below; `indices` increase within a row.
    Blocks are in the sample's road frame (t along the heading, n to the left), so they do not
    change when the scene is rotated or shifted; float32 storage, to be summed in float64.

    blocks (nnz, 1 | 3): information of one frame taken alone, 1/m²: [J] where the model is
        isotropic (J·I), else [J_tt, J_tn, J_nn]. White and persistent errors both count.
    white (nnz, 1 | 3) or None: one frame's information against its white error alone; None where
        the whole error is white, and then `blocks` is that.
    offsets (nnz, 2, p) or None: derivative of the measured (t, n) position with respect to the
        camera's p persistent offsets, each scaled to unit variance, in metres; None where white.
    frames_per_sample: how many frames the camera takes while the car passes one sample.
    """

    n_samples: int
    indptr: IntArray
    indices: NDArray[np.int32]
    blocks: NDArray[np.float32]
    white: NDArray[np.float32] | None = None
    offsets: NDArray[np.float32] | None = None
    frames_per_sample: float = 1.0

    @property
    def n_candidates(self) -> int:
        """The number of candidates, c."""
        return len(self.indptr) - 1

    @property
    def isotropic(self) -> bool:
        """Whether each block is one number times the identity."""
        return int(self.blocks.shape[1]) == 1
