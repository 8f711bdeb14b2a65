"""How fast all gains of the navigation objectives are: `python -m benchmarks.navigation_sweep`.

Writes `sweep.csv` into --out. Part one, on `winding` with a placement of 20: one sweep of every
candidate's `entropy` gain from its own window, against filtering the whole road again for each
candidate, by two rivals in turn (A B C A B C): `textbook`, the filter as one writes it down, with
3×3 matrices and an inverse a sample, compiled; and `kernel`, the same scalar kernels that the
windows use. Part two: a sweep of the same number of candidates on roads of 1, 4 and 16 repeats.
Seconds are of processor time, so that a busy machine does not matter.
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
from numba import njit

from models.geometry import FloatArray, IntArray
from models.vehicle import PROFILES
from placement.assemble import assemble
from placement.information import Information
from placement.instance import load_instance
from placement.objectives.entropy import Entropy, WhiteEntropyMessages
from placement.objectives.navigation import NavigationObjective, WhiteDrive
from placement.objectives.navigation_chain import Drive
from placement.objectives.trace import Trace
from placement.objectives.windows.filter import filter_forward

REPEATS = 3
INITIAL_SIGMA = (0.1, 0.1, 0.01)


def main() -> None:
    """Measure, write sweep.csv, and show it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("out/navigation_sweep"))
    arguments = parser.parse_args()
    rows = [*compare_with_refiltering(), *grow_the_road()]
    arguments.out.mkdir(parents=True, exist_ok=True)
    table = pd.DataFrame(rows)
    table.to_csv(arguments.out / "sweep.csv", index=False)
    with pd.option_context("display.width", 160, "display.max_columns", 20):
        print(table.to_string(index=False))  # noqa: T201 - the command's output


def compare_with_refiltering() -> list[dict[str, object]]:
    """Time one sweep on `winding` three ways in turn; differences are relative to the gain."""
    rows = []
    for profile in PROFILES:
        drive = winding_drive(1, profile)
        placement = greedy(Entropy([drive]), 20)
        messages = WhiteEntropyMessages(WhiteDrive(drive), placement)
        everyone = np.arange(drive.information.n_candidates)
        contestants: dict[str, Callable[[], FloatArray]] = {
            "window": lambda m=messages, r=everyone: m.gains(r),  # type: ignore[misc]
            "kernel": lambda m=messages: refilter(m, textbook=False),  # type: ignore[misc]
            "textbook": lambda m=messages: refilter(m, textbook=True),  # type: ignore[misc]
        }
        messages.gains(everyone[:1])
        warm_up(messages)
        seconds: dict[str, list[float]] = {name: [] for name in contestants}
        gains: dict[str, FloatArray] = {}
        for repeat in range(REPEATS):
            for name, contestant in contestants.items():
                if name == "textbook" and repeat > 0:
                    continue  # half a minute, and no close race
                start = time.process_time()
                gains[name] = contestant()
                seconds[name].append(time.process_time() - start)
        own = statistics.median(seconds["window"])
        for name, times in seconds.items():
            difference = np.max(np.abs(gains[name] - gains["window"]))
            rows.append(
                {
                    "part": "sweep",
                    "objective": "entropy",
                    "profile": profile,
                    "road_m": float(drive.points.s_m[-1]),
                    "candidates": everyone.size,
                    "method": name,
                    "seconds": statistics.median(times),
                    "spread_s": max(times) - min(times),
                    "ratio": statistics.median(times) / own,
                    "largest_difference_nats": difference,
                }
            )
    return rows


