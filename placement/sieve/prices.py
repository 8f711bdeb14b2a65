"""The price of a camera at which paths of any length bound those of at most k best.

As a function of the price the bound is convex; its slope is k less the cameras of the best path. So
tangents at two prices, one at which paths are too long and one at which they are too short, say how
much lower it can be anywhere between them.
"""

from __future__ import annotations

import math
from collections.abc import Callable

STEEP = 0.75  # a path's cameras fall with the price to about −1 / STEEP: a first guess
PAST = 1.03  # a guess goes so much farther, to have the best price between two


def seek_price(
    evaluate: Callable[[float], tuple[float, int]],
    budget: int,
    price: float,
    enough: Callable[[float], float],
    may_go_on: Callable[[int], bool],
) -> None:
    """Try prices; `evaluate` says the bound at one and its path's cameras.

    Stops where no price can lower the least bound b found by more than `enough(b)`, or after so
    many as `may_go_on` no more.
    """
    low: tuple[float, float, int] | None = None  # price, bound and cameras: too many
    high: tuple[float, float, int] | None = None  # not enough
    least = math.inf
    tried = 0
    while tried == 0 or may_go_on(tried):
        tried += 1
        bound, length = evaluate(price)
        least = min(least, bound)
        if length == budget or (price == 0.0 and length < budget):
            return
        if length > budget:
            low = price, bound, length
        else:
            high = price, bound, length
        if low is None or high is None:
            factor = min(max((max(length, 0.5) / budget) ** STEEP, 0.25), 4.0)
            price = max(price, 1e-9) * factor * (PAST if factor > 1.0 else 1.0 / PAST)
            price = price if price > 1e-9 else 0.0
            continue
        fall, rise = low[2] - budget, budget - high[2]
        meet = (low[1] - high[1] + fall * low[0] + rise * high[0]) / (fall + rise)
        if least - (low[1] - fall * (meet - low[0])) <= enough(least):
            return
        # where there would be k cameras if they fell as a power of the price
        many, few = math.log(low[2] / budget), math.log(budget / max(high[2], 0.5))
        part = min(max(many / (many + few), 0.1), 0.9)
        price = low[0] * (high[0] / low[0]) ** part if low[0] > 0.0 else part * high[0]
