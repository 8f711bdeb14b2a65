"""The derivative of the navigation objectives by a camera's share, offsets marginalised.

With its offsets marginalised, camera i's information is Σ_s N_sᵀ A_s N_s over the samples it
sees, where N_s maps the trajectory to ν_s = e_s − B_s b, the part of e_s that the camera's own
offset filter did not foresee from earlier samples, and A_s = (J_s⁻¹ + B_s C_s B_sᵀ)⁻¹. The offset
estimate b rides along as p more states, driven by the trajectory and never measured, so
D_s = Cov(ν_s, state) is at hand, and the derivative of

    log det              is  Σ_s tr(A_s [Var ν_s − D_s G_s D_sᵀ]),  G = Γ (I + P Γ)⁻¹,
    −Σ_t tr(W P_t)       is  Σ_s tr(A_s D_s [Λ_s + W] D_sᵀ),  Λ the adjoint of `offset_adjoint`.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from placement.objectives.windows.offset_gains import load_before
from placement.objectives.windows.offsets import drop_unseen, innovation, pass_sample, white_block


@njit(cache=True)
def offset_slopes(  # type: ignore[no-untyped-def]
    rows, steps, p0, views, plan, matrices, kernel, variance, w_tt, w_nn, out
):
    """Set out[k] to Σ_s tr(A_s [variance · Var ν_s + D_s (kernel_s + W) D_sᵀ]) of rows[k].

    `kernel` is laid out as `matrices`: minus G for the log det (variance 1), else the adjoint
    (variance 0).
    """
    p = views.offsets.shape[2]
    base = 3 + p
    enter_ptr, measure_ptr, measure_slot = plan.enter_ptr, plan.measure_ptr, plan.measure_slot
    measure_entry, shares, last_seen = plan.measure_entry, plan.share, plan.last
    white, offsets, frames = views.white, views.offsets, views.frames
    size = plan.widest + p
    m = np.zeros((size, size))
    u, v = np.empty((2, size)), np.empty((2, size))
    own = np.empty((p, p))  # C: the offsets' covariance in the camera's own filter
    active = np.empty(plan.camera.size + 1, dtype=np.int64)
    for k in range(rows.size):
        e, stop = views.indptr[rows[k]], views.indptr[rows[k] + 1]
        out[k] = 0.0
        if e == stop:
            continue
        t = np.int64(views.indices[e])
        n, n_active = load_before(t, m, base, p0, matrices, plan, p, active)
        for i in range(3, base):
            for j in range(n):
                m[i, j] = 0.0
                m[j, i] = 0.0
        own[:] = np.eye(p)
        found = 0.0
        while True:
            n, n_active, _ = pass_sample(
                t,
                m,
                n,
                base,
                active,
                n_active,
                steps,
                enter_ptr,
                measure_ptr,
                measure_slot,
                measure_entry,
                shares,
                white,
                offsets,
                frames,
                u,
                v,
            )
            n, n_active = drop_unseen(t, m, n, base, active, n_active, p, last_seen)
            if views.indices[e] == t:
                a00, a01, a11 = own_innovation(white, offsets, frames, e, own, v)
                v00, v01, v11 = foresee(m, n, offsets, e, u)
                q00, q01, q11 = variance * v00, variance * v01, variance * v11
                start = plan.matrix_ptr[t]
                stored = n - p
                for i in range(stored):
                    ui = i if i < 3 else i + p
                    w = w_tt if i == 0 else (w_nn if i == 1 else 0.0)
                    x0, x1 = w * u[0, ui], w * u[1, ui]
                    for j in range(stored):
                        g = kernel[start + i * stored + j]
                        uj = j if j < 3 else j + p
                        x0 += g * u[0, uj]
                        x1 += g * u[1, uj]
                    q00 += u[0, ui] * x0
                    q01 += u[0, ui] * x1
                    q11 += u[1, ui] * x1
                found += a00 * q00 + 2.0 * a01 * q01 + a11 * q11
                move_estimate(m, n, p, u, v, v00, v01, v11)
                e += 1
                if e == stop:
                    break
            t += 1
        out[k] = found


@njit(cache=True)
def own_innovation(white, offsets, frames, e, own, gain):  # type: ignore[no-untyped-def]
    """Return A of entry e and update the camera's own offset covariance; its gain in (2, p)."""
    p = offsets.shape[2]
    s00, s01, s11 = 0.0, 0.0, 0.0
    c = np.zeros((2, p))
    for i in range(p):
        for j in range(p):
            c[0, i] += own[i, j] * offsets[e, 0, j]
            c[1, i] += own[i, j] * offsets[e, 1, j]
    for i in range(p):
        s00 += offsets[e, 0, i] * c[0, i]
        s01 += offsets[e, 1, i] * c[0, i]
        s11 += offsets[e, 1, i] * c[1, i]
    jtt, jtn, jnn = white_block(white, frames, e, 1.0)
    _, a00, a01, a11 = innovation(s00, s01, s11, jtt, jtn, jnn)
    for i in range(p):
        gain[0, i] = a00 * c[0, i] + a01 * c[1, i]
        gain[1, i] = a01 * c[0, i] + a11 * c[1, i]
    for i in range(p):
        for j in range(p):
            own[i, j] -= gain[0, i] * c[0, j] + gain[1, i] * c[1, j]
    return a00, a01, a11


@njit(cache=True)
def foresee(m, n, offsets, e, u):  # type: ignore[no-untyped-def]
    """Fill u (2, n) with Cov(ν, state), ν = e_s − B b; return Var ν (tt, tn, nn)."""
    p = offsets.shape[2]
    u0, u1 = u[0], u[1]
    for i in range(n):
        u0[i], u1[i] = m[0, i], m[1, i]
    for q in range(p):
        b0, b1 = np.float64(offsets[e, 0, q]), np.float64(offsets[e, 1, q])
        row = m[3 + q]
        for i in range(n):
            u0[i] -= b0 * row[i]
            u1[i] -= b1 * row[i]
    v00, v01, v11 = u0[0], u0[1], u1[1]
    for q in range(p):
        v00 -= offsets[e, 0, q] * u0[3 + q]
        v01 -= offsets[e, 1, q] * u0[3 + q]
        v11 -= offsets[e, 1, q] * u1[3 + q]
    return v00, v01, v11


@njit(cache=True)
def move_estimate(m, n, p, u, gain, v00, v01, v11):  # type: ignore[no-untyped-def]
    """Replace b by b + K ν in the states' covariance, K in `gain` (2, p), Cov(ν, ·) in `u`."""
    for i in range(p):
        for j in range(p):
            m[3 + i, 3 + j] += (
                gain[0, i] * u[0, 3 + j]
                + gain[1, i] * u[1, 3 + j]
                + u[0, 3 + i] * gain[0, j]
                + u[1, 3 + i] * gain[1, j]
                + gain[0, i] * (v00 * gain[0, j] + v01 * gain[1, j])
                + gain[1, i] * (v01 * gain[0, j] + v11 * gain[1, j])
            )
        for j in range(n):
            if j < 3 or j >= 3 + p:
                m[3 + i, j] += gain[0, i] * u[0, j] + gain[1, i] * u[1, j]
                m[j, 3 + i] = m[3 + i, j]
