"""Gyroscope parameters from the turns between poses: integrated rates carry one measured vertical to the next."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from schuler.arrays import FloatArray, IntArray
from schuler.calibration.freepose.accel import AccelFit
from schuler.calibration.freepose.bias import TurnBias
from schuler.calibration.freepose.rests import Rests
from schuler.calibration.freepose.turns import (
    COARSE,
    Turns,
    direction_noise,
    residual_map,
    tangents,
    vertical_residuals,
)
from schuler.calibration.freepose.weights import (
    excess_spread,
    outlier_weights,
    propagated,
    pseudo_inverse,
    residual_factor,
    solve_weighted,
    too_many_outliers,
)


@dataclass(frozen=True, eq=False)
class GyroFit:
    """Gyroscopes from turns.

    Attributes
    ----------
    M, b, G : ndarray, shape (3, 3), (3,), (3, 3)
        Errors of the input times nominal. [-], [rad/s], [(rad/s)/(m/s^2)]
    columns : slice tuple
        Places of M, b and G among the estimated parameters; b and G may be empty.
    residual : ndarray, shape (n, 3)
        Predicted less measured vertical of each turn. [rad]
    sigma : ndarray, shape (n,)
        1-sigma of a component of it by noise alone. [rad]
    spread : float
        Scatter of the turns beyond noise, 1-sigma per component. [rad]
    rest_spread : float
        Scatter of the rates at rest beyond noise, if they were used. [rad/s]
    weight : ndarray, shape (n,)
        1 or less for outliers.
    chi2, freedom : float, int
        By noise alone; degrees of freedom.
    normal : ndarray, shape (p, p)
        J^T W J.
    covariance, cross : ndarray, shape (p, p), (p, 9)
        Covariance of the estimated parameters, and with those of the accelerometers.
    bias_covariance : ndarray, shape (3, 3)
    bias_cross : ndarray, shape (p, 3)
        Covariance of the estimated parameters with a bias that was measured at rest.
    history : ndarray, shape (k, p)
    """

    M: FloatArray
    b: FloatArray
    G: FloatArray
    columns: tuple[slice, slice, slice]
    residual: FloatArray
    sigma: FloatArray
    spread: float
    rest_spread: float
    weight: FloatArray
    chi2: float
    freedom: int
    normal: FloatArray
    covariance: FloatArray
    cross: FloatArray
    bias_covariance: FloatArray
    bias_cross: FloatArray
    history: FloatArray


def fit_gyroscopes(
    turns: Turns,
    rests: Rests,
    accel: AccelFit,
    sigma_f: FloatArray,
    nominal: float,
    bias: FloatArray,
    bias_sigma: FloatArray,
    *,
    estimate_bias: bool,
    g_sensitivity: bool,
    robust: bool,
    M: FloatArray,
    near: bool = False,
    rest_covariance: FloatArray | None = None,
    wander: float = 0.0,
    turn_bias: TurnBias | None = None,
) -> GyroFit:
    """Gauss-Newton on the verticals that the turns predict.

    Parameters
    ----------
    turns : Turns
    rests : Rests
        Poses; their rates are used with ``g_sensitivity``.
    accel : AccelFit
    sigma_f : ndarray, shape (K, 3)
        1-sigma of the pose means, spread included. [m/s^2]
    nominal : float
        [rad/s per unit of the log]
    bias, bias_sigma : ndarray, shape (3,)
        Measured at rest. [rad/s]
    estimate_bias, g_sensitivity, robust : bool
    M : ndarray, shape (3, 3)
        Start of the response.
    near : bool
        The start is good to a few sigma: no coarse fit before, and steps end at a hundredth of a sigma.
    rest_covariance : ndarray, shape (3, K, K), optional
        Covariance of the rates at rest of each axis, scatter between rests included, for ``g_sensitivity``. None: noise
        alone. [(rad/s)^2]
    wander : float
        How much the bias in a turn differs from that of the log, 1 sigma: its scatter between rests. [rad/s]
    turn_bias : TurnBias, optional
        Of the turns, where the bias of all rests is held: stands for ``bias_sigma`` and ``wander``.

    Returns
    -------
    GyroFit
        Weights are the inverse of the covariance of the residuals: noise of both poses (a pose is the end of one turn
        and the start of the next), the accelerometer parameters from the same means, gyroscope noise ``N^2 T``, the
        bias measured at rest, and the scatter beyond noise, see
        :func:`~schuler.calibration.freepose.weights.excess_spread`.

    References
    ----------
    Tedaldi, Pretto, Menegatti (2014), eq. (13); Fong, Ong, Nee (2008). Departures: exact steps instead of
    Runge-Kutta, analytic derivatives, weights and covariance. White noise N is taken alike on the three axes (their
    root mean square), and the Earth's rotation is part of the scatter beyond noise.
    """
    start = _start(turns, rests, nominal, bias, M, estimate_bias, g_sensitivity)
    parameters, history = (start, [start.vector]) if near else _coarse_fit(turns, nominal, start)
    n = len(turns.spans)
    tangent = tangents(turns.up[turns.pair[:, 1]])
    up_noise, to_accel = direction_noise(turns, accel, sigma_f)
    held_bias = None if start.estimates_bias else (turn_bias or _constant_bias(bias_sigma, n))
    wander = wander if turn_bias is None or start.estimates_bias else 0.0
    weight, spread, hat = np.ones(n), 0.0, np.zeros(n)
    rates: _RestRates | None = None
    for k in range(15):
        at = _linearised(parameters, turns, tangent, nominal)
        if k < 3 or k == 14:
            to_residual = residual_map(turns, tangent, at.C, up_noise)
            noise = _turn_noise(
                to_residual, sigma_f, at.by_bias, held_bias, parameters.M, nominal * rests.density_g, at.seconds, wander
            )
        if k > 0:
            spread, weight = _scatter_and_weights(at.r, hat, noise.sigma, robust)
        own = _own_variance(noise, spread, weight)
        if g_sensitivity:
            rates = _rest_rates(parameters, turns.f, rests, nominal, rest_covariance, robust)
        step = _gauss_newton_step(at.J[:, start.estimated], at.r, noise.common, own, rates)
        hat = step.leverage
        parameters = parameters.moved(step.dx)
        history.append(parameters.vector)
        if not np.isfinite(step.dx).all() or np.linalg.det(np.eye(3) + parameters.M) < 1e-3:
            parameters = replace(parameters, M=history[-2][:9].reshape(3, 3))
            break
        if k >= 2 and step.length < 1e-4 if near else k >= 3 and float(np.abs(step.dx[:9]).max()) < 1e-9:
            break
    if too_many_outliers(weight):
        return fit_gyroscopes(
            turns, rests, accel, sigma_f, nominal, bias, bias_sigma, estimate_bias=estimate_bias,
            g_sensitivity=g_sensitivity, robust=False, M=parameters.M, rest_covariance=rest_covariance,
            wander=wander, turn_bias=turn_bias,
        )  # fmt: skip
    covariance, cross, bias_cross = _gyro_covariance(
        step, to_residual, sigma_f.ravel() ** 2, own, to_accel, at.by_bias, held_bias, rates
    )
    end = _linearised(parameters, turns, tangent, nominal)
    chi2 = float(end.r @ solve_weighted(noise.common, np.repeat(noise.gyro, 2), end.r[:, None])[:, 0])
    freedom = 2 * n - len(start.estimated)
    if rates is not None:
        q, sigma = parameters.rest_residual(turns.f, nominal * rests.gyro), _rest_sigma(rests, nominal)
        chi2, freedom = chi2 + float((q**2 / sigma**2).sum()), freedom + q.size
    return GyroFit(
        parameters.M, parameters.b, parameters.G, parameters.columns, end.residual, noise.sigma, spread,
        0.0 if rates is None else rates.spread, weight, chi2, freedom, step.N, covariance, cross,
        np.diag(bias_sigma**2), bias_cross, np.array(history),
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class _GyroParameters:
    """M, b and G of ``omega = (I + M)^-1 (nominal y - b - G f)``, and which of them are estimated."""

    M: FloatArray
    b: FloatArray
    G: FloatArray
    estimates_bias: bool
    g_sensitivity: bool

    @property
    def columns(self) -> tuple[slice, slice, slice]:
        """Places of M, b and G among the estimated parameters."""
        return slice(0, 9), slice(9, 12 if self.estimates_bias else 9), slice(12, 21 if self.g_sensitivity else 12)

    @property
    def estimated(self) -> IntArray:
        """Places of the estimated parameters among all 21."""
        places: IntArray = np.r_[0:9, 9 : (12 if self.estimates_bias else 9), 12 : (21 if self.g_sensitivity else 12)]
        return places

    @property
    def vector(self) -> FloatArray:
        """Estimated parameters."""
        return np.asarray(np.concatenate((self.M.ravel(), self.b, self.G.ravel()))[self.estimated])

    def moved(self, dx: FloatArray) -> _GyroParameters:
        """Parameters changed by a step of the estimated ones."""
        return replace(
            self,
            M=self.M + dx[:9].reshape(3, 3),
            b=self.b + dx[9:12] if self.estimates_bias else self.b,
            G=self.G + dx[12:].reshape(3, 3) if self.g_sensitivity else self.G,
        )

    def residuals(
        self, turns: Turns, nominal: float, stride: int
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Residuals of the predicted verticals, see :func:`schuler.calibration.freepose.turns.vertical_residuals`."""
        return vertical_residuals(turns, nominal, self.M, self.b, self.G if self.g_sensitivity else None, stride)

    def rest_residual(self, f: FloatArray, omega: FloatArray) -> FloatArray:
        """Rates at rest less ``b + G f``. Shape (K, 3). [rad/s]"""
        return np.asarray(omega - self.b - f @ self.G.T)


