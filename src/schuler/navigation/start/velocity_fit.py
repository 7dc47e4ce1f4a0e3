"""Velocities of an antenna from its positions, where the receiver gives none or says little of a component."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from schuler import frames
from schuler.arrays import FloatArray
from schuler.recording.series import GnssSeries

_HALF_S = 1.0  # the fit covers at least this much on both sides [s] ...
_FIXES = 2  # ... and at least so many fixes
_ENOUGH = 20  # fits that say how alike errors are
_UNKNOWN = 100.0  # 1-sigma where too few fixes are near [m/s]
_ALIKE = 5.0  # errors of neighbouring fixes are no more alike than that: their differences are so much better at most
_NO_NEWS = 5.0  # a stated 1-sigma so many times the fit's, and above 1 m/s, is no measurement


def with_velocities(gnss: GnssSeries) -> GnssSeries:
    """Fixes with a velocity in every component, for alignment: the receiver's, or that of the positions.

    Parameters
    ----------
    gnss : GnssSeries
        With velocities, without, or with components that the receiver does not measure: their 1-sigma is large (NMEA
        and phones give speed and course; vertical 10 m/s).

    Returns
    -------
    GnssSeries
        Stated velocities unchanged where they are a measurement; the others from :func:`velocity_fit`.
    """
    if gnss.v_n is None or gnss.cov_v_n is None:
        v, cov = velocity_fit(gnss)
        return replace(gnss, v_n=v, cov_v_n=cov)
    stated = np.sqrt(np.einsum("nii->ni", gnss.cov_v_n))
    if not (stated > 1.0).any():
        return gnss
    v, cov = velocity_fit(gnss)
    take = stated > np.maximum(_NO_NEWS * np.sqrt(np.einsum("nii->ni", cov)), 1.0)
    same = take[:, :, None] == take[:, None, :]
    mixed = np.where(take[:, :, None] & take[:, None, :], cov, gnss.cov_v_n) * same
    return replace(gnss, v_n=np.where(take, v, gnss.v_n), cov_v_n=mixed)


def velocity_fit(gnss: GnssSeries) -> tuple[FloatArray, FloatArray]:
    """Velocity at every fix from a weighted parabola through the positions around it.

    Parameters
    ----------
    gnss : GnssSeries

    Returns
    -------
    v_n : ndarray, shape (n, 3)
        North, east, down. [m/s]
    cov_v_n : ndarray, shape (n, 3, 3)
        From the covariances of the positions, and from the jerk that a parabola does not have: the fits' own
        accelerations say how large it is. 100 m/s where fewer than three fixes are near. [m^2/s^2]

    Notes
    -----
    Errors common to neighbouring fixes cancel in the velocity: where what the fits leave is smaller than the
    covariances say, by the median over the log, velocities are so much better, at most five times (errors that wander
    change within a fit, too). Fixes after the first two are measurements of the filter again: the velocity of a start
    is so far not independent of them.
    """
    n = len(gnss)
    v, cov = np.zeros((n, 3)), np.tile(_UNKNOWN**2 * np.eye(3), (n, 1, 1))
    if n < 3:
        return v, cov
    step = max(float(np.median(np.diff(gnss.t))), 1e-3)
    m = max(_FIXES, round(_HALF_S / step))
    first = np.clip(np.arange(n) - m, 0, max(n - 2 * m - 1, 0))
    index = first[:, None] + np.arange(min(2 * m + 1, n))
    tau = gnss.t[index] - gnss.t[:, None]
    r_e = frames.ecef_from_llh(gnss.llh)
    d_n = np.einsum("nji,nkj->nki", frames.C_en(gnss.llh), r_e[index] - r_e[:, None])
    variance = np.einsum("nii->n", gnss.cov_r_n[:, :2, :2])[index]
    weight = np.where(np.abs(tau) <= 2.5 * m * step, 1.0 / variance, 0.0)
    near = (weight > 0.0).sum(axis=1) >= 3
    half = m * step
    A = (tau[:, :, None] / half) ** np.arange(3)  # constant, velocity, half the acceleration; scaled
    normal = np.einsum("nki,nk,nkj->nij", A, weight, A)
    normal[~near] = np.eye(3)
    # weights of the fixes in the three coefficients
    gain = np.linalg.solve(normal, np.swapaxes(A * weight[:, :, None], 1, 2))
    slope = gain[:, 1] / half
    acceleration = np.einsum("nk,nki->ni", 2.0 * gain[:, 2] / half**2, d_n)
    pair = near[1:] & near[:-1] & (np.diff(gnss.t) <= 2.5 * step)
    change = (np.diff(acceleration, axis=0) / np.diff(gnss.t)[:, None])[pair]
    jerk = np.mean(change**2, axis=0) if len(change) else np.zeros(3)
    missed = np.einsum("nk,nk->n", slope, tau**3) / 6.0
    left = d_n - np.einsum("nki,nij->nkj", A, np.einsum("nik,nkj->nij", gain, d_n))
    free = np.maximum((weight > 0.0).sum(axis=1) - 3, 0)
    squares = np.einsum("nk,nki->ni", weight, left[:, :, :2] ** 2) / np.maximum(2.0 * free, 1.0)[:, None]
    fitted = np.einsum("nk,nkij->nij", slope**2, gnss.cov_r_n[index]) * _shared(squares[near & (free > 0)].sum(axis=1))
    fitted += (missed**2)[:, None, None] * np.diag(jerk)
    v[near], cov[near] = np.einsum("nk,nki->ni", slope, d_n)[near], fitted[near]
    return v, cov


def _shared(squares: FloatArray) -> float:
    """Factor on the variance of differences of neighbouring fixes, from mean normalised squares of what fits leave."""
    if len(squares) < _ENOUGH:
        return 1.0
    # two components of two degrees of freedom each: the median of chi-square of four is 3.36
    return float(np.clip(np.median(squares) * 4.0 / 3.36, 1.0 / _ALIKE**2, 1.0))
