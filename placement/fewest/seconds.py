"""What a camera's second copy may tell: those left out because the camera exceeds them.

A candidate j is left out where a kept one x tells more everywhere and costs no more; x then stands
for it. Let every left-out j have one such x, of its own mount if there is one. A placement's
cameras for which x stands are then x or left out; one of them is taken to be x, and the others
tell at most x̃, the join of those left out for x. Of x's own mount there is one camera at most in a
placement, and it is the one taken to be x: so x̃ joins those of other mounts alone. Where it is
nothing, x is in no placement twice.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from models.geometry import FloatArray, IntArray
from placement.diagram.moves import TWINS
from placement.diagram.order import block_below, block_join

NOBODY, OWN_MOUNT = -1, -2


def seconds_of(
    indptr: IntArray, indices: np.ndarray, blocks: FloatArray, left: IntArray, group: IntArray,
    price: IntArray, kept: tuple[IntArray, FloatArray, IntArray, IntArray, IntArray],
) -> tuple[FloatArray, IntArray]:  # fmt: skip
    """Return x̃ of every kept camera, laid out as its blocks (n, 3), and who tells most of it (v,).

    left: the left-out candidates; group, price: of all candidates, group −1 where others of its
    mount may stand beside it. kept: ptr (v + 1,), blocks (n, 3), first sample (v,), candidates (v,)
    and the first kept camera of each sample. Where one that is left out has nobody to stand for it,
    which rounding may do, every camera is its own second.
    """
    ptr, dense, first, who, at = kept
    out, most = np.zeros_like(dense), who.copy()
    told = np.zeros(who.size)
    if _join(indptr, indices, blocks, left, group, price, ptr, dense, first, who, at, out, told,
             most):  # fmt: skip
        return out, most
    return dense, who


@njit(cache=True)
def _join(indptr, indices, blocks, left, group, price, ptr, dense, first, who, at, out, told, most):  # type: ignore[no-untyped-def]
    """Join each left-out camera to the second of one that stands for it; False if none does."""
    for j in left:
        begin, end = indptr[j], indptr[j + 1]
        from_t, to_t = indices[begin], indices[end - 1]
        found = NOBODY
        for v in range(at[from_t + 1]):
            i = who[v]
            own = group[j] >= 0 and group[i] == group[j]
            if found >= 0 and not own:
                continue
            if first[v] + ptr[v + 1] - ptr[v] <= to_t or price[i] > price[j]:
                continue
            below = True
            for e in range(begin, end):
                f = ptr[v] + indices[e] - first[v]
                if not block_below(
                    blocks[e, 0], blocks[e, 1], blocks[e, 2],
                    (1.0 + TWINS) * dense[f, 0], (1.0 + TWINS) * dense[f, 1],
                    (1.0 + TWINS) * dense[f, 2],
                ):  # fmt: skip
                    below = False
                    break
            if below:
                found = OWN_MOUNT if own else v
                if own:
                    break
        if found == NOBODY:
            return False
        if found == OWN_MOUNT:
            continue
        total = 0.0
        for e in range(begin, end):
            total += blocks[e, 0] + blocks[e, 2]
            f = ptr[found] + indices[e] - first[found]
            o = out[f]
            o[0], o[1], o[2] = block_join(
                o[0], o[1], o[2], blocks[e, 0], blocks[e, 1], blocks[e, 2]
            )
        if total > told[found]:
            told[found], most[found] = total, j
    return True
