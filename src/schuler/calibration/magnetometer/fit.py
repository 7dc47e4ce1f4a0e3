"""Hard iron, soft iron and alignment of a magnetometer from poses in which the vertical is known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schuler.arrays import BoolArray, FloatArray, IntArray
from schuler.exceptions import InputError
from schuler.rotation import dcm_from_quat, dcm_from_rotvec, rotvec_from_dcm

#: Fewest poses for hard iron and alignment, and with soft iron too.
FEWEST, FEWEST_SOFT_IRON = 6, 9
#: 1 sigma beyond which hard iron is not determined, of the field; the same of a matrix element.
USELESS = 0.1
#: Scatter between poses, of the field, from which on it is another field from pose to pose. [-]
UNEVEN = 0.03
# range of an axis that is turned in no pose, of the median size of the readings
_STILL = 0.02
# improbability of a pose, over their number, from which on it is left out; most of them that are
_OUTLIER, _MOST_OUTLIERS = 1e-3, 0.2
# another minimum is as good below this quantile of F; not another below this angle [rad]; start not worth a fit beyond
_AS_GOOD, _SAME_TURN, _WORTH_A_TRY = 0.999, 0.1, 100.0
# symmetric matrices without trace, and the identity
_SYMMETRIC = np.array([
    np.diag([1.0, -1.0, 0.0]), np.diag([0.0, 1.0, -1.0]), np.eye(3)[[1, 0, 2]] - np.diag([0.0, 0.0, 1.0]),
    np.eye(3)[[2, 1, 0]] - np.diag([0.0, 1.0, 0.0]), np.eye(3)[[0, 2, 1]] - np.diag([1.0, 0.0, 0.0]), np.eye(3),
])  # fmt: skip


@dataclass(frozen=True, eq=False)
class MagneticFit:
    """A magnetometer fitted as ``y = b + (I + M) m_b``, with ``I + M = S C``.

    Attributes
    ----------
    b : ndarray, shape (3,)
        Hard iron. [unit of the readings]
    S : ndarray, shape (3, 3)
        Soft iron and scale, symmetric. [-]
    C : ndarray, shape (3, 3)
        Body axes to axes of the magnetometer, a rotation.
    covariance : ndarray, shape (12, 12)
        Of b and of M row by row.
    soft, turn : ndarray, shape (3, 3)
        1 sigma of S; covariance of the rotation vector of C, in body axes [rad^2].
    field, dip : (float, float)
        Strength and dip, positive down, and their 1 sigma. [unit of the readings], [rad]
    spread : float
        1 sigma between poses beyond noise, from the residuals. [unit of the readings]
    residual : ndarray, shape (n, 2)
        Vertical and horizontal component less those of the field. [unit of the readings]
    sigma : ndarray, shape (n,)
        1 sigma that was expected of a component. [unit of the readings]
    used : ndarray of bool, shape (n,)
        Poses that were not left out as outliers.
    ambiguous : float or None
        Angle to another rotation that fits as well; C is the smaller one. [rad]
    freedom : int
    """

    b: FloatArray
    S: FloatArray
    C: FloatArray
    covariance: FloatArray
    soft: FloatArray
    turn: FloatArray
    field: tuple[float, float]
    dip: tuple[float, float]
    spread: float
    residual: FloatArray
    sigma: FloatArray
    used: BoolArray
    ambiguous: float | None
    freedom: int


@dataclass(frozen=True, eq=False)
class _State:
    b: FloatArray
    S: FloatArray
    C: FloatArray
    field: float
    dip: float


def fit_magnetometer(
    down: FloatArray,
    readings: FloatArray,
    sigma: FloatArray,
    *,
    field: float | None = None,
    soft_iron: bool = True,
) -> MagneticFit:
    """Fit hard iron, soft iron and alignment by the strength and the dip of a field that is the same in all poses.

    Parameters
    ----------
    down : ndarray, shape (n, 3)
        Unit vectors down, in body axes.
    readings : ndarray, shape (n, 3)
        Mean readings in the poses. [any unit]
    sigma : ndarray, shape (n,)
        1 sigma of a component by noise and by the error of ``down``. [unit of the readings]
    field : float, optional
        Strength of the local field. None: the mean of the eigenvalues of S is 1, and the strength is estimated.
        [unit of the readings]
    soft_iron : bool
        Estimate S; else S is a scale factor, 1 without ``field``.

    Returns
    -------
    MagneticFit

    Raises
    ------
    InputError
        If there are too few poses, or they do not determine the parameters.

    Notes
    -----
    The horizontal direction of the field in a pose is unknown, its vertical component ``B sin I`` and its horizontal
    ``B cos I`` are the same in all: two conditions a pose. Weighted least squares of both (Gauss-Newton), with one
    variance of poses beyond noise such that chi-square is what it should be; its uncertainty is in the covariance
    (variance of Student's t). A pose whose residual is improbable given the others is left out. Poses
    along the axes alone may fit two rotations; the smaller one is taken, and ``ambiguous`` set.

    A magnetometer of left-handed axes cannot be told from a right-handed one in a field whose dip has the other sign.

    References
    ----------
    Gebre-Egziabher, Elkaim, Powell, Parkinson (2006) for the ellipsoid; Kok and Schön (2016), Magnetometer calibration
    using inertial sensors, for the dip as what aligns both triads.
    """
    n = len(readings)
    fewest = FEWEST_SOFT_IRON if soft_iron else FEWEST
    if n < fewest:
        raise InputError(f"expected {fewest} poses, got {n}")
    # without field the last of the symmetric matrices, the scale, is held
    basis = _SYMMETRIC[: 6 if field is not None else 5] if soft_iron else _SYMMETRIC[5 : 6 if field is not None else 5]
    size = float(np.median(np.linalg.norm(readings - readings.mean(axis=0), axis=1)))
    if not size > 0.0:
        raise InputError("expected readings that differ between poses, got the same in all: the sensor is stuck")
    if (still := np.flatnonzero(np.ptp(readings, axis=0) < _STILL * size)).size:
        raise InputError(
            f"axis {'xyz'[still[0]]} reads the same in all poses: turn all sides up and down, or the sensor is stuck"
        )
    y, w = readings / size, np.maximum(sigma / size, 1e-12)
    strength = None if field is None else field / size
    used = np.ones(n, dtype=bool)
    freedom = 2 * n - (5 + len(basis) + (field is None) + 2)
    state, ambiguous = _best(_starts(down, y, strength, soft_iron), down, y, w, basis, strength)
    while True:
        state, r, J, spread = _fit(state, down[used], y[used], w[used], basis, strength)
        freedom = 2 * int(used.sum()) - J.shape[1]
        worst = _outlier(r, J, np.hypot(w[used], spread), freedom)
        if worst is None or used.sum() - 1 < max(fewest, (1.0 - _MOST_OUTLIERS) * n):
            break
        used[np.flatnonzero(used)[worst]] = False
    s = np.repeat(np.hypot(w[used], spread), 2)
    N = (J / s[:, None]).T @ (J / s[:, None])
    d = np.sqrt(np.diag(N))
    if not (d > 0.0).all() or np.linalg.eigvalsh(N / np.outer(d, d)).min() < 1e-9:
        raise InputError("the poses do not determine hard iron, soft iron and alignment: turn all sides up and down")
    share = spread**2 / float(np.mean(np.hypot(w[used], spread) ** 2))
    P = np.linalg.inv(N) * (1.0 + share * 2.0 / max(freedom - 2, 1))
    to_bM, to_S = _derivatives(state, basis, P.shape[0])
    covariance = to_bM @ P @ to_bM.T
    if np.sqrt(np.diag(covariance)).max() > USELESS * max(1.0, state.field):
        if spread > UNEVEN * state.field:
            raise InputError(
                f"no one field fits all poses, they scatter by {100.0 * spread / state.field:.2g} % of it: iron or a "
                "current nearby, or readings beyond the range; calibrate in one spot, away from both"
            )
        raise InputError("the poses hardly determine hard iron, soft iron and alignment: turn all sides up and down")
    scale = np.concatenate((np.full(3, size), np.ones(9)))
    turn = P[3 + len(basis) : 6 + len(basis), 3 + len(basis) : 6 + len(basis)]
    dip = float(np.sqrt(P[6 + len(basis), 6 + len(basis)]))
    of_field = 0.0 if field is not None else float(np.sqrt(P[-1, -1])) * size
    return MagneticFit(
        state.b * size, state.S, state.C, covariance * np.outer(scale, scale),
        np.sqrt(np.einsum("ijk,kl,ijl->ij", to_S, P, to_S)), turn, (state.field * size, of_field),
        (state.dip, dip), spread * size, _residuals(state, down, y) * size, np.hypot(w, spread) * size, used,
        ambiguous, freedom,
    )  # fmt: skip


def _residuals(state: _State, down: FloatArray, y: FloatArray) -> FloatArray:
    """Vertical and horizontal component less those of the field. Shape (n, 2)."""
    m = np.linalg.solve(state.S @ state.C, (y - state.b).T).T
    vertical = np.einsum("ni,ni->n", m, down)
    horizontal = np.linalg.norm(m - vertical[:, None] * down, axis=1)
    return np.column_stack(
        (vertical - state.field * np.sin(state.dip), horizontal - state.field * np.cos(state.dip))
    )  # fmt: skip


def _moved(state: _State, step: FloatArray, basis: FloatArray) -> _State:
    """The state after a step in b, S, the rotation vector of C (body axes), dip and, if it is estimated, strength."""
    q = 3 + len(basis)
    return _State(
        state.b + step[:3], state.S + np.einsum("k,kij->ij", step[3:q], basis),
        state.C @ dcm_from_rotvec(step[q : q + 3]), state.field + (step[q + 4] if len(step) > q + 4 else 0.0),
        state.dip + step[q + 3],
    )  # fmt: skip


def _fit(
    state: _State, down: FloatArray, y: FloatArray, w: FloatArray, basis: FloatArray, strength: float | None
) -> tuple[_State, FloatArray, FloatArray, float]:
    """Least squares with a variance of poses that makes chi-square what it should be."""
    p = 7 + len(basis) + (strength is None)
    spread, freedom = 0.0, 2 * len(y) - p
    r, J = np.empty(0), np.empty((0, p))
    for _ in range(8):
        state, r, J = _gauss_newton(state, down, y, np.hypot(w, spread), basis, p)
        before, spread = spread, _spread(r, w, freedom)
        if abs(spread - before) <= 1e-3 * max(spread, before):
            break
    return state, r, J, spread


def _gauss_newton(
    state: _State, down: FloatArray, y: FloatArray, s: FloatArray, basis: FloatArray, p: int
) -> tuple[_State, FloatArray, FloatArray]:
    """Damped Gauss-Newton. Residuals and their derivative by the parameters, shapes (n, 2), (2 n, p)."""
    weight = np.repeat(1.0 / s, 2)
    damping = 0.0
    r, J = _residuals(state, down, y), _jacobian(state, down, y, basis, p)
    for _ in range(60):
        A, b = J * weight[:, None], r.ravel() * weight
        N = A.T @ A
        cost = float(b @ b)
        for _ in range(12):
            damped = N + np.diag(damping * np.diag(N) + 1e-14 * np.trace(N))
            step = np.asarray(-np.linalg.solve(damped, A.T @ b), dtype=np.float64)
            new = _moved(state, step, basis) if np.abs(step).max() < 2.0 else None
            after = _residuals(new, down, y) if new is not None and np.linalg.det(new.S) > 1e-6 else None
            if after is not None and float(((after.ravel() * weight) ** 2).sum()) <= cost * (1.0 + 1e-12) + 1e-300:
                break
            damping = max(10.0 * damping, 1e-4)
        else:
            break
        if new is None or after is None:
            break
        state, r = new, after
        J = _jacobian(state, down, y, basis, p)
        damping = 0.0 if damping < 1e-4 else 0.1 * damping
        if np.abs(step).max() < 1e-9:
            break
    return state, r, J


def _jacobian(state: _State, down: FloatArray, y: FloatArray, basis: FloatArray, p: int) -> FloatArray:
    """Derivative of the residuals by the parameters, in the order of :func:`_moved`. Shape (2 n, p)."""
    inverse = np.linalg.inv(state.S @ state.C)
    m = (y - state.b) @ inverse.T
    vertical = np.einsum("ni,ni->n", m, down)
    level = m - vertical[:, None] * down
    level /= np.maximum(np.linalg.norm(level, axis=1), 1e-9)[:, None]
    to = np.stack((down, level), axis=1)  # (n, 2, 3)
    q = 3 + len(basis)
    J = np.zeros((len(y), 2, p))
    J[:, :, :3] = -to @ inverse
    if len(basis):
        J[:, :, 3:q] = -np.einsum("nci,kij,nj->nck", to, inverse @ basis @ state.C, m)
    J[:, :, q : q + 3] = np.cross(to, m[:, None, :])  # a step turns m by -step x m
    J[:, 0, q + 3], J[:, 1, q + 3] = -state.field * np.cos(state.dip), state.field * np.sin(state.dip)
    if p > q + 4:
        J[:, 0, q + 4], J[:, 1, q + 4] = -np.sin(state.dip), -np.cos(state.dip)
    return J.reshape(-1, p)


def _best(
    starts: list[_State], down: FloatArray, y: FloatArray, w: FloatArray, basis: FloatArray, strength: float | None
) -> tuple[_State, float | None]:
    """The best of several fits, of those as good as it the least turned; angle between them, if there are. [rad]"""
    from scipy.stats import f as fisher

    fits = [_fit(start, down, y, w, basis, strength) for start in starts]
    s = np.hypot(w, min(fit[3] for fit in fits))[:, None]
    costs = [float(((r / s) ** 2).sum()) for _, r, _, _ in fits]
    freedom = max(2 * len(y) - fits[0][2].shape[1], 1)
    limit = min(costs) + max(1.0, min(costs) / freedom) * float(fisher.ppf(_AS_GOOD, 1, freedom))
    good = [fit[0] for fit, cost in zip(fits, costs, strict=True) if cost <= limit]
    chosen = max(good, key=lambda state: float(np.trace(state.C)))
    apart = max(float(np.linalg.norm(rotvec_from_dcm(state.C.T @ chosen.C))) for state in good)
    return chosen, apart if apart > _SAME_TURN else None


def _spread(r: FloatArray, w: FloatArray, freedom: int) -> float:
    """1 sigma of poses beside the noise ``w`` with which chi-square is its expectation; 0 if noise is enough."""
    squared = np.square(r).sum(axis=1)
    low, high = 0.0, float(squared.sum() / max(freedom, 1))
    if freedom < 1 or float((squared / (w * w)).sum()) <= freedom:
        return 0.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        if float((squared / (w * w + middle)).sum()) > freedom:
            low = middle
        else:
            high = middle
    return float(np.sqrt(high))


def _outlier(r: FloatArray, J: FloatArray, s: FloatArray, freedom: int) -> int | None:
    """Pose whose residual is improbable given the scatter of the others."""
    from scipy.stats import f as fisher

    if freedom < 4:
        return None
    A = J / np.repeat(s, 2)[:, None]
    H = (A @ np.linalg.pinv(A)).reshape(len(r), 2, len(r), 2)
    own = np.eye(2) - H[np.arange(len(r)), :, np.arange(len(r)), :]
    z = r / s[:, None]
    gained = np.array([v @ np.linalg.pinv(o, rcond=1e-6) @ v for v, o in zip(z, own, strict=True)])
    left = float((z * z).sum()) - gained
    k = int(np.argmax(gained))
    ratio = 0.5 * gained[k] / max(float(left[k]) / (freedom - 2), 1e-300)
    # residuals at the level of rounding are no outliers
    return k if fisher.sf(ratio, 2, freedom - 2) < _OUTLIER / len(r) and np.abs(r[k]).max() > 1e-9 else None


def _derivatives(state: _State, basis: FloatArray, p: int) -> tuple[FloatArray, FloatArray]:
    """Derivatives of b and M, shape (12, p), and of S, shape (3, 3, p), by the parameters."""
    q, h = 3 + len(basis), 1e-6
    to_bM, to_S = np.zeros((12, p)), np.zeros((3, 3, p))
    to_bM[:3, :3] = np.eye(3)
    to_S[:, :, 3:q] = np.moveaxis(basis, 0, -1)
    for k in range(3, q + 3):
        e = np.zeros(p)
        e[k] = h
        plus, minus = _moved(state, e, basis), _moved(state, -e, basis)
        to_bM[3:, k] = (plus.S @ plus.C - minus.S @ minus.C).ravel() / (2.0 * h)
    return to_bM, to_S


def _starts(down: FloatArray, y: FloatArray, strength: float | None, soft_iron: bool) -> list[_State]:
    """First states: ellipsoid through the readings, and the best of many rotations."""
    b, S, field = _ellipsoid(y) if soft_iron else _sphere(y)
    if strength is not None:
        S, field = S * (field / strength), strength
    m = np.linalg.solve(S, (y - b).T).T
    C0 = _rotations()
    vertical = np.einsum("nj,kji,ni->kn", m, C0, down)  # C maps body axes to the magnetometer's
    tries: list[tuple[float, _State]] = []
    for k in _apart(np.argsort(vertical.var(axis=1)), C0):
        sine = float(np.clip(vertical[k].mean() / field, -0.99, 0.99))
        state = _State(b, S, C0[k], field, float(np.arcsin(sine)))
        for _ in range(8):  # rotation and dip alone
            r, J = _residuals(state, down, y), _jacobian(state, down, y, np.empty((0, 3, 3)), 7)[:, 3:]
            step = -np.linalg.lstsq(J, r.ravel(), rcond=None)[0]
            step *= min(1.0, 0.3 / max(float(np.abs(step).max()), 1e-12))
            state = _moved(state, np.concatenate((np.zeros(3), step)), np.empty((0, 3, 3)))
        tries.append((float((_residuals(state, down, y) ** 2).sum()), state))
    tries.sort(key=lambda one: one[0])
    distinct = [tries[0]]
    for cost, state in tries[1:]:
        near = any(np.linalg.norm(rotvec_from_dcm(state.C.T @ other.C)) < _SAME_TURN for _, other in distinct)
        if not near and cost < _WORTH_A_TRY * tries[0][0]:
            distinct.append((cost, state))
    return [state for _, state in distinct]


def _rotations() -> FloatArray:
    """Rotations all over. Shape (k, 3, 3)."""
    q = np.random.default_rng(20).standard_normal((400, 4))
    return np.asarray(dcm_from_quat(q / np.linalg.norm(q, axis=1, keepdims=True)))


def _apart(order: IntArray, C: FloatArray) -> list[int]:
    """The first four that are half a radian from each other."""
    chosen: list[int] = []
    for k in order:
        if all(np.trace(C[k].T @ C[j]) < 1.0 + 2.0 * np.cos(0.5) for j in chosen):
            chosen.append(int(k))
        if len(chosen) == 4:
            break
    return chosen


def _sphere(y: FloatArray) -> tuple[FloatArray, FloatArray, float]:
    """Centre and radius of a sphere through readings."""
    A = np.column_stack((2.0 * y, np.ones(len(y))))
    x = np.linalg.lstsq(A, (y * y).sum(axis=1), rcond=None)[0]
    return x[:3], np.eye(3), float(np.sqrt(max(x[3] + x[:3] @ x[:3], 1e-6)))


def _ellipsoid(y: FloatArray) -> tuple[FloatArray, FloatArray, float]:
    """Centre, shape with eigenvalues of mean 1, and size of an ellipsoid through readings; or those of a sphere."""
    a, b, c = y.T
    A = np.column_stack((a * a, b * b, c * c, 2 * a * b, 2 * a * c, 2 * b * c, 2 * a, 2 * b, 2 * c))
    v = np.linalg.lstsq(A, np.ones(len(y)), rcond=None)[0]
    Q = np.array([[v[0], v[3], v[4]], [v[3], v[1], v[5]], [v[4], v[5], v[2]]])
    L, U = np.linalg.eigh(Q)
    if L.min() <= 1e-3 * L.max():
        return _sphere(y)
    centre = -np.linalg.solve(Q, v[6:])
    k = 1.0 + centre @ Q @ centre
    if not k > 0.0:
        return _sphere(y)
    axes = np.sqrt(k / L)
    field = float(axes.mean())
    return centre, (U * (axes / field)) @ U.T, field
