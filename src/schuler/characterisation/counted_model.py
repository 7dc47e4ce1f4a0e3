"""The noise behind counted pulses: the Allan curve that the counter makes of it, fitted to the measured one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from math import inf

import numpy as np

from schuler.arrays import FloatArray, IntArray
from schuler.characterisation.counting import Lattice
from schuler.characterisation.curve import AllanCurve
from schuler.sensors.noise import Counted, GaussMarkov, NoiseModel, RandomWalk, ShotNoise, White, terms_of
from schuler.sensors.noise.counted import second_differences

_POINTS = 40  # averaging times fitted
_FLOOR = 0.004  # relative deviation to which a fit is held: no log is stationary to better
_BOUNDED = 256  # samples over which the sum is to stay within a pulse, or counting does not matter
_PRIOR = 0.05  # pull of each logarithm towards its start, for those that the curve does not tell
_GOOD, _PASSES = 0.8, 1.5  # root mean square misfits: with which no term is added, and beyond which there is no model
_MOST_SHOTS = 2
_STARTS = 2  # of the best on the grid
_FEWEST_SHOTS = 50  # in a record: of fewer, chance decides what the record looks like


@dataclass(frozen=True)
class _Setting:
    """What a trial is compared with. Times in readings, integrals in pulses."""

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
        Of the log.
    lattice : Lattice
    mean : float
        Of the log. [x]
    dt : float
        Sampling interval. [s]
    samples : int
        Of the log.

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
    best = _improved(setting, weights, [np.concatenate((start, v)) for v in _vibrations()])
    for _ in range(_MOST_SHOTS):
        if best[1] < _GOOD:
            break
        more = [np.concatenate((best[0], s)) for s in _shots()]
        # with shots in the model, the vibration that seemed the best without them may not be
        other = [np.concatenate((best[0][:4], v, s)) for v in _vibrations() for s in _shots()[::7]]
        best = min((best, _improved(setting, weights, more), _improved(setting, weights, other)), key=lambda b: b[1])
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
    own = weight @ model.mean_square(lag) * (model.quantum / tau) ** 2 / 2.0
    rest = sum((t.allan_variance(tau) for t in terms_of(model.inner) if not isinstance(t, White)), np.zeros(len(tau)))
    return 0.5 * np.log(np.maximum(own + rest, 1e-300))


def _misfit(setting: _Setting, weights: tuple[IntArray, FloatArray], parameters: FloatArray) -> FloatArray:
    model = _model(setting, parameters)
    return (_deviation(setting, weights, model) - setting.target) / setting.tolerance


def _improved(
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

        found = least_squares(residual, first, max_nfev=60, x_scale=1.0)
        rms = float(np.sqrt(np.mean(_misfit(setting, weights, found.x) ** 2)))
        if best is None or rms < best[1]:
            best = found.x, rms
    assert best is not None
    return best


def _simplest(setting: _Setting, weights: tuple[IntArray, FloatArray], parameters: FloatArray) -> Counted:
    """The model without terms that make no difference to the curve."""
    model = _model(setting, parameters)
    whole = _deviation(setting, weights, model)
    for part in ("inner", "jitter"):
        for term in terms_of(getattr(model, part)):
            less = NoiseModel(tuple(t for t in terms_of(getattr(model, part)) if t is not term))
            trial = Counted(
                less if part == "inner" else model.inner,
                less if part == "jitter" else model.jitter,
                model.quantum, model.mean, model.read_rate_hz, span=model.span,
            )  # fmt: skip
            change = (_deviation(setting, weights, trial) - whole) / setting.tolerance
            if np.abs(change).max() < 0.1:
                model = trial
    return model
