"""Noise terms fitted to Allan variances: generalised method of wavelet moments, weighted fit, choice of the model.

The moments are the Allan variances at averaging times of 1, 2, 4, ... samples (twice the Haar wavelet variances). Their
logarithms are fitted, since a chi-square with few degrees of freedom is nearly Gaussian in its logarithm: with ``nu``
the degrees of freedom and ``psi`` the digamma function ::

    E[ln AVAR_hat] = ln AVAR + psi(nu / 2) - ln(nu / 2),     Var[ln AVAR_hat] = psi'(nu / 2)

Weights are the inverse of the covariance of these logarithms under the model itself (:mod:`.moments`), found by
repeating the fit; the covariance of the parameters is what follows from it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from math import factorial
from typing import Any, Literal

import numpy as np

from schuler.arrays import FloatArray, IntArray
from schuler.characterisation import moments
from schuler.characterisation.moments import Moments
from schuler.exceptions import InputError, SchulerError

Weights = Literal["full", "diagonal"]

_FLICKER = 2.0 * np.log(2.0) / np.pi
_POWER: dict[str, Callable[[FloatArray], FloatArray]] = {
    "Q": lambda tau: 3.0 / tau**2,
    "N": lambda tau: 1.0 / tau,
    "B": lambda tau: _FLICKER + 0.0 * tau,
    "K": lambda tau: tau / 3.0,
    "R": lambda tau: 0.5 * tau**2,
}
#: Of the Gauss-Markov process in the ratio of averaging and correlation time, from the tenth power down to the first.
_SERIES = tuple((-1) ** k * (4 - 2**k) / factorial(k) for k in range(12, 2, -1))
_ORDER = ("Q", "N", "F", "B", "K", "R", "GM")
_ROUNDS = 3  # weights are taken from the model of the round before; nothing moves any more after two


class NoFitError(SchulerError):
    """A model has a term that the data do not show."""


@dataclass(frozen=True)
class Fit:
    """A model fitted to moments.

    Attributes
    ----------
    names : tuple of str
        Parameters: Q, N, tau_N (with F), B, K, R, sigma_1, tau_1, ...
    values : ndarray, shape (p,)
        SI.
    covariance : ndarray, shape (p, p)
        Covariance of the logarithms of the values.
    misfit : float
        Weighted sum of squares.
    freedom : int
        Moments less parameters.
    """

    names: tuple[str, ...]
    values: FloatArray
    covariance: FloatArray
    misfit: float
    freedom: int

    @property
    def terms(self) -> tuple[str, ...]:
        """Terms as they are asked for: ``("N", "K", "GM")``."""
        return tuple({"sig": "GM", "tau": "F"}.get(n[:3], n) for n in self.names if n == "tau_N" or n[:3] != "tau")

    @property
    def sigma(self) -> FloatArray:
        """1-sigma uncertainty of the logarithms."""
        spread: FloatArray = np.sqrt(np.diag(self.covariance))
        return spread


def parse_terms(text: str) -> tuple[str, ...]:
    """Terms of a model written as ``"N + K + 2 GM"``; F is a filter of the sensor that takes N off the first times.

    Raises
    ------
    InputError
        If a term is unknown or, but for GM, given twice.
    """
    terms: list[str] = []
    for part in text.replace(" ", "").split("+"):
        count, name = (int(part[0]), part[1:]) if part[:1].isdigit() else (1, part)
        if name not in _ORDER or count < 1 or (name != "GM" and (count > 1 or name in terms)):
            raise InputError(
                f"models: expected terms out of {', '.join(_ORDER)} joined by +, such as 'N + K + 2GM'; got {text!r}"
            )
        terms += [name] * count
    if "F" in terms and "N" not in terms:
        raise InputError(f"models: F is the sensor's filter on its white noise N, which is not in {text!r}")
    return tuple(sorted(terms, key=_ORDER.index))


def parameter_names(terms: tuple[str, ...]) -> tuple[str, ...]:
    """Parameters of a model, in the order of its covariance."""
    names: list[str] = []
    for term in terms:
        if term == "GM":
            k = 1 + sum(n.startswith("sigma") for n in names)
            names += [f"sigma_{k}", f"tau_{k}"]
        elif term == "F":
            names.append("tau_N")
        else:
            names.append(term)
    return tuple(names)


def allan_variance(names: tuple[str, ...], values: FloatArray, m: IntArray, dt: float) -> tuple[FloatArray, FloatArray]:
    """Allan variance of a model [x^2], shape (k,), and its derivative by the logarithms of the parameters (k, p)."""
    tau = np.asarray(m * dt, dtype=np.float64)
    total: FloatArray = np.zeros(len(m))
    J = np.zeros((len(m), len(names)))
    for i, name in enumerate(names):
        v = values[i]
        if name.startswith("tau"):
            continue
        if name.startswith("sigma") or (name == "N" and "tau_N" in names):
            k = i + 1
            h = 1e-4
            part, later, sooner = _markov_parts(name, float(v), float(values[k]) * np.exp([0.0, h, -h]), m, dt)
            J[:, k] = (later - sooner) / (2.0 * h)
        else:
            part = v**2 * _POWER[name](tau)
        J[:, i] = 2.0 * part
        total += part
    return total, J


def _markov_parts(name: str, value: float, times: FloatArray, m: IntArray, dt: float) -> FloatArray:
    """Allan variance of a Gauss-Markov process, or of filtered white noise, of each correlation time (t, k). [x^2]"""
    sigmas = np.array([filtered_sigma(value, float(time), dt) if name == "N" else value for time in times])
    return np.asarray(sigmas[:, None] ** 2 * sampled_gauss_markov(m, dt / times[:, None]))


def filtered_sigma(N: float, time: float, dt: float) -> float:
    """Standard deviation of samples of white noise N after a first-order filter of time constant ``time`` [s]. [x]"""
    e = np.exp(-dt / time)
    return float(N * np.sqrt((1.0 - e) / (dt * (1.0 + e))))


def sampled_gauss_markov(m: IntArray, step: float | FloatArray) -> FloatArray:
    """Allan variance of a Gauss-Markov process of unit variance, sampled every ``step`` of its correlation time.

    ``[m (1 - e^2) - 3 e + 4 e^(m+1) - e^(2m+1)] / (m (1 - e))^2``, ``e = exp(-step)``. For small steps it is the
    formula of the continuous process, but for the first few m, where point samples have more variance than means (22 %
    more deviation at m = 1).

    Parameters
    ----------
    m : ndarray of int, shape (k,)
        Averaging times in samples.
    step : float or ndarray, shape (t, 1)
        One step, or one for each row of what is returned: close together, the first chooses the formula of all.
    """
    x = m * step
    if np.ravel(step)[0] > 1e-3:
        e = np.exp(-step)
        numerator = m * (1.0 - e * e) - 3.0 * e + 4.0 * e * np.exp(-x) - e * np.exp(-2.0 * x)
        return np.asarray(numerator / np.square(m * (1.0 - e)))
    small, series = np.minimum(x, 0.1), np.zeros_like(x)
    for coefficient in _SERIES:
        series = (series + coefficient) * small
    large = np.maximum(x, 0.1)
    u = -np.expm1(-large)
    # the first samples of a continuous path: exact at m = 1, where the series has 2/3 of it
    point = np.where(x < 0.1, step / (3.0 * m), 0.0)
    return np.asarray(np.where(x < 0.1, series, (2.0 * large - 2.0 * u - u * u) / large**2) + point)


def spectrum(names: tuple[str, ...], values: FloatArray, dt: float, f: FloatArray) -> FloatArray:
    """Two-sided density of a model as sampled at ``dt``; a ramp has none. [x^2/Hz]"""
    w2 = np.square(2.0 * np.sin(np.pi * f * dt) / dt)  # (2 pi f)^2 of sums and differences of samples
    S = np.zeros_like(f)
    for i, name in enumerate(names):
        v = values[i]
        if name == "Q":
            S = S + v**2 * dt * w2
        elif name == "N" and "tau_N" in names:
            e = np.exp(-dt / values[i + 1])
            S = S + v**2 / (1.0 + w2 * dt**2 * e / (1.0 - e) ** 2)
        elif name == "N":
            S = S + v**2
        elif name == "B":
            S = S + v**2 / (2.0 * np.pi * f)
        elif name == "K":
            S = S + v**2 / w2
        elif name.startswith("sigma"):
            e = np.exp(-dt / values[i + 1])
            S = S + v**2 * dt * (1.0 + e) / (1.0 - e) / (1.0 + w2 * dt**2 * e / (1.0 - e) ** 2)
    return S


def fit(
    data: Moments, terms: tuple[str, ...], weights: Weights = "full", model_error: float = 0.0, start: Fit | None = None
) -> Fit:
    """Fit a model to Allan variances.

    Parameters
    ----------
    data : Moments
    terms : tuple of str
        From :func:`parse_terms`.
    weights : {"full", "diagonal"}
        Inverse of the whole covariance of the moments, or of its diagonal only; the covariance of the parameters counts
        the correlations in both cases.
    model_error : float
        Relative 1-sigma amount by which a real sensor departs from any sum of terms at each averaging time, in
        variance; independent between them.
    start : Fit, optional
        A fit whose terms are among these, to start from.

    Returns
    -------
    Fit

    Raises
    ------
    NoFitError
        If a parameter runs away: these data do not have that term.
    """
    names = parameter_names(terms)
    if len(data.m) < len(names):
        raise NoFitError(f"{len(names)} parameters cannot be fitted to {len(data.m)} averaging times")
    duration = float(data.lengths.sum() * data.dt)
    rough = []
    for guess in _guesses(data, names, start):
        theta = np.log(guess)
        low, high = theta - 23.0, theta + 14.0
        for i, name in enumerate(names):
            if name.startswith("tau"):
                # faster than the shortest averaging time is white
                fastest = data.m[0] if data.m[0] > 1 else 0.2
                low[i], high[i] = np.log(fastest * data.dt), np.log(10.0 * duration)
                theta[i] = np.clip(theta[i], low[i] + 1e-3, high[i] - 1e-3)
        # degrees of freedom as for white noise are near enough to find the neighbourhood
        s = np.sqrt(2.0 * data.m / np.maximum(data.lengths.sum() - 2.0 * data.m, 1.0) + model_error**2 + 1e-4)
        near, cost = _solve(data, names, theta, (low, high), np.diag(1.0 / s), np.log(data.variance))
        rough.append((cost, near, low, high))
    rough.sort(key=lambda r: r[0])
    trials = []
    for _, near, low, high in rough[:2]:
        solution = _refined(data, names, near, (low, high), weights, model_error, duration, rounds=1)
        if solution is not None:
            trials.append((solution, low, high))
    if trials:
        once, low, high = min(trials, key=lambda t: t[0].misfit)
        solution = _refined(data, names, np.log(once.values), (low, high), weights, model_error, duration, _ROUNDS - 1)
        if solution is not None:
            return _ordered(solution)
    raise NoFitError(f"no fit of {' + '.join(terms)}: the curve does not show one of these terms")


def _refined(
    data: Moments,
    names: tuple[str, ...],
    theta: FloatArray,
    bounds: tuple[FloatArray, FloatArray],
    weights: Weights,
    model_error: float,
    duration: float,
    rounds: int,
) -> Fit | None:
    """Fit with the weights that its own result implies; None if a parameter runs to its bound."""
    from scipy.special import digamma, polygamma

    for _ in range(rounds):
        psd = partial(spectrum, names, np.exp(theta), data.dt)
        edf = moments.degrees_of_freedom(data.m, data.lengths, data.dt, psd)
        target = np.log(data.variance) - digamma(0.5 * edf) + np.log(0.5 * edf)
        s = np.sqrt(polygamma(1, 0.5 * edf))
        V = moments.correlation(data.m, data.dt, duration, psd) * np.outer(s, s)
        V[np.diag_indices(len(s))] += model_error**2 + 1e-9 * s**2
        white = np.linalg.inv(np.linalg.cholesky(V)) if weights == "full" else np.diag(1.0 / np.sqrt(np.diag(V)))
        theta, cost = _solve(data, names, theta, bounds, white, target)
        if np.any(theta - bounds[0] < 1e-6) or np.any(bounds[1] - theta < 1e-6):
            return None
    v, J = allan_variance(names, np.exp(theta), data.m, data.dt)
    J = white @ (J / v[:, None])
    try:
        inverse = np.linalg.inv(J.T @ J)
    except np.linalg.LinAlgError:
        return None
    if weights == "diagonal":
        inverse = inverse @ J.T @ (white @ V @ white.T) @ J @ inverse
    if not np.all(np.diag(inverse) > 0.0):
        return None
    return Fit(names, np.exp(theta), np.asarray(inverse, dtype=np.float64), 2.0 * cost, len(data.m) - len(names))


def _solve(
    data: Moments,
    names: tuple[str, ...],
    theta: FloatArray,
    bounds: tuple[FloatArray, FloatArray],
    white: FloatArray,
    target: FloatArray,
) -> tuple[FloatArray, float]:
    """Least squares in the logarithms of the parameters: where, and half the sum of squares."""
    from scipy.optimize import leastsq

    # MINPACK asks for residuals and derivatives in turn at the same place
    last: list[Any] = [None, None, None]

    def both(p: FloatArray) -> tuple[FloatArray, FloatArray]:
        if last[0] is None or not np.array_equal(p, last[0]):
            inside = np.clip(p, *bounds)
            v, J = allan_variance(names, np.exp(inside), data.m, data.dt)
            last[:] = p.copy(), white @ (np.log(v) - target), white @ (J / v[:, None])
        return last[1], last[2]

    solution, _, info, _, _ = leastsq(
        lambda p: both(p)[0], theta, Dfun=lambda p: both(p)[1], full_output=True, ftol=1e-7, xtol=1e-6, maxfev=60
    )
    return np.clip(solution, *bounds), 0.5 * float(np.sum(np.square(info["fvec"])))


def _guesses(data: Moments, names: tuple[str, ...], start: Fit | None) -> list[FloatArray]:
    """Starting values: for each term as much as the curve allows, Gauss-Markov times spread over the curve."""
    tau, v = data.tau, data.variance
    upper = {
        "Q": np.min(v * tau**2 / 3.0), "N": np.min(v * tau), "B": np.min(v / _FLICKER), "K": np.min(3.0 * v / tau),
        "R": np.min(2.0 * v / tau**2),
    }  # fmt: skip
    n_gm = sum(n.startswith("sigma") for n in names)
    start_values = {} if start is None else dict(zip(start.names, start.values, strict=True))
    places = [()] if n_gm == 0 else _places(tau, n_gm)
    guesses = []
    for times in places:
        values = []
        for name in names:
            if name.startswith("sigma"):
                peak = times[int(name[6:]) - 1] * 1.89
                values.append(max(float(np.sqrt(np.interp(np.log(peak), np.log(tau), v))) / 0.62, 1e-300) * 0.7)
            elif name == "tau_N":
                values.append(data.dt)
            elif name.startswith("tau"):
                values.append(times[int(name[4:]) - 1])
            else:
                values.append(start_values.get(name, float(np.sqrt(0.7 * upper[name]))))
        guesses.append(np.array(values))
    return guesses


def _places(tau: FloatArray, n: int) -> list[tuple[float, ...]]:
    """Correlation times to start from."""
    inside = np.geomspace(8.0 * tau[0], tau[-1], 5)
    if n == 1:
        return [(float(t),) for t in inside[1:]]
    return [
        tuple(float(t) for t in np.geomspace(a, b, n))
        for a, b in ((inside[1], inside[3]), (inside[2], inside[4]), (inside[0], inside[4]))
    ]


def _ordered(solution: Fit) -> Fit:
    """The same fit with its Gauss-Markov terms by increasing correlation time."""
    first = next((i for i, n in enumerate(solution.names) if n.startswith("sigma")), None)
    if first is None:
        return solution
    pairs = np.arange(first, len(solution.names)).reshape(-1, 2)
    order = np.concatenate((np.arange(first), pairs[np.argsort(solution.values[pairs[:, 1]])].ravel()))
    return Fit(
        solution.names,
        solution.values[order],
        solution.covariance[np.ix_(order, order)],
        solution.misfit,
        solution.freedom,
    )
