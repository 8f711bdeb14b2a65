"""The candidates of a placement under construction, in the order they were added."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from models.geometry import IntArray


class Selection:
    """Keep which candidates are chosen; a state adds what it knows of them."""

    def __init__(self, n_candidates: int, selected: list[int]) -> None:
        """Start from `selected`, which is kept."""
        self._n_candidates = n_candidates
        self._selected = selected

    @property
    def selected(self) -> list[int]:
        """The candidates chosen so far, in the order they were added."""
        return list(self._selected)

    def add(self, candidate: int) -> None:
        """Add one candidate; ValueError if it is there already or does not exist."""
        if candidate in self._selected:
            raise ValueError(f"candidate {candidate} is already selected")
        distinct([candidate], self._n_candidates)
        self._selected.append(int(candidate))
        self._changed()

    def remove(self, candidate: int) -> None:
        """Remove one candidate; ValueError if it is not selected."""
        if candidate not in self._selected:
            raise ValueError(f"candidate {candidate} is not selected")
        self._selected.remove(candidate)
        self._changed()

    def _changed(self) -> None:
        """Forget what held for the old selection."""


def distinct(selected: Iterable[int] | IntArray, n_candidates: int) -> IntArray:
    """Return `selected` sorted, refusing repeats and indices outside 0…c − 1."""
    chosen = np.array(sorted(int(i) for i in selected), dtype=np.int64)
    if chosen.size and (chosen[0] < 0 or chosen[-1] >= n_candidates):
        bad = chosen[0] if chosen[0] < 0 else chosen[-1]
        raise ValueError(f"selected must hold candidates 0…{n_candidates - 1}, got {bad}")
    repeated = chosen[1:][chosen[1:] == chosen[:-1]]
    if repeated.size:
        raise ValueError(f"selected must hold each candidate once, got {repeated[0]} twice")
    return chosen
