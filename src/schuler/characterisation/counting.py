"""Whether readings are counts of pulses: the lattice on which their sum lies, and the rate at which it was read."""

from __future__ import annotations

from dataclasses import dataclass
from math import gcd

import numpy as np

from schuler.arrays import ArrayLike, BoolArray, FloatArray, IntArray
from schuler.characterisation.findings import Finding
from schuler.characterisation.readings import resolution

_LONGEST_CYCLE = 12  # samples after which samples and readings meet again, at most
_MOST_READS = 3  # readings per sample, at most
_AGREE = 0.95  # share of the cycles with a pulse that must be as the lattice says: counters slip now and then
_FEWEST = 50  # cycles with a pulse
_CYCLES = 20000  # looked at
_CHANGES = (0, 1, -1, 2, -2)  # pulses from one reading to the next, beside the steady ones


@dataclass(frozen=True, slots=True)
class Lattice:
    """Lattice of the integral of a signal.

    Attributes
    ----------
    quantum : float
        A pulse. [x*s]
    read_rate_hz : float
        Rate at which the counter was read; samples lie on lines between its readings. [Hz]
    """

    quantum: float
    read_rate_hz: float


def pulse_lattice(x: ArrayLike, rate_hz: float) -> Lattice | None:
    """Lattice on which the sum of the samples lies, or None.

    Parameters
    ----------
    x : array_like, shape (n,)
        Rate-like signal without gaps. [x]
    rate_hz : float
        Sampling rate. [Hz]

    Returns
    -------
    Lattice or None
        None if readings show no resolution. Where no lattice coarser than the resolution is seen, the lattice is that
        of the resolution itself, read at every sample; whether the sum keeps to it is for the Allan variance to say.

    Notes
    -----
    A counter read r times in P samples and interpolated: every P-th sample falls on a reading, so the sum over P
    samples from there is a whole number of pulses. P is the one that gives the largest pulse, the smallest if several
    do. Samples between lie on the
    line between two readings at known fractions; r is the smallest number for which whole readings can be found in
    nearly all cycles, neighbours sharing theirs.
    """
    x = np.asarray(x, dtype=np.float64)
    step = resolution(x)
    if step is None:
        return None
    number = x / step
    c = np.round(number).astype(np.int64)
    if np.quantile(np.abs(number - c), 0.99) > 0.1:
        c = np.round((x - np.median(x)) / step).astype(np.int64)
    V = np.concatenate(([0], np.cumsum(c)))
    best, read_rate_hz = 1, rate_hz
    for P in range(2, _LONGEST_CYCLE + 1):
        for first in range(P):
            U = V[first : first + (len(V) - 1 - first) // P * P + 1]
            pulse = _pulse(np.diff(U[::P]))
            if pulse > best and (reads := _reads(U, P, pulse)):
                best, read_rate_hz = pulse, reads / P * rate_hz
    return Lattice(best * step / rate_hz, read_rate_hz)


def _pulse(sums: IntArray) -> int:
    """Step between the sums over cycles, 1 if there is none."""
    if not len(sums):
        return 1
    sums = sums[: 8 * _CYCLES]
    value, count = np.unique(sums, return_counts=True)
    away = np.abs(value - value[np.argmax(count)])
    if count[away > 0].sum() < _FEWEST:
        return 1
    pulse = int(away[away > 0][np.argmax(count[away > 0])])
    on = count[(away > 0) & (away % pulse == 0)].sum() / count[away > 0].sum()
    return pulse if on >= _AGREE else 1


def _reads(U: IntArray, P: int, pulse: int) -> int:
    """Smallest number of readings in P samples that explains them, 0 if none does."""
    cycles = U[:-1].reshape(-1, P)[:_CYCLES]
    last = U[P::P][: len(cycles)]
    u = np.concatenate((cycles - cycles[:, :1], (last - cycles[:, 0])[:, None]), axis=1)
    for r in range(1, _MOST_READS * P + 1):
        if gcd(r, P) == 1:
            steady = round(float(np.median(u[:, -1])) / (pulse * r))
            change = u / pulse - steady * r / P * np.arange(P + 1)
            busy = (np.abs(change) > 1e-6).any(axis=1)
            if busy.sum() >= _FEWEST and np.mean(_explained(change[busy], P, r)) >= _AGREE:
                return r
    return 0


def _explained(change: FloatArray, P: int, r: int) -> BoolArray:
    """Whether whole readings can be found whose interpolation is the cycle's. [pulse], shape (k, P + 1)"""
    try_ = np.array(_CHANGES, dtype=np.float64)
    before = np.zeros((len(change), 1))
    after = before  # the reading at the start, as if of an interval that ends there
    possible = np.ones((len(change), 1), dtype=bool)
    place = -1
    for j in range(1, P):
        i, part = j * r // P, (j * r % P) / P
        low = change[:, j, None] - part * try_
        high = low + try_
        fits = np.abs(low - np.round(low)) < 1e-6
        for_each = np.ones((len(change), before.shape[1], len(try_)), dtype=bool)
        if i == place:
            for_each &= np.abs(low[:, None, :] - before[:, :, None]) < 1e-6
            for_each &= np.abs(high[:, None, :] - after[:, :, None]) < 1e-6
        elif i == place + 1:
            for_each &= np.abs(low[:, None, :] - after[:, :, None]) < 1e-6
        possible = fits & (for_each & possible[:, :, None]).any(axis=1)
        before, after, place = low, high, i
    whole = np.abs(change[:, -1] - np.round(change[:, -1])) < 1e-6
    if place == r - 1:
        possible &= np.abs(after - change[:, -1, None]) < 1e-6
    return np.asarray(whole & possible.any(axis=1))


def counted(axis: str, lattice: Lattice, rate_hz: float, unit: str) -> Finding:
    """That the readings are counts of pulses, and what that means."""
    reading = (
        "once a sample"
        if abs(lattice.read_rate_hz / rate_hz - 1.0) < 1e-6
        else f"at {lattice.read_rate_hz:.5g} Hz and interpolated to {rate_hz:.5g} Hz"
    )
    text = (
        f"{axis}: the readings count pulses of {lattice.quantum:.3g} {unit}*s, read {reading}: the integral is right "
        "to half a pulse, but a sample shows the pulses and not the sensor's noise; the model counts as the sensor "
        "does, and only what it has at averaging times of many pulses is noise of the sensor"
    )
    return Finding("counted", text, severity="note")
