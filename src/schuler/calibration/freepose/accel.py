"""Nine accelerometer parameters from poses of unknown direction: the calibrated magnitude is gravity."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schuler.arrays import BoolArray, FloatArray
from schuler.calibration.freepose.weights import excess_spread, outlier_weights, residual_factor, too_many_outliers

#: Estimated elements of M_a, upper triangular: body z is the z accelerometer.
UPPER = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
NAMES = ("b_a_x", "b_a_y", "b_a_z", "M_a_xx", "M_a_xy", "M_a_xz", "M_a_yy", "M_a_yz", "M_a_zz")
UPPER_ROW, UPPER_COLUMN = np.array([e[0] for e in UPPER]), np.array([e[1] for e in UPPER])


@dataclass(frozen=True, eq=False)
class AccelFit:
    """Accelerometers from poses.

    Attributes
    ----------
    p : ndarray, shape (9,)
        In the order of :data:`NAMES`.
    residual, sigma : ndarray, shape (n,)
        Calibrated magnitude less gravity, and its 1-sigma by noise alone. [m/s^2]
    J : ndarray, shape (n, 9)
        Derivatives of the residuals.
    weight : ndarray, shape (n,)
        1 or less for outliers.
    spread : float
        Scatter of the poses beyond noise, 1-sigma. [m/s^2]
    history : ndarray, shape (k, 9)
    converged : bool
    """

    p: FloatArray
    residual: FloatArray
    sigma: FloatArray
    J: FloatArray
    weight: FloatArray
    spread: float
    history: FloatArray
    converged: bool

    @property
    def R(self) -> FloatArray:
        """I + M_a."""
        return response(self.p)

    @property
    def inverse_weighted(self) -> FloatArray:
        """Rows weighted for the normal equations: J^T W, shape (9, n)."""
        return self.J.T * (self.weight / (self.sigma**2 + self.spread**2))

    @property
    def normal(self) -> FloatArray:
        """J^T W J."""
        return np.asarray(self.inverse_weighted @ self.J)

    @property
    def log_determinant(self) -> float:
        """Logarithm of the determinant of the covariance; infinite if it is singular."""
        d = np.sqrt(np.diag(self.normal))
        if not (np.isfinite(d).all() and (d > 0.0).all()):
            return float("inf")
        sign, value = np.linalg.slogdet(self.normal / np.outer(d, d))
        return float("inf") if sign <= 0 else float(-value - 2.0 * np.log(d).sum())


def response(p: FloatArray) -> FloatArray:
    """I + M_a of nine parameters."""
    R = np.eye(3)
    R[UPPER_ROW, UPPER_COLUMN] += p[3:]
    return R


def magnitude_residuals(p: FloatArray, y: FloatArray, gravity: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Calibrated magnitude less gravity, with its derivatives.

    Parameters
    ----------
    p : ndarray, shape (9,)
    y : ndarray, shape (n, 3)
        Measured means. [m/s^2]
    gravity : float
        [m/s^2]

    Returns
    -------
    r : ndarray, shape (n,)
        [m/s^2]
    J : ndarray, shape (n, 9)
        Derivatives by the parameters, ``-w`` and ``-w_i f_j`` with ``f = R^-1 (y - b)``, ``w = R^-T f/|f|``.
    w : ndarray, shape (n, 3)
        Derivatives by the measured means.
    """
    B = np.linalg.inv(response(p))
    f = (y - p[:3]) @ B.T
    size = np.sqrt((f * f).sum(axis=1))
    w = (f / size[:, None]) @ B
    J = np.empty((len(y), 9))
    J[:, :3] = -w
    J[:, 3:] = -w[:, UPPER_ROW] * f[:, UPPER_COLUMN]
    return size - gravity, J, w


def ellipsoid_start(y: FloatArray, gravity: float) -> FloatArray | None:
    """Nine parameters from the ellipsoid through the means, linear least squares; None if they lie on none.

    ``y^T Q y + 2 q^T y = 1`` about the centre of the data, then ``Q ~ R^-T R^-1`` with R upper triangular.

    References
    ----------
    The common linear fit to an ellipsoid; it weights large radii too much and only serves as a start.
    """
    centre = 0.5 * (y.max(axis=0) + y.min(axis=0))
    scale = max(float(np.abs(y - centre).max()), 1e-300)
    x = (y - centre) / scale
    D = np.stack(
        (x[:, 0] ** 2, x[:, 1] ** 2, x[:, 2] ** 2, 2 * x[:, 0] * x[:, 1], 2 * x[:, 0] * x[:, 2], 2 * x[:, 1] * x[:, 2],
         2 * x[:, 0], 2 * x[:, 1], 2 * x[:, 2]), axis=1,
    )  # fmt: skip
    a, _, rank, _ = np.linalg.lstsq(D, np.ones(len(x)), rcond=1e-10)
    if rank < 9:
        return None
    Q = np.array([[a[0], a[3], a[4]], [a[3], a[1], a[5]], [a[4], a[5], a[2]]])
    values = np.linalg.eigvalsh(Q)
    if values.min() <= 1e-4 * values.max():
        return None
    c = -np.linalg.solve(Q, a[6:])
    Q = Q / (1.0 + c @ Q @ c) / scale**2 * gravity**2
    # Q = B^T B with B upper triangular and positive diagonal
    B = np.linalg.cholesky(Q).T
    R = np.linalg.inv(B)
    return np.concatenate((centre + scale * c, (R - np.eye(3))[UPPER_ROW, UPPER_COLUMN]))