def _start(
    turns: Turns,
    rests: Rests,
    nominal: float,
    bias: FloatArray,
    M: FloatArray,
    estimate_bias: bool,
    g_sensitivity: bool,
) -> _GyroParameters:
    """Parameters to begin with; b and G from the rates at rest by least squares, where G is estimated."""
    start = _GyroParameters(np.array(M), bias.copy(), np.zeros((3, 3)), estimate_bias or g_sensitivity, g_sensitivity)
    if not g_sensitivity:
        return start
    rows = np.column_stack((np.ones(len(turns.f)), turns.f))
    x = np.linalg.lstsq(rows, nominal * rests.gyro, rcond=None)[0]
    return replace(start, b=np.array(x[0], dtype=np.float64), G=np.array(x[1:].T, dtype=np.float64))


class _Linearised(NamedTuple):
    """Predicted less measured verticals of n turns and their derivatives.

    ``residual`` (n, 3) in the axes of the unit, ``r`` (2 n,) along the tangents [rad]; ``J`` (2 n, 12 or 21) by M, b
    and G; ``C`` (n, 3, 3) the turns; ``seconds`` (n,) how long they took.
    """

    residual: FloatArray
    r: FloatArray
    J: FloatArray
    C: FloatArray
    seconds: FloatArray

    @property
    def by_bias(self) -> FloatArray:
        """Derivatives by the bias. Shape (2 n, 3). [s]"""
        return self.J[:, 9:12]


