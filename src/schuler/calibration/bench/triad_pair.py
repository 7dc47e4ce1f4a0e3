"""Both triads in one adjustment: the angle between gravity and Earth rate ties the gyroscopes to the accelerometers.

Magnitudes leave the rotation between the triads open. The inner product does not: at rest the specific force is
(0, 0, -g) and the rate (omega_ie cos(lat), 0, -omega_ie sin(lat)) in north-east-down, so in any attitude ::

    f . omega = + g omega_ie sin(lat)

A table with a vertical axis does not help: there both vectors are parallel, and their product does not change to first
order with the angle between them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from schuler.arrays import BoolArray, FloatArray
from schuler.calibration.bench.gauss_helmert import LARGEST_SIGMA
from schuler.calibration.bench.magnitude import possible
from schuler.calibration.bench.poses import Poses
from schuler.calibration.bench.sensor_geometry import PARAMETERS, triad_derivative, triad_inverse, triad_matrix
from schuler.calibration.bench.triad import TriadCalibration, to_model, triad_names
from schuler.calibration.bench.triad_verdicts import REJECT
from schuler.calibration.result.parameters import BIAS_G, MATRIX_G
from schuler.calibration.result.result import CalibrationResult, Residuals
from schuler.rotation import dcm_from_rotvec, rotvec_from_dcm, skew

_ITERATIONS = 50  # at most


@dataclass(frozen=True, eq=False)
class TriadPair:
    """Result of :func:`adjust_pair`.

    Attributes
    ----------
    accel, gyro : ndarray, shape (9,)
        As :class:`schuler.calibration.bench.adjustment.Adjustment` has them; SI.
    C_bs : ndarray, shape (3, 3)
        From the gyroscopes' own axes to the accelerometers'.
    cofactor : ndarray, shape (21, 21)
        Of accelerometers, gyroscopes and a small turn of ``C_bs`` about body axes; zero for held parameters.
    variance_of_unit_weight : float
    freedom : int
    converged : bool
    """

    accel: FloatArray
    gyro: FloatArray
    C_bs: FloatArray
    cofactor: FloatArray
    variance_of_unit_weight: float
    freedom: int
    converged: bool

    @property
    def turn(self) -> FloatArray:
        """Rotation vector from the accelerometers' axes to the gyroscopes'. Shape (3,). [rad]"""
        return rotvec_from_dcm(self.C_bs)

    def gyro_model(self) -> tuple[FloatArray, FloatArray]:
        """Bias and all nine elements of M_g in the accelerometers' axes, shape (12,), and their covariance (12, 12)."""
        L = triad_matrix(self.gyro[3:6], self.gyro[6:])
        J = self.gyro_derivative()
        return np.concatenate((self.gyro[:3], (L @ self.C_bs.T - np.eye(3)).ravel())), J @ self.cofactor @ J.T

    def gyro_derivative(self) -> FloatArray:
        """Derivative of the values of :meth:`gyro_model` by all 21 parameters. Shape (12, 21)."""
        L = triad_matrix(self.gyro[3:6], self.gyro[6:])
        dL = triad_derivative(self.gyro[3:6], self.gyro[6:])
        J = np.zeros((12, 21))
        J[:3, 9:12] = np.eye(3)
        J[3:, 12:18] = np.einsum("ijp,jk->ikp", dL, self.C_bs.T).reshape(9, 6)
        for k in range(3):  # C_bs turned by a small angle about body axis k
            J[3:, 18 + k] = (-L @ self.C_bs.T @ skew(np.eye(3)[k])).ravel()
        return J


