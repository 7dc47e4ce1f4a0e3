"""Modulation: what a rotation makes of the constant errors of an IMU, seen in navigation axes.

A bias across the axis turns with the IMU and its mean over a revolution is zero; one along the axis stays. What counts
is the rotation relative to the *navigation* axes: a vehicle that turns back as fast as the platform turns undoes it.
The integrals here are first order in the errors and open loop: no Earth rate acts on the tilt, no Schuler feedback.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schuler import rotation
from schuler.arrays import ArrayLike, FloatArray, as_floats, as_vector3
from schuler.exceptions import InputError
from schuler.plotting.notebook import Abridged
from schuler.rotary.rotating_imu import RotatingMotion
from schuler.sensors.errors import ImuErrors
from schuler.simulation.motion import LocalMotion, Motion, inertial_quantities

_NODES = 4  # of collocation in a step


@dataclass(frozen=True, eq=False, repr=False)
class Modulation(Abridged):
    """A bias of the IMU in navigation axes.

    Attributes
    ----------
    t : ndarray, shape (n,)
        [s]
    bias_n : ndarray, shape (n, 3)
        North, east, down; units of the bias.
    mean_n : ndarray, shape (n, 3)
        Its mean from the first time to each; the first row is the value itself.
    """

    t: FloatArray
    bias_n: FloatArray
    mean_n: FloatArray


@dataclass(frozen=True, eq=False)
class OpenLoop:
    """Errors of navigation, first order and without feedback, estimate minus truth, north east down.

    Attributes
    ----------
    t : ndarray, shape (n,)
        [s]
    attitude, velocity, position : ndarray, shape (n, 3)
        [rad], [m/s], [m]
    """

    t: FloatArray
    attitude: FloatArray
    velocity: FloatArray
    position: FloatArray


@dataclass(frozen=True, eq=False)
class Residue:
    """What is left of an IMU's errors after a time: linear maps, means in navigation axes.

    Attributes
    ----------
    duration : float
        [s]
    bias : ndarray, shape (3, 3)
        Mean of ``C_ns``: times a bias in IMU axes, its mean in navigation axes.
    bias_twice : ndarray, shape (3, 3)
        ``2 / T^2`` times its double integral: of a gyroscope's bias, twice the mean tilt over the time, by ``T``; of an
        accelerometer's, the position error by ``T^2 / 2``.
    matrix, matrix_twice : ndarray, shape (3, 3, 3)
        The same for error matrices of the gyroscopes: times ``M_g`` over the last two indices (output, input).
    """

    duration: float
    bias: FloatArray
    bias_twice: FloatArray
    matrix: FloatArray
    matrix_twice: FloatArray


def turning_vehicle(
    llh: ArrayLike, rate: float, duration: float, *, rpy_nb: ArrayLike = (0.0, 0.0, 0.0)
) -> LocalMotion:
    """A vehicle on the spot that turns evenly about its own z axis (down).

    Parameters
    ----------
    llh : array_like, shape (3,)
        Latitude, longitude [rad], height [m].
    rate : float
        Positive to the right. [rad/s]
    duration : float
        [s]
    rpy_nb : array_like, shape (3,)
        At the start. [rad]
    """
    C_0 = rotation.dcm_from_rpy(as_vector3(rpy_nb, "rpy_nb"))

    def attitude(t: FloatArray) -> tuple[FloatArray, FloatArray]:
        turn = np.zeros((len(t), 3))
        turn[:, 2] = rate * t
        return C_0 @ rotation.dcm_from_rotvec(turn), np.broadcast_to(np.array([0.0, 0.0, rate]), (len(t), 3))

    def path(t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        zero = np.zeros((len(t), 3))
        return zero, zero, zero

    return LocalMotion(as_vector3(llh, "llh"), path, attitude, duration)


def bias_in_n(motion: Motion, bias_s: ArrayLike, t: ArrayLike) -> FloatArray:
    """A constant bias of the IMU in north-east-down axes.

    Parameters
    ----------
    motion : Motion
        Motion of the IMU, e.g. :class:`~schuler.rotary.rotating_imu.RotatingMotion`.
    bias_s : array_like, shape (3,)
        IMU axes.
    t : array_like, shape (n,)
        [s]

    Returns
    -------
    ndarray, shape (n, 3)
        ``C_ns b``; units of the bias.

    References
    ----------
    Du (2015), eqs. (2.6)-(2.9).
    """
    seen: FloatArray = motion.state(as_floats(t, "t", (None,))).C_nb @ as_vector3(bias_s, "bias_s")
    return seen


def modulation(motion: Motion, bias_s: ArrayLike, t: ArrayLike) -> Modulation:
    """The bias over time and its running mean; ``t`` (n,) increases from the start of the mean. [s]"""
    t = as_floats(t, "t", (None,))
    errors = ImuErrors(b_g=as_vector3(bias_s, "bias_s"))
    seen = bias_in_n(motion, bias_s, t)
    run = open_loop_errors(motion, errors, t)
    elapsed = (t - t[0])[1:, None]
    return Modulation(t, seen, np.concatenate((seen[:1], run.attitude[1:] / elapsed)))


def effective_rate(motion: RotatingMotion, t: ArrayLike) -> FloatArray:
    """Rate of the IMU about its innermost axis relative to navigation axes: what modulates.

    Parameters
    ----------
    motion : RotatingMotion
    t : array_like, shape (n,)
        [s]

    Returns
    -------
    ndarray, shape (n,)
        For a level Z rotation the platform's rate plus the vehicle's about the same axis: zero if the vehicle turns
        back as fast (Du, section 2.3). Earth and transport rate are in it, and are small. [rad/s]
    """
    from schuler import earth

    t = as_floats(t, "t", (None,))
    s = motion.state(t)
    llh = s.llh
    omega_en_n = earth.transport_rate_ned(llh[:, 0], llh[:, 2], s.v_eb_n)
    omega_ns_s = s.omega_eb_b - np.einsum("nji,nj->ni", s.C_nb, omega_en_n)
    rate: FloatArray = omega_ns_s @ (motion.schedule.C_mount.T @ motion.schedule.axes[-1])
    return rate


def open_loop_errors(motion: Motion, errors: ImuErrors, t: ArrayLike, *, step: float = 0.1) -> OpenLoop:
    """Errors of navigation by integrals of the IMU's fixed errors in navigation axes.

    Parameters
    ----------
    motion : Motion
        Motion of the IMU.
    errors : ImuErrors
        Biases and matrices (``b_g, b_a, M_g, M_a, G_g``); noise and temperature are left out.
    t : array_like, shape (n,)
        Increasing, from where the integrals start. [s]
    step : float
        Longest step of the quadrature, of eighth order; it also stops at jumps of the platform. [s]

    Returns
    -------
    OpenLoop
        ``eps' = C_ns dw``, ``dv' = C_ns df + eps x f_n``, ``dr' = dv``, from zero.

    References
    ----------
    Du (2015), eqs. (3.1)-(3.10).
    """
    t = as_floats(t, "t", (None,))

    def rates(at: FloatArray) -> tuple[FloatArray, FloatArray]:
        state = motion.state(at)
        omega, f = inertial_quantities(state)
        C_ns = state.C_nb
        d_omega = errors.b_g + omega @ errors.M_g.T + f @ errors.G_g.T
        d_f = errors.b_a + f @ errors.M_a.T
        turned = [np.einsum("nij,nj->ni", C_ns, v) for v in (d_omega, d_f, f)]
        return turned[0], np.concatenate(turned[1:], axis=1)

    limits, kept = _steps(motion, t, step)
    inner, weights, nodes = _collocation(_NODES)
    h = np.diff(limits)
    at = (limits[:-1, None] + h[:, None] * nodes).ravel()
    d_omega, forces = rates(at)
    eps, eps_nodes = _integrated(d_omega.reshape(-1, _NODES, 3), h, inner, weights)
    forces = forces.reshape(-1, _NODES, 6)
    v, v_nodes = _integrated(forces[..., :3] + np.cross(eps_nodes, forces[..., 3:]), h, inner, weights)
    r, _ = _integrated(v_nodes, h, inner, weights)
    return OpenLoop(t, eps[kept], v[kept], r[kept])


def residue(motion: Motion, duration: float, *, start: float = 0.0, step: float = 0.1) -> Residue:
    """What a rotation leaves of biases and of error matrices of the gyroscopes after a time.

    Parameters
    ----------
    motion : Motion
        Motion of the IMU.
    duration : float
        [s]
    start : float
        Where it begins, e.g. after the rest of a schedule. [s]
    step : float
        See :func:`open_loop_errors`.

    Notes
    -----
    Objective of a search for schemes: small ``bias`` holds the attitude, small ``bias_twice`` the velocity. The thesis
    says that errors across the axis "eliminate themselves" over a revolution; that is so for attitude, while the mean
    of the tilt is fixed by the phase at the start and goes on into velocity, see
    :mod:`schuler.reproduce.du.study.analytic_tables`.
    """
    if not duration > 0.0:
        raise InputError(f"duration: expected a positive number of seconds, got {duration!r}")
    limits, _ = _steps(motion, np.array([start, start + duration]), step)
    inner, weights, nodes = _collocation(_NODES)
    h = np.diff(limits)
    state = motion.state((limits[:-1, None] + h[:, None] * nodes).ravel())
    omega, _ = inertial_quantities(state)
    C_ns = state.C_nb
    both = np.concatenate((C_ns.reshape(-1, 9), np.einsum("nij,nk->nijk", C_ns, omega).reshape(-1, 27)), axis=1)
    once, once_nodes = _integrated(both.reshape(len(h), _NODES, -1), h, inner, weights)
    twice, _ = _integrated(once_nodes, h, inner, weights)
    first, second = once[-1] / duration, 2.0 * twice[-1] / duration**2
    return Residue(
        duration, first[:9].reshape(3, 3), second[:9].reshape(3, 3), first[9:].reshape(3, 3, 3),
        second[9:].reshape(3, 3, 3),
    )  # fmt: skip


def _steps(motion: Motion, t: FloatArray, step: float) -> tuple[FloatArray, FloatArray]:
    """Limits of the steps of a quadrature that stops at given times and at jumps; places of the former among them."""
    if len(t) < 2 or np.any(np.diff(t) <= 0.0) or not step > 0.0:
        raise InputError("t: expected at least two increasing times, and a positive step")
    stops = t
    if isinstance(motion, RotatingMotion):
        breaks = motion.schedule.breakpoints(float(t[0]), float(t[-1]))
        near = np.abs(t[np.clip(np.searchsorted(t, breaks), 1, len(t) - 1)] - breaks) < 1e-9
        near |= np.abs(t[np.clip(np.searchsorted(t, breaks) - 1, 0, len(t) - 1)] - breaks) < 1e-9
        stops = np.union1d(t, breaks[~near])
    parts = np.maximum(np.ceil(np.diff(stops) / step - 1e-9), 1).astype(np.int64)
    first = np.concatenate(([0], np.cumsum(parts)))
    limits = np.interp(np.arange(first[-1] + 1), first, stops)
    limits[first] = stops
    return limits, first[np.searchsorted(stops, t)]


def _integrated(
    rate: FloatArray, h: FloatArray, inner: FloatArray, weights: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Integral at the limits (n + 1, k) and at the nodes (n, nodes, k) of values at the nodes."""
    whole = h[:, None] * np.einsum("j,njk->nk", weights, rate)
    ends = np.concatenate((np.zeros((1, rate.shape[-1])), np.cumsum(whole, axis=0)))
    return ends, ends[:-1, None] + h[:, None, None] * np.einsum("ij,njk->nik", inner, rate)


def _collocation(n: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Integrals of the polynomials of Gauss-Legendre nodes in 0..1 up to each node and up to 1, and the nodes."""
    x, w = np.polynomial.legendre.leggauss(n)
    nodes, powers = 0.5 * (x + 1.0), np.arange(n)
    inverse = np.linalg.inv(np.vander(nodes, increasing=True))
    return (nodes[:, None] ** (powers + 1) / (powers + 1)) @ inverse, 0.5 * w, nodes
