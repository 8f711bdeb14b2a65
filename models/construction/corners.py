"""Roads of lines and arcs: given which corners they go round and how, pulled tight.

With its corners and sides given, the length of a road is least where every circle that may turn
about its corner has done so until the pulls of its two lines balance: the circle's centre moves
against u_in − u_out, the gradient of the length with respect to it (u the directions of travel).
Where that road is blocked, a corner more may help, or a search over the angles.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from models.construction.homotopy import Word, crossing_word
from models.construction.kernels import STRAIGHT, distance_of_pieces, leg
from models.construction.lattice import Lattice, polyline
from models.geometry import FloatArray

_ROUNDS = 60
_STILL_RAD = 1e-10
_LIMIT_RAD = 1.05 * math.pi  # a circle that turns more has lost its grip
_MOST_CORNERS_MORE = 12
_STEPS_RAD = tuple(math.radians(10.0) * 0.4**n for n in range(12))  # down to 0.0004°
_MOST_TRIES = 1500

Touch = tuple[int, float]  # a corner of the site, and the side (1 left, −1 right) it is rounded


@dataclass(frozen=True, slots=True)
class Belt:
    """Hold nodes (m, 5) and the kinds of the legs between them, as `kernels` has them.

    `corner` and `angle` (m,): what corner of the site each node goes round, touching where; −1 for
    those that cannot turn. `word`: the class that the belt must not leave.
    """

    lattice: Lattice
    nodes: FloatArray
    corner: tuple[int, ...]
    angle: FloatArray
    kinds: tuple[int, ...]
    word: Word

    def legs(self) -> list[FloatArray] | None:
        """Return each leg's pieces (3, 2); None if one does not exist."""
        radius = self.lattice.at_ends.radius_m
        found = [
            leg(self.nodes[n], self.nodes[n + 1], kind, radius) for n, kind in enumerate(self.kinds)
        ]
        return None if any(pieces[0, 0] < 0.0 for pieces in found) else found

    @property
    def length_m(self) -> float:
        """The length, infinite for a belt that does not exist."""
        legs = self.legs()
        return math.inf if legs is None else float(sum(pieces[:, 0].sum() for pieces in legs))

    def pieces(self) -> list[tuple[float, float]]:
        """Return (length, curvature) of every line and arc in order."""
        return [(float(size), float(k)) for pieces in self.legs() or [] for size, k in pieces]

    def touches(self) -> list[Touch]:
        """Return the corners gone round, in order, each once."""
        found = [
            (corner, float(node[3]))
            for corner, node in zip(self.corner, self.nodes, strict=True)
            if corner >= 0
        ]
        return [touch for n, touch in enumerate(found) if n == 0 or touch != found[n - 1]]

    def turned(self, angles: FloatArray) -> Belt:
        """Return the belt with its circles turned to `angles` (m,)."""
        nodes = self.nodes.copy()
        for n, corner in enumerate(self.corner):
            if corner >= 0:
                side = float(nodes[n, 3])
                nodes[n] = self.lattice.round_corner(corner, float(angles[n]), side)
        return replace(self, nodes=nodes, angle=angles)

    def clear(self) -> bool:
        """Return whether legs exist, hold their bends, turn little, keep their distance and class.

        A corner's circle may turn by half a circle and a little, all in all.
        """
        legs = self.legs()
        if legs is None:
            return False
        lattice, last = self.lattice, len(self.nodes) - 1
        for n in range(1, last):
            turn = (legs[n - 1][2, 0] + legs[n][0, 0]) / self.nodes[n, 4]
            if turn > _LIMIT_RAD:
                return False
        for n, pieces in enumerate(legs):
            need = self._lead(n) + self._lead(n + 1)
            if self.kinds[n] == STRAIGHT and pieces[:, 0].any() and pieces[1, 0] < need - 1e-9:
                return False
            keep = lattice.site.keep_m if n in (0, last - 1) else lattice.keep_m
            x, y, heading = (float(value) for value in self.nodes[n, :3])
            edges = lattice.site.edges_m
            if distance_of_pieces(x, y, heading, pieces, edges, keep, keep - 2e-9) < keep - 2e-9:
                return False
        return crossing_word(self.path(legs), lattice.site.marks_m) == self.word

    def path(self, legs: list[FloatArray]) -> FloatArray:
        """Return points (m, 2) along the belt, at most 5° apart on arcs."""
        x, y, heading = (float(value) for value in self.nodes[0, :3])
        return polyline(x, y, heading, np.concatenate(legs))

    def _lead(self, n: int) -> float:
        bend = self.lattice.at_corners if self.corner[n] >= 0 else self.lattice.at_ends
        return bend.lead_m


def belt_of_rows(lattice: Lattice, rows: Sequence[int], kinds: Sequence[int], word: Word) -> Belt:
    """Return the belt of a way through the lattice's nodes `rows`."""
    at = list(rows)
    corner = tuple(int(c) for c in lattice.corner[at])
    return Belt(lattice, lattice.nodes[at], corner, lattice.angle[at].copy(), tuple(kinds), word)


def tighten(belt: Belt) -> Belt:
    """Return the shortest clear belt found by turning the circles of a clear one."""
    if all(corner < 0 for corner in belt.corner):
        return belt
    tight = _balanced(belt)
    if tight.length_m < belt.length_m and tight.clear():
        return tight
    more = pull(belt.lattice, belt.touches(), belt.word)
    best = belt if more is None or more.length_m > belt.length_m else more
    return _searched(best)


