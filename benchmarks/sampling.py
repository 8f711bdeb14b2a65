"""Measure how fast reports are sampled: `python -m benchmarks.sampling`, a Markdown table."""

from __future__ import annotations

import argparse
import statistics
import sys
import time

import numpy as np

from models.cameras import make_camera
from models.installation import Installation
from models.sampling import sample_image


def sampling_table(samples: int = 1_000_000, repeats: int = 5) -> list[tuple[str, float]]:
    """Return (lens, million samples a second), one core, compiled code warm, median of repeats."""
    rows = []
    for lens in ("pinhole", "stereographic", "equidistant"):
        camera = make_camera(projection=lens)
        index, rng = np.zeros(samples, dtype=np.int64), np.random.default_rng(0)
        seconds = []
        for turn in range(repeats + 1):
            started = time.perf_counter()
            sample_image(camera, index, Installation(), rng)
            if turn:
                seconds.append(time.perf_counter() - started)
        rows.append((lens, samples / statistics.median(seconds) / 1e6))
    return rows


if __name__ == "__main__":
    argparse.ArgumentParser(description=__doc__).parse_args()
    sys.stdout.write("| lens | million samples a second |\n| --- | --- |\n")
    for lens, speed in sampling_table():
        sys.stdout.write(f"| {lens} | {speed:.1f} |\n")
