"""SIMULATION ONLY: non-coherent discriminators of a tracking channel, and how noisy they are, in closed form.

A discriminator is a product of correlator outputs whose mean is a known function of the tracking error. The ones here
are non-coherent: they need no carrier phase and no data bits, which is why they work on weak signals. Means and
variances are in units of the correlators' noise; ``A^2 = 2 c tau`` is the power of a prompt accumulation.

============================ ======================= ====================
discriminator                product                 mean, small errors
============================ ======================= ====================
``power`` (early minus late) ``abs(E)^2 - abs(L)^2`` ``2 (2 - d) A^2 x``
``dot`` (dot product)        ``Re(P conj(E - L))``   ``2 A^2 x``
frequency (cross product)    ``Im(P2 conj(P1))``     ``2 pi tau A^2 f``
============================ ======================= ====================

References
----------
Groves (2013), sections 9.2.2, 9.2.3, 9.3.3; Kaplan and Hegarty (2006), sections 5.3-5.6; Stefanisko (2015), 3.1.4.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from schuler.arrays import ArrayLike, FloatArray
from schuler.exceptions import InputError
from schuler.reproduce.stefanisko.study.deep.correlator import (
    Correlator,
    Taps,
    code_correlation,
    coherence,
    expected_taps,
    noisy,
)

CodeKind: TypeAlias = Literal["dot", "power"]

CODE_KINDS: tuple[CodeKind, ...] = ("dot", "power")


def early_late_power(taps: Taps) -> FloatArray:
    """Early minus late power, ``I_E^2 + Q_E^2 - I_L^2 - Q_L^2``."""
    return np.asarray(np.abs(taps.early) ** 2 - np.abs(taps.late) ** 2)


def dot_product(taps: Taps) -> FloatArray:
    """Dot product power, ``I_P (I_E - I_L) + Q_P (Q_E - Q_L)``."""
    return np.asarray((taps.prompt * np.conj(taps.early - taps.late)).real)


def cross_product(first: np.ndarray, second: np.ndarray) -> FloatArray:
    """``I_1 Q_2 - I_2 Q_1`` of two prompt accumulations within one data bit."""
    return np.asarray((second * np.conj(first)).imag)


def code_curve(kind: CodeKind, x: ArrayLike, spacing: float) -> FloatArray:
    """Mean of a code discriminator for a prompt power of one: its S-curve. ``x`` and ``spacing`` in chips."""
    _check(kind)
    x = np.asarray(x, dtype=np.float64)
    early, late = code_correlation(x - 0.5 * spacing), code_correlation(x + 0.5 * spacing)
    if kind == "power":
        return np.asarray(early**2 - late**2)
    return np.asarray(code_correlation(x) * (early - late))


def code_slope(kind: CodeKind, spacing: float) -> float:
    """Slope of :func:`code_curve` at zero. [1/chip]"""
    _check(kind)
    return 2.0 * (2.0 - spacing) if kind == "power" else 2.0


def frequency_curve(f: ArrayLike, tau: float) -> FloatArray:
    """Mean of the cross product for a power of one in each accumulation of ``tau``: zero again at ``1 / (2 tau)``.

    ``f`` in Hz; ``sinc^2(f tau) sin(2 pi f tau)``.
    """
    f = np.asarray(f, dtype=np.float64)
    return np.asarray(np.abs(coherence(f, tau)) ** 2 * np.sin(2.0 * np.pi * f * tau))


def frequency_slope(tau: float) -> float:
    """Slope of :func:`frequency_curve` at zero, ``2 pi tau``. [1/Hz]"""
    return 2.0 * np.pi * tau


def code_variance(kind: CodeKind, cn0: ArrayLike, tau: float, spacing: float, x: ArrayLike = 0.0) -> FloatArray:
    """Variance of a code discriminator divided by its slope at zero: noise-equivalent code error of one output.

    Parameters
    ----------
    kind : {"dot", "power"}
    cn0 : array_like
        A ratio. [Hz]
    tau : float
        Length of the accumulation. [s]
    spacing : float
        Early to late. [chips]
    x : array_like
        Code error. [chips]

    Returns
    -------
    ndarray
        [chips^2]

    Notes
    -----
    At zero error, ``d / (4 c tau) (1 + 2 / ((2 - d) c tau))`` of early-minus-late power and
    ``d / (4 c tau) (1 + 1 / (c tau))`` of the dot product: Groves (2013), section 9.3.3, whose loop noise is
    ``2 B tau`` times these. The second term is noise times noise ("squaring loss"). For other errors the same products
    of Gaussian variables are kept in full; sum and difference of two taps of equal noise are independent.
    """
    _check(kind)
    power = 2.0 * np.asarray(cn0, dtype=np.float64) * tau
    x = np.asarray(x, dtype=np.float64)
    early, late = code_correlation(x - 0.5 * spacing), code_correlation(x + 0.5 * spacing)
    apart = 2.0 * spacing  # variance of I_E - I_L
    if kind == "power":
        together = 2.0 * (2.0 - spacing)
        variance = power * ((early + late) ** 2 * apart + (early - late) ** 2 * together) + 2.0 * apart * together
    else:
        variance = power * (code_correlation(x) ** 2 * apart + (early - late) ** 2) + 2.0 * apart
    return np.asarray(variance / (code_slope(kind, spacing) * power) ** 2)


def frequency_variance(cn0: ArrayLike, tau: float, f: ArrayLike = 0.0) -> FloatArray:
    """Variance of the cross product divided by its slope at zero, of two accumulations of ``tau`` seconds. [Hz^2]

    Parameters
    ----------
    cn0 : array_like
        A ratio. [Hz]
    tau : float
        Length of each of the two. [s]
    f : array_like
        Frequency error. [Hz]

    Notes
    -----
    At zero error ``(1 + 1 / (2 c tau)) / (4 pi^2 tau^3 c)``. The rule of thumb of Kaplan and Hegarty (2006), section
    5.6.2, has ``1 / (c tau)`` in the bracket; the exact variance of the products, which Monte Carlo confirms
    (tests/reproduce/stefanisko/deep/test_discriminators.py), has half of it.
    """
    power = 2.0 * np.asarray(cn0, dtype=np.float64) * tau
    kept = np.abs(coherence(f, tau)) ** 2
    return np.asarray((2.0 * power * kept + 2.0) / (frequency_slope(tau) * power) ** 2)


def measured_cn0(prompt_power: ArrayLike, tau: float) -> FloatArray:
    """C/N0 from the mean power of prompt accumulations, noise power (2) taken off. A ratio, below zero by chance. [Hz]

    Parameters
    ----------
    prompt_power : array_like
        Mean of ``I_P^2 + Q_P^2``; of k accumulations it is known to ``sqrt((4 A^2 + 4) / k)``.
    tau : float
        [s]

    Notes
    -----
    The noise level is taken as known, as from a correlator on a code that is not transmitted. Tracking errors lower
    the power, so this is the C/N0 that the discriminators work with, ``c R(x)^2 sinc^2(f tau)``.
    """
    return np.asarray((np.asarray(prompt_power, dtype=np.float64) - 2.0) / (2.0 * tau))


@dataclass(frozen=True, slots=True)
class Outputs:
    """Discriminator outputs of data bits, arrays of one shape.

    Attributes
    ----------
    code, cross, power : ndarray
        Code discriminator over the bit, cross product of its halves, prompt power over the bit.
    """

    code: FloatArray
    cross: FloatArray
    power: FloatArray


def bit_outputs(
    correlator: Correlator,
    kind: CodeKind,
    cn0: ArrayLike,
    range_error: ArrayLike,
    rate_error: ArrayLike,
    rng: np.random.Generator,
    *,
    scale: float = 1.0,
) -> Outputs:
    """One data bit after the other through correlators and discriminators.

    Parameters
    ----------
    correlator : Correlator
    kind : {"dot", "power"}
    cn0 : array_like
        A ratio. [Hz]
    range_error, rate_error : array_like
        Replica minus truth in the middle of each bit. [m], [m/s]
    rng : numpy.random.Generator
        Noise, data bits, carrier phase.
    scale : float
        Factor on the correlators' noise; 0 for exact signals.
    """
    _check(kind)
    e, rate = np.broadcast_arrays(np.asarray(range_error, dtype=np.float64), np.asarray(rate_error, dtype=np.float64))
    tau = correlator.half
    phase = rng.uniform(0.0, 2.0 * np.pi, e.shape)
    data = np.where(rng.random(e.shape) < 0.5, -1.0, 1.0)
    first, second = (
        noisy(
            expected_taps(correlator, cn0, e + shift * rate, rate, tau=tau, phase=phase, data=data),
            correlator,
            rng,
            scale=scale,
        )
        for shift in (-0.5 * tau, 0.5 * tau)
    )
    whole = first.followed_by(second)
    code = early_late_power(whole) if kind == "power" else dot_product(whole)
    power = np.abs(whole.prompt) ** 2 + 2.0 * (1.0 - scale**2)  # the noise power measured_cn0 takes off
    return Outputs(code, cross_product(first.prompt, second.prompt), np.asarray(power))


def code_error(correlator: Correlator, kind: CodeKind, code: ArrayLike, cn0: ArrayLike) -> FloatArray:
    """Range error that a code discriminator's output over a bit stands for, replica minus truth. [m]"""
    power = 2.0 * np.asarray(cn0, dtype=np.float64) * correlator.signal.bit
    return np.asarray(correlator.signal.chip * np.asarray(code) / (code_slope(kind, correlator.spacing) * power))


def rate_error(correlator: Correlator, cross: ArrayLike, cn0: ArrayLike) -> FloatArray:
    """Range-rate error that the cross product of two halves of a bit stands for, replica minus truth. [m/s]"""
    power = 2.0 * np.asarray(cn0, dtype=np.float64) * correlator.half
    return np.asarray(correlator.signal.wavelength * np.asarray(cross) / (frequency_slope(correlator.half) * power))


def range_sigma(correlator: Correlator, kind: CodeKind, cn0: ArrayLike) -> FloatArray:
    """1-sigma of :func:`code_error` of one bit, small errors. [m]"""
    s = correlator.signal
    return np.asarray(s.chip * np.sqrt(code_variance(kind, cn0, s.bit, correlator.spacing)))


def rate_sigma(correlator: Correlator, cn0: ArrayLike) -> FloatArray:
    """1-sigma of :func:`rate_error` of one bit, small errors. [m/s]"""
    return np.asarray(correlator.signal.wavelength * np.sqrt(frequency_variance(cn0, correlator.half)))


def _check(kind: str) -> None:
    if kind not in CODE_KINDS:
        raise InputError(f"code discriminator: expected dot or power, got {kind!r}")
