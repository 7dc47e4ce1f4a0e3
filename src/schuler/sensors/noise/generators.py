"""Exact discrete generators: arrays in, arrays out."""

from __future__ import annotations

from math import exp, expm1, sqrt

import numpy as np

from schuler.arrays import ArrayLike, FloatArray, as_floats
from schuler.exceptions import InputError
from schuler.sensors.noise._checks import Shape, Start, magnitude, positive, shape_of


def white(N: float, n: Shape, dt: float, rng: np.random.Generator) -> FloatArray:
    """White noise of root density N, as the mean over each sampling interval.

    Parameters
    ----------
    N : float
        Two-sided root power spectral density. [x/sqrt(Hz)]
    n : int or tuple of int
        Number of samples, or the shape with time along axis 0; the other axes are independent.
    dt : float
        Sampling interval. [s]
    rng : numpy.random.Generator

    Returns
    -------
    ndarray, shape n
        Independent normal samples of standard deviation ``N / sqrt(dt)``. [x]

    Raises
    ------
    InputError
        If N is negative, dt not positive, or n no shape.

    Notes
    -----
    The mean of m consecutive samples is a sample of the same process at ``m * dt``: the statistics do not depend on the
    rate. Flenniken (2005) divides by the rate instead of multiplying in chapters 5 and 6; his chapter 2 has it right.

    References
    ----------
    Flenniken (2005), eqs. (2.2), (2.8).
    """
    shape, dt = shape_of(n), positive(dt, "dt")
    return magnitude(N, "N") / sqrt(dt) * rng.standard_normal(shape)


def random_walk(K: float, n: Shape, dt: float, rng: np.random.Generator) -> FloatArray:
    """Random walk (rate random walk of a sensor) that starts at zero.

    Parameters
    ----------
    K : float
        Root density of the driving white noise. [x*sqrt(Hz)]
    n : int or tuple of int
        Number of samples, or the shape with time along axis 0.
    dt : float
        Sampling interval. [s]
    rng : numpy.random.Generator

    Returns
    -------
    ndarray, shape n
        Sample k has variance ``K**2 * k * dt``, exactly and at any rate; sample 0 is zero. [x]

    Raises
    ------
    InputError
        If K is negative, dt not positive, or n no shape.
    """
    shape, dt = shape_of(n), positive(dt, "dt")
    steps = magnitude(K, "K") * sqrt(dt) * rng.standard_normal(shape)
    steps[:1] = 0.0
    walk: FloatArray = np.cumsum(steps, axis=0)
    return walk


def gauss_markov(
    sigma: float, tau: float, n: Shape, dt: float, rng: np.random.Generator, start: Start = "stationary"
) -> FloatArray:
    """First-order Gauss-Markov process, exact at the samples for any rate.

    Parameters
    ----------
    sigma : float
        Standard deviation in the steady state. [x]
    tau : float
        Correlation time. [s]
    n : int or tuple of int
        Number of samples, or the shape with time along axis 0.
    dt : float
        Sampling interval. [s]
    rng : numpy.random.Generator
    start : {"stationary", "zero"}
        First sample from N(0, sigma^2), or exactly zero (a bias just calibrated out).

    Returns
    -------
    ndarray, shape n
        ``b[k+1] = e b[k] + sigma sqrt(1 - e^2) v[k]``, ``e = exp(-dt / tau)``. [x]

    Raises
    ------
    InputError
        If sigma is negative, tau or dt not positive, n no shape or start unknown.

    Notes
    -----
    The source integrates ``b' = -b / tau + w`` by Euler's rule, which is unstable for ``dt > 2 tau`` and needs a drive
    of its own for every rate; its sizing (B.9) moreover has a plus where (B.8) leads to a minus. The recursion above
    has neither defect. The source leaves the start open although it changes short runs most; hence the argument.

    References
    ----------
    Flenniken (2005), eqs. (2.4), (2.5) and appendix B.
    """
    from scipy.signal import lfilter

    shape, dt = shape_of(n), positive(dt, "dt")
    step = dt / positive(tau, "tau")
    drive = magnitude(sigma, "sigma") * sqrt(-expm1(-2.0 * step)) * rng.standard_normal(shape)
    if start == "stationary":
        drive[:1] = sigma * rng.standard_normal(drive[:1].shape)
    elif start == "zero":
        drive[:1] = 0.0
    else:
        raise InputError(f"start: expected 'stationary' or 'zero', got {start!r}")
    out: FloatArray = lfilter([1.0], [1.0, -exp(-step)], drive, axis=0)
    return out


def quantise(x: ArrayLike, lsb: float) -> FloatArray:
    """Round to the nearest multiple of ``lsb``; no memory from sample to sample.

    Parameters
    ----------
    x : array_like
        [x]
    lsb : float
        Value of the least significant bit. [x]

    Returns
    -------
    ndarray of the same shape

    Raises
    ------
    InputError
        If lsb is not positive.
    """
    lsb = positive(lsb, "lsb")
    return np.asarray(np.round(as_floats(x, "x") / lsb) * lsb)


def quantise_increments(x: ArrayLike, lsb: float) -> FloatArray:
    """Round increments to whole pulses and carry the remainder into the next interval.

    What a pulse-output sensor does: the sum of its pulses never differs by more than half a pulse from the sum of the
    true increments, so quantisation makes noise but no drift.

    Parameters
    ----------
    x : array_like, shape (n, ...)
        Increments, time along axis 0.
    lsb : float
        Size of a pulse, in the unit of ``x``.

    Returns
    -------
    ndarray of the same shape

    Raises
    ------
    InputError
        If lsb is not positive.
    """
    lsb = positive(lsb, "lsb")
    pulses = np.round(np.cumsum(as_floats(x, "x"), axis=0) / lsb)
    return np.asarray(np.diff(pulses, axis=0, prepend=np.zeros_like(pulses[:1])) * lsb)