def sphere_start(y: FloatArray, gravity: float) -> FloatArray:
    """Bias and one common scale by linear least squares, for a small or badly spread set of poses."""
    centre = y.mean(axis=0)
    x = y - centre
    D = np.column_stack((2.0 * x, np.ones(len(x))))
    a = np.linalg.lstsq(D, (x * x).sum(axis=1), rcond=1e-6)[0]
    radius = np.sqrt(max(a[3] + a[:3] @ a[:3], 1e-30))
    p = np.zeros(9)
    p[:3] = centre + a[:3]
    p[[3, 6, 8]] = radius / gravity - 1.0
    return p


def accel_start(y: FloatArray, gravity: float, factor: float | None) -> tuple[float, FloatArray | None]:
    """Factor of the accelerometers, estimated unless stated, and nine parameters to start from, or None."""
    if factor is not None:
        p = ellipsoid_start(factor * y, gravity)
        return factor, sphere_start(factor * y, gravity) if p is None else p
    p = ellipsoid_start(y, gravity)
    if p is None:
        p = sphere_start(y, gravity)
    det = np.linalg.det(response(p))
    if not det > 0.0:
        return 1.0, None
    gain = float(np.cbrt(det))
    # a log in m/s^2 keeps the factor 1; counts, or g, get the estimated one
    factor = 1.0 if 0.8 < gain < 1.25 else float(f"{1.0 / gain:.4g}")
    p = p.copy()
    p[3:] = (factor * response(p) - np.eye(3))[np.triu_indices(3)]
    p[:3] *= factor
    return factor, p


def fit_accelerometers(
    y: FloatArray,
    sigma: FloatArray,
    gravity: float,
    *,
    robust: bool,
    start: FloatArray,
    near: bool = False,
    iterations: int = 40,
) -> AccelFit:
    """Fit nine parameters by Gauss-Newton on the magnitude, weighted with the noise of the means.

    Parameters
    ----------
    y, sigma : ndarray, shape (n, 3)
        Measured means and their 1-sigma noise. [m/s^2]
    gravity : float
        [m/s^2]
    robust : bool
    start : ndarray, shape (9,)
    near : bool
        The start is good to a few sigma: weights are taken from the first step on.
    iterations : int
        At most.

    Returns
    -------
    AccelFit
        Outliers are judged by residuals over ``sqrt(1 - leverage)``: a pose that stands alone in its direction pulls
        the fit towards itself. If residuals are larger than noise explains, beyond chance, each pose gets the common
        ``spread`` on top of its noise; poses then count nearly alike, which is right for what makes them
        scatter (nonlinearity, temperature, a table that gives way).

    References
    ----------
    Tedaldi, Pretto, Menegatti (2014), eq. (10), without their weights (all samples alike); noise weights as in
    Shin, El-Sheimy (2002).
    """
    p = np.array(start, dtype=np.float64)
    history, weight, spread, converged = [p], np.ones(len(y)), 0.0, False
    r, J, w = magnitude_residuals(p, y, gravity)
    noise = np.sqrt((w * w * sigma * sigma).sum(axis=1))
    total = np.ones(len(y))
    for step in range(iterations):
        if near or step >= 2:
            # equal weights until the parameters are good enough to separate noise from other scatter
            e = r / residual_factor(leverage(J, weight / total))
            spread = excess_spread(e, noise, 1, robust)
            total = noise**2 + spread**2
            if robust:
                weight = outlier_weights(np.abs(e) / np.sqrt(total), 1)
        rows = np.sqrt(weight / total)
        dp = _solve(J * rows[:, None], -r * rows)
        if not np.isfinite(p + dp).all() or abs(np.linalg.det(response(p + dp))) < 1e-9:
            break
        p = p + dp
        history.append(p)
        r, J, w = magnitude_residuals(p, y, gravity)
        noise = np.sqrt((w * w * sigma * sigma).sum(axis=1))
        if step >= (1 if near else 3) and float(np.abs(dp).max()) < 1e-9:
            converged = True
            break
    if too_many_outliers(weight):
        return fit_accelerometers(y, sigma, gravity, robust=False, start=start, iterations=iterations)
    return AccelFit(p, r, noise, J, weight, spread, np.array(history), converged)


def leverage(J: FloatArray, weight: FloatArray) -> FloatArray:
    """Leverage of each residual: share of its own error that the fit takes up, 0 to 1. Shape (n,)."""
    scale = np.sqrt((J * J * weight[:, None]).sum(axis=0))
    scale[scale == 0.0] = 1.0
    A = J * np.sqrt(weight)[:, None] / scale
    values, Q = np.linalg.eigh(A.T @ A)
    good = values > 1e-12 * values[-1]
    return np.asarray((((A @ Q[:, good]) ** 2) / values[good]).sum(axis=1))


def _solve(A: FloatArray, b: FloatArray) -> FloatArray:
    """Least squares with columns scaled alike; zero in directions without information."""
    scale = np.sqrt((A * A).sum(axis=0))
    scale[scale == 0.0] = 1.0
    return np.asarray(np.linalg.lstsq(A / scale, b, rcond=1e-9)[0] / scale)


def distinct(f: FloatArray, angle: float = 0.17) -> BoolArray:
    """First of each group of poses whose directions are closer than ``angle`` [rad]. Shape (n,)."""
    u = f / np.linalg.norm(f, axis=1, keepdims=True)
    keep = np.zeros(len(u), dtype=bool)
    for k in range(len(u)):
        keep[k] = not (u[:k][keep[:k]] @ u[k] > np.cos(angle)).any()
    return keep
