"""Which candidates of a node may stand for each other: orbits of verified symmetries.

A permutation π of rank-one candidates with signs s, s_i s_j ⟨v_πi, v_πj⟩ = ⟨v_i, v_j⟩ (whitened
columns), leaves the log det of every set what it was, det(I + VᵀV) being a function of these
products. If it also keeps those fixed in among themselves, candidates of one orbit are alike:
either one of them is in, and it may be any one, or all are out (orbital branching: Ostrowski,
Linderoth, Rossi & Smriglio 2011). Designs from graphs and factorial experiments are full of this;
their trees are smaller by the order of the group.

Symmetries are found by colour refinement with individualisation and believed only when every
product agrees to the last bit. What is not found makes orbits smaller, which is harmless.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from models.geometry import FloatArray, IntArray

MOST_TRIES = 60  # refinements spent on one pair of candidates
_FEW_VALUES = 0.05  # products that take more distinct values than this share have no symmetry


def products(V: FloatArray) -> FloatArray | None:
    """Return ⟨v_i, v_j⟩ (c, c) of rank-one candidates V (c, 1, n); None where all differ anyway."""
    c, r, _ = V.shape
    if r != 1 or c < 3 or c > 400:
        return None
    gram: FloatArray = V[:, 0] @ V[:, 0].T
    gram = 0.5 * (gram + gram.T)
    distinct = np.unique(np.abs(gram)).size
    return gram if distinct <= max(6.0, _FEW_VALUES * c * c) else None


def orbits(gram: FloatArray, colours: IntArray) -> IntArray:
    """Number each candidate's orbit (c,) among the symmetries that keep `colours` (c,)."""
    found = _Symmetries(gram)
    c = len(colours)
    label = np.arange(c)
    refined = _refined(found.codes, colours[None, :])[0]
    for cell in np.unique(refined):
        members = np.flatnonzero(refined == cell)
        for other in members[1:]:
            lead = members[0]
            if label[lead] == label[other]:
                continue
            # towards any representative already found, not the first alone
            for target in np.unique(label[members[members < other]]):
                if label[other] == target:
                    break
                move = found.mapping(refined, int(target), int(other))
                if move is not None:
                    _join(label, move)
                    break
    return label


def _join(label: IntArray, move: IntArray) -> None:
    """Merge the orbits of i and π(i) for every i; the least member names an orbit."""
    for i, j in enumerate(move):
        a, b = label[i], label[j]
        if a != b:
            label[label == max(a, b)] = min(a, b)


@dataclass(slots=True)
class _Symmetries:
    """Look for signed permutations of `gram` (c, c)."""

    gram: FloatArray
    codes: IntArray = field(init=False)
    tries: int = 0

    def __post_init__(self) -> None:
        _, codes = np.unique(np.abs(self.gram), return_inverse=True)
        self.codes = codes.reshape(self.gram.shape).astype(np.int64)

    def mapping(self, colours: IntArray, i: int, j: int) -> IntArray | None:
        """Return a symmetry that takes i to j and keeps colours; None if none was found."""
        self.tries = 0
        return self._match(*_singled(colours, colours, i, j))

    def _match(self, here: IntArray, there: IntArray) -> IntArray | None:
        """Return a symmetry that takes colours `here` to colours `there`."""
        self.tries += 1
        if self.tries > MOST_TRIES:
            return None
        here, there = _refined(self.codes, np.stack([here, there]))
        counts = np.bincount(here)
        if not np.array_equal(counts, np.bincount(there, minlength=len(counts))):
            return None
        if counts.max() == 1:
            move = np.empty(len(here), dtype=np.int64)
            move[np.argsort(here)] = np.argsort(there)
            return move if self._holds(move) else None
        cell = int(np.argmin(np.where(counts > 1, counts, len(here) + 1)))
        first = int(np.flatnonzero(here == cell)[0])
        for target in np.flatnonzero(there == cell):
            found = self._match(*_singled(here, there, first, int(target)))
            if found is not None or self.tries > MOST_TRIES:
                return found
        return None

    def _holds(self, move: IntArray) -> bool:
        """Whether signs exist with s_i s_j ⟨v_πi, v_πj⟩ = ⟨v_i, v_j⟩, exactly."""
        moved = self.gram[np.ix_(move, move)]
        if not np.array_equal(np.abs(moved), np.abs(self.gram)):
            return False
        agree = np.sign(moved) * np.sign(self.gram)
        c = len(move)
        signs = np.zeros(c)
        for start in range(c):
            if signs[start]:
                continue
            signs[start], waiting = 1.0, [start]
            while waiting:
                i = waiting.pop()
                new = np.flatnonzero((agree[i] != 0.0) & (signs == 0.0))
                signs[new] = signs[i] * agree[i, new]
                waiting.extend(int(a) for a in new)
        return bool(np.array_equal(signs[:, None] * signs[None, :] * moved, self.gram))


def _singled(here: IntArray, there: IntArray, i: int, j: int) -> tuple[IntArray, IntArray]:
    """Give i and j a colour of their own in copies of the two."""
    here, there = here.copy(), there.copy()
    here[i] = there[j] = max(here.max(), there.max()) + 1
    return here, there


def _refined(codes: IntArray, colours: IntArray) -> IntArray:
    """Split colours (s, c) until whoever shares one sees the same products in the same colours.

    Colours mean the same in all s copies.
    """
    s, c = colours.shape
    count = 0
    while True:
        _, flat = np.unique(colours, return_inverse=True)
        colours = flat.reshape(s, c).astype(np.int64)
        now = int(colours.max()) + 1
        if now == count:
            return colours
        count = now
        seen = np.sort(codes[None] * now + colours[:, None, :], axis=2)
        rows = np.concatenate([colours[:, :, None], seen], axis=2).reshape(s * c, c + 1)
        _, colours = np.unique(rows, axis=0, return_inverse=True)
        colours = colours.reshape(s, c)