def pair_conditions(
    Y: FloatArray, x: FloatArray, C_bs: FloatArray, squares: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Three conditions of each pose and their derivatives.

    Parameters
    ----------
    Y : ndarray, shape (n, 6)
        Specific force [m/s^2] and rate [rad/s] as read.
    x : ndarray, shape (18,)
        Parameters of both triads.
    C_bs : ndarray, shape (3, 3)
    squares : ndarray, shape (n, 3)
        ``g^2``, ``rho^2``, ``f . omega``.

    Returns
    -------
    h : ndarray, shape (n, 3)
        ``|f|^2 - g^2``, ``|omega|^2 - rho^2``, ``f . C_bs omega - g omega_up``.
    A : ndarray, shape (n, 3, 21)
        By the parameters and a small turn of C_bs about body axes.
    B : ndarray, shape (n, 3, 6)
        By the readings.
    """
    n = len(Y)
    h, A, B = np.empty((n, 3)), np.zeros((n, 3, 21)), np.zeros((n, 3, 6))
    v, W, D = [], [], []
    for i in (0, 1):
        b, s, theta = np.split(x[9 * i : 9 * i + 9], 3)
        W.append(triad_inverse(s, theta))
        v.append((Y[:, 3 * i : 3 * i + 3] - b) @ W[i].T)
        # v = W (Y - b), so dv = -W (dM v + db)
        by_matrix = -np.einsum("ij,jkp,nk->nip", W[i], triad_derivative(s, theta), v[i])
        D.append(np.concatenate((np.broadcast_to(-W[i], (n, 3, 3)), by_matrix), axis=2))
    f, w = v
    other = (w @ C_bs.T, f @ C_bs)  # the other vector, in the axes of this triad
    for i in (0, 1):
        h[:, i] = np.sum(v[i] ** 2, axis=1)
        for row, left in ((i, 2.0 * v[i]), (2, other[i])):
            A[:, row, 9 * i : 9 * i + 9] = np.einsum("ni,nip->np", left, D[i])
            B[:, row, 3 * i : 3 * i + 3] = left @ W[i]
    h[:, 2] = np.sum(f * other[0], axis=1)
    A[:, 2, 18:] = np.cross(other[0], f)
    return h - squares, A, B


def adjust_pair(
    Y: FloatArray,
    sigma: FloatArray,
    squares: FloatArray,
    used: BoolArray,
    accel: FloatArray,
    gyro: FloatArray,
    free: BoolArray,
    prior: Mapping[int, tuple[float, float]] | None = None,
) -> TriadPair:
    """Both triads and the rotation between them, from estimates of each alone.

    Parameters
    ----------
    Y, sigma : ndarray, shape (n, 6)
        Means of specific force [m/s^2] and rate [rad/s], and their uncertainty.
    squares : ndarray, shape (n, 3)
        See :func:`pair_conditions`.
    used : ndarray of bool, shape (n, 3)
        Which conditions exist in a pose.
    accel, gyro : ndarray, shape (9,)
        First values.
    free : ndarray of bool, shape (18,)
        What to estimate besides the rotation.
    prior : mapping of index to (value, sigma), optional
        By index in the 18 parameters.

    Returns
    -------
    TriadPair

    References
    ----------
    Gauss-Helmert model as in :func:`schuler.calibration.bench.gauss_helmert.adjust`, three conditions a pose. The inner
    product is not in Hayal (2010).
    """
    prior = prior or {}
    every = np.concatenate((free, np.ones(3, dtype=bool)))
    x, C, e = np.concatenate((accel, gyro)), np.eye(3), np.zeros_like(Y)
    variance = sigma**2
    priors = np.array([k for k in prior if free[k]], dtype=np.int64)
    value, spread = (np.array([prior[int(k)][i] for k in priors]) for i in (0, 1))
    rows = np.zeros((len(priors), 21))
    rows[np.arange(len(priors)), priors] = 1.0 / spread
    converged = False
    for _ in range(_ITERATIONS):
        h, A, B = pair_conditions(Y + e, x, C, squares)
        A, B = A * used[:, :, None], B * used[:, :, None]
        w = h * used - np.einsum("nij,nj->ni", B, e)
        K = np.einsum("nij,nj,nkj->nik", B, variance, B)
        K[:, [0, 1, 2], [0, 1, 2]] += np.where(used, 0.0, 1.0)  # a condition that does not exist is 0 = 0
        R = np.linalg.inv(np.linalg.cholesky(K))
        design = np.vstack(((R @ A).reshape(-1, 21), rows))[:, every]
        misfit = np.concatenate(((R @ w[:, :, None]).ravel(), (x[priors] - value) / spread))
        D = np.linalg.norm(design, axis=0)
        D[D == 0.0] = 1.0
        step = np.zeros(21)
        step[every] = -np.linalg.lstsq(design / D, misfit, rcond=1e-12)[0] / D
        lagrange = np.linalg.solve(K, (w + A @ step)[:, :, None])
        correction = -variance * np.einsum("nij,ni->nj", B, lagrange[:, :, 0])
        if not (possible(x[:9] + step[:9]) and possible(x[9:] + step[9:18])):
            break
        x = x + step[:18]
        C = dcm_from_rotvec(step[18:]) @ C
        done = np.abs(step[every] * D).max() < 1e-8 and (np.abs(correction - e) / sigma).max() < 1e-6
        e = correction
        if done:
            converged = True
            break
    Q = np.zeros((21, 21))
    scaled = design / D
    Q[np.ix_(every, every)] = np.linalg.pinv(scaled.T @ scaled, hermitian=True) / np.outer(D, D)
    freedom = int(used.sum()) + len(priors) - int(every.sum())
    total = float(np.sum(e * e / variance) + np.sum(((x[priors] - value) / spread) ** 2))
    return TriadPair(x[:9], x[9:], C, Q, total / freedom if freedom > 0 else float("nan"), freedom, converged)


def with_turn(
    result: CalibrationResult,
    accel: TriadCalibration,
    gyro: TriadCalibration,
    poses: Poses,
    gravity: float,
    rho: FloatArray,
    rate_up: float,
    magnitude: BoolArray,
    at_rest: BoolArray,
) -> CalibrationResult:
    """All of M_g in the accelerometers' axes, if the poses tell.

    Parameters
    ----------
    result : CalibrationResult
        Of both triads alone.
    accel, gyro : TriadCalibration
        These triads.
    poses : Poses
    gravity : float
        [m/s^2]
    rho : ndarray, shape (n,)
        Magnitude of the rate. [rad/s]
    rate_up : float
        Earth rate about the upward vertical. [rad/s]
    magnitude : ndarray of bool, shape (n,)
        Poses that count for the accelerometers.
    at_rest : ndarray of bool, shape (n,)
        Poses that do not turn with a table.

    Returns
    -------
    CalibrationResult
        The same with verdicts that say why not, where a triad is not determined or the angles come out worse than
        0.3 rad.
    """
    a, g = accel.adjustment, gyro.adjustment
    if a is None or g is None or "refused" in (accel.status, gyro.status) or not at_rest.any():
        sentence = "rotation between the triads not determined: it needs both triads determined, and poses at rest"
        return replace(result, status="refused", verdicts=(*result.verdicts, sentence))
    n = len(poses)
    Y, sigma = np.hstack((poses.f, poses.omega)), np.hstack((poses.sigma_f, poses.sigma_omega))
    squares = np.column_stack((np.full(n, gravity**2), rho**2, np.full(n, gravity * rate_up)))
    used = np.column_stack((magnitude, np.ones(n, dtype=bool), at_rest))
    prior = {9 * i + PARAMETERS.index(k): v for i, t in enumerate((accel, gyro)) for k, v in t.prior.items()}
    pair = adjust_pair(Y, sigma, squares, used, a.values, g.values, np.concatenate((a.free, g.free)), prior)
    turn_sigma = np.sqrt(np.diag(pair.cofactor)[18:])
    if not pair.converged or not (turn_sigma < LARGEST_SIGMA).all() or not turn_sigma.all():
        sentence = (
            "rotation between the triads not determined: Earth rate is too weak for these gyroscopes, or its direction "
            "in the body is too much the same in all poses; stay longer, vary headings"
        )
        return replace(result, status="refused", verdicts=(*result.verdicts, sentence))
    return _joined(result, accel, gyro, pair, Y, squares, sigma, at_rest, gravity)


def _joined(
    result: CalibrationResult,
    accel: TriadCalibration,
    gyro: TriadCalibration,
    pair: TriadPair,
    Y: FloatArray,
    squares: FloatArray,
    sigma: FloatArray,
    at_rest: BoolArray,
    gravity: float,
) -> CalibrationResult:
    from scipy.stats import chi2

    inflation, suspicious = 1.0, []
    if pair.freedom > 0 and chi2.sf(pair.variance_of_unit_weight * pair.freedom, pair.freedom) < REJECT:
        inflation = pair.variance_of_unit_weight
        suspicious.append(
            f"both triads together: residuals are {np.sqrt(inflation):.2g} times as large as the noise explains; wrong "
            "latitude, movement or drift; uncertainties are enlarged accordingly"
        )
    keep = ~accel.held
    values_a, J_a = to_model(pair.accel)
    values_g, _ = pair.gyro_model()
    J = np.zeros((int(keep.sum()) + 12, 21))
    J[: keep.sum(), :9] = J_a[keep]
    J[keep.sum() :] = pair.gyro_derivative()
    names = tuple(n for n, k in zip(triad_names("a"), keep, strict=True) if k) + BIAS_G + MATRIX_G
    x = np.concatenate((pair.accel, pair.gyro))
    h, _, B = pair_conditions(Y, x, pair.C_bs, squares)
    inner = Residuals(
        tuple(label for label, k in zip(result.residuals["gyro"].label, at_rest, strict=True) if k),
        h[at_rest, 2] / gravity,
        np.sqrt(np.sum((B[at_rest, 2] * sigma[at_rest]) ** 2, axis=1)) / gravity,
        "rad/s",
    )
    turn, turn_sigma = pair.turn, np.sqrt(inflation * np.diag(pair.cofactor)[18:])
    sentence = "gyroscopes: turned against the accelerometers by " + ", ".join(
        f"{t:.3g} ({s:.1g})" for t, s in zip(turn, turn_sigma, strict=True)
    )
    sheet = gyro.prior_sigma.get("M_g_yx")
    prior_sigma = result.prior_sigma | (dict.fromkeys(("M_g_xy", "M_g_xz", "M_g_yz"), sheet) if sheet else {})
    if sheet and turn_sigma.max() > sheet:
        sentence += "; the data sheet's misalignment is smaller than this uncertainty"
    return replace(
        result,
        names=names,
        values=np.concatenate((values_a[keep], values_g)),
        covariance=inflation * J @ pair.cofactor @ J.T,
        fixed={n: v for n, v in result.fixed.items() if n not in names},
        status="warning" if suspicious and result.status == "ok" else result.status,
        verdicts=(*result.verdicts, *suspicious, sentence + " rad about body x, y, z"),
        prior_sigma=prior_sigma,
        variance_of_unit_weight=pair.variance_of_unit_weight,
        freedom=pair.freedom,
        residuals=result.residuals | {"inner product": inner},
        history=None,
        extra=result.extra | {"turn": {"value": turn.tolist(), "sigma": turn_sigma.tolist()}},
    )
