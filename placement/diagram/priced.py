"""Sweeps that pay for cameras instead of counting them: one bounds every budget at once.

With a price μ a camera the diagram bounds f(S) + μ|S| from below over placements of any size, by L
say, and so f(S) ≥ L − μk for every placement of k cameras: a tangent of the curve's convex hull
(Lagrange: Geoffrion 1974). Labels need no count, so k of them are one, and no placement below the
threshold θ has more than θ/μ cameras, which raises the floors.

Inside clusters labels are told apart by how many cameras have joined at this sample, so that an arc
into a label is recorded before those out of it: at the next sample that number is 1 again. Where
more could join than are told apart, the last of them brings the join of all that start there, as
often as cameras may be missing, and no other may follow: docs/trace-bound.md has the proof.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from models.geometry import BoolArray, IntArray
from placement.diagram.alone import alone_moves
from placement.diagram.arrays import LOOKS, Rules, empty_table
from placement.diagram.layout import lay_moves, longest_view, road_above, views_of
from placement.diagram.moves import floor_information
from placement.diagram.passes import COARSE, EPSILON, ROUNDING
from placement.diagram.single import sweep_once
from placement.diagram.togo import least_by_cut, merged_table
from placement.objectives.navigation import WhiteDrive
from placement.objectives.navigation_chain import Drive


@dataclass(frozen=True, slots=True)
class PricedOutcome:
    """What a sweep proved and found: the bound on the sum, and the moves of its best path."""

    bound: float
    path: list[int]
    labels: int
    looks: int  # at pairs of labels: what a sweep's time goes with


class PricedDiagram:
    """The relaxed decision diagram of one drive under one weight and one price a camera."""

    def __init__(
        self,
        drive: WhiteDrive,
        weight: tuple[float, float],
        usable: BoolArray,
        required: IntArray,
        price: float,
        *,
        most: int,
        starting: IntArray,
        together: int,
        typical: int,
        persistent: Drive | None = None,
    ) -> None:
        """Prepare for at most `most` of the `usable` (c,) cameras beside the required ones.

        `price` > 0 is in the unit of the sum over samples. `starting` (t,) is how many cameras of a
        placement start at each sample at most (`moves.most_starting`), `together` how many that
        join at one sample are told apart; `typical` is a likely number of cameras in all.
        `persistent`: as for `Diagram`.

        Raises:
            ValueError: if most views are too long, or fewer than two may join at one sample.
        """
        if together < 2:
            raise ValueError(f"together must be at least 2, got {together}")
        self.drive = drive
        self.price = price
        self.counts = max(1, min(most, together, 1 + int(starting.max(initial=0))))
        self.moves, base = lay_moves(drive, usable, required, most)
        floor = drive.total(required) + floor_information(drive, usable, most)
        reach = max(1, drive.n_samples // (2 * max(typical, 1)))
        self.road = road_above(drive, weight, base, floor, reach)
        beyond = np.minimum(most - self.counts, starting - (self.counts - 1))
        self.views = views_of(self.moves, drive.n_samples, beyond)
        self.alone = alone_moves(persistent, usable, base, longest_view(most))
        self.candidate = np.concatenate([self.moves.candidate, self.alone.candidate])
        self.bound = float(self.road.floor_cost[-1])
        self.threshold = np.inf
        self.forget()

    def forget(self) -> None:
        """Give back the memory of earlier sweeps; the bound stays."""
        self.table = empty_table(self.drive.n_samples, self.counts)
        self.cuts = np.zeros((self.drive.n_samples + 1, self.counts + 1))

    def sweep(
        self,
        width: int,
        threshold: float,
        out_of_time: Callable[[], bool],
        *,
        probing: bool = False,
        epsilon: float = EPSILON,
        coarse_width: int = 4,
        slots: int = 2,
        progress: Callable[[float], None] = lambda _share: None,
    ) -> PricedOutcome | None:
        """Sweep once, forgetting placements whose sum and price come to `threshold` or more.

        Improves `bound`, at most the least threshold so far. Return None if storage ran out.

        Raises:
            OutOfTime: before the bound is known; nothing is changed then.
        """
        self.threshold = min(self.threshold, threshold)
        limit = np.inf if probing else self.threshold
        rules = Rules(limit, width, epsilon, 0.0, COARSE, coarse_width, slots, probing, self.price)
        swept = sweep_once(
            self.drive.p0,
            self.road,
            self.views,
            self.alone,
            rules,
            self.table,
            self.cuts,
            self.counts,
            [(0, 0.0)],
            out_of_time,
            progress,
        )
        if swept is None:
            return None
        nodes, root = swept.nodes, int(swept.roots[0])
        found = min(float(nodes.togo[root]) * (1.0 - ROUNDING), self.threshold)
        self.bound = max(self.bound, found)
        if not probing:
            least_by_cut(nodes.lo, nodes.hi, nodes.togo, self.cuts)
        self.table = merged_table(self.table, nodes.lo, nodes.hi, nodes.p, nodes.togo)
        path = swept.path(root, self.candidate)
        return PricedOutcome(found, path, swept.labels, swept.counters[LOOKS])
