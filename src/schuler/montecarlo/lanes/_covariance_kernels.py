"""Covariance of eight runs in lock-step: the engine's propagation in lanes.

``P[n, n]`` is an array of lanes, of which the columns of the parameters in the rows of the navigation states are not
used: by symmetry row c holds what column c would. The m = n - 9 parameters are all sensor parameters, in threes.
"""
# mypy: disallow-untyped-defs=False, disallow-incomplete-defs=False
# mypy: disallow-untyped-calls=False, check-untyped-defs=False

from __future__ import annotations

from schuler.jit import kernel
from schuler.montecarlo.lanes._shared_kernels import navigation_rows, scale_parameters, transition


@kernel
def flush(P, nav, acc, A, B, T, D, mean, on_psi, decays, omega):
    """Carry the covariance over the accumulated transition, as ``filtering.kernels.covariance.flush`` does.

    ``T[n, 9]`` is workspace: the navigation rows of the transition times column c of P, as row c.
    """
    n = P.shape[0]
    m = n - 9
    if decays:
        for k in range(m):
            if mean[k] != 1.0:
                for i in range(9):
                    B[k, i] *= mean[k]
    transition(A, acc, nav, omega)
    navigation_rows(A, B, P.T, P[9:], T.T, n, on_psi, m, False)  # Phi P
    navigation_rows(A, B, T, T[9:], P.T, 9, on_psi, m, True)  # Phi P Phi'
    for a in range(9):
        for b in range(a):
            P[b, a] = P[a, b]
    for c in range(m):
        p, t = P[9 + c], T[9 + c]
        for i in range(9):
            p[i] = t[i] * D[c]
    if decays:
        scale_parameters(P, D)
