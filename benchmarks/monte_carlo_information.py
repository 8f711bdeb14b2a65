"""Mutual information by simulated runs: `python -m benchmarks.monte_carlo_information`.

The dissertation's way. Drives are simulated along the odometry chain, each with cameras installed
anew, and scored by

    I = E[ log p(z | trajectory) − log p(z) ],

the mean over runs with its standard error. The closed form, half the `entropy` objective, must
lie within the error bars; and it takes microseconds where this takes seconds. Densities are those
of whole measurement vectors, so nothing is shared with the objective's filters but the chain.
"""

from __future__ import annotations

import argparse
import math
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.linalg import solve_triangular

from models.geometry import FloatArray, IntArray
from models.vehicle import PROFILES
from placement.assemble import assemble
from placement.information import Information
from placement.instance import load_instance
from placement.objectives.entropy import Entropy
from placement.objectives.navigation_chain import Drive
from placement.objectives.windows.dense import DenseDrive


@dataclass(frozen=True, slots=True)
class Estimate:
    """A mutual information in nats with its standard error over `runs` runs."""

    nats: float
    standard_error: float
    runs: int


def main() -> None:
    """Compare closed form and simulation on `winding`; write monte_carlo_information.csv."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("out/monte_carlo_information"))
    parser.add_argument("--runs", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    rows = compare(arguments.runs, arguments.seed)
    arguments.out.mkdir(parents=True, exist_ok=True)
    table = pd.DataFrame(rows)
    table.to_csv(arguments.out / "monte_carlo_information.csv", index=False)
    print(table.to_string(index=False))  # noqa: T201 - the command's output


def compare(runs: int, seed: int) -> list[dict[str, float | str]]:
    """Return a row for each error model and odometry profile on `winding` with 12 cameras."""
    rows: list[dict[str, float | str]] = []
    for model in ("radius", "covariance"):
        changes = {"errors.model": model, "errors.persistent": model == "covariance"}
        scene = assemble(load_instance("winding").changed(changes))
        for profile, odometry in PROFILES.items():
            drive = Drive(scene.points, scene.information, odometry, np.array([0.1, 0.1, 0.01]))
            objective = Entropy([drive])
            chosen = np.linspace(0, objective.n_candidates - 1, 12).astype(np.int64)
            start = time.perf_counter()
            closed = 0.5 * objective.value(chosen)
            middle = time.perf_counter()
            rng = np.random.default_rng(seed)
            estimate = simulate_information(drive, chosen, runs, rng)
            rows.append(
                {
                    "errors": model,
                    "profile": profile,
                    "cameras": chosen.size,
                    "runs": estimate.runs,
                    "closed_form_nats": closed,
                    "simulated_nats": estimate.nats,
                    "standard_error_nats": estimate.standard_error,
                    "z": (estimate.nats - closed) / estimate.standard_error,
                    "closed_form_s": middle - start,
                    "simulated_s": time.perf_counter() - middle,
                }
            )
    return rows


def simulate_information(
    drive: Drive, selected: IntArray, runs: int, rng: np.random.Generator
) -> Estimate:
    """Estimate the mutual information of trajectory and measurements from simulated runs."""
    where, map_position, map_offsets = measurement_maps(drive, selected)
    states = simulate_states(drive, runs, rng)
    offsets = rng.standard_normal((runs, map_offsets.shape[1]))
    signal = states[:, where] @ map_position.T
    z = signal + offsets @ map_offsets.T + rng.standard_normal(signal.shape)
    dense = DenseDrive(drive)
    given = np.eye(len(map_position)) + map_offsets @ map_offsets.T
    alone = given + map_position @ dense.prior[np.ix_(where, where)] @ map_position.T
    surprise = log_density(z - signal, given) - log_density(z, alone)
    return Estimate(float(surprise.mean()), float(surprise.std(ddof=1) / math.sqrt(runs)), runs)


def measurement_maps(drive: Drive, selected: IntArray) -> tuple[IntArray, FloatArray, FloatArray]:
    """Return which states are measured, and how: z = M_position e + M_offsets o + N(0, I)."""
    info = drive.information
    white = info.white if drive.persistent and info.white is not None else info.blocks
    width = info.offsets.shape[2] if drive.persistent and info.offsets is not None else 0
    entries = np.concatenate(
        [np.arange(info.indptr[i], info.indptr[i + 1]) for i in selected]
        or [np.empty(0, dtype=np.int64)]
    )
    where = (3 * info.indices[entries].astype(np.int64)[:, None] + np.arange(2)).ravel()
    position = np.zeros((2 * entries.size, 2 * entries.size))
    offset = np.zeros((2 * entries.size, width * len(selected)))
    row = 0
    for k, i in enumerate(selected):
        for e in range(info.indptr[i], info.indptr[i + 1]):
            root = information_root(info, white[e].astype(np.float64))
            position[row : row + 2, row : row + 2] = root
            if width and info.offsets is not None:
                block = slice(width * k, width * (k + 1))
                offset[row : row + 2, block] = root @ info.offsets[e].astype(np.float64)
            row += 2
    return where, position, offset


def information_root(info: Information, block: FloatArray) -> FloatArray:
    """Return R (2, 2) with RᵀR the information of all frames of a sample; it may be singular."""
    tt, tn, nn = (block[0], 0.0, block[0]) if block.size == 1 else block
    values, vectors = np.linalg.eigh(info.frames_per_sample * np.array([[tt, tn], [tn, nn]]))
    return np.asarray(np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T, dtype=np.float64)


def simulate_states(drive: Drive, runs: int, rng: np.random.Generator) -> FloatArray:
    """Drive `runs` times along the chain; return the states (runs, 3t)."""
    steps = drive.steps()
    states = np.empty((runs, 3 * len(steps)))
    now = rng.standard_normal((runs, 3)) * drive.initial_sigma
    for t, (c, s, y, x, *q) in enumerate(steps):
        if t > 0:
            f = np.array([[c, s, y], [-s, c, x], [0.0, 0.0, 1.0]])
            noise = np.array([[q[0], q[1], q[2]], [q[1], q[3], q[4]], [q[2], q[4], q[5]]])
            values, vectors = np.linalg.eigh(noise)
            root = vectors * np.sqrt(np.maximum(values, 0.0))
            now = now @ f.T + rng.standard_normal((runs, 3)) @ root.T
        states[:, 3 * t : 3 * t + 3] = now
    return states


def log_density(z: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return log N(z; 0, covariance) of each row of z (runs, m), without the (2π)^(m/2)."""
    low = np.linalg.cholesky(covariance)
    white = solve_triangular(low, z.T, lower=True)
    return np.asarray(-0.5 * np.sum(white**2, axis=0) - np.sum(np.log(np.diag(low))))


if __name__ == "__main__":
    main()
