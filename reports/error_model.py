"""The error-model study: the dissertation's chapter 5, and whether our models are calibrated."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from placement.atomic import prepare_folder, write_files
from reports import error_figures, error_tables
from reports.parts import Parts
from reports.study_files import study_files
from reports.style import style

SAMPLES = 125_000


def run(
    out_dir: Path,
    *,
    quick: bool = False,
    seed: int = 0,
    parts: Parts | None = None,
    progress: Callable[[str, float | None], None] = lambda _text, _fraction: None,
) -> None:
    """Write the study's CSV files and figures (PNG and SVG) into `out_dir`.

    Every table has its own stream of random numbers, so one table does not change with another.
    `quick` draws a tenth of the samples. Raises ValueError where the folder cannot be written.
    """
    prepare_folder(out_dir)
    makers = _tables(quick)
    made = (parts or Parts()).compute(
        _table,
        {name: (name, quick, seed) for name in makers},
        lambda name, share: progress(f"error model: {name}", share),
    )
    tables: dict[str, pd.DataFrame] = dict(zip(makers, made, strict=True))
    with style():
        figures = {
            name: draw(tables[name]) for name, (_, draw) in makers.items() if draw is not None
        }
    progress("error model: writing", None)
    write_files(out_dir, study_files(tables, figures))


def _table(name: str, quick: bool, seed: int) -> pd.DataFrame:
    """Make one table, with a stream of random numbers of its own."""
    makers = _tables(quick)
    return makers[name][0](np.random.default_rng([seed, list(makers).index(name)]))


Maker = Callable[[np.random.Generator], pd.DataFrame]
Drawer = Callable[[pd.DataFrame], Figure]


def _tables(quick: bool) -> dict[str, tuple[Maker, Drawer | None]]:
    share = 10 if quick else 1
    samples, side = SAMPLES // share, 60 if quick else 250

    def sampled(make: Callable[[int, np.random.Generator], pd.DataFrame], n: int) -> Maker:
        return partial(make, n)

    def regular(make: Callable[[int], pd.DataFrame]) -> Maker:
        return lambda _rng: make(side)

    return {
        "bound_coverage": (sampled(error_tables.bound_coverage, SAMPLES), None),
        "coverage_by_pitch": (
            sampled(error_tables.coverage_by_pitch, samples),
            error_figures.draw_coverage,
        ),
        "first_order_limit": (
            sampled(error_tables.first_order_limit, 16 * samples),
            error_figures.draw_first_order,
        ),
        "residuals": (sampled(error_tables.residuals, samples), error_figures.draw_residuals),
        "components_by_pitch": (
            regular(error_tables.components_by_pitch),
            error_figures.draw_components,
        ),
        "algorithm_error": (
            sampled(error_tables.algorithm_error, samples),
            error_figures.draw_algorithm,
        ),
        "resolution": (regular(error_tables.resolution), error_figures.draw_resolution),
        "bounds_by_pitch": (regular(error_tables.bounds_by_pitch), error_figures.draw_bounds),
        "distances_by_pitch": (regular(error_tables.distances_by_pitch), None),
        "installation": (regular(error_tables.installation), error_figures.draw_installation),
    }
