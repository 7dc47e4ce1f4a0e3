"""SIMULATION ONLY: conventional tracking, every satellite in loops of its own.

A delay lock loop of first order, carrier-aided, and a frequency lock loop of second order, both fed by
:mod:`.discriminators`. Such a channel knows of nothing but its own signal: where that fades or the receiver jerks, the
loop loses it, and has to search for it afterwards. It is what tight coupling gets its ranges from. Phase lock is left
out: it is lost some 5 dB earlier.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schuler.arrays import ArrayLike, BoolArray, FloatArray, as_floats
from schuler.exceptions import InputError
from schuler.reproduce.stefanisko.study.deep import discriminators as ts
from schuler.reproduce.stefanisko.study.deep.correlator import Correlator, ratio_from_dbhz

_DAMPING, _NATURAL = 1.414, 0.53  # of a second-order loop: B = 0.53 omega, Kaplan and Hegarty (2006), table 5.6
_QUICK, _JUMP = 0.1, 5.0  # second mean of the power [s], and by how many sigmas it leaves the first one


@dataclass(frozen=True, kw_only=True)
class ScalarLoops:
    """Options of a conventional tracking channel.

    Attributes
    ----------
    code_bandwidth, frequency_bandwidth : float
        One-sided noise bandwidths of the two loops. [Hz]
    kind : {"dot", "power"}
        Code discriminator.
    window : float
        Time over which C/N0 is measured. [s]
    lock_dbhz : float
        A channel whose measured C/N0 falls below is given up. Noise alone measures below 12 dB-Hz in a second.
    acquire_dbhz, acquire : float
        A lost signal is found again after so many seconds above this C/N0. [dB-Hz], [s]
    settle : float
        Ranges are used so long after that. [s]
    acquired_range, acquired_rate : float
        1-sigma with which a search hands over. [m], [m/s]
    jerk : float
        Along the line of sight, 1-sigma, for the claimed accuracy: a second-order loop lags by ``jerk / omega^2`` in
        rate, and the code it aids by ``1 / (4 B)`` of that. [m/s^3]
    """

    code_bandwidth: float = 1.0
    frequency_bandwidth: float = 5.0
    kind: ts.CodeKind = "dot"
    window: float = 1.0
    lock_dbhz: float = 15.0
    acquire_dbhz: float = 33.0
    acquire: float = 3.0
    settle: float = 2.0
    acquired_range: float = 40.0
    acquired_rate: float = 1.0
    jerk: float = 0.0

    def __post_init__(self) -> None:
        for name in ("code_bandwidth", "frequency_bandwidth", "window"):
            if not getattr(self, name) > 0.0:
                raise InputError(f"{name}: expected a positive number, got {getattr(self, name)!r}")

    def sigmas(self, correlator: Correlator, cn0: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """1-sigma of tracked range and range rate: ``sqrt(2 B T)`` of one bit's noise, and the lag. [m], [m/s]

        Source: Groves (2013), section 9.3.3. ``cn0`` is a ratio. [Hz]
        """
        bit = correlator.signal.bit
        lag = self.jerk / (self.frequency_bandwidth / _NATURAL) ** 2
        return (
            np.hypot(
                np.sqrt(2.0 * self.code_bandwidth * bit) * ts.range_sigma(correlator, self.kind, cn0),
                lag / (4.0 * self.code_bandwidth),
            ),
            np.hypot(np.sqrt(2.0 * self.frequency_bandwidth * bit) * ts.rate_sigma(correlator, cn0), lag),
        )


@dataclass(frozen=True)
class Tracked:
    """Channels at the ends of data bits, arrays of shape (k, ...).

    Attributes
    ----------
    range_error, rate_error : ndarray
        Errors of the replicas, estimate minus truth. [m], [m/s]
    cn0 : ndarray
        As measured, a ratio, not below half the limit of lock. [Hz]
    locked : ndarray of bool
        What the lock detector says.
    usable : ndarray of bool
        Locked and settled.
    """

    range_error: FloatArray
    rate_error: FloatArray
    cn0: FloatArray
    locked: BoolArray
    usable: BoolArray

    def on_signal(self, correlator: Correlator) -> BoolArray:
        """Whether the replicas really are within a chip of the code and ``1 / (2 tau)`` of the carrier."""
        return in_reach(correlator, self.range_error, self.rate_error)


def in_reach(correlator: Correlator, range_error: FloatArray, rate_error: FloatArray) -> BoolArray:
    """Whether there is any signal to correlate with: within a chip, within ``1 / (2 tau)`` of the frequency.

    Beyond that, discriminators put out noise, or pull the wrong way: a channel that is there has lost its signal.
    """
    limit = 0.5 * correlator.signal.wavelength / correlator.half
    return np.asarray((np.abs(range_error) < correlator.signal.chip) & (np.abs(rate_error) < limit))


def track(
    loops: ScalarLoops,
    correlator: Correlator,
    ranges: ArrayLike,
    rates: ArrayLike,
    cn0: ArrayLike,
    rng: np.random.Generator,
    *,
    scale: float = 1.0,
) -> Tracked:
    """Track signals from a settled start.

    Parameters
    ----------
    loops : ScalarLoops
    correlator : Correlator
    ranges, rates : array_like, shape (2 k + 1, ...)
        True range and range rate, receiver clock included, every half data bit: start, middle, end, ... [m], [m/s]
    cn0 : array_like, shape (k, ...)
        A ratio, by data bit. [Hz]
    rng : numpy.random.Generator
    scale : float
        Factor on the correlators' noise.

    Returns
    -------
    Tracked

    Notes
    -----
    What a loop does with its discriminators: divides them by the measured signal power (of the last ``window``
    seconds, exponentially weighted; of the last tenth of a second where that differs by more than five sigma, lest a
    fade leaves the loop without gain) and limits them to half a chip and ``1 / (4 tau)``. Pull-in, loss of lock and
    noise are what the correlators give; nothing is decided by a rule but giving up and finding again.
    """
    s, bit = correlator.signal, correlator.signal.bit
    cn0 = as_floats(cn0, "cn0")
    shape = (2 * len(cn0) + 1, *cn0.shape[1:])
    ranges, rates = as_floats(ranges, "ranges"), as_floats(rates, "rates")
    if ranges.shape != shape or rates.shape != shape:
        raise InputError(f"ranges, rates: expected shape {shape} for {len(cn0)} data bits, got {ranges.shape}")
    omega = loops.frequency_bandwidth / _NATURAL
    least = 0.5 * float(ratio_from_dbhz(loops.lock_dbhz))
    most_rate = 0.25 * s.wavelength / correlator.half
    memory, short = np.exp(-bit / loops.window), np.exp(-bit / _QUICK)
    sigma_range, sigma_rate = (scale * x for x in loops.sigmas(correlator, cn0[0]))
    place = ranges[0] + sigma_range * rng.standard_normal(shape[1:])
    speed = rates[0] + sigma_rate * rng.standard_normal(shape[1:])
    growth = (rates[2] - rates[0]) / bit
    speed = speed + 0.5 * bit * growth
    measured, quick, missing = cn0[0].copy(), cn0[0].copy(), np.zeros(shape[1:])
    settling = np.full(shape[1:], loops.settle)
    locked = np.ones(shape[1:], dtype=bool)
    out = Tracked(*(np.empty(cn0.shape, dtype=d) for d in (float, float, float, bool, bool)))
    strong = cn0 >= ratio_from_dbhz(loops.acquire_dbhz)
    for k in range(len(cn0)):
        e = place + 0.5 * bit * speed - ranges[2 * k + 1]
        o = ts.bit_outputs(correlator, loops.kind, cn0[k], e, speed - rates[2 * k + 1], rng, scale=scale)
        seen = ts.measured_cn0(o.power, bit)
        measured, quick = memory * measured + (1.0 - memory) * seen, short * quick + (1.0 - short) * seen
        # variance of one bit's power: 4 A^2 + 4; an exponential mean holds 2 tau / T of them
        spread = np.sqrt((8.0 * bit * np.maximum(measured, 0.0) + 4.0) * 0.5 * bit / _QUICK) / (2.0 * bit)
        measured = np.where(np.abs(quick - measured) > _JUMP * spread, quick, measured)
        level = np.maximum(measured, least)
        code = np.clip(ts.code_error(correlator, loops.kind, o.code, level), -0.5 * s.chip, 0.5 * s.chip)
        rate = np.clip(ts.rate_error(correlator, o.cross, level), -most_rate, most_rate)
        place = place + bit * speed - np.where(locked, 4.0 * loops.code_bandwidth * bit * code, 0.0)
        growth = np.where(locked, growth - bit * omega**2 * rate, 0.0)
        speed = speed + bit * growth - np.where(locked, bit * _DAMPING * omega * rate, 0.0)
        settling = settling + bit
        lost = locked & (measured < 2.0 * least) & (settling > loops.window)
        missing = np.where(locked | ~strong[k], 0.0, missing + bit)
        again = missing >= loops.acquire
        locked = (locked & ~lost) | again
        if again.any():
            place = np.where(again, ranges[2 * k + 2] + loops.acquired_range * rng.standard_normal(shape[1:]), place)
            speed = np.where(again, rates[2 * k + 2] + loops.acquired_rate * rng.standard_normal(shape[1:]), speed)
            settling = np.where(again, 0.0, settling)
            measured, quick = np.where(again, cn0[k], measured), np.where(again, cn0[k], quick)
        out.range_error[k] = place - ranges[2 * k + 2]
        out.rate_error[k] = speed - 0.5 * bit * growth - rates[2 * k + 2]  # the replica's rate is that of mid-bit
        out.cn0[k], out.locked[k], out.usable[k] = (
            np.maximum(measured, least),
            locked,
            locked & (settling >= loops.settle),
        )
    return out