def grow_the_road() -> list[dict[str, object]]:
    """Time a sweep of 10,440 candidates on roads 1, 4 and 16 times as long."""
    rows = []
    for repeats in (1, 4, 16):
        drive = winding_drive(repeats, "car")
        for objective in (Entropy([drive]), Trace([drive])):
            placement = np.arange(0, objective.n_candidates, objective.n_candidates // 20)[:20]
            state = objective.state(placement)
            state.gains()
            times = []
            for _ in range(REPEATS):
                start = time.process_time()
                state.gains()
                times.append(time.process_time() - start)
            rows.append(
                {
                    "part": "road length",
                    "objective": objective.name,
                    "profile": "car",
                    "road_m": float(drive.points.s_m[-1]),
                    "candidates": objective.n_candidates,
                    "method": "window",
                    "seconds": statistics.median(times),
                    "spread_s": max(times) - min(times),
                }
            )
    return rows


def winding_drive(repeats: int, profile: str) -> Drive:
    """Drive `winding` laid end to end; every `repeats`-th candidate, so their number stays."""
    instance = load_instance("winding")
    if repeats > 1:
        pieces = [piece.model_dump() for piece in instance.road.pieces or []]
        # every other one mirrored, or the road would bite its own tail
        mirrored = [
            {**piece, "curvature": [-k for k in np.atleast_1d(piece["curvature"]).tolist()]}
            for piece in pieces
        ]
        laid = [mirrored if lap % 2 else pieces for lap in range(repeats)]
        instance = instance.changed({"road.pieces": [piece for lap in laid for piece in lap]})
    scene = assemble(instance)
    count = scene.information.n_candidates
    rows = np.sort(np.random.default_rng(0).permutation(count)[:10_440])
    return Drive(
        scene.points,
        subset(scene.information, rows),
        PROFILES[profile],
        np.array(INITIAL_SIGMA),
    )


def subset(information: Information, rows: IntArray) -> Information:
    """Return the information of the candidates `rows` alone."""
    counts = np.diff(information.indptr)[rows]
    entries = np.concatenate(
        [np.arange(information.indptr[i], information.indptr[i + 1]) for i in rows]
    )
    return Information(
        information.n_samples,
        np.concatenate([[0], np.cumsum(counts)]),
        information.indices[entries],
        information.blocks[entries],
        frames_per_sample=information.frames_per_sample,
    )


def greedy(objective: NavigationObjective, count: int) -> IntArray:
    """Return `count` candidates, each the best next."""
    state = objective.state()
    for _ in range(count):
        state.add(int(np.argmax(state.gains())))
    return np.array(state.selected)


def warm_up(messages: WhiteEntropyMessages) -> None:
    """Compile the rivals."""
    d = messages.drive
    for textbook in (False, True):
        refilter_rows(
            d.indptr, d.indices, d.blocks, d.frames, 1, d.steps, d.p0, messages.total, textbook
        )


def refilter(messages: WhiteEntropyMessages, *, textbook: bool) -> FloatArray:
    """Return every candidate's gain by filtering the whole road with it."""
    d = messages.drive
    values = refilter_rows(
        d.indptr,
        d.indices,
        d.blocks,
        d.frames,
        d.indptr.size - 1,
        d.steps,
        d.p0,
        messages.total,
        textbook,
    )
    return np.asarray(values - messages.score, dtype=np.float64)


@njit(cache=True)
def refilter_rows(indptr, indices, blocks, frames, count, steps, p0, base, textbook):  # type: ignore[no-untyped-def]
    """Return Σ log det(I + P_t J_t) over the road for the placement with each candidate."""
    out = np.empty(count)
    n = steps.shape[0]
    before, after, logs = np.empty((n, 6)), np.empty((n, 6)), np.empty(n)
    total = np.empty_like(base)
    for i in range(count):
        total[:] = base
        for e in range(indptr[i], indptr[i + 1]):
            total[indices[e], 0] += frames * blocks[e, 0]
            total[indices[e], 2] += frames * blocks[e, 0]
        if textbook:
            out[i] = filter_textbook(steps, p0, total)
        else:
            out[i] = filter_forward(steps, p0, total, before, after, logs)
    return out


@njit(cache=True)
def filter_textbook(steps, p0, total):  # type: ignore[no-untyped-def]
    """Return Σ log det(I + P_t J_t) with 3×3 matrices: P ← F P Fᵀ + Q, P ← (P⁻¹ + HᵀJH)⁻¹."""
    p = np.array([[p0[0], p0[1], p0[2]], [p0[1], p0[3], p0[4]], [p0[2], p0[4], p0[5]]])
    f, q, j = np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((3, 3))
    log_sum = 0.0
    for t in range(steps.shape[0]):
        if t > 0:
            s = steps[t]
            f[0, 0], f[0, 1], f[0, 2] = s[0], s[1], s[2]
            f[1, 0], f[1, 1], f[1, 2], f[2, 2] = -s[1], s[0], s[3], 1.0
            q[0, 0], q[0, 1], q[0, 2] = s[4], s[5], s[6]
            q[1, 0], q[1, 1], q[1, 2] = s[5], s[7], s[8]
            q[2, 0], q[2, 1], q[2, 2] = s[6], s[8], s[9]
            p = f @ p @ f.T + q
        j[0, 0], j[0, 1], j[1, 0], j[1, 1] = total[t, 0], total[t, 1], total[t, 1], total[t, 2]
        gained = np.eye(3) + p @ j
        log_sum += np.log(np.linalg.det(gained))
        p = np.linalg.inv(gained) @ p
        p = 0.5 * (p + p.T)
    return log_sum


if __name__ == "__main__":
    main()
