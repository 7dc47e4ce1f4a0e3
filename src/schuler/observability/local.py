"""Local observability matrix of a time-varying system at one instant: the recursion with derivatives."""

from __future__ import annotations

import numpy as np

from schuler.arrays import ArrayLike, FloatArray, as_floats
from schuler.exceptions import InputError
from schuler.filtering.states import StateLayout
from schuler.observability.dynamics import SystemFunction, system_matrices
from schuler.observability.ranks import Spectrum
from schuler.observability.system import state_names
from schuler.simulation.motion import Motion

_EPS = float(np.finfo(np.float64).eps)


def local_matrix(F: ArrayLike, H: ArrayLike, order: int | None = None) -> FloatArray:
    """Stack ``[N_0; N_1; ...]`` with ``N_0 = H``, ``N_k = N_(k-1) F + dN_(k-1)/dt``.

    Parameters
    ----------
    F : array_like, shape (j, n, n)
        System matrix and its derivatives with time at the instant; those not given are zero.
    H : array_like, shape (i, m, n)
        Measurement matrix and its derivatives.
    order : int, optional
        Number of blocks; by default as many as states.

    Returns
    -------
    N : ndarray, shape (order, m, n)

    Notes
    -----
    The observability of the state at the instant is that of the stack, ``N.reshape(-1, n)``. Du writes the
    blocks beside each other; they stand below each other.

    References
    ----------
    Du (2015), eqs. (5.1), (5.2) with that correction; Chen (1999), Linear system theory and design, theorem 6.O12.
    """
    F = np.atleast_3d(np.asarray(F, dtype=np.float64)) if np.ndim(F) == 3 else np.asarray(F, dtype=np.float64)[None]
    H = np.asarray(H, dtype=np.float64)
    H = H if H.ndim == 3 else H[None]
    n = F.shape[-1]
    if F.shape[1:] != (n, n) or H.shape[2] != n:
        raise InputError(f"F, H: expected (j, n, n) and (i, m, n), got {F.shape} and {H.shape}")
    count = n if order is None else order
    # D[j] is the j-th derivative of the current block; each block needs one derivative less than the one before
    D = [H[j] if j < len(H) else np.zeros(H.shape[1:]) for j in range(count)]
    out = [D[0]]
    for k in range(1, count):
        D = [
            D[j + 1] + sum((_binomial(j, i) * D[i] @ F[j - i] for i in range(j + 1) if j - i < len(F)), 0.0 * D[0])
            for j in range(count - k)
        ]
        out.append(D[0])
    return np.array(out)


def _binomial(n: int, k: int) -> float:
    from math import comb

    return float(comb(n, k))


def derivatives(function: SystemFunction, t: float, order: int, width: float) -> FloatArray:
    """A matrix function and its derivatives at an instant, by interpolation at Chebyshev points.

    Parameters
    ----------
    function : callable
        Times (k,) to matrices (k, ...), smooth within ``t`` plus or minus ``width``.
    t : float
        [s]
    order : int
        Highest derivative.
    width : float
        Half the window. [s]

    Returns
    -------
    ndarray, shape (order + 1, ...)
        The k-th is the k-th derivative. [per s^k]

    Notes
    -----
    In units of ``width`` the error of the k-th Taylor coefficient is about ``eps 2.4**order``: 1e-11 for order 11.
    """
    from numpy.polynomial import chebyshev

    count = order + 8
    x = np.cos(np.pi * (np.arange(count) + 0.5) / count)
    values = np.asarray(function(t + width * x), dtype=np.float64)
    flat = values.reshape(count, -1)
    c = chebyshev.chebvander(x, count - 1)
    c = np.linalg.solve(c, flat)
    out = []
    for k in range(order + 1):
        d = chebyshev.chebder(c, k) if k else c
        out.append(chebyshev.chebval(0.0, d).reshape(values.shape[1:]) / width**k)
    return np.array(out)


