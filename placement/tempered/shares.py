"""Look for the share at which the tempered chain bounds a line best.

The distance of a share from 1 is what matters: it is doubled or halved while that lowers the bound,
then tried half as far to either side. The bound is quasi-convex in it wherever we looked, but
nothing depends on that: every bound tried is valid, and the least is kept.
"""

from __future__ import annotations

from collections.abc import Callable

LEAST_DISTANCE = 0.005  # of shares from 1, where the search begins at 1
LOWEST = 0.1


def better_share(
    share: float, bound: float, evaluate: Callable[[float], float], may_go_on: Callable[[], bool]
) -> float:
    """Return the best share found from `share`, whose `bound` is known.

    `evaluate` returns the bound at a share; it is not called again once `may_go_on` says no.
    """
    for step in (2.0, 2.0**0.5):
        for factor in (step, 1.0 / step):
            improved = False
            while may_go_on():
                other = 1.0 - factor * max(1.0 - share, LEAST_DISTANCE)
                if not LOWEST <= other < 1.0:
                    break
                found = evaluate(other)
                if found >= bound:
                    break
                share, bound, improved = other, found, True
            if improved:
                break
    return share
