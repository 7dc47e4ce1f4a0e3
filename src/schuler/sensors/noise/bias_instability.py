"""Bias instability: 1/f noise, ideal and as a sum of Gauss-Markov processes."""

from __future__ import annotations

from dataclasses import dataclass
from math import floor, log, log10, pi, sqrt

import numpy as np

from schuler.arrays import ArrayLike, FloatArray
from schuler.exceptions import InputError
from schuler.sensors.noise._checks import Shape, counts, frequencies, magnitude, over, positive, shape_of, times
from schuler.sensors.noise.markov import GaussMarkov
from schuler.sensors.noise.process import NoiseModel, Process
from schuler.sensors.noise.state_space import StateSpace

# Correlation times of the samples' processes: from 0.72 sampling intervals, where what point sampling adds and what the
# missing shorter times lack cancel best, in steps of sqrt(10), to five times the record, where the mean of a record has
# the standard deviation B.
_FIRST, _STEP, _RECORDS = 0.72, sqrt(10.0), 5.0


@dataclass(frozen=True, slots=True)
class Flicker(Process):
    """Bias instability: noise with the density ``B^2 / (2 pi |f|)`` at all frequencies.

    Attributes
    ----------
    B : float
        Bias instability of IEEE Std 952; the Allan deviation is 0.664 B everywhere. [x]
    shortest, longest : float or None
        Correlation times [s] at which the band ends in samples and states; None is chosen by what is asked for.

    Raises
    ------
    InputError
        If B is negative or the band empty.

    Notes
    -----
    Allan variance and density are those of ideal 1/f noise, which has no finite variance. Samples and states are sums
    of Gauss-Markov processes:

    - :meth:`sample` takes two per decade from 0.72 dt to five times the record, so that the band follows the rate and
      the duration. The Allan deviation of the samples is 4 % above 0.664 B at one sample and within 2 % from two to
      half the record, the density within 4 % below a twentieth of the rate and within 14 % up to half of it. The mean
      of the record, and with it the drift, does not depend on the rate: its standard deviation is B, within 1 %.
    - :meth:`state_space`, and with it ``sampled``, is that of :func:`flicker`, one process per decade from 1 s to
      10^4 s: few states, within 3 % from 10 s to 4000 s.

    References
    ----------
    IEEE Std 952, annex C (bias instability), without its cut-off at low frequencies.
    """

    B: float
    shortest: float | None = None
    longest: float | None = None

    def __post_init__(self) -> None:
        magnitude(self.B, "B")
        for name in ("shortest", "longest"):
            if getattr(self, name) is not None:
                positive(getattr(self, name), name)
        if self.shortest is not None and self.longest is not None and not self.shortest < self.longest:
            raise InputError(f"longest: expected more than shortest = {self.shortest} s, got {self.longest} s")

    def approximation(self, n: int, dt: float) -> NoiseModel:
        """The Gauss-Markov processes of which a record of ``n`` samples every ``dt`` [s] is made.

        Each stands for the correlation times within half a step around its own. The last has what is left of a step, so
        that the band ends where it shall for every rate and duration.
        """
        dt = positive(dt, "dt")
        shortest = self.shortest or _FIRST * dt
        longest = self.longest or _RECORDS * max(n, 1) * dt
        steps = max(1.0, 1.0 + log(longest / shortest) / log(_STEP))
        whole = floor(steps + 1e-9)
        sizes = [1.0] * whole + ([steps - whole] if steps - whole > 1e-9 else [])
        sigma = self.B * sqrt(log(_STEP) / pi)
        return NoiseModel(
            tuple(
                GaussMarkov(sigma * sqrt(size), shortest * _STEP ** (k + 0.5 * (size - 1.0)))
                for k, size in enumerate(sizes)
            )
        )

    def sample(self, n: Shape, dt: float, rng: np.random.Generator) -> FloatArray:
        """Sum of the processes of :meth:`approximation`; its mean wanders as far as the record is long. [x]"""
        shape = shape_of(n)
        return self.approximation(shape[0], dt).sample(shape, dt, rng)

    def allan_variance(self, tau: ArrayLike) -> FloatArray:
        """``2 ln 2 / pi B^2`` at every averaging time. [x^2]"""
        return np.full_like(times(tau), 2.0 * log(2.0) / pi * self.B**2)

    def discrete_allan_variance(self, m: ArrayLike, dt: float) -> FloatArray:
        """The same: ideal samples are means over the interval. See the class on how near :meth:`sample` is. [x^2]"""
        return self.allan_variance(counts(m) * positive(dt, "dt"))

    def psd(self, f: ArrayLike) -> FloatArray:
        """``B^2 / (2 pi |f|)``. [x^2/Hz]"""
        return over(self.B**2, 2.0 * pi * np.abs(frequencies(f)))

    def discrete_psd(self, f: ArrayLike, dt: float) -> FloatArray:
        """The same, without aliases. [x^2/Hz]"""
        positive(dt, "dt")
        return self.psd(f)

    def state_space(self) -> StateSpace:
        """That of :func:`flicker` from ``shortest``, or 1 s, to ``longest``, or 10^4 s and at least a decade."""
        shortest = self.shortest or min(1.0, 0.1 * (self.longest or 10.0))
        return flicker(self.B, shortest, self.longest or max(1e4, 10.0 * shortest)).state_space()


def flicker(B: float, shortest: float = 1.0, longest: float = 1e4) -> NoiseModel:
    """Bias instability (1/f noise) as a sum of Gauss-Markov processes, one per decade of correlation time.

    Parameters
    ----------
    B : float
        Bias instability of IEEE Std 952, ``S(f) = B^2 / (2 pi |f|)``; the flat part of the Allan deviation lies at
        ``0.664 B``. [x]
    shortest, longest : float
        Correlation times of the first and last process. [s]

    Returns
    -------
    NoiseModel
        Its Allan deviation is within 3 % of ``0.664 B`` from ``10 shortest`` to ``0.4 longest``, 7 % below at
        ``longest`` and 18 % below at ``shortest``; its standard deviation is ``0.86 B`` times the square root of the
        number of decades plus one, 1.9 B by default.

    Raises
    ------
    InputError
        If B is negative or the band empty.

    Notes
    -----
    Equal variances ``B^2 ln(r) / pi`` at correlation times in the ratio r add up to ``B^2 / (2 pi f)``, since
    ``integral 2 tau / (1 + (w tau)^2) d ln(tau) = pi / w``. Unlike true 1/f noise the sum has a finite variance and an
    exact state-space form, and it is stationary from the first sample.
    """
    magnitude(B, "B")
    shortest = positive(shortest, "shortest")
    if not shortest < positive(longest, "longest"):
        raise InputError(f"longest: expected more than shortest = {shortest} s, got {longest} s")
    taus = np.geomspace(shortest, longest, max(2, round(log10(longest / shortest)) + 1))
    sigma = B * sqrt(log(taus[1] / taus[0]) / pi)
    return NoiseModel(tuple(GaussMarkov(sigma, float(tau)) for tau in taus))
