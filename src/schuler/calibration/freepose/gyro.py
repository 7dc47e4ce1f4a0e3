"""Gyroscope parameters from the turns between poses: integrated, they must carry one measured vertical to the next."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from schuler.arrays import FloatArray
from schuler.calibration.freepose.accel import UPPER_COLUMN, UPPER_ROW, AccelFit
from schuler.calibration.freepose.rests import Rests
from schuler.calibration.freepose.turns import COARSE, Turns, predicted, tangents
from schuler.calibration.freepose.weights import downweighted, freed, pseudo_inverse, spread_beyond, too_many
from schuler.exceptions import InputError


@dataclass(frozen=True, eq=False)
class GyroFit:
    """Gyroscopes from turns.

    Attributes
    ----------
    M, b, G : ndarray, shape (3, 3), (3,), (3, 3)
        Of the input times nominal. [-], [rad/s], [(rad/s)/(m/s^2)]
    columns : slice tuple
        Where M, b and G are among the estimated parameters; b and G may be empty.
    residual : ndarray, shape (n, 3)
        Predicted less measured vertical of each turn. [rad]
    sigma : ndarray, shape (n,)
        Its 1 sigma per component by noise alone. [rad]
    spread : float
        What turns scatter beyond noise, 1 sigma per component. [rad]
    rest_spread : float
        The same of the rates at rest, if they were used. [rad/s]
    weight : ndarray, shape (n,)
        1 or less for outliers.
    chi2, freedom : float, int
        By noise alone.
    normal : ndarray, shape (p, p)
        J^T W J.
    covariance, cross : ndarray, shape (p, p), (p, 9)
        Of the estimated parameters, and with those of the accelerometers.
    bias_covariance : ndarray, shape (3, 3)
    bias_cross : ndarray, shape (p, 3)
        Of the estimated parameters with a bias that was measured at rest.
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
) -> GyroFit:
    """Gauss-Newton on the verticals that the turns predict.

    Parameters
    ----------
    turns : Turns
    rests : Rests
        For the rates at rest, used with ``g_sensitivity``.
    accel : AccelFit
    sigma_f : ndarray, shape (K, 3)
        1-sigma of the pose means, spread included. [m/s^2]
    nominal : float
        [rad/s per unit of the log]
    bias, bias_sigma : ndarray, shape (3,)
        Measured at rest. [rad/s]
    estimate_bias, g_sensitivity, robust : bool
    M : ndarray, shape (3, 3)
        Start.

    Returns
    -------
    GyroFit
        Weights are the inverse of the covariance of the residuals: noise of both poses (a pose is the end of one turn
        and the start of the next), the accelerometer parameters found from the same means, gyroscope noise
        ``N^2 T``, the bias measured at rest, and what is beyond noise, see
        :func:`~schuler.calibration.freepose.weights.spread_beyond`.

    References
    ----------
    Tedaldi, Pretto, Menegatti (2014), eq. (13); Fong, Ong, Nee (2008). Departures: exact steps instead of
    Runge-Kutta, analytic derivatives, weights and covariance. White noise N is taken alike on the three axes (their
    root mean square), and the Earth's rotation is part of what is not explained.
    """
    G: FloatArray = np.zeros((3, 3))
    b: FloatArray = bias.copy()
    free_bias = estimate_bias or g_sensitivity
    slices = (slice(0, 9), slice(9, 12 if free_bias else 9), slice(12, 21 if g_sensitivity else 12))
    used = np.r_[0:9, 9 : (12 if free_bias else 9), 12 : (21 if g_sensitivity else 12)]
    count, n = len(used), len(turns.spans)
    omega_rest = nominal * rests.gyro
    rest_noise = (nominal * rests.density_g) / np.sqrt(rests.duration)[:, None]
    if g_sensitivity:
        rows = np.column_stack((np.ones(len(turns.f)), turns.f))
        x = np.linalg.lstsq(rows, omega_rest, rcond=None)[0]
        b, G = np.array(x[0], dtype=np.float64), np.array(x[1:].T, dtype=np.float64)
    M = np.array(M)

    def step(dx: FloatArray) -> None:
        nonlocal M, b, G
        M = M + dx[:9].reshape(3, 3)
        if free_bias:
            b = b + dx[9:12]
        if g_sensitivity:
            G = G + dx[12:].reshape(3, 3)

    def evaluate(stride: int) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        return predicted(turns, nominal, M, b, G if g_sensitivity else None, stride)

    # 1. From afar: turns alike, damped, in coarse steps, matrix only.
    damping = 1e-3
    r, J, _, _ = evaluate(COARSE)
    cost = float((r * r).sum())
    history = [np.concatenate((M.ravel(), b, G.ravel()))[used]]
    for _ in range(30):
        A = J[:, :, :9].reshape(-1, 9)
        N = A.T @ A
        dx = np.zeros(count)
        dx[:9] = np.linalg.solve(N + damping * np.diag(np.diag(N) + 1e-9), -A.T @ r.ravel())
        kept = M
        M = M + dx[:9].reshape(3, 3)
        if np.linalg.det(np.eye(3) + M) > 1e-3:
            r_new, J_new, _, _ = evaluate(COARSE)
            cost_new = float((r_new * r_new).sum())
        else:
            cost_new = np.inf
        if cost_new < cost:
            done = cost_new > cost * (1.0 - 1e-3)
            r, J, cost, damping = r_new, J_new, cost_new, 0.1 * damping
            history.append(np.concatenate((M.ravel(), b, G.ravel()))[used])
            if done:
                break
        else:
            M, damping = kept, 10.0 * damping
            if damping > 1e6:
                break

    # 2. Sample by sample, with the covariance of the residuals.
    weight, spread, rest_spread = np.ones(n), 0.0, 0.0
    swallowed = np.zeros(n)
    up_noise, to_accel = direction_noise(turns, accel, sigma_f)
    for k in range(15):
        r, J, C, seconds = evaluate(1)
        E = tangents(turns.up[turns.pair[:, 1]])
        r2 = np.einsum("kia,ki->ka", E, r).ravel()
        J2 = np.einsum("kia,kip->kap", E, J).reshape(2 * n, -1)[:, : 21 if g_sensitivity else 12]
        if k < 3 or k == 14:
            S = _residual_map(turns, E, C, up_noise)
            V_a = _spread_of(S, sigma_f.ravel() ** 2)
            if not free_bias:  # its error is that of all turns
                V_a = V_a + (J2[:, 9:12] * bias_sigma**2) @ J2[:, 9:12].T
            # noise is that of what is read; the calibrated rate has it divided by the response
            Q = np.linalg.inv(np.eye(3) + M)
            gyro_var = float(np.mean(Q**2 @ (nominal * rests.density_g) ** 2)) * seconds
            own = np.repeat(gyro_var, 2)
            sigma = np.sqrt(0.5 * np.diag(V_a).reshape(n, 2).sum(axis=1) + gyro_var)
        size = np.linalg.norm(r2.reshape(n, 2), axis=1)
        if k > 0:
            size = size / freed(swallowed)
            spread = spread_beyond(size, sigma, 2, robust)
            if robust:
                weight = downweighted(size / np.sqrt(sigma**2 + spread**2), 2)
            own = np.repeat((gyro_var + spread**2) / weight + (1.0 / weight - 1.0) * (sigma**2 - gyro_var), 2)
        A = J2[:, used]
        WA = _weighted(V_a, own, np.column_stack((A, r2)))
        N, g = A.T @ WA[:, :-1], A.T @ WA[:, -1]
        if g_sensitivity:
            q = omega_rest - b - turns.f @ G.T
            e = q.ravel() / np.sqrt(1.0 - 12.0 / q.size)
            rest_spread = spread_beyond(e, rest_noise.ravel(), 1, robust)
            rest_var = rest_noise**2 + rest_spread**2
            rest_weight = downweighted(np.abs(q) / np.sqrt(rest_var), 1) if robust else np.ones_like(q)
            D = _rest_rows(turns.f, count)
            wq = (rest_weight / rest_var).ravel()
            N, g = N + D.T @ (wq[:, None] * D), g + D.T @ (wq * q.ravel())
        inverse = pseudo_inverse(N)
        swallowed = 0.5 * ((A @ inverse) * WA[:, :-1]).sum(axis=1).reshape(n, 2).sum(axis=1)
        dx = -inverse @ g
        step(dx)
        history.append(np.concatenate((M.ravel(), b, G.ravel()))[used])
        if not np.isfinite(dx).all() or np.linalg.det(np.eye(3) + M) < 1e-3:
            M = history[-2][:9].reshape(3, 3)
            break
        if k >= 3 and float(np.abs(dx[:9]).max()) < 1e-9:
            break
    if too_many(weight):
        return fit_gyroscopes(
            turns, rests, accel, sigma_f, nominal, bias, bias_sigma, estimate_bias=estimate_bias,
            g_sensitivity=g_sensitivity, robust=False, M=M,
        )  # fmt: skip
    r, J, C, seconds = evaluate(1)
    r2 = np.einsum("kia,ki->ka", E, r).ravel()
    K = -inverse @ WA[:, :-1].T
    chi2 = float(r2 @ _weighted(V_a, np.repeat(gyro_var, 2), r2[:, None])[:, 0])
    freedom = 2 * n - count
    from_poses = K @ S
    var = sigma_f.ravel() ** 2
    covariance = (from_poses * var) @ from_poses.T + (K * own) @ K.T
    cross = (from_poses * var) @ to_accel.T
    bias_covariance, bias_cross = np.diag(bias_sigma**2), np.zeros((count, 3))
    if not free_bias:
        KJ = K @ J2[:, 9:12]
        covariance += (KJ * bias_sigma**2) @ KJ.T
        bias_cross = KJ * bias_sigma**2
    if g_sensitivity:
        L = inverse @ (D.T * wq)
        covariance += (L * rest_var.ravel()) @ L.T
        q = omega_rest - b - turns.f @ G.T
        chi2 += float((q**2 / rest_noise**2).sum())
        freedom += q.size
    return GyroFit(
        M, b, G, slices, r, sigma, spread, rest_spread, weight, chi2, freedom, N, 0.5 * (covariance + covariance.T),
        cross, bias_covariance, bias_cross, np.array(history),
    )  # fmt: skip


