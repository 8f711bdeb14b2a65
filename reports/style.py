"""One look for every figure: colours that colour-blind readers can tell apart, units on axes."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import matplotlib as mpl
from cycler import cycler
from matplotlib.figure import Figure

# Okabe and Ito (2008), colours distinct under every common colour-vision deficiency.
BLACK, ORANGE, SKY, GREEN, YELLOW, BLUE, VERMILION, PURPLE = (
    "#000000", "#E69F00", "#56B4E9", "#009E73", "#F0E442", "#0072B2", "#D55E00", "#CC79A7",
)  # fmt: skip
GREY = "#8A8A8A"
CYCLE = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY, BLACK)

_STYLE: Any = {
    "axes.grid": True,
    "axes.prop_cycle": cycler(color=CYCLE),
    "axes.spines.right": False,
    "axes.spines.top": False,
    "figure.constrained_layout.use": True,
    "font.size": 9.0,
    "grid.alpha": 0.3,
    "legend.frameon": False,
    "savefig.dpi": 160,
    "svg.hashsalt": "placement",  # the same figure is the same bytes
}


@contextmanager
def style() -> Iterator[None]:
    """Draw in our style until the block ends."""
    with mpl.rc_context(_STYLE):
        yield


def saved(figure: Figure, kind: str) -> Callable[[Path], None]:
    """Return a function that writes `figure` to a path as `kind` (png, svg), undated.

    It is laid out for what is written first; the other has its axes at the same places.
    """

    def save(path: Path) -> None:
        metadata = {"Date": None} if kind == "svg" else {"Software": None}
        with style():
            figure.savefig(path, format=kind, metadata=metadata)
        figure.set_layout_engine("none")  # which takes a third of the time, once more

    return save
