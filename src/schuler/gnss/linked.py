"""Track of a receiver from many epochs tied by range rates: which ranges took a detour, where one epoch cannot tell.

Between houses half of the ranges may be reflected. The satellites of one epoch then agree with several places; those of
its neighbours, tied to it by the velocity that range rates give, agree with one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schuler.arrays import FloatArray, IntArray
from schuler.gnss.detours import RangeNoise
from schuler.gnss.epoch_fits import Padded, fit_rates
from schuler.gnss.ranges import predicted_ranges, predicted_rates

_CONVEX_ROUNDS = 6  # with weights that have one minimum
_ROUNDS = 40
_SETTLED = 0.05  # largest step of a position that ends the rounds [m]
_BEND = 1.5  # normalised residual from which convex weights fall
_RATE_BEND = 3.0  # likewise of range rates, whose later weights fall as Geman and McClure's
_WIDEST, _ANNEALING = 12.0, 0.6  # factor on the noise in the first round after the convex ones, and from round to round
_LONGEST_MEMORY = 120  # epochs over which residuals may be correlated
_FORGOTTEN = 0.05  # correlation below which residuals are taken for independent
_CALMEST, _WILDEST = 0.3, 100.0  # bounds of the random walk of velocity [m/s per sqrt(s)]
_DRIFT_WALK = 1.0  # of the clock drift [m/s per sqrt(s)]
_OFFSET_WALK = 0.02  # of the offsets between systems' clocks [m per sqrt(s)]
_CLOCK_STEP = 1e5  # the first clock itself is free, as receivers set it [m]
_SHORTEST_STEP_S = 1e-3  # between epochs, for the sake of rounding [s]
_WEAK = 1e-9  # inverse variance of what nothing else determines


@dataclass(frozen=True)
class Linked:
    """Track of one receiver, k epochs of m places, g clocks.

    Attributes
    ----------
    r_e, v_e : ndarray, shape (k, 3)
        [m], [m/s]
    cov_r_e, cov_v_e : ndarray, shape (k, 3, 3)
        [m^2], [m^2/s^2]
    clock, sigma_clock : ndarray, shape (k, g)
        Also of systems that show no satellite at an epoch. [m]
    drift, sigma_drift : ndarray, shape (k,)
        [m/s]
    direct : ndarray, shape (k, m)
        Probability that a range came by the direct path; 0 where there is none.
    rate_weight : ndarray, shape (k, m)
        Weight of each range rate, 1 where it agrees; 0 where there is none.
    hidden : ndarray, shape (k, s, 3)
        Error of position if all ranges of one of the s satellites are late by as much as still passes for direct. [m]
    """

    r_e: FloatArray
    cov_r_e: FloatArray
    v_e: FloatArray
    cov_v_e: FloatArray
    clock: FloatArray
    sigma_clock: FloatArray
    drift: FloatArray
    sigma_drift: FloatArray
    direct: FloatArray
    rate_weight: FloatArray
    hidden: FloatArray


def link_epochs(p: Padded, t: FloatArray, sat: IntArray, cn0: FloatArray, start: FloatArray) -> Linked:
    """Robust least squares of all epochs together, tied by velocity.

    Parameters
    ----------
    p : Padded
        Ranges and range rates of k epochs, m places each.
    t : ndarray, shape (k,)
        Increasing. [s]
    sat : ndarray of int, shape (k, m)
    cn0 : ndarray, shape (k, m)
        NaN where unknown. [dB-Hz]
    start : ndarray, shape (k, 3)
        Positions to begin at, Earth-fixed, at least one of them finite. [m]

    Returns
    -------
    Linked

    Notes
    -----
    Unknowns of an epoch are position, velocity, clock drift, the first clock, and by how much further systems' clocks
    differ from it. Between epochs the velocity is a random walk, as dense as the epochs' own velocities scatter (median
    of their steps); the clock is free, the systems' offsets hardly change.

    A range is direct or took a detour, see :class:`schuler.gnss.detours.RangeNoise`, whose parameters are learned from
    the ranges along with the track. The first rounds have weights with one minimum (Huber), the next a widened noise
    that narrows to the stated one, so that the start does not matter. Errors of direct ranges last, so that n epochs
    do not know as much as n independent ones: variances grow by ``1 + 2 sum rho_j``, with the correlations of
    satellites' residuals j epochs apart.

    References
    ----------
    Yang, Song & Xu (2002), J. Geodesy 76, 353-358 (equivalent weights); Yang, Antonante, Tzoumas & Carlone (2020), IEEE
    Robotics and Automation Letters 5, 1127-1134 (annealing); Zieba (2010), Metrology and Measurement Systems 17, 3-16
    (effective number of correlated observations).
    """
    x = _begin(p, t, start)
    F, information = _walk(p, t, x)
    noise = RangeNoise.stated(p, cn0)
    direct, rate_weight = p.usable.astype(float), p.has_rate.astype(float)
    lasting = lasting_rate = 1.0
    for n in range(_ROUNDS):
        A, y, B, z = _rows(p, x)
        widened = max(1.0, _WIDEST * _ANNEALING ** (n - _CONVEX_ROUNDS - 1))
        if 0 < n <= _CONVEX_ROUNDS:
            direct = p.usable / np.maximum(1.0, np.abs(y) * p.w / _BEND)
            rate_weight = p.has_rate / np.maximum(1.0, np.abs(z) * p.w_rate / _BEND)
        elif n > _CONVEX_ROUNDS:
            direct = noise.probability_direct(y, widened)
            square = (_RATE_BEND * widened * noise.rate_factor) ** 2
            rate_weight = p.has_rate * (square / (square + (z * p.w_rate) ** 2)) ** 2
            noise = noise.learned(y, direct, z, rate_weight)
            if widened == 1.0:
                lasting, lasting_rate = (
                    lasting_factor(sat, y * p.w, direct),
                    lasting_factor(sat, z * p.w_rate, rate_weight),
                )
        of_range = (A, y, direct * (p.w / noise.factor) ** 2 / lasting)
        of_rate = (B, z, rate_weight * (p.w_rate / noise.rate_factor) ** 2 / lasting_rate)
        normal, beside, right = _normal((of_range, of_rate), x, F, information)
        step = _solved(normal, beside, right)[..., 0]
        x = x + step
        if n > _CONVEX_ROUNDS and widened == 1.0 and np.abs(step[:, :3]).max() < _SETTLED:
            break
    P = _diagonal_blocks(normal, beside)
    to_clocks = np.eye(p.n_groups)
    to_clocks[:, 0] = 1.0
    of_clocks = np.einsum("ij,kjl,il->ki", to_clocks, P[:, 7:, 7:], to_clocks)
    return Linked(
        x[:, :3], P[:, :3, :3], x[:, 3:6], P[:, 3:6, 3:6], x[:, 7:] @ to_clocks.T, np.sqrt(of_clocks), x[:, 6],
        np.sqrt(P[:, 6, 6]), direct, rate_weight,
        _solved(normal, beside, _pulls(sat, of_range, noise.largest_direct()))[:, :3].swapaxes(1, 2),
    )  # fmt: skip


def _begin(p: Padded, t: FloatArray, start: FloatArray) -> FloatArray:
    """Unknowns to begin with: positions between the finite ones, clocks by the median, the rest zero."""
    finite = np.isfinite(start).all(axis=1)
    x = np.zeros((len(t), 7 + p.n_groups))
    x[:, :3] = np.stack([np.interp(t, t[finite], start[finite, i]) for i in range(3)], axis=-1)
    predicted, _ = predicted_ranges(p.r_s, x[:, None, :3])
    shown = p.usable.any(axis=1)
    clock = np.nanmedian(np.where(p.usable, p.rho - predicted, np.nan)[shown], axis=1)
    x[:, 7] = np.interp(t, t[shown], clock)
    return x


def _walk(p: Padded, t: FloatArray, x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Transition from epoch to epoch, and inverse covariance of what it leaves open. Shapes (k - 1, n, n)."""
    dt, n = np.maximum(np.diff(t), _SHORTEST_STEP_S), x.shape[1]
    own = fit_rates(p, p.has_rate, x[:, :3])
    both = own.solvable[1:] & own.solvable[:-1]
    steps = np.abs(np.diff(own.x, axis=0)[both]) / np.sqrt(dt[both])[:, None]
    density = np.clip(1.4826 * np.median(steps), _CALMEST, _WILDEST) ** 2 if len(steps) else _WILDEST**2
    F = np.broadcast_to(np.eye(n), (len(dt), n, n)).copy()
    F[:, range(3), range(3, 6)] = dt[:, None]
    F[:, 7, 6] = dt
    information = np.zeros((len(dt), n, n))
    for i in range(3):  # the inverse of density [[dt^3 / 3, dt^2 / 2], [dt^2 / 2, dt]]
        information[:, i, i] = 12.0 / dt**3 / density
        information[:, i, 3 + i] = information[:, 3 + i, i] = -6.0 / dt**2 / density
        information[:, 3 + i, 3 + i] = 4.0 / dt / density
    information[:, 6, 6] = 1.0 / (_DRIFT_WALK**2 * dt)
    information[:, 7, 7] = 1.0 / _CLOCK_STEP**2
    information[:, range(8, n), range(8, n)] = 1.0 / (_OFFSET_WALK**2 * dt)[:, None]
    return F, information


