"""Bound a whole curve by diagrams at a few prices, wherever its gap is then the widest.

At a price μ a camera every budget k has the bound L(μ) − μk (`placement.diagram.priced`). What is
missing at k is what the diagram has not proven, θ(μ) − L(μ) with θ(μ) = min over budgets of value +
μ·budget, and what the price does not suit k, value + μk − θ(μ). The one is bettered by a finer
sweep, the other by another price: where k is a corner of the curve's hull one between the slopes on
both sides, else the slope of its side, which leaves how far k lies above the hull.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from models.geometry import BoolArray, IntArray
from placement.diagram.moves import most_starting
from placement.diagram.priced import PricedDiagram
from placement.objectives.navigation_chain import Drive
from placement.objectives.trace import WhiteTrace
from placement.solvers.diagram import PROBE, PROBE_EPSILON, Effort

# The few cameras of small budgets seldom start together; many do, and what is given for nothing
# then costs more than telling them apart.
FEW = 15
TOGETHER_FEW, TOGETHER = 3, 10
EFFORTS_FEW = (Effort(60, 4, 2), Effort(250, 8, 4), Effort(400, 16, 8))
EFFORTS = (Effort(60, 4, 2), Effort(120, 8, 4), Effort(400, 16, 8))
LOOKS_A_LABEL = 100.0  # take as long as it takes to make a label
MOST_WORK = 31e6  # labels, or as much work, where there is no time limit
TRIES = 2  # sweeps after which a price must say more than is known
BEHIND = 1.5  # times what is open already, after the first sweep, will stay more
BESIDE = 1.25  # where a price said nothing new, none for nearly as many cameras will
SLIGHT = 1e-3  # a gap that nothing is done about
ALIKE = 1.05  # prices this near are one
OUTER = 1.3  # the ratio of slopes where the curve has no budget beyond its end
CLOSED = 1e-7


@dataclass(slots=True)
class Price:
    """One price, in m² a camera, and the drives' weighted diagrams at it."""

    price: float
    diagrams: list[tuple[float, PricedDiagram]]
    efforts: tuple[Effort, ...]
    steps: int = 0  # sweeps so far
    coarse: bool = False  # sweeps better one another by half, at most
    spent: bool = False  # no finer sweep is worth it

    @property
    def bound(self) -> float:
        """The proven lower bound on the value and the cameras' price, in m²."""
        return float(sum(w * d.bound / d.drive.n_samples for w, d in self.diagrams))


