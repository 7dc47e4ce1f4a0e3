"""Transition and smoother of the error-state filter with dense matrices and inverses, as the books have them."""

import numpy as np

from schuler.filtering.engine import unpack_symmetric
from schuler.observability.filter_system import change_of_axes


def dense_transition(nodes, j, n):
    """Phi of node j from what the filter kept of it: sensor columns, decay, and the clock's shear after it."""
    from schuler.filtering.kernels import covariance as k
    from schuler.filtering.kernels.axes import TURNED

    if nodes.phi[j, 0] == TURNED:
        return change_of_axes(nodes.B[j], n)
    A, nav = np.zeros((9, 9)), np.zeros(10)
    A[2, 2] = 1.0
    nav[7:10] = nodes.phi[j, 8:11]
    k.transition(A, nodes.phi[j, :8].copy(), nav, nodes.omega)
    Phi = np.eye(n)
    Phi[:9, :9] = A
    Phi[:9, 9 : 9 + nodes.n_sensor] = nodes.B[j]
    T = nodes.phi[j, 0]
    Phi[range(9, n), range(9, n)] = np.exp(-nodes.pmod[:, 0] * T)
    if nodes.i_clock >= 0:
        Phi[nodes.i_clock, nodes.i_clock + 1] = T
    return Phi


def dense_smoother(nodes, n):
    """Rauch-Tung-Striebel with inverses: corrections (K, n) after the updates of each node, covariances (K, n, n)."""
    K = len(nodes.t)
    P_minus = unpack_symmetric(nodes.P, n)
    P_plus, inj = P_minus.copy(), np.zeros((K, n))
    for j in range(K):
        for u in range(nodes.upd[j - 1] if j else 0, nodes.upd[j]):
            P_plus[j] -= nodes.W[u].T @ nodes.W[u]
            inj[j] += nodes.W[u].T @ nodes.e[u]
    plus, P_s = np.zeros((K, n)), P_plus.copy()
    for j in range(K - 2, -1, -1):
        Phi = dense_transition(nodes, j + 1, n)
        D = np.sqrt(np.diag(P_minus[j + 1]))
        G = P_plus[j] @ Phi.T @ (np.linalg.inv(P_minus[j + 1] / np.outer(D, D)) / np.outer(D, D))
        plus[j] = G @ (plus[j + 1] - inj[j + 1])
        P_s[j] = P_plus[j] + G @ (P_s[j + 1] - P_minus[j + 1]) @ G.T
    return plus, P_s
