"""Line of sight against shapely's STRtree: `python -m benchmarks.sight NETWORK [--rays N]`.

NETWORK is a SUMO network with its buildings beside it. Rays run from mounts every 25 m along all
carriageways, 6 m high, to the samples of the network within 45 m: those that a field of view would
let through. Three ways answer all of them, in turns (A B C A B C …), in processor time:

- ours: the compiled walk through the grid;
- exact: STRtree's query for `intersects`, then the intersection matrix of each ray and building it
  found, because a ray that only touches a wall is clear;
- loose: STRtree's query alone, which takes touching for blocking.

The answers of ours and exact must be identical. Buildings without a height of their own are 10 m
high, above every camera, so rays need no cutting at the roofs and the rival gets none.
"""

from __future__ import annotations

import argparse
import json
import statistics
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from scipy.spatial import cKDTree

from models.files.roadfile import read_road_file
from models.geometry import BoolArray, FloatArray
from models.network import RoadNetwork
from models.obstacles import Obstacles
from models.sight import clear_rays
from models.sight_grid import sight_grid
from placement.city.mounts import network_mounts, network_order
from placement.instance.schema import CameraSection, MountsSection

HEIGHT_M = 6.0
REACH_M = 45.0


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure, print the table as Markdown, and write the numbers as JSON if asked to."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    parser.add_argument("network", type=Path)
    parser.add_argument("--rays", type=int, default=1_000_000)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--json", type=Path, help="also write the numbers here")
    options = parser.parse_args(arguments)
    network = read_road_file(options.network)
    cameras, cars = some_rays(network, options.rays)
    found = compare(network.obstacles, cameras, cars, options.repeats)
    sys.stdout.write("\n".join(f"{key}: {value}" for key, value in found.items()) + "\n")
    if options.json is not None:
        options.json.write_text(json.dumps(found, indent=2) + "\n")
    if found["answers that differ"]:
        sys.exit(1)


def some_rays(network: RoadNetwork, n: int) -> tuple[FloatArray, FloatArray]:
    """Return cameras and cars (n, 2): rays of whole mounts, spread evenly over the city."""
    order = network_order(network)
    samples = network.sample(1.0, order)
    mounts = network_mounts(network, order, MountsSection(spacing_m=25.0), CameraSection())
    at = np.column_stack([mounts.x_m, mounts.y_m])
    near: Any = cKDTree(samples.points.xy).query_ball_point(at, REACH_M, return_sorted=True)
    counts = np.array([len(rows) for rows in near])
    every = max(1, int(counts.sum()) // n)
    runs = np.arange(len(at)) // 8 % every == 0  # neighbours stay together, as mounts do in use
    cameras = np.repeat(at[runs], counts[runs], axis=0)[:n]
    cars = samples.points.xy[np.concatenate([near[i] for i in np.flatnonzero(runs)])][:n]
    return np.ascontiguousarray(cameras), np.ascontiguousarray(cars)


def compare(
    obstacles: Obstacles, cameras: FloatArray, cars: FloatArray, repeats: int
) -> dict[str, Any]:
    """Answer every ray in three ways, in turns; return rays a second, ratios and differences."""
    if obstacles.height_m.min(initial=np.inf) < HEIGHT_M:
        raise ValueError(f"obstacles must be at least {HEIGHT_M} m high: rays would need cutting")
    grid = sight_grid(obstacles)
    columns = [np.ascontiguousarray(a) for a in (*cameras.T, *cars.T)]
    x, y, tx, ty = columns
    height = np.full(len(x), HEIGHT_M)
    polygons = np.array([shapely.Polygon(ring) for ring in obstacles.rings], dtype=object)
    tree = shapely.STRtree(polygons)

    def ours() -> BoolArray:
        out = np.empty(len(x), dtype=np.bool_)
        clear_rays(grid, x, y, height, tx, ty, out)
        return out

    def loose() -> BoolArray:
        rays = shapely.linestrings(np.stack([cars, cameras], axis=1))
        out = np.ones(len(x), dtype=np.bool_)
        out[tree.query(rays, predicate="intersects")[0]] = False
        return out

    def exact() -> BoolArray:
        rays: Any = shapely.linestrings(np.stack([cars, cameras], axis=1))
        ray, building = tree.query(rays, predicate="intersects")
        out = np.ones(len(x), dtype=np.bool_)
        out[ray[shapely.relate_pattern(rays[ray], polygons[building], "T********")]] = False
        return out

    ours()  # compiles
    ways: dict[str, Callable[[], BoolArray]] = {"ours": ours, "exact": exact, "loose": loose}
    seconds: dict[str, list[float]] = {name: [] for name in ways}
    answers: dict[str, BoolArray] = {}
    for _ in range(repeats):
        for name, way in ways.items():
            started = time.process_time()
            answers[name] = way()
            seconds[name].append(time.process_time() - started)
    median = {name: statistics.median(times) for name, times in seconds.items()}
    return {
        "buildings": len(obstacles),
        "rays": len(x),
        "clear": round(float(answers["ours"].mean()), 4),
        **{f"{name}, M rays/s": round(len(x) / s / 1e6, 3) for name, s in median.items()},
        "ratio to exact STRtree": round(median["exact"] / median["ours"], 1),
        "ratio to loose STRtree": round(median["loose"] / median["ours"], 1),
        "answers that differ": int(np.sum(answers["ours"] != answers["exact"])),
        "answers that differ from loose": int(np.sum(answers["ours"] != answers["loose"])),
    }


if __name__ == "__main__":
    main()
