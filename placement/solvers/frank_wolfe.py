"""The concave relaxation of any relaxable score, by pairwise Frank–Wolfe steps, certified by us.

    max f(x)  over  0 ≤ x ≤ 1, Σ x ≤ k, at most one of each group, required candidates at 1

The linear subproblem is exact (`placement.matroid.best_choice`), so every iterate x carries its own
certificate: f(S) ≤ f(x) + max_y ∂f(x)·(y − x) over placements y. The same tangent says how much
less a placement is worth that *holds* a candidate; those that cannot beat the incumbent are left
out and the smaller problem is solved again (reduced-cost fixing).

Lacoste-Julien & Jaggi 2015 for the pairwise steps; Joshi & Boyd 2009 for the relaxation.
"""

from __future__ import annotations
