"""Ways told apart by homotopy: crossing words, and the shortest ways of each class in a graph.

From a mark inside every group of obstacles a ray runs north. A way spells a word: +n where it
crosses ray n eastwards, −n westwards (n from 1), adjacent opposites struck out. Two ways between
the same points can be pulled into each other without touching a mark exactly if their reduced
words are equal: the words are the free group of the plane without the marks (Bhattacharya,
Likhachev & Kumar 2012 search graphs in the same way).
"""

from __future__ import annotations

import heapq
import itertools
import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import networkx as nx
import numpy as np

from models.geometry import FloatArray

Word = tuple[int, ...]
_MOST_STATES = 200_000  # memory: a way's state is some hundred bytes


@dataclass(frozen=True, slots=True)
class Way:
    """Hold a way through a graph: its length, its nodes, its reduced word."""

    length_m: float
    nodes: tuple[int, ...]
    word: Word


def crossing_word(path_m: FloatArray, marks_m: FloatArray) -> Word:
    """Return the reduced word that the polyline (m, 2) spells with rays north of marks (n, 2)."""
    x0, x1 = path_m[:-1, 0, None], path_m[1:, 0, None]
    y0, y1 = path_m[:-1, 1, None], path_m[1:, 1, None]
    mx, my = marks_m[:, 0], marks_m[:, 1]
    east, west = (x0 < mx) & (x1 >= mx), (x0 >= mx) & (x1 < mx)
    step, mark = np.nonzero(east | west)
    if not len(step):
        return ()
    share = (mx[mark] - x0[step, 0]) / (x1 - x0)[step, 0]
    north = y0[step, 0] + share * (y1 - y0)[step, 0] > my[mark]
    step, mark, share = step[north], mark[north], share[north]
    order = np.lexsort((share, step))
    signs = np.where(east[step, mark], 1, -1)
    return reduced(tuple(int(s * (m + 1)) for s, m in zip(signs[order], mark[order], strict=True)))


def reduced(word: Word, more: Word = ()) -> Word:
    """Return `word` followed by `more` with adjacent opposites struck out."""
    letters: list[int] = []
    for letter in (*word, *more):
        if letters and letters[-1] == -letter:
            letters.pop()
        else:
            letters.append(letter)
    return tuple(letters)


def spelled(word: Word) -> str:
    """Write a word: `E1 W2` crosses ray 1 eastwards, then 2 westwards; `direct` crosses none."""
    return " ".join(f"{'E' if letter > 0 else 'W'}{abs(letter)}" for letter in word) or "direct"


def ways_by_class(
    graph: nx.DiGraph[int],
    source: int,
    target: int,
    word_of: Callable[[int, int], Word],
    *,
    length_factor: float,
    most_classes: int,
    per_class: int = 1,
    deadline: float = math.inf,
) -> Iterator[Way]:
    """Yield ways from source to target, shortest first: the `per_class` shortest of each class.

    Edges have a `weight` and, by `word_of(i, j)`, a word. A* on pairs of node and word, guided by
    the exact distances to the target; ends at `length_factor` times the shortest, after
    `most_classes`, at the deadline (time.monotonic()), or after 200,000 states.
    """
    ahead = nx.single_source_dijkstra_path_length(graph.reverse(copy=False), target)
    if source not in ahead:
        return
    longest = length_factor * ahead[source] * (1.0 + 1e-12)
    number = itertools.count()
    heap: list[tuple[float, int, float, int, Word, int]] = [
        (ahead[source], next(number), 0.0, source, (), -1)
    ]
    trail: list[tuple[int, int]] = []  # (node, place of the one before) of each state reached
    reached: dict[tuple[int, Word], int] = {}
    found: set[Word] = set()
    while heap and len(trail) < _MOST_STATES:
        _, _, done, node, word, before = heapq.heappop(heap)
        times = reached.get((node, word), 0)
        if times >= per_class:
            continue
        reached[node, word] = times + 1
        trail.append((node, before))
        if node == target:
            if word not in found and len(found) == most_classes:
                return
            found.add(word)
            yield Way(done, _trail(trail), word)
            continue
        if len(trail) % 64 == 0 and time.monotonic() > deadline:
            return
        here = len(trail) - 1
        for other, data in graph[node].items():
            if other not in ahead:
                continue
            length = done + data["weight"]
            if length + ahead[other] > longest:
                continue
            letters = word_of(node, other)
            then = reduced(word, letters) if letters else word
            if reached.get((other, then), 0) < per_class:
                heapq.heappush(
                    heap, (length + ahead[other], next(number), length, other, then, here)
                )


def _trail(trail: list[tuple[int, int]]) -> tuple[int, ...]:
    nodes, at = [], len(trail) - 1
    while at >= 0:
        node, at = trail[at]
        nodes.append(node)
    return tuple(reversed(nodes))