def pull(lattice: Lattice, touches: Sequence[Touch], word: Word) -> Belt | None:
    """Return the tight belt round corners, with more or fewer of them where that clears its way.

    None if no such belt of the class `word` is clear. Tries both sides at both ends.
    """
    found = []
    last = len(lattice.nodes) - 2
    for start, goal in itertools.product((0, 1), (last, last + 1)):
        # from nothing, too: a corner of a way without radius may be none of the road's
        for first in (list(touches), []) if touches else ([],):
            belt = _pulled(lattice, first, start, goal, word)
            if belt is not None:
                found.append(belt)
    return min(found, key=lambda belt: belt.length_m, default=None)


def _pulled(
    lattice: Lattice, touches: list[Touch], start: int, goal: int, word: Word
) -> Belt | None:
    dropped: set[Touch] = set()
    for _ in range(_MOST_CORNERS_MORE):
        belt = _balanced(_laid(lattice, touches, start, goal, word))
        legs = belt.legs()
        if legs is None:
            return None
        slack = [
            n
            for n in range(1, len(belt.nodes) - 1)
            if legs[n - 1][2, 0] + legs[n][0, 0] > _LIMIT_RAD * belt.nodes[n, 4]
        ]
        if slack:  # it would have to push: go without
            dropped.add(touches.pop(slack[0] - 1))
            continue
        if belt.clear():
            return belt
        place = _blocking(belt, legs, touches)
        if place is None or place[1] in dropped:
            return None
        touches.insert(*place)
    return None


def _laid(lattice: Lattice, touches: list[Touch], start: int, goal: int, word: Word) -> Belt:
    """Lay a belt round corners, each touched on the outside of the bend of the chain of corners."""
    site = lattice.site
    ends = lattice.nodes[[start, goal], :2]
    chain = np.vstack((ends[:1], site.corner_m[[c for c, _ in touches]].reshape(-1, 2), ends[1:]))
    steps = np.diff(chain, axis=0)
    steps /= np.maximum(np.hypot(*steps.T), 1e-12)[:, None]
    nodes, angles = [lattice.nodes[start]], [0.0]
    for n, (corner, side) in enumerate(touches):
        along = steps[n] + steps[n + 1]
        angle = math.atan2(along[1], along[0]) - side * 0.5 * math.pi
        nodes.append(lattice.round_corner(corner, angle, side))
        angles.append(angle)
    nodes.append(lattice.nodes[goal])
    return Belt(
        lattice,
        np.array(nodes),
        (-1, *(c for c, _ in touches), -1),
        np.array([*angles, 0.0]),
        (STRAIGHT,) * (len(touches) + 1),
        word,
    )


def _balanced(belt: Belt) -> Belt:
    """Turn every circle between two lines until the pulls balance."""
    free = [
        n
        for n, corner in enumerate(belt.corner)
        if corner >= 0 and belt.kinds[n - 1] == STRAIGHT == belt.kinds[n]
    ]
    for _ in range(_ROUNDS if free else 0):
        legs = belt.legs()
        if legs is None:
            return belt
        angles, most = belt.angle.copy(), 0.0
        for n in free:
            before = belt.nodes[n, 2] - legs[n - 1][2].prod()  # headings on the lines in and out
            after = belt.nodes[n, 2] + legs[n][0].prod()
            pull_x = math.cos(before) - math.cos(after)
            pull_y = math.sin(before) - math.sin(after)
            if math.hypot(pull_x, pull_y) < 1e-7:  # no bend: touch where the line does
                side = float(belt.nodes[n, 3])
                wanted = before - side * 0.5 * math.pi
            else:
                wanted = math.atan2(pull_y, pull_x)
            change = math.remainder(wanted - angles[n], math.tau)
            angles[n] += change
            most = max(most, abs(change))
        belt = belt.turned(angles)
        if most < _STILL_RAD:
            break
    return belt


def _blocking(belt: Belt, legs: list[FloatArray], touches: list[Touch]) -> tuple[int, Touch] | None:
    """Return the corner that a belt passes most too near, its side, and between which touches."""
    site = belt.lattice.site
    found: tuple[float, int, Touch] | None = None
    for n, pieces in enumerate(legs):
        x, y, heading = (float(value) for value in belt.nodes[n, :3])
        path = polyline(x, y, heading, pieces)
        for a, b in itertools.pairwise(path):
            step = b - a
            size = float(np.hypot(*step))
            if size < 1e-9:
                continue
            off = site.corner_m - a
            share = np.clip(off @ step / size**2, 0.0, 1.0)
            gap = np.hypot(*(off - share[:, None] * step).T)
            for corner in np.flatnonzero(gap < site.keep_m - 1e-6):
                left = step[0] * off[corner, 1] - step[1] * off[corner, 0] > 0.0
                touch = (int(corner), 1.0 if left else -1.0)
                known = touch in touches[max(0, n - 1) : n + 1]
                if not known and (found is None or gap[corner] < found[0]):
                    found = (float(gap[corner]), n, touch)
    return None if found is None else found[1:]


def _searched(belt: Belt) -> Belt:
    """Turn a clear belt's circles in ever smaller steps, singly and in pairs, while it helps."""
    free = [n for n, corner in enumerate(belt.corner) if corner >= 0]
    moves = [{n: 1.0} for n in free]
    moves += [{n: 1.0, m: s} for n, m in itertools.pairwise(free) for s in (1.0, -1.0)]
    length, tries = belt.length_m, 0
    for step in _STEPS_RAD:
        gained = True
        while gained and tries < _MOST_TRIES:
            gained = False
            for move, way in itertools.product(moves, (1.0, -1.0)):
                angles = belt.angle.copy()
                for n, share in move.items():
                    angles[n] += way * share * step
                tried = belt.turned(angles)
                tries += 1
                shorter = tried.length_m
                if shorter < length - 1e-9 and tried.clear():
                    belt, length, gained = tried, shorter, True
    return belt