def _linearised(parameters: _GyroParameters, turns: Turns, tangent: FloatArray, nominal: float) -> _Linearised:
    """Residuals of the verticals about parameters."""
    residual, J, C, seconds = parameters.residuals(turns, nominal, 1)
    r = np.einsum("kia,ki->ka", tangent, residual).ravel()
    J_t = np.einsum("kia,kip->kap", tangent, J).reshape(len(r), -1)[:, : 21 if parameters.g_sensitivity else 12]
    return _Linearised(residual, r, J_t, C, seconds)


def _scatter_and_weights(
    r: FloatArray, leverage: FloatArray, sigma: FloatArray, robust: bool
) -> tuple[float, FloatArray]:
    """Scatter beyond noise [rad] and weights of the turns from the sizes of their residuals."""
    size = np.linalg.norm(r.reshape(-1, 2), axis=1) / residual_factor(leverage)
    spread = excess_spread(size, sigma, 2, robust)
    return spread, outlier_weights(size / np.sqrt(sigma**2 + spread**2), 2) if robust else np.ones(len(size))


def _own_variance(noise: _TurnNoise, spread: float, weight: FloatArray) -> FloatArray:
    """Variance of a component that a turn shares with no other; a small weight is more of it. Shape (2 n,). [rad^2]"""
    return np.repeat((noise.gyro + spread**2) / weight + (1.0 / weight - 1.0) * (noise.sigma**2 - noise.gyro), 2)