@dataclass(slots=True)
class PricedCurve:
    """Diagrams at prices for the budgets in `value`, which others keep up to date.

    Budgets here count cameras beside the required ones. `nothing` is the value of none, in m².
    `parts` are the weighted drives, `persistent` those whose cameras' offsets persist, else None;
    `usable` (c,), `required` and `group` (c,) as in constraints.
    """

    parts: list[tuple[float, WhiteTrace]]
    persistent: list[Drive | None]
    usable: BoolArray
    required: IntArray
    group: IntArray
    nothing: float
    value: Callable[[], dict[int, float]]
    offer: Callable[[list[int]], None]
    out_of_time: Callable[[], bool]
    tell: Callable[[str], None]
    prices: list[Price] = field(default_factory=list)
    work_done: float = 0.0
    probe_labels: int = 0  # the most that a probe took
    ceiling: float = math.inf  # no new price for as many cameras
    _starting: list[IntArray] = field(default_factory=list)

    def bound(self, budget: int) -> float:
        """Return the proven lower bound on the value with `budget` cameras, in m²."""
        return max([0.0, *(p.bound - p.price * budget for p in self.prices)])

    def refine(self, known: Callable[[int], float], most_work: float) -> None:
        """Sweep where the gap is widest until all are slight, nothing helps or work is done.

        `known` tells a budget's lower bound from elsewhere. Raises OutOfTime, bounds kept.
        """
        self._starting = [most_starting(p.drive, self.usable, self.group) for _, p in self.parts]
        given_up: set[int] = set()
        while self.work_done < most_work:
            value = self.value()
            gaps = {
                k: 1.0 - max(self.bound(k), known(k)) / max(v, 1e-300)
                for k, v in value.items()
                if k not in given_up and k > 0
            }
            widest = max(gaps, key=gaps.__getitem__, default=None)
            if widest is None or gaps[widest] <= SLIGHT:
                return
            chosen = self._chosen(widest, value)
            if chosen is None:
                given_up.add(widest)
                continue
            self._sweep(chosen, value)
            if not chosen.spent and self._lost(chosen, known):
                # what is given away where many views overlap is more than what others leave
                self._spend(chosen)
                self.ceiling = min(self.ceiling, least_at(chosen.price, value)[1] / BESIDE)

    def _lost(self, at: Price, known: Callable[[int], float]) -> bool:
        """Return whether a price will hardly bound any budget better than what is known does."""
        value = self.value()
        others = [p for p in self.prices if p is not at]
        ahead = 0.0
        for k, v in value.items():
            said = max([known(k), *(p.bound - p.price * k for p in others)])
            ahead = max(ahead, (v - said) / max(v - at.bound + at.price * k, 1e-300))
        return ahead < 1.0 if at.steps >= TRIES else at.coarse and ahead < 1.0 / BEHIND

    def above_hull(self, budget: int) -> float:
        """Return how far the value of `budget` cameras lies above the curve's hull, as a share."""
        value = self.value()
        price = price_for(budget, value, self.nothing)
        above = value[budget] + price * budget - least_at(price, value)[0]
        return above / max(value[budget], 1e-300)

    def _chosen(self, budget: int, value: dict[int, float]) -> Price | None:
        """Return what to refine for a budget: the price that suits it, or a new one, or nothing."""

        def unsuited(price: float) -> float:
            return value[budget] + price * budget - least_at(price, value)[0]

        unspent = [p for p in self.prices if not p.spent]
        best = min(unspent, key=lambda p: unsuited(p.price), default=None)
        wanted = price_for(budget, value, self.nothing)
        if wanted <= 0.0:  # no more cameras help
            return None
        if best is not None:
            unproven = least_at(best.price, value)[0] - best.bound
            if unsuited(best.price) <= max(unproven, unsuited(wanted) + SLIGHT * value[budget]):
                return best
        alike = [p for p in self.prices if max(p.price / wanted, wanted / p.price) < ALIKE]
        if budget >= self.ceiling or (alike and all(p.spent for p in alike)):
            return None
        return next((p for p in alike if not p.spent), None) or self._new(wanted, value)

    def _new(self, price: float, value: dict[int, float]) -> Price:
        """Lay out the diagrams at a price."""
        threshold, typical = least_at(price, value)
        most = min(max(value), int(threshold / price * (1.0 + 1e-9)))
        few = typical <= FEW
        total = sum(w for w, _ in self.parts)
        diagrams = [
            (
                weight,
                PricedDiagram(
                    part.drive,
                    (part.w_tt, part.w_nn),
                    self.usable,
                    self.required,
                    price / total * part.drive.n_samples,
                    most=most,
                    starting=starting,
                    together=TOGETHER_FEW if few else TOGETHER,
                    typical=typical,
                    persistent=persistent,
                ),
            )
            for (weight, part), starting, persistent in zip(
                self.parts, self._starting, self.persistent, strict=True
            )
        ]
        self.prices.append(Price(price, diagrams, EFFORTS_FEW if few else EFFORTS, coarse=not few))
        return self.prices[-1]

    def _sweep(self, at: Price, value: dict[int, float]) -> None:
        """Sweep every drive once at a price, more finely than before; the first time probe, too."""
        effort = at.efforts[at.steps]
        for weight, diagram in at.diagrams:
            n = diagram.drive.n_samples
            self.tell(f"price {at.price:.3g} m² a camera, width {effort.width}")
            if at.steps == 0:
                probe = diagram.sweep(
                    PROBE.width,
                    math.inf,
                    self.out_of_time,
                    probing=True,
                    epsilon=PROBE_EPSILON,
                    coarse_width=PROBE.coarse,
                    slots=PROBE.slots,
                )
                if probe is not None:
                    self.work_done += _work(probe.labels, probe.looks)
                    self.probe_labels = max(self.probe_labels, probe.labels)
            others = at.bound - weight * diagram.bound / n
            found = diagram.sweep(
                effort.width,
                (least_at(at.price, value)[0] - others) * n / weight,
                self.out_of_time,
                coarse_width=effort.coarse,
                slots=effort.slots,
            )
            if found is None:  # no room
                at.spent = True
                continue
            self.work_done += _work(found.labels, found.looks)
            self.offer(found.path)
        at.steps += 1
        closed = at.bound >= (1.0 - CLOSED) * least_at(at.price, self.value())[0]
        at.spent = at.spent or closed or at.steps == len(at.efforts)
        if at.spent:
            self._spend(at)

    def _spend(self, at: Price) -> None:
        """Sweep no more at a price."""
        at.spent = True
        for _, diagram in at.diagrams:
            diagram.forget()


def least_at(price: float, value: dict[int, float]) -> tuple[float, int]:
    """Return the least value with the cameras' price over all budgets, and its budget."""
    return min((v + price * k, k) for k, v in value.items())


def price_for(budget: int, value: dict[int, float], nothing: float) -> float:
    """Return the price, in m² a camera, that suits a budget: see the module's docstring."""
    points = dict(value)
    if 1 in points:
        points.setdefault(0, nothing)
    x = np.array(sorted(points), dtype=np.float64)
    y = np.array([points[int(k)] for k in x])
    corners: list[int] = []
    for n in range(x.size):
        while len(corners) > 1 and _slope(x, y, corners[-2], corners[-1]) >= _slope(
            x, y, corners[-1], n
        ):
            corners.pop()
        corners.append(n)
    at = int(np.searchsorted(x, budget))
    if at not in corners:
        right = int(np.searchsorted(corners, at))
        return -_slope(x, y, corners[right - 1], corners[right])
    n = corners.index(at)
    sides = [
        -_slope(x, y, corners[m], corners[m + 1]) for m in (n - 1, n) if 0 <= m < len(corners) - 1
    ]
    if not sides or min(sides) <= 0.0:
        return max([0.0, *sides])
    if len(sides) == 2:
        return math.sqrt(sides[0] * sides[1])
    return sides[0] * (OUTER if n == 0 else 1.0 / OUTER)


def _slope(x: np.ndarray, y: np.ndarray, a: int, b: int) -> float:
    return float((y[b] - y[a]) / (x[b] - x[a]))


def _work(labels: int, looks: int) -> float:
    return labels + looks / LOOKS_A_LABEL
