"""Random drives past random cameras: small enough for dense oracles, odd enough to find faults."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from models.geometry import FloatArray, IntArray
from models.vehicle import OdometryNoise
from placement.information import Information
from placement.objectives.navigation_chain import Drive

CAR = OdometryNoise(4.12e-4, 0.01, 0.003)  # heading 0.0236°/√m
ROBOT = OdometryNoise(5.24e-3, 0.02, 0.005)  # heading 0.3°/√m


@dataclass(frozen=True, slots=True)
class Samples:
    """Path samples by arc length and heading, (t,) each."""

    s_m: FloatArray
    heading_rad: FloatArray


def random_drive(
    rng: np.random.Generator,
    n_samples: int = 30,
    n_candidates: int = 25,
    *,
    isotropic: bool = False,
    offsets: int = 0,
    longest_window: int = 12,
    wrap: bool = False,
    odometry: OdometryNoise = ROBOT,
    initial_sigma: tuple[float, float, float] = (0.1, 0.1, 0.0),
    strength: float = 60.0,
) -> Drive:
    """Draw a drive along a wandering road, each camera seeing most of one short window.

    Blocks are about `strength` 1/m². `wrap` lets windows run over the end of the lap into its
    start. `offsets` > 0 gives each camera that many persistent offsets of some centimetres.
    """
    s_m: FloatArray = 1.5 * np.arange(n_samples, dtype=np.float64)
    heading = np.cumsum(rng.normal(0.0, 0.08, n_samples))
    rows: list[IntArray] = []
    for _ in range(n_candidates):
        start, length = rng.integers(0, n_samples), rng.integers(1, longest_window + 1)
        seen = np.arange(start, start + length)
        seen = np.unique(seen % n_samples) if wrap else seen[seen < n_samples]
        rows.append(seen[rng.random(seen.size) < 0.9])
    indices = np.concatenate(rows).astype(np.int32)
    blocks = random_blocks(rng, indices.size, isotropic=isotropic, strength=strength)
    jacobians = None
    if offsets:
        jacobians = rng.normal(0.0, 0.15, (indices.size, 2, offsets)).astype(np.float32)
    return Drive(
        Samples(s_m, heading),
        Information(
            n_samples,
            np.concatenate([[0], np.cumsum([r.size for r in rows])]).astype(np.int64),
            indices,
            blocks,
            white=blocks if offsets else None,
            offsets=jacobians,
            frames_per_sample=0.75,
        ),
        odometry,
        np.array(initial_sigma),
    )


def random_blocks(
    rng: np.random.Generator, n: int, *, isotropic: bool, strength: float
) -> np.typing.NDArray[np.float32]:
    """Draw positive semidefinite blocks (n, 1 | 3); one in eight sees one direction only."""
    if isotropic:
        return rng.uniform(0.1, 2.0, (n, 1)).astype(np.float32) * np.float32(strength)
    root = rng.normal(0.0, np.sqrt(0.5 * strength), (n, 2, 2))
    root[rng.random(n) < 0.125, :, 1] = 0.0
    j = root @ root.transpose(0, 2, 1)
    return np.stack([j[:, 0, 0], j[:, 0, 1], j[:, 1, 1]], axis=1).astype(np.float32)