class _Step(NamedTuple):
    """Step of Gauss and Newton.

    ``dx`` (p,) the step, ``N`` (p, p) the normal matrix and its ``inverse``, ``gain`` (p, 2 n) the step by residuals
    of turns, ``leverage`` (n,) of the turns.
    """

    dx: FloatArray
    N: FloatArray
    inverse: FloatArray
    gain: FloatArray
    leverage: FloatArray

    @property
    def length(self) -> float:
        """Square of the step in sigmas."""
        return float(self.dx @ self.N @ self.dx)


def _gauss_newton_step(
    A: FloatArray, r: FloatArray, common: FloatArray, own: FloatArray, rates: _RestRates | None
) -> _Step:
    """Step ``-N^-1 g`` of residuals r (2 n,) of turns, of covariance ``common + diag(own)``, and of rates at rest."""
    WA = solve_weighted(common, own, np.column_stack((A, r)))
    N, g = A.T @ WA[:, :-1], A.T @ WA[:, -1]
    if rates is not None:
        N, g = N + rates.D.T @ rates.WD, g + rates.WD.T @ rates.residual.T.ravel()
    inverse = pseudo_inverse(N)
    leverage = 0.5 * ((A @ inverse) * WA[:, :-1]).sum(axis=1).reshape(-1, 2).sum(axis=1)
    return _Step(-inverse @ g, N, inverse, -inverse @ WA[:, :-1].T, leverage)


def _coarse_fit(turns: Turns, nominal: float, start: _GyroParameters) -> tuple[_GyroParameters, list[FloatArray]]:
    """Response matrix by damped least squares (Levenberg, Marquardt), turns weighted alike, in coarse steps."""
    parameters, damping = start, 1e-3
    r, J, _, _ = parameters.residuals(turns, nominal, COARSE)
    cost = float((r * r).sum())
    history = [parameters.vector]
    for _ in range(30):
        A = J[:, :, :9].reshape(-1, 9)
        N = A.T @ A
        dM = np.linalg.solve(N + damping * np.diag(np.diag(N) + 1e-9), -A.T @ r.ravel())
        trial, cost_new = replace(parameters, M=parameters.M + dM.reshape(3, 3)), np.inf
        if np.linalg.det(np.eye(3) + trial.M) > 1e-3:
            r_new, J_new, _, _ = trial.residuals(turns, nominal, COARSE)
            cost_new = float((r_new * r_new).sum())
        if cost_new < cost:
            converged = cost_new > cost * (1.0 - 1e-3)
            parameters, r, J, cost, damping = trial, r_new, J_new, cost_new, 0.1 * damping
            history.append(parameters.vector)
            if converged:
                break
        else:
            damping = 10.0 * damping
            if damping > 1e6:
                break
    return parameters, history


class _TurnNoise(NamedTuple):
    """Noise of the tangential residuals of n turns.

    ``common`` (2 n, 2 n): covariance by pose means and held bias; ``gyro`` (n,): variance of a component by the noise
    of the gyroscopes in the turn; ``sigma`` (n,): 1-sigma of a component by both. [rad]
    """

    common: FloatArray
    gyro: FloatArray
    sigma: FloatArray


def _turn_noise(
    to_residual: FloatArray,
    sigma_f: FloatArray,
    by_bias: FloatArray,
    held_bias: TurnBias | None,
    M: FloatArray,
    density: FloatArray,
    seconds: FloatArray,
    wander: float,
) -> _TurnNoise:
    """Noise of the residuals: pose means, a bias measured at rest, and of each turn ``N^2 T`` and that of its bias."""
    common = propagated(to_residual, sigma_f.ravel() ** 2)
    if held_bias is not None:
        common = common + held_bias.in_residuals(by_bias)
    # the density is that of the readings; calibrated rates have it divided by the response
    Q = np.linalg.inv(np.eye(3) + M)
    gyro = float(np.mean(Q**2 @ density**2)) * seconds + (wander * seconds) ** 2
    return _TurnNoise(common, gyro, np.sqrt(0.5 * np.diag(common).reshape(-1, 2).sum(axis=1) + gyro))


