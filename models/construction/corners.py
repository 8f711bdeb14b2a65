"""Roads of lines and arcs: a way through the lattice, pulled tight.

With its corners and sides given, the length of a road is least where every circle that may turn
about its corner has done so until the pulls of its two lines balance: the circle's centre moves
against u_in − u_out, the gradient of the length with respect to it (u the directions of travel).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from models.construction.kernels import STRAIGHT, distance_of_pieces, leg
from models.construction.lattice import Lattice
from models.geometry import FloatArray

_ROUNDS = 60
_STILL_RAD = 1e-10
_LIMIT_RAD = 1.05 * math.pi  # a circle that turns more has lost its grip


@dataclass(frozen=True, slots=True)
class Belt:
    """Hold nodes (m, 5) and the kinds of the legs between them, as `kernels` has them."""

    lattice: Lattice
    rows: tuple[int, ...]  # of the lattice's nodes, before they were turned
    nodes: FloatArray
    kinds: tuple[int, ...]

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
        return [(float(l), float(k)) for pieces in self.legs() or [] for l, k in pieces]

    def clear(self) -> bool:
        """Return whether all legs exist, hold their bends, turn little, and keep their distance."""
        legs = self.legs()
        if legs is None:
            return False
        lattice, ends = self.lattice, (0, len(self.nodes) - 1)
        for n, pieces in enumerate(legs):
            i, j = self.rows[n], self.rows[n + 1]
            for row, place, turned in ((i, n, pieces[0]), (j, n + 1, pieces[2])):
                if place not in ends and turned[0] > _LIMIT_RAD * lattice.nodes[row, 4]:
                    return False
            need = lattice.slack[i] + lattice.slack[j]
            if self.kinds[n] == STRAIGHT and pieces[:, 0].any() and pieces[1, 0] < need - 1e-9:
                return False
            keep = lattice.site.keep_m if n in (0, len(legs) - 1) else lattice.keep_m
            x, y, heading = (float(value) for value in self.nodes[n, :3])
            edges = lattice.site.edges_m
            if distance_of_pieces(x, y, heading, pieces, edges, keep, keep - 2e-9) < keep - 2e-9:
                return False
        return True


def tighten(lattice: Lattice, rows: Sequence[int], kinds: Sequence[int]) -> Belt:
    """Return the shortest clear belt found by turning the circles of a way through the lattice.

    The way's own belt is clear, so there always is one. Where the tightest is blocked, the nearest
    to it on the way there that is clear.
    """
    rows = tuple(rows)
    best = Belt(lattice, rows, lattice.nodes[list(rows)], tuple(kinds))
    angles = lattice.angle[list(rows)].copy()
    free = _free_corners(best)
    if not free:
        return best
    tight = _balanced(best, angles, free)
    for _ in range(3):
        gained = False
        for share in (1.0, 0.8, 0.6, 0.4, 0.25, 0.12, 0.05):
            tried = angles + share * _turned(tight - angles)
            belt = _with_angles(best, tried, free)
            if belt.length_m < best.length_m - 1e-9 and belt.clear():
                best, angles, gained = belt, tried, True
                break
        if not gained or share == 1.0:
            break
    return _one_by_one(best, angles, tight, free) if share != 1.0 else best


def _one_by_one(best: Belt, angles: FloatArray, tight: FloatArray, free: list[int]) -> Belt:
    """Turn the circles of a blocked belt singly, each as far as it goes."""
    for step in (1.0, 0.5, 0.2, 0.05):
        for n in free:
            tried = angles.copy()
            tried[n] += step * float(_turned(tight - angles)[n])
            belt = _with_angles(best, tried, free)
            if belt.length_m < best.length_m - 1e-9 and belt.clear():
                best, angles = belt, tried
    return best


def _free_corners(belt: Belt) -> list[int]:
    """Return the places of nodes that go round a corner between two straight legs."""
    return [
        n
        for n in range(1, len(belt.rows) - 1)
        if belt.lattice.corner[belt.rows[n]] >= 0
        and belt.kinds[n - 1] == STRAIGHT
        and belt.kinds[n] == STRAIGHT
    ]


def _balanced(belt: Belt, angles: FloatArray, free: list[int]) -> FloatArray:
    """Turn every free circle until the pulls balance; return the angles."""
    angles = angles.copy()
    for _ in range(_ROUNDS):
        legs = _with_angles(belt, angles, free).legs()
        if legs is None:
            return angles
        nodes = _with_angles(belt, angles, free).nodes
        most = 0.0
        for n in free:
            before = nodes[n, 2] - legs[n - 1][2].prod()  # headings on the lines in and out
            after = nodes[n, 2] + legs[n][0].prod()
            pull_x = math.cos(before) - math.cos(after)
            pull_y = math.sin(before) - math.sin(after)
            if math.hypot(pull_x, pull_y) < 1e-9:
                continue
            wanted = math.atan2(pull_y, pull_x)
            change = math.remainder(wanted - angles[n], math.tau)
            angles[n] += change
            most = max(most, abs(change))
        if most < _STILL_RAD:
            break
    return angles


def _with_angles(belt: Belt, angles: FloatArray, free: list[int]) -> Belt:
    nodes = belt.nodes.copy()
    for n in free:
        corner = int(belt.lattice.corner[belt.rows[n]])
        nodes[n] = belt.lattice.round_corner(corner, float(angles[n]), float(nodes[n, 3]))
    return Belt(belt.lattice, belt.rows, nodes, belt.kinds)


def _turned(change: FloatArray) -> FloatArray:
    turned: FloatArray = (change + math.pi) % math.tau - math.pi
    return turned
