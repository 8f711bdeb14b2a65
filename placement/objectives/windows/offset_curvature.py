"""How the slopes of `entropy` with persistent offsets change with the shares: cheap, and nearly so.

    ∂²f / ∂x_i ∂x_j = −tr(Λ_i Σ Λ_j Σ),   Σ = (Λ_0 + Σ_i x_i Λ_i)⁻¹

The car's position error is taken to run straight between *nodes*, one every few samples, in the
frame that the road has at its start; then Σ is one dense matrix of moderate size, whatever the
offsets. With a node at every sample nothing is neglected. Newton steps need no more: what they
arrive at is certified by slopes that are exact (`placement.bounds.concave`).
"""

from __future__ import annotations

import numpy as np
from numba import njit
from scipy.linalg import solve_triangular

from models.geometry import FloatArray, IntArray
from placement.objectives.navigation_chain import Drive
from placement.objectives.windows.offsets import views_of, white_block

MOST_NODES = 400
NODES_A_WINDOW = 4.0  # fewer than this for the middle camera's window would show nothing
_JITTER = 1e-10  # of the largest prior variance: nodes close together know nearly the same


class OffsetCurvature:
    """One drive at its nodes; `at` gives the curvature of its log det."""

    def __init__(self, drive: Drive, most_nodes: int = MOST_NODES) -> None:
        """Lay out the prior of the nodes and every camera's information about them."""
        views, steps = views_of(drive), drive.steps()
        n_samples = len(steps)
        self.every = max(1, -(-n_samples // most_nodes))
        nodes = np.unique(np.append(np.arange(0, n_samples, self.every), n_samples - 1))
        heading = np.cumsum(np.append(0.0, np.arctan2(steps[1:, 1], steps[1:, 0])))
        samples = np.arange(n_samples)
        low = np.maximum(np.searchsorted(nodes, samples, side="right") - 1, 0)
        low = np.minimum(low, max(len(nodes) - 2, 0))
        span = np.maximum(np.diff(nodes, append=nodes[-1] + 1)[low], 1)
        after = (samples - nodes[low]) / span
        self.width = 2 * len(nodes)
        self.ptr = np.zeros(views.indptr.size, dtype=np.int64)
        axes = np.empty(4 * views.indices.size, dtype=np.int64)
        list_axes(views.indptr, views.indices, low, len(nodes), self.ptr, axes)
        self.axes = axes[: self.ptr[-1]].copy()
        self.block_ptr = np.append(0, np.cumsum(np.diff(self.ptr) ** 2))
        self.blocks = np.empty(int(self.block_ptr[-1]))
        tell_nodes(views, low, after, heading, self.ptr, self.axes, self.blocks)
        self.prior = prior_root(drive, nodes, heading[nodes])

    @property
    def tells(self) -> bool:
        """Whether nodes are dense enough to show what a camera sees."""
        lengths = np.diff(self.ptr)
        return self.every == 1 or float(np.median(lengths)) >= 2.0 * NODES_A_WINDOW

    def at(self, x: FloatArray, among: IntArray) -> FloatArray:
        """Return the second derivatives (m, m) at the shares `x` (c,) by those of `among` (m,)."""
        told = np.zeros((self.width, self.width))
        add_shares(x, self.ptr, self.axes, self.block_ptr, self.blocks, told)
        inner = np.eye(self.width) + self.prior.T @ told @ self.prior
        half = solve_triangular(np.linalg.cholesky(inner), self.prior.T, lower=True)
        out = np.empty((among.size, among.size))
        curvature_of(among, self.ptr, self.axes, self.block_ptr, self.blocks, half.T @ half, out)
        return out


def prior_root(drive: Drive, nodes: np.ndarray, heading: FloatArray) -> FloatArray:
    """Return a lower triangular root (2m, 2m) of the nodes' prior covariance, in one frame."""
    steps = drive.steps()
    p = _symmetric(drive.initial_covariance())
    m = len(nodes)
    joint = np.zeros((3 * m, 3 * m))
    joint[:3, :3] = p
    for a in range(1, m):
        turn, noise = np.eye(3), np.zeros((3, 3))
        for c, s, y, x, *q in steps[nodes[a - 1] + 1 : nodes[a] + 1]:
            f = np.array([[c, s, y], [-s, c, x], [0.0, 0.0, 1.0]])
            turn, noise = f @ turn, f @ noise @ f.T + _symmetric(q)
        p = turn @ p @ turn.T + noise
        here, before = slice(3 * a, 3 * a + 3), slice(3 * a - 3, 3 * a)
        joint[here, : 3 * a] = turn @ joint[before, : 3 * a]
        joint[: 3 * a, here] = joint[here, : 3 * a].T
        joint[here, here] = p
    place = np.stack([3 * np.arange(m), 3 * np.arange(m) + 1], axis=1).ravel()
    cov = joint[np.ix_(place, place)]
    for a, angle in enumerate(heading):
        c, s = np.cos(angle), np.sin(angle)
        back, own = np.array([[c, -s], [s, c]]), slice(2 * a, 2 * a + 2)
        cov[own] = back @ cov[own]
        cov[:, own] = cov[:, own] @ back.T
    jitter = _JITTER * max(float(np.max(np.diag(cov))), 1e-300)
    return np.asarray(np.linalg.cholesky(cov + jitter * np.eye(2 * m)), dtype=np.float64)


def _symmetric(q: object) -> FloatArray:
    tt, tn, th, nn, nh, hh = np.asarray(q, dtype=np.float64)
    return np.array([[tt, tn, th], [tn, nn, nh], [th, nh, hh]])


@njit(cache=True)
def list_axes(indptr, indices, low, n_nodes, ptr, axes):  # type: ignore[no-untyped-def]
    """List which axes, two a node, every camera tells of: camera i's from ptr[i] on."""
    for i in range(indptr.size - 1):
        k, last = ptr[i], -1
        for e in range(indptr[i], indptr[i + 1]):
            for node in range(low[indices[e]], min(low[indices[e]] + 2, n_nodes)):
                if node > last:
                    axes[k], axes[k + 1] = 2 * node, 2 * node + 1
                    k += 2
                    last = node
        ptr[i + 1] = k


@njit(cache=True)
def tell_nodes(views, low, after, heading, ptr, axes, blocks):  # type: ignore[no-untyped-def]
    """Fill `blocks` with every camera's information about its axes, one matrix after another."""
    p = views.offsets.shape[2]
    used = 0
    rows = np.zeros((2, 4))  # what the sample's (t, n) are of the axes of its two nodes
    j, jb, jr = np.empty((2, 2)), np.empty((2, p)), np.empty((2, 4))
    for i in range(ptr.size - 1):
        own = axes[ptr[i] : ptr[i + 1]]
        k = own.size
        told, mixed, alone = np.zeros((k, k)), np.zeros((k, p)), np.eye(p)
        at = 0
        for e in range(views.indptr[i], views.indptr[i + 1]):
            t = views.indices[e]
            while own[at] != 2 * low[t]:
                at += 2
            c, s, w = np.cos(heading[t]), np.sin(heading[t]), after[t]
            rows[0, 0], rows[0, 1], rows[1, 0], rows[1, 1] = c, s, -s, c
            rows[:, 2:] = w * rows[:, :2]
            rows[:, :2] *= 1.0 - w
            j[0, 0], j[0, 1], j[1, 1] = white_block(views.white, views.frames, e, 1.0)
            j[1, 0] = j[0, 1]
            for a in range(2):
                for q in range(p):
                    jb[a, q] = j[a, 0] * views.offsets[e, 0, q] + j[a, 1] * views.offsets[e, 1, q]
                for q in range(4):
                    jr[a, q] = j[a, 0] * rows[0, q] + j[a, 1] * rows[1, q]
            for a in range(min(4, k - at)):
                for b in range(min(4, k - at)):
                    told[at + a, at + b] += rows[0, a] * jr[0, b] + rows[1, a] * jr[1, b]
                for q in range(p):
                    mixed[at + a, q] += rows[0, a] * jb[0, q] + rows[1, a] * jb[1, q]
            for a in range(p):
                for q in range(p):
                    alone[a, q] += views.offsets[e, 0, a] * jb[0, q]
                    alone[a, q] += views.offsets[e, 1, a] * jb[1, q]
        if k:
            told -= mixed @ np.linalg.solve(alone, np.ascontiguousarray(mixed.T))
        blocks[used : used + k * k] = told.ravel()
        used += k * k


@njit(cache=True)
def add_shares(x, ptr, axes, block_ptr, blocks, out):  # type: ignore[no-untyped-def]
    """Add Σ x_i Λ_i to `out`."""
    for i in np.flatnonzero(x):
        own = axes[ptr[i] : ptr[i + 1]]
        at = block_ptr[i]
        for a in own:
            for b in own:
                out[a, b] += x[i] * blocks[at]
                at += 1


@njit(cache=True)
def curvature_of(among, ptr, axes, block_ptr, blocks, posterior, out):  # type: ignore[no-untyped-def]
    """Fill out[r, s] with −tr(Λ_i Σ Λ_j Σ), i and j the r-th and s-th of `among`."""
    n, width = among.size, posterior.shape[0]
    row = np.zeros(n + 1, np.int64)
    for r in range(n):
        row[r + 1] = row[r] + ptr[among[r] + 1] - ptr[among[r]]
    own = np.empty(row[n], np.int64)
    through = np.empty((row[n], width))  # Λ_i Σ, one row for each of camera i's axes
    for r in range(n):
        i, k = among[r], row[r + 1] - row[r]
        own[row[r] : row[r + 1]] = axes[ptr[i] : ptr[i + 1]]
        seen = np.empty((k, width))
        for a in range(k):
            seen[a] = posterior[own[row[r] + a]]
        block = blocks[block_ptr[i] : block_ptr[i + 1]].copy().reshape((k, k))
        through[row[r] : row[r + 1]] = block @ seen
    for r in range(n):
        for s in range(r + 1):
            found = 0.0
            for a in range(row[r], row[r + 1]):
                for b in range(row[s], row[s + 1]):
                    found -= through[a, own[b]] * through[b, own[a]]
            out[r, s], out[s, r] = found, found
