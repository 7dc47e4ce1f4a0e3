"""Whether readings are counts of pulses: the lattice on which their sum lies, and the rate at which it was read."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from math import gcd, inf

import numpy as np

from schuler.arrays import ArrayLike, BoolArray, FloatArray, IntArray
from schuler.characterisation.allan import AllanCurve
from schuler.characterisation.readings import resolution
from schuler.characterisation.result import Finding
from schuler.sensors.noise import Counted, GaussMarkov, NoiseModel, RandomWalk, ShotNoise, White, terms_of
from schuler.sensors.noise.counted import second_differences

_LONGEST_CYCLE = 12  # samples after which samples and readings meet again, at most
_MOST_READS = 3  # readings per sample, at most
_AGREE = 0.95  # share of the cycles with a pulse that must be as the lattice says: counters slip now and then
_FEWEST = 50  # cycles with a pulse
_CYCLES = 20000  # looked at
_CHANGES = (0, 1, -1, 2, -2)  # pulses from one reading to the next, beside the steady ones
_POINTS = 40  # averaging times fitted
_FLOOR = 0.004  # relative deviation to which a fit is held: no log is stationary to better
_BOUNDED = 256  # samples over which the sum is to stay within a pulse, or counting does not matter
_PRIOR = 0.05  # pull of each logarithm towards its start, for those that the curve does not tell
_GOOD, _PASSES = 0.8, 1.5  # root mean square misfits: with which no term is added, and beyond which there is no model
_MOST_SHOTS = 2
_STARTS = 2  # of the best on the grid
_FEWEST_SHOTS = 50  # in a record: of fewer, chance decides what the record looks like


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
    reference = np.abs(change[:, -1] - np.round(change[:, -1])) < 1e-6
    if place == r - 1:
        possible &= np.abs(after - change[:, -1, None]) < 1e-6
    return np.asarray(reference & possible.any(axis=1))


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


@dataclass(frozen=True)
class _Setting:
    """Measured curve that trials are compared with. Times in readings, integrals in pulses."""

    lattice: Lattice
    mean: float
    span: float
    m: IntArray
    dt: float
    target: FloatArray
    tolerance: FloatArray


def counted_model(curve: AllanCurve, lattice: Lattice, mean: float, dt: float, samples: int) -> Counted | None:
    """Counted noise whose Allan curve is that of a log.

    Parameters
    ----------
    curve : AllanCurve
        Curve of the log.
    lattice : Lattice
    mean : float
        Mean of the log. [x]
    dt : float
        Sampling interval. [s]
    samples : int
        Number of samples of the log.

    Returns
    -------
    Counted or None
        None if the sum of the samples does not keep to the lattice (pulses that noise hides need no model of their
        own), or nothing fits.

    Notes
    -----
    The closed form of :class:`Counted` is fitted to the logarithms of the Allan deviations, by least squares over the
    logarithms of the parameters: inner noise ``N + K + GM``, and as jitter a steady Gaussian vibration, then one kind
    of shots, then a second, until the curve is met. Each new term starts from the best point of a coarse grid. Terms
    without which the curve is met as well are left out.

    Many parameters for one curve: jitter is there to make the counter turn to and fro as it does in the log, and its
    numbers are not known one by one.
    """
    q = lattice.quantum
    m = np.round(curve.tau / dt).astype(np.int64)
    keep = np.unique(np.searchsorted(m, np.geomspace(1, m[-1], _POINTS)).clip(0, len(m) - 1))
    at = int(np.argmin(np.abs(m - _BOUNDED)))
    if m[-1] < 4 * _BOUNDED or curve.deviation[at] * m[at] * dt > q:
        return None
    m = m[keep]
    tolerance = np.sqrt(_FLOOR**2 + 0.2 * m / samples)
    setting = _Setting(lattice, mean, samples * dt, m, dt, np.log(curve.deviation[keep]), tolerance)
    weights = second_differences(m, lattice.read_rate_hz * dt)
    long = float(curve.deviation[-1]) * dt * 1e-1 / q
    start = np.log([1e-3, max(long * 1e-2, 1e-9), max(long, 1e-8), 0.02 * samples])
    best = _best_fit(setting, weights, [np.concatenate((start, v)) for v in _vibrations()])
    for _ in range(_MOST_SHOTS):
        if best[1] < _GOOD:
            break
        more = [np.concatenate((best[0], s)) for s in _shots()]
        # with shots in the model, the vibration that seemed the best without them may not be
        other = [np.concatenate((best[0][:4], v, s)) for v in _vibrations() for s in _shots()[::7]]
        best = min((best, _best_fit(setting, weights, more), _best_fit(setting, weights, other)), key=lambda b: b[1])
    if best[1] > _PASSES:
        return None
    return _simplest(setting, weights, best[0])


def _vibrations() -> list[FloatArray]:
    """Deviation [pulse], frequency [cycles per reading], decay [readings] of steady jitter, and no number of shots."""
    grid = product((0.03, 0.08, 0.15), (1e-3, 0.1, 0.2, 0.3, 0.35, 0.45), (2.0, 8.0))
    return [np.log((*point, 1e6)) for point in grid]


def _shots() -> list[FloatArray]:
    """The same of shots, with their number in the record."""
    grid = product((0.03, 0.1), (0.003, 0.01, 0.018, 0.03, 0.06), (15.0, 60.0), (50.0, 300.0))
    return [np.log(point) for point in grid]


def _model(setting: _Setting, parameters: FloatArray) -> Counted:
    """The process of logarithms: N, K, sigma_b, tau_b in pulses and readings, then four of each term of the jitter."""
    q, rate = setting.lattice.quantum, setting.lattice.read_rate_hz
    p = np.exp(np.clip(parameters, -60.0, 30.0))
    inner = (
        White(p[0] * q * np.sqrt(rate)),
        RandomWalk(p[1] * q * rate**1.5),
        GaussMarkov(p[2] * q * rate, p[3] / rate),
    )
    jitter = tuple(
        ShotNoise(
            s * q, min(f, 0.5) * rate, d / rate, inf if number >= 1e5 else max(number, _FEWEST_SHOTS) / setting.span
        )
        for s, f, d, number in p[4:].reshape(-1, 4)
    )
    return Counted(NoiseModel(inner), NoiseModel(jitter), q, setting.mean, rate, span=setting.span)


def _deviation(setting: _Setting, weights: tuple[IntArray, FloatArray], model: Counted) -> FloatArray:
    """Logarithm of its Allan deviation."""
    lag, weight = weights
    tau = setting.m * setting.dt
    counter = weight @ model.mean_square(lag) * (model.quantum / tau) ** 2 / 2.0
    other_terms = sum(
        (t.allan_variance(tau) for t in terms_of(model.inner) if not isinstance(t, White)), np.zeros(len(tau))
    )
    return 0.5 * np.log(np.maximum(counter + other_terms, 1e-300))


def _misfit(setting: _Setting, weights: tuple[IntArray, FloatArray], parameters: FloatArray) -> FloatArray:
    model = _model(setting, parameters)
    return (_deviation(setting, weights, model) - setting.target) / setting.tolerance


def _best_fit(
    setting: _Setting,
    weights: tuple[IntArray, FloatArray],
    trials: Sequence[FloatArray],
) -> tuple[FloatArray, float]:
    """The best of the parameters that the best of the trials lead to, and its root mean square misfit."""
    from scipy.optimize import least_squares

    cost = [float(np.sum(np.minimum(_misfit(setting, weights, t) ** 2, 1e4))) for t in trials]
    best: tuple[FloatArray, float] | None = None
    for k in np.argsort(cost, kind="stable")[:_STARTS]:
        first = trials[k]
        pull = np.full(len(first), _PRIOR)
        pull[7::4] = 0.5  # a curve tells the number of shots badly

        def residual(p: FloatArray, first: FloatArray = first, pull: FloatArray = pull) -> FloatArray:
            return np.concatenate((_misfit(setting, weights, p), pull * (p - first)))

        solution = least_squares(residual, first, max_nfev=60, x_scale=1.0)
        rms = float(np.sqrt(np.mean(_misfit(setting, weights, solution.x) ** 2)))
        if best is None or rms < best[1]:
            best = solution.x, rms
    assert best is not None
    return best


def _simplest(setting: _Setting, weights: tuple[IntArray, FloatArray], parameters: FloatArray) -> Counted:
    """The model without terms that make no difference to the curve."""
    model = _model(setting, parameters)
    reference = _deviation(setting, weights, model)
    for part in ("inner", "jitter"):
        for term in terms_of(getattr(model, part)):
            reduced = NoiseModel(tuple(t for t in terms_of(getattr(model, part)) if t is not term))
            trial = Counted(
                reduced if part == "inner" else model.inner,
                reduced if part == "jitter" else model.jitter,
                model.quantum, model.mean, model.read_rate_hz, span=model.span,
            )  # fmt: skip
            change = (_deviation(setting, weights, trial) - reference) / setting.tolerance
            if np.abs(change).max() < 0.1:
                model = trial
    return model
