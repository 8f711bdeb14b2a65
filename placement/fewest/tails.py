"""What is needed from the floor on, asked from the end of the road backward, window by window.

A sweep that starts at the root knows little of what lies far ahead, and follows placements that
spend there what they cannot have. So the floor is asked first at the end of the road, then a window
earlier, and so on: labels are followed some way beyond the window, to where what has been learned
before says what they still need.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from placement.fewest.arrays import MOST_UNITS, Effort

if TYPE_CHECKING:
    from placement.fewest.bound import Counting


@dataclass(frozen=True, slots=True)
class Pass:
    """One pass from the end to the start: samples of a window, and how far labels are followed."""

    window: int
    ahead: int
    effort: Effort


PASSES = (
    Pass(20, 60, Effort(4, 1, 0.1)),
    Pass(20, 100, Effort(4, 1, 0.1)),
    Pass(20, 150, Effort(4, 1, 0.1)),
)


def ask_tails(
    counting: Counting,
    how: Pass,
    stop: Callable[[], bool],
    tell: Callable[[float], None] = lambda _share: None,
) -> None:
    """Raise what the floor needs, and what labels do, from the last window to the first.

    Raises:
        OutOfTime: when `stop` says so; what was learned stays.
    """
    t = counting.course.steps.shape[0]
    asked = np.zeros(t, dtype=np.bool_)
    for end in range(t, 0, -how.window):
        here = slice(max(0, end - how.window), end)
        tell(1.0 - end / t)
        asked[here] = counting.floor[here] < MOST_UNITS
        while asked.any():  # whoever needs more than was known is asked again
            before = counting.floor[:t].copy()
            if not counting.ask(asked, min(t, end + how.ahead), how.effort, stop):
                break
            asked &= counting.floor[:t] > before
        asked[:] = False
