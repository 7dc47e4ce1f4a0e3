"""The rotation between the triads added to a multi-position result."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from schuler.arrays import BoolArray, FloatArray
from schuler.calibration.bench.gauss_helmert import LARGEST_SIGMA
from schuler.calibration.bench.poses import Poses
from schuler.calibration.bench.sensor_geometry import PARAMETERS
from schuler.calibration.bench.triad_verdicts import REJECT
from schuler.calibration.result.parameters import BIAS_G, MATRIX_G
from schuler.calibration.result.result import CalibrationResult, Residuals
from schuler.calibration.result.triad_calibration import TriadCalibration, to_model, triad_names
from schuler.calibration.result.two_triads import TriadPair, adjust_pair, pair_conditions


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
        said = "rotation between the triads not determined: it needs both triads determined, and poses at rest"
        return replace(result, status="refused", verdicts=(*result.verdicts, said))
    n = len(poses)
    Y, sigma = np.hstack((poses.f, poses.omega)), np.hstack((poses.sigma_f, poses.sigma_omega))
    squares = np.column_stack((np.full(n, gravity**2), rho**2, np.full(n, gravity * rate_up)))
    used = np.column_stack((magnitude, np.ones(n, dtype=bool), at_rest))
    prior = {9 * i + PARAMETERS.index(k): v for i, t in enumerate((accel, gyro)) for k, v in t.prior.items()}
    pair = adjust_pair(Y, sigma, squares, used, a.values, g.values, np.concatenate((a.free, g.free)), prior)
    turn_sigma = np.sqrt(np.diag(pair.cofactor)[18:])
    if not pair.converged or not (turn_sigma < LARGEST_SIGMA).all() or not turn_sigma.all():
        said = (
            "rotation between the triads not determined: Earth rate is too weak for these gyroscopes, or its direction "
            "in the body is too much the same in all poses; stay longer, vary headings"
        )
        return replace(result, status="refused", verdicts=(*result.verdicts, said))
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
    said = "gyroscopes: turned against the accelerometers by " + ", ".join(
        f"{t:.3g} ({s:.1g})" for t, s in zip(turn, turn_sigma, strict=True)
    )
    sheet = gyro.prior_sigma.get("M_g_yx")
    prior_sigma = result.prior_sigma | (dict.fromkeys(("M_g_xy", "M_g_xz", "M_g_yz"), sheet) if sheet else {})
    if sheet and turn_sigma.max() > sheet:
        said += "; the data sheet's misalignment is smaller than this uncertainty"
    return replace(
        result,
        names=names,
        values=np.concatenate((values_a[keep], values_g)),
        covariance=inflation * J @ pair.cofactor @ J.T,
        fixed={n: v for n, v in result.fixed.items() if n not in names},
        status="warning" if suspicious and result.status == "ok" else result.status,
        verdicts=(*result.verdicts, *suspicious, said + " rad about body x, y, z"),
        prior_sigma=prior_sigma,
        variance_of_unit_weight=pair.variance_of_unit_weight,
        freedom=pair.freedom,
        residuals=result.residuals | {"inner product": inner},
        history=None,
        extra=result.extra | {"turn": {"value": turn.tolist(), "sigma": turn_sigma.tolist()}},
    )
