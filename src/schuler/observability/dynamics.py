"""System matrices along a motion, and transitions of a time-varying system to rounding."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from schuler import earth, frames, rotation
from schuler.arrays import ArrayLike, FloatArray, as_floats
from schuler.exceptions import InputError
from schuler.filtering.error_model import ecef_from_ned_states
from schuler.filtering.states import StateLayout
from schuler.simulation.motion import Motion, inertial_quantities

#: ``F(t)``: times of shape (k,) to system matrices of shape (k, n, n).
SystemFunction = Callable[[FloatArray], FloatArray]

_CLOSE = 1e-9  # nodes nearer than this are one [s]
_CHUNK = 4000  # steps worked on at once: bounded memory
#: Norm up to which the series is taken, and its terms: 0.5^15 / 15! is below rounding.
_PART, _TERMS = 0.5, 14


def system_matrices(
    motion: Motion, layout: StateLayout, t: ArrayLike, *, earth_rotation: bool = True, axes: str = "ecef"
) -> FloatArray:
    """System matrices of the error state along a motion.

    Parameters
    ----------
    motion : Motion
        Motion of the IMU itself, also of a turning one.
    layout : StateLayout
    t : array_like, shape (k,)
        [s]
    earth_rotation : bool
        False sets the Earth's rate to zero wherever it stands.
    axes : {"ecef", "ned"}
        ``ned``: the same matrix turned into north, east, down at each time; not that of
        :func:`~schuler.filtering.error_model.system_matrix_ned`, whose velocity and attitude errors refer to the
        estimated place. The derivative of the turned axes is included.

    Returns
    -------
    F : ndarray, shape (k, n, n)
        Order of the layout, estimate minus truth, linearised about perfect sensors.

    References
    ----------
    As :func:`~schuler.filtering.error_model.system_matrix_ecef`, for many times at once.
    """
    if axes not in ("ecef", "ned"):
        raise InputError(f"axes: expected 'ecef' or 'ned', got {axes!r}")
    t = as_floats(t, "t", (None,))
    s = motion.state(t)
    omega, f = inertial_quantities(s, earth_rotation=earth_rotation)
    k, n = len(t), layout.size
    C, rate = s.C_eb, earth.WGS84.omega_ie if earth_rotation else 0.0
    W = np.array([[0.0, -rate, 0.0], [rate, 0.0, 0.0], [0.0, 0.0, 0.0]])
    F = np.zeros((k, n, n))
    F[:, 0:3, 0:3] = -W
    F[:, 3:6, 0:3] = -rotation.skew(np.einsum("kij,kj->ki", C, f))
    F[:, 3:6, 3:6] = -2.0 * W
    # the gradient of gravity holds the centrifugal part, which stays as gravity itself does
    F[:, 3:6, 6:9] = _gradient(s.r_eb_e)
    F[:, 6:9, 3:6] = np.eye(3)
    regressors = np.concatenate((np.ones((k, 1)), f, omega), axis=1)
    for j, (sensor, axis, source) in enumerate(layout.table()[: layout.n_sensor]):
        rows = slice(0, 3) if sensor == 0 else slice(3, 6)
        F[:, rows, 9 + j] = -C[:, :, axis] * regressors[:, source, None]
    m = range(9, n)
    F[:, m, m] = -layout.dynamics()[:, 0]
    if "clock" in layout:
        F[:, layout["clock"].start, layout["clock_drift"].start] = 1.0
    if axes == "ned":
        T = ecef_from_ned_states(frames.llh_from_ecef(s.r_eb_e), n)
        turn = np.zeros((k, n, n))
        llh = s.llh
        lon_rate = earth.transport_rate_ned(llh[:, 0], llh[:, 2], s.v_eb_n)
        for i in (0, 3, 6):
            turn[:, i : i + 3, i : i + 3] = rotation.skew(lon_rate)
        F = np.swapaxes(T, 1, 2) @ F @ T - turn
    return F


def transitions(function: SystemFunction, t: ArrayLike, *, step: float = 0.1, breaks: ArrayLike = ()) -> FloatArray:
    """Transitions between nodes by the sixth-order Magnus expansion.

    Parameters
    ----------
    function : callable
        ``F(t)``, times (m,) to matrices (m, n, n), smooth between the nodes.
    t : array_like, shape (k,)
        Increasing nodes. [s]
    step : float
        Largest step; the interval between two nodes is cut into equal ones. [s]
    breaks : array_like, shape (b,), optional
        Moments at which ``F`` or a derivative jumps, such as those at which a platform changes its rate. [s]

    Returns
    -------
    Phi : ndarray, shape (k, n, n)
        Into each node from the one before; the identity for the first.

    References
    ----------
    Blanes, Casas, Oteo, Ros (2009), The Magnus expansion and some of its applications, section 5.4: three
    Gauss-Legendre nodes a step, error of order ``step**7`` a step.
    """
    nodes = as_floats(t, "t", (None,))
    if len(nodes) < 1 or np.any(np.diff(nodes) <= 0.0) or not step > 0.0:
        raise InputError("t: expected increasing nodes and a positive step")
    jumps = np.asarray(breaks, dtype=np.float64)
    jumps = jumps[(jumps > nodes[0]) & (jumps < nodes[-1])]
    jumps = jumps[np.min(np.abs(jumps[:, None] - nodes), axis=1, initial=np.inf) > _CLOSE] if len(jumps) else jumps
    t = np.unique(np.concatenate((nodes, jumps)))
    to = np.searchsorted(nodes, t - _CLOSE)  # node that each of the finer ones belongs to
    count = np.maximum(np.ceil(np.diff(t) / step - 1e-9), 1).astype(np.int64)
    into = np.repeat(to[1:], count)  # node each step leads to
    first = np.concatenate(([0], np.cumsum(count)[:-1])) if len(count) else np.zeros(0, np.int64)
    h = np.repeat(np.diff(t) / count, count)
    begin = np.repeat(t[:-1], count) + (np.arange(len(h)) - np.repeat(first, count)) * h
    n = function(t[:1]).shape[-1]
    out = np.broadcast_to(np.eye(n), (len(nodes), n, n)).copy()
    offset = np.sqrt(15.0) / 10.0 * np.array([-1.0, 0.0, 1.0])
    for start in range(0, len(h), _CHUNK):
        part = slice(start, start + _CHUNK)
        times = begin[part, None] + h[part, None] * (0.5 + offset)
        A = function(times.ravel()).reshape(-1, 3, n, n)
        d = h[part, None, None]
        a1, a2, a3 = (
            d * A[:, 1],
            np.sqrt(15.0) / 3.0 * d * (A[:, 2] - A[:, 0]),
            10.0 / 3.0 * d * (A[:, 2] - 2.0 * A[:, 1] + A[:, 0]),
        )
        c1 = _bracket(a1, a2)
        c2 = -_bracket(a1, 2.0 * a3 + c1) / 60.0
        exponent = a1 + a3 / 12.0 + _bracket(-20.0 * a1 - a3 + c1, a2 + c2) / 240.0
        for k, E in zip(into[part], _exponentials(exponent), strict=True):
            out[k] = E @ out[k]
    return out


def _exponentials(A: FloatArray) -> FloatArray:
    """Exponentials of many small matrices (k, n, n): Taylor series of a part of them, squared up again.

    A library's routine takes them one by one, with threads that a matrix of twelve rows keeps waiting.
    """
    size = float(np.abs(A).sum(axis=-2).max(initial=0.0))
    squarings = max(int(np.ceil(np.log2(size / _PART))), 0) if size > 0.0 else 0
    part = A / 2.0**squarings
    out = np.broadcast_to(np.eye(A.shape[-1]), A.shape).copy()
    for k in range(_TERMS, 0, -1):
        out = part @ out / k
        out[..., range(A.shape[-1]), range(A.shape[-1])] += 1.0
    for _ in range(squarings):
        out = out @ out
    return out


def _bracket(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(a @ b - b @ a)


def _gradient(r: FloatArray) -> FloatArray:
    """Gradient of gravity at places; computed once where the body rests."""
    if len(r) and np.ptp(r, axis=0).max() < 1.0:  # a metre changes it by 1e-12 1/s^2
        return np.broadcast_to(earth.gravity_gradient_ecef(r[0]), (len(r), 3, 3))
    return np.asarray(earth.gravity_gradient_ecef(r))