def local_spectrum(
    F: SystemFunction,
    H: SystemFunction | ArrayLike,
    t: float,
    sigma: ArrayLike,
    names: tuple[str, ...],
    *,
    order: int | None = None,
    width: float = 1.0,
) -> Spectrum:
    """Singular values of the local observability matrix at an instant, from functions of time.

    Parameters
    ----------
    F : callable
        ``F(t)``: times (k,) to system matrices (k, n, n).
    H : callable or array_like, shape (m, n)
        Measurement matrix, of time or constant.
    t : float
        The instant. [s]
    sigma : array_like, shape (n,)
        Scale of the states.
    names : tuple of str
    order : int, optional
        Number of blocks.
    width : float
        Time the blocks are scaled by, ``N_k width**k / k!``, as they would count in a measurement over so long; and
        half the window derivatives are taken over. About the time in which the motion turns by a radian. [s]

    Returns
    -------
    Spectrum
        Spectrum of one measurement of unit accuracy; only its ranks ``formal`` and ``rank`` mean something.
    """
    scale = as_floats(sigma, "sigma", (None,))
    n = len(scale)
    count = n if order is None else order
    stacks = []
    for w in (width, 0.7 * width):
        f = derivatives(F, t, count - 1, w)
        h = derivatives(H, t, count - 1, w) if callable(H) else np.asarray(H, dtype=np.float64)[None]
        N = local_matrix(f, h, count)
        factor = np.cumprod(np.concatenate(([1.0], width / np.arange(1.0, count))))
        stacks.append((N * factor[:, None, None]).reshape(-1, n) * scale)
    _, s, V = np.linalg.svd(stacks[0])
    doubt = float(np.linalg.norm(stacks[0] - stacks[1])) + max(stacks[0].shape) * _EPS * float(s[0])
    return Spectrum(names, s, V, scale, doubt)


def motion_local_spectrum(
    motion: Motion,
    layout: StateLayout,
    t: float,
    sigma: ArrayLike,
    *,
    measured: tuple[str, ...] = ("dv",),
    fixed: tuple[str, ...] = (),
    width: float = 1.0,
    order: int | None = None,
    earth_rotation: bool = True,
) -> Spectrum:
    """Local observability of a filter at one moment of a motion.

    Parameters
    ----------
    motion : Motion
        Motion of the IMU; smooth within ``t`` plus or minus ``width``.
    layout : StateLayout
    t : float
        [s]
    sigma : array_like, shape (n,)
        Scale of all states of the layout.
    measured : tuple of str
        Blocks that are measured: ``dv``, ``dr``, ``dpsi`` or any other.
    fixed : tuple of str
        Blocks left out, as if they were known.
    width, order
        See :func:`local_spectrum`.
    earth_rotation : bool
    """
    gone = {i for block in fixed for i in range(layout[block].start, layout[block].stop)}
    keep = [i for i in range(layout.size) if i not in gone]
    seen = [i for block in measured for i in range(layout[block].start, layout[block].stop)]
    if not seen or gone & set(seen):
        raise InputError(f"measured: expected blocks that are not known, got {measured} with known {fixed}")
    if not width <= t <= motion.duration - width:
        raise InputError(
            f"t: expected {width:g} to {motion.duration - width:g} s, a width of {width:g} s from both ends of the "
            f"motion, got {t:g}"
        )

    def matrices(times: FloatArray) -> FloatArray:
        F = system_matrices(motion, layout, times, earth_rotation=earth_rotation, axes="ned")
        return np.asarray(F[:, keep][:, :, keep])

    names = state_names({block: layout[block].stop - layout[block].start for block in layout.blocks})
    scale = as_floats(sigma, "sigma", (layout.size,))[keep]
    H = np.eye(layout.size)[seen][:, keep]
    return local_spectrum(matrices, H, t, scale, tuple(names[i] for i in keep), order=order, width=width)