def _constant_bias(sigma: FloatArray, n: int) -> TurnBias:
    """A bias that is the same in all n turns, measured with an error of ``sigma`` (3,)."""
    return TurnBias(np.broadcast_to((sigma**2)[:, None, None], (3, n, n)), np.broadcast_to(sigma**2, (n, 3)))


class _RestRates(NamedTuple):
    """Rates at rest as observations of b and G, axis by axis: residual (K, 3), design D and ``V^-1 D`` (3 K, p)."""

    residual: FloatArray
    D: FloatArray
    WD: FloatArray
    spread: float


def _rest_rates(
    parameters: _GyroParameters,
    f: FloatArray,
    rests: Rests,
    nominal: float,
    covariance: FloatArray | None,
    robust: bool,
) -> _RestRates:
    """Observations ``rate at rest = b + G f`` with their covariance, more of it for outliers."""
    sigma = _rest_sigma(rests, nominal)
    q = parameters.rest_residual(f, nominal * rests.gyro)
    V = np.stack([np.diag(sigma[:, i] ** 2) for i in range(3)]) if covariance is None else covariance.copy()
    variance = np.einsum("ijj->ji", V)
    spread = float(np.sqrt(max(0.0, float(np.mean(variance - sigma**2)))))
    if robust:
        weight = outlier_weights(np.abs(q) / np.sqrt(variance), 1)
        if not too_many_outliers(weight):
            k = np.arange(len(q))
            V[:, k, k] += (variance * (1.0 / weight - 1.0)).T
    D = _rest_rows(f, len(parameters.estimated)).reshape(len(q), 3, -1).transpose(1, 0, 2)
    return _RestRates(q, D.reshape(q.size, -1), np.asarray(np.linalg.solve(V, D).reshape(q.size, -1)), spread)


def _rest_sigma(rests: Rests, nominal: float) -> FloatArray:
    """1-sigma noise of the mean rates at rest. Shape (K, 3). [rad/s]"""
    return np.asarray((nominal * rests.density_g) / np.sqrt(rests.duration)[:, None])


def _gyro_covariance(
    step: _Step,
    to_residual: FloatArray,
    variance: FloatArray,
    own: FloatArray,
    to_accel: FloatArray,
    by_bias: FloatArray,
    held_bias: TurnBias | None,
    rates: _RestRates | None,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Covariance of the estimated parameters, cross-covariance with accelerometers (p, 9) and held bias (p, 3)."""
    gain = step.gain
    from_poses = gain @ to_residual
    covariance = (from_poses * variance) @ from_poses.T + (gain * own) @ gain.T
    cross = (from_poses * variance) @ to_accel.T
    bias_cross = np.zeros((len(gain), 3))
    if held_bias is not None:
        covariance += gain @ held_bias.in_residuals(by_bias) @ gain.T
        bias_cross = gain @ (by_bias * np.repeat(held_bias.cross, 2, axis=0))
    if rates is not None:
        covariance += step.inverse @ (rates.D.T @ rates.WD) @ step.inverse
    return 0.5 * (covariance + covariance.T), cross, bias_cross


def rescaled(fit: GyroFit, ratio: float) -> GyroFit:
    """The same fit for a nominal factor that is ``ratio`` times as large."""
    identity = np.eye(3)
    return replace(
        fit, M=ratio * (identity + fit.M) - identity, b=ratio * fit.b, G=ratio * fit.G,
        covariance=ratio**2 * fit.covariance, cross=ratio * fit.cross, normal=fit.normal / ratio**2,
        bias_covariance=ratio**2 * fit.bias_covariance, bias_cross=ratio**2 * fit.bias_cross,
        rest_spread=ratio * fit.rest_spread,
    )  # fmt: skip


def _rest_rows(f: FloatArray, count: int) -> FloatArray:
    """Derivatives of ``rate at rest - b - G f`` by (M, b, G). Shape (3 K, count)."""
    n = len(f)
    D = np.zeros((n, 3, count))
    for i in range(3):
        D[:, i, 9 + i] = -1.0
        D[:, i, 12 + 3 * i : 15 + 3 * i] = -f
    return D.reshape(3 * n, count)
