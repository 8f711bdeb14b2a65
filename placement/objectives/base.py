"""What a solver may ask of an objective."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from models.geometry import FloatArray, IntArray


class State(Protocol):
    """A placement under construction: the messages that make gains cheap.

    `score` is what solvers maximise: the value where the objective is maximised, minus the
    value where it is minimised. Gains and losses are changes of the score.
    """

    @property
    def selected(self) -> list[int]:
        """The candidates chosen so far, in the order they were added."""

    @property
    def score(self) -> float:
        """The score of `selected`."""

    def gains(self, candidates: IntArray | None = None) -> FloatArray:
        """Return the change of the score on adding each of `candidates` (default: all), (m,)."""

    def add(self, candidate: int) -> None:
        """Add one candidate."""

    def remove(self, candidate: int) -> None:
        """Remove one candidate."""


class Objective(Protocol):
    """A set function over candidates, deterministic and cheap to update."""

    @property
    def name(self) -> str:
        """The `objective.kind` of the instance file."""

    @property
    def unit(self) -> str:
        """`nats`, `m^2`, …"""

    @property
    def maximise(self) -> bool:
        """Whether larger values are better."""

    @property
    def submodular(self) -> bool:
        """Whether the score is monotone submodular, so that greedy's guarantees hold."""

    @property
    def n_candidates(self) -> int:
        """The number of candidates, c."""

    def value(self, selected: IntArray) -> float:
        """Evaluate a placement from scratch, independently of any state."""

    def state(self, selected: IntArray | None = None) -> State:
        """Start a placement, empty unless `selected` is given."""


@runtime_checkable
class Demanding(Protocol):
    """An objective that not every placement satisfies, whatever its constraints."""

    def shortfall(self, selected: IntArray) -> str | None:
        """Say what a placement lacks; None if it lacks nothing."""


@runtime_checkable
class Relaxable(Protocol):
    """An objective whose score extends concavely to fractional choices x in [0, 1]^c."""

    def relaxed(self, x: FloatArray) -> tuple[float, FloatArray]:
        """Return the extended score and its gradient (c,) at `x` (c,).

        Concavity makes score(x) + gradient·(y − x) an upper bound on the score at every y:
        the certificate of `placement.bounds`.
        """


@runtime_checkable
class Curved(Relaxable, Protocol):
    """A relaxable objective that knows how its gradient changes, at least nearly."""

    def curvature(self, x: FloatArray, among: IntArray) -> FloatArray | None:
        """Return the second derivatives (m, m) at `x` (c,) by the shares of `among` (m,).

        Near enough for Newton's steps; None where it cannot tell. What it prepares grows with the
        number of candidates: ask it of those that matter (`placement.bounds.restrict`).
        """