def rescaled(fit: GyroFit, ratio: float) -> GyroFit:
    """The same fit for a nominal factor that is ``ratio`` times as large."""
    identity = np.eye(3)
    return replace(
        fit, M=ratio * (identity + fit.M) - identity, b=ratio * fit.b, G=ratio * fit.G,
        covariance=ratio**2 * fit.covariance, cross=ratio * fit.cross, normal=fit.normal / ratio**2,
        bias_covariance=ratio**2 * fit.bias_covariance, bias_cross=ratio**2 * fit.bias_cross,
        rest_spread=ratio * fit.rest_spread,
    )  # fmt: skip


def direction_noise(turns: Turns, accel: AccelFit, sigma_f: FloatArray) -> tuple[FloatArray, FloatArray]:
    """How the noise of all pose means moves the vertical of each pose, and the accelerometer parameters.

    Returns
    -------
    ndarray, shape (K, 3, 3 K)
        d up_k / d mean_j; through the pose itself and through the parameters.
    ndarray, shape (9, 3 K)
        d p / d mean_j.
    """
    n = len(turns.up)
    B = np.linalg.inv(accel.R)
    size = np.linalg.norm(turns.f, axis=1)
    w = turns.up @ B
    to_p = np.zeros((9, n, 3))
    L = -pseudo_inverse(accel.normal) @ accel.inverse_weighted
    to_p[:] = L[:, :, None] * w[None, :, :]
    across = (np.eye(3) - turns.up[:, :, None] * turns.up[:, None, :]) @ B / size[:, None, None]
    by_p = np.empty((n, 3, 9))
    by_p[:, :, :3] = -across
    by_p[:, :, 3:] = -across[:, :, UPPER_ROW] * turns.f[:, None, UPPER_COLUMN]
    out = by_p @ to_p.reshape(9, 3 * n)
    k = np.arange(n)
    out.reshape(n, 3, n, 3)[k, :, k, :] += across
    return out, to_p.reshape(9, 3 * n)


