"""Does a filter's covariance tell the truth? NEES, NIS and whiteness over many drives."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from scipy import stats

from models.geometry import FloatArray
from models.simulation import Drives

POSE_FREEDOM = 3
POSITION_FREEDOM = 2
_FEWEST = 0.5  # of the runs, still driving, for a step to be judged


def chi2_band(n: FloatArray, freedom: int, level: float = 0.95) -> tuple[FloatArray, FloatArray]:
    """Return where the mean of n squared normalised errors lies with probability `level`.

    n (t,): how many independent runs each mean is over. A mean of n χ²(freedom) variables is
    χ²(n·freedom)/n (Bar-Shalom, Li and Kirubarajan 2001, section 5.4.2).
    """
    tail = 0.5 * (1.0 - level)
    low: FloatArray = stats.chi2.ppf(tail, freedom * n) / n
    high: FloatArray = stats.chi2.ppf(1.0 - tail, freedom * n) / n
    return low, high


def bootstrap_band(
    totals: FloatArray, counts: FloatArray, rng: np.random.Generator, *, draws: int = 2000
) -> tuple[float, float]:
    """Return the 95 % percentile band of Σ totals/Σ counts, resampling whole runs, (m,) each.

    Steps of one run are far from independent, runs are independent: so runs are what is drawn.
    """
    m = len(totals)
    share = rng.multinomial(m, np.full(m, 1.0 / m), size=draws).astype(np.float64)
    means = (share @ totals) / (share @ counts)
    low, high = np.quantile(means, [0.025, 0.975])
    return float(low), float(high)


@dataclass(slots=True)
class StepTally:
    """Gather NEES by filter step over any number of batches of drives.

    total, runs (t,): the sum over runs at each step, and how many were still driving.
    """

    total: FloatArray = field(default_factory=lambda: np.zeros(0))
    runs: FloatArray = field(default_factory=lambda: np.zeros(0))

    def add(self, drives: Drives) -> None:
        """Take in a batch."""
        longest = max(len(self.total), drives.nees.shape[1])
        for name, more in (
            ("total", drives.nees.sum(axis=0)),
            ("runs", drives.active.sum(axis=0).astype(np.float64)),
        ):
            grown = np.zeros(longest)
            grown[: len(getattr(self, name))] = getattr(self, name)
            grown[: len(more)] += more
            setattr(self, name, grown)

    def judged(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the mean NEES at each step that counts, and its χ² band: three arrays (t,).

        Steps at which less than half of the runs still drive do not count.
        """
        n = self.runs[self.runs >= _FEWEST * self.runs.max(initial=0.0)]
        n = n[n > 0.0]
        low, high = chi2_band(n, POSE_FREEDOM)
        return self.total[: len(n)] / n, low, high

    def share_in_band(self) -> float:
        """Return the share of steps whose mean over runs lies in its 95 % χ² band."""
        mean, low, high = self.judged()
        return float(np.mean((mean >= low) & (mean <= high)))


def whiteness_band(pairs: int) -> float:
    """Return the half-width of the 95 % band of the lag-one autocorrelation of `pairs` pairs.

    Each pair has two components, so the variance of a white sequence's estimate is 1/(2·pairs).
    """
    return 1.959964 / math.sqrt(2.0 * pairs) if pairs else math.inf