def _rows(p: Padded, x: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Design and differences of ranges [m], and of range rates [m/s], about x."""
    predicted, gradient = predicted_ranges(p.r_s, x[:, None, :3])
    A = np.zeros((*p.usable.shape, x.shape[1]))
    A[..., :3] = gradient
    A[..., 7:] = p.group[..., None] == np.arange(p.n_groups)
    A[..., 7] = 1.0
    y = np.where(p.usable, p.rho - predicted - np.einsum("kmi,ki->km", A[..., 7:], x[:, 7:]), 0.0)
    speed, gradient = predicted_rates(p.r_s, p.v_s, x[:, None, :3], x[:, None, 3:6])
    B = np.zeros_like(A)
    B[..., 3:6] = gradient
    B[..., 6] = 1.0
    return A, y, B, np.where(p.has_rate, p.rate - speed - x[:, 6:7], 0.0)


def _normal(
    rows: tuple[tuple[FloatArray, FloatArray, FloatArray], ...], x: FloatArray, F: FloatArray, information: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Blocks of the normal matrix on its diagonal and to the right of it, and the right side. Shape (k, n, 1)."""
    k, n = x.shape
    N, b = np.zeros((k, n, n)), np.zeros((k, n, 1))
    for A, y, w in rows:
        transposed = np.swapaxes(A, 1, 2)
        N += transposed @ (A * w[..., None])
        b += transposed @ (y * w)[..., None]
    misfit = x[1:, :, None] - F @ x[:-1, :, None]
    back = np.swapaxes(F, 1, 2) @ information
    N[1:] += information
    N[:-1] += back @ F
    b[1:] -= information @ misfit
    b[:-1] += back @ misfit
    N[:, range(n), range(n)] += _WEAK
    return N, -back, b


def _solved(N: FloatArray, beside: FloatArray, b: FloatArray) -> FloatArray:
    """Solution of a block tridiagonal system for several right sides. Shape (k, n, c)."""
    from scipy.linalg import solveh_banded

    k, n = N.shape[:2]
    bands = np.zeros((2 * n, k * n))  # the upper ones, as LAPACK has them
    for i in range(n):
        for j in range(n):
            if j >= i:
                bands[2 * n - 1 + i - j, j::n] = N[:, i, j]
            bands[n - 1 + i - j, n + j :: n] = beside[:, i, j]
    return np.asarray(solveh_banded(bands, b.reshape(k * n, -1))).reshape(k, n, -1)


def _pulls(sat: IntArray, of_range: tuple[FloatArray, FloatArray, FloatArray], bias: FloatArray) -> FloatArray:
    """Right sides if all ranges of one satellite are late by their ``bias`` [m]. Shape (k, n, s)."""
    A, _, w = of_range
    pulls = [np.einsum("kmi,km->ki", A, np.where(sat == s, w * bias, 0.0)) for s in np.unique(sat[w > 0.0])]
    return np.stack(pulls, axis=-1)


def _diagonal_blocks(N: FloatArray, beside: FloatArray) -> FloatArray:
    """Blocks on the diagonal of the inverse of a block tridiagonal matrix. Shape (k, n, n)."""
    reduced = N.copy()
    for k in range(1, len(N)):
        reduced[k] -= beside[k - 1].T @ np.linalg.solve(reduced[k - 1], beside[k - 1])
    P: FloatArray = np.asarray(np.linalg.inv(reduced))
    for k in range(len(N) - 2, -1, -1):
        gain = P[k] @ beside[k]
        P[k] += gain @ P[k + 1] @ gain.T
    return P


def lasting_factor(sat: IntArray, v: FloatArray, w: FloatArray) -> float:
    """``1 + 2 sum rho_j`` over the correlations of satellites' residuals j epochs apart, while there are any.

    By which the variance of a mean of them is larger than if they were independent. Shapes (k, m) of all three.
    """
    k, place = np.nonzero(w > 0.0)
    sats, row = np.unique(sat[k, place], return_inverse=True)
    r, a = np.zeros((2, len(sats), len(v)))
    r[row, k], a[row, k] = v[k, place], w[k, place]
    total = 1.0
    for lag in range(1, min(_LONGEST_MEMORY, len(v) - 1) + 1):
        both = a[:, lag:] * a[:, :-lag]
        power = 0.5 * np.sum(both * (r[:, lag:] ** 2 + r[:, :-lag] ** 2))
        rho = float(np.sum(both * r[:, lag:] * r[:, :-lag]) / power) if power > 0.0 else 0.0
        if rho < _FORGOTTEN:
            break
        total += 2.0 * rho
    return total