def _residual_map(turns: Turns, E: FloatArray, C: FloatArray, up_noise: FloatArray) -> FloatArray:
    """How the noise of all pose means moves the tangent residuals ``E^T (C^T up_start - up_end)``. Shape (2 n, 3 K)."""
    i, j = turns.pair.T
    moved = np.einsum("kba,kbm->kam", C, up_noise[i]) - up_noise[j]
    return np.asarray(np.einsum("kia,kim->kam", E, moved).reshape(2 * len(E), -1))


def _rest_rows(f: FloatArray, count: int) -> FloatArray:
    """Derivatives of ``rate at rest - b - G f`` by (M, b, G). Shape (3 K, count)."""
    n = len(f)
    D = np.zeros((n, 3, count))
    for i in range(3):
        D[:, i, 9 + i] = -1.0
        D[:, i, 12 + 3 * i : 15 + 3 * i] = -f
    return D.reshape(3 * n, count)


def _spread_of(S: FloatArray, variance: FloatArray) -> FloatArray:
    """Covariance ``S diag(variance) S^T``."""
    from schuler.calibration.freepose import _kernels as kernels

    V = np.empty((len(S), len(S)))
    kernels.weighted_square(np.ascontiguousarray(S), variance, V)
    return V


def _weighted(V: FloatArray, own: FloatArray, X: FloatArray) -> FloatArray:
    """``(V + diag(own))^-1 X``."""
    from schuler.calibration.freepose import _kernels as kernels

    X = np.array(X, order="C")
    total = V + np.diag(own)
    if not kernels.solve_positive(total, X):
        raise InputError(
            "imu: the covariance of the turns is singular; the log has no noise at all in some pose, give noise="
        )
    return X
