"""Magnetometer of a nine-axis unit, calibrated in the poses in which its accelerometers were."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from schuler.arrays import FloatArray, IntArray
from schuler.calibration.magnetometer.fit import FEWEST, FEWEST_SOFT_IRON, UNEVEN, MagneticFit, fit_magnetometer
from schuler.calibration.result.parameters import BIAS_M, MATRIX_M
from schuler.calibration.result.result import CalibrationResult, Residuals
from schuler.exceptions import InputError
from schuler.recording.series import ImuSeries
from schuler.rotation import rotvec_from_dcm
from schuler.units import DEG, UT

if TYPE_CHECKING:
    from schuler.calibration.bench.poses import Poses

#: Strength of the Earth's field taken for a magnetometer in counts if none is stated [T]
TYPICAL = 50e-6
# larger readings are counts: no magnet a compass survives [T]
_LARGEST = 0.1


def magnetic_means(imu: ImuSeries, index: IntArray | Sequence[tuple[int, int]]) -> tuple[FloatArray, FloatArray] | None:
    """Mean readings of the magnetometer over spans of samples, and their 1 sigma; None if the log has none.

    Parameters
    ----------
    imu : ImuSeries
    index : array_like of int, shape (n, 2)
        First sample and the one after the last.

    Returns
    -------
    (ndarray, ndarray), shapes (n, 3), (n,), or None
        [unit of the log]. Readings that are held count once; noise is pooled over the spans (median), the larger of
        that of readings and that of tenths of a span.
    """
    if imu.magnetometer is None or not imu.magnetometer.any() or not len(index):
        return None
    means, white, coloured, count = [], [], [], []
    for a, b in index:
        x = imu.magnetometer[a:b]
        means.append(x.mean(axis=0))
        new = x[np.concatenate(([True], (np.diff(x, axis=0) != 0.0).any(axis=1)))]
        count.append(len(new))
        m = len(new) // 10
        white.append(float(new.var(axis=0, ddof=1).mean()) if len(new) > 1 else 0.0)
        tenths = new[: 10 * m].reshape(10, m, 3).mean(axis=1) if m else None
        coloured.append(0.0 if tenths is None else float(tenths.var(axis=0, ddof=1).mean()) * m)
    variance = max(float(np.median(white)), float(np.median(coloured)))
    return np.array(means), np.sqrt(variance / np.array(count))


def with_magnetometer(
    result: CalibrationResult,
    f: FloatArray,
    readings: FloatArray,
    sigma: FloatArray,
    labels: Sequence[str],
    *,
    field: float | None = None,
    soft_iron: bool | None = None,
) -> CalibrationResult:
    """A calibration of accelerometers with the magnetometer in the same poses and the same body axes.

    Parameters
    ----------
    result : CalibrationResult
    f : ndarray, shape (n, 3)
        Mean readings of the accelerometers. [unit of the log]
    readings, sigma : ndarray, shape (n, 3), (n,)
        See :func:`magnetic_means`. [T], or counts, of which the size tells
    labels : sequence of str
        Names of the poses.
    field : float, optional
        Strength of the local field. None: scale factors are relative to their mean. [T]
    soft_iron : bool, optional
        Estimate the soft iron. None: with nine poses or more.

    Returns
    -------
    CalibrationResult
        With ``b_m`` (hard iron) and ``M_m`` (soft iron, scale and alignment) of ``y = b_m + (I + M_m) m_b``,
        ``extra["magnetometer"]`` and residuals. As it was, ``warning`` and with a verdict that says why, if the
        magnetometer cannot be calibrated.

    Notes
    -----
    ``extra["magnetometer"]``: ``field_ut``, ``dip_deg``, ``soft_iron`` (symmetric), ``alignment_deg`` (rotation vector
    from body axes to the magnetometer's, in body axes), with 1 sigma each; ``spread_ut`` between poses, ``left_out``
    poses, ``nominal`` factor to tesla. Errors of the accelerometers' calibration, arc minutes beside degrees, are
    taken from the uncertainty of M_a and b_a.
    """
    if result.status == "refused":
        return result
    size = float(np.median(np.linalg.norm(readings - readings.mean(axis=0), axis=1)))
    factor = 1.0
    if size > _LARGEST:
        factor = float(f"{(field or TYPICAL) / size:.4g}")
    errors = result.errors
    force = np.linalg.solve(np.eye(3) + errors.M_a, (result.nominal[0] * f - errors.b_a).T).T
    g = np.linalg.norm(force, axis=1)
    tilt = _tilt(result, float(np.median(g)))
    soft = len(f) >= FEWEST_SOFT_IRON if soft_iron is None else soft_iron
    y = factor * readings
    noise = np.hypot(factor * sigma, tilt * (field or float(np.median(np.linalg.norm(y - y.mean(axis=0), axis=1)))))
    try:
        fit = fit_magnetometer(-force / g[:, None], y, noise, field=field, soft_iron=soft)
        if not np.isfinite(fit.covariance).all():
            raise InputError("the poses do not determine it")
    except (InputError, np.linalg.LinAlgError) as error:
        sentence = f"The magnetometer is not calibrated: {error}."
        return replace(result, verdicts=(*result.verdicts, sentence), status="warning")
    names = (*BIAS_M, *MATRIX_M)
    k = len(result.names)
    covariance = np.zeros((k + 12, k + 12))
    covariance[:k, :k], covariance[k:, k:] = result.covariance, fit.covariance
    values = np.concatenate((result.values, fit.b, (fit.S @ fit.C - np.eye(3)).ravel()))
    history = result.history
    if history is not None:  # what is solved once does not move from iteration to iteration
        history = np.hstack((history, np.tile(values[k:], (len(history), 1))))
    sentences = _verdicts(fit, labels, field is None, soft)
    doubtful = fit.spread > UNEVEN * fit.field[0] or fit.ambiguous is not None
    residuals = Residuals(
        tuple(labels), np.linalg.norm(fit.residual, axis=1), np.sqrt(2.0) * fit.sigma, "T", None, None
    )  # fmt: skip
    return replace(
        result, names=(*result.names, *names), values=values, covariance=covariance, history=history,
        residuals={**result.residuals, "magnetometer": residuals}, verdicts=(*result.verdicts, *sentences),
        status="warning" if doubtful else result.status,
        extra=result.extra | {"magnetometer": _facts(fit, labels, factor, field, soft)},
    )  # fmt: skip


def with_poses(
    result: CalibrationResult, poses: Poses, field: float | None = None, soft_iron: bool | None = None
) -> CalibrationResult:
    """:func:`with_magnetometer` of bench poses; as it was without a magnetometer or accelerometers."""
    if poses.magnetometer is None or "M_a_xx" not in result.parameters:
        return result
    labels = [
        f"pose {i + 1} ({a:.1f}..{b:.1f} s)" for i, (a, b) in enumerate(zip(poses.start, poses.stop, strict=True))
    ]
    return with_magnetometer(result, poses.f, *poses.magnetometer, labels, field=field, soft_iron=soft_iron)


def estimates_soft_iron(result: CalibrationResult) -> bool | None:
    """Whether the soft iron was estimated; None without a magnetometer."""
    facts = result.extra.get("magnetometer")
    return bool(facts["soft_iron_estimated"]) if isinstance(facts, dict) else None


def magnetometer_words(result: CalibrationResult) -> str:
    """Field, hard iron, soft iron and alignment in a line; empty without a magnetometer."""
    facts = result.extra.get("magnetometer")
    if not isinstance(facts, dict):
        return ""
    angles = ", ".join(f"{a:+.2f}" for a in facts["alignment_deg"])
    worst = max(facts["alignment_sigma_deg"])
    values = np.linalg.eigvalsh(np.array(facts["soft_iron"]))
    strength = "as stated" if not facts["field_sigma_ut"] else f"+- {facts['field_sigma_ut']:.2g}"
    return (
        f"field {facts['field_ut']:.4g} uT ({strength}), dip {facts['dip_deg']:+.2f} +- {facts['dip_sigma_deg']:.2g} "
        f"deg; turned against the accelerometers by {angles} deg about x, y, z (+- {worst:.2g}); principal scale "
        f"factors of the soft iron {', '.join(f'{v:.4f}' for v in values)}; {facts['poses']} poses, which scatter by "
        f"{facts['spread_ut']:.2g} uT beyond noise"
    )


def _tilt(result: CalibrationResult, gravity: float) -> float:
    """1 sigma of the vertical by the calibration of the accelerometers. [rad]"""
    a = [s for n, s in zip(result.names, result.sigma, strict=True) if n[:3] == "b_a" and np.isfinite(s)]
    M = [s for n, s in zip(result.names, result.sigma, strict=True) if n[:3] == "M_a" and np.isfinite(s)]
    return float(np.hypot(max(a, default=0.0) / gravity, max(M, default=0.0)))


def _facts(fit: MagneticFit, labels: Sequence[str], factor: float, field: float | None, soft: bool) -> dict[str, Any]:
    turn = rotvec_from_dcm(fit.C) / DEG
    return {
        "field_ut": fit.field[0] / UT, "field_sigma_ut": fit.field[1] / UT, "field_stated": field is not None,
        "dip_deg": fit.dip[0] / DEG, "dip_sigma_deg": fit.dip[1] / DEG, "soft_iron": fit.S.tolist(),
        "soft_iron_sigma": fit.soft.tolist(), "soft_iron_estimated": soft, "alignment_deg": turn.tolist(),
        "alignment_sigma_deg": (np.sqrt(np.diag(fit.turn)) / DEG).tolist(), "spread_ut": fit.spread / UT,
        "poses": int(fit.used.sum()), "left_out": [labels[int(k)] for k in np.flatnonzero(~fit.used)],
        "nominal": factor, "freedom": fit.freedom,
    }  # fmt: skip


def _verdicts(fit: MagneticFit, labels: Sequence[str], relative: bool, soft: bool) -> list[str]:
    out = []
    if not soft:
        out.append(
            f"Magnetometer: hard iron and alignment only; soft iron takes {FEWEST_SOFT_IRON} poses (of {FEWEST} at "
            f"least, {len(fit.used)} came)."
        )
    if fit.ambiguous is not None:
        out.append(
            f"Magnetometer: another alignment, {fit.ambiguous / DEG:.0f} deg away, fits as well, and the one of the "
            "smaller angle was taken; add poses between the faces, on edges and corners."
        )
    if not fit.used.all():
        out.append(
            f"Magnetometer: {', '.join(labels[int(k)] for k in np.flatnonzero(~fit.used))} left out, another field "
            "than in the other poses: iron nearby, or a current."
        )
    if fit.spread > UNEVEN * fit.field[0]:
        out.append(
            f"Magnetometer: the field differs by {100.0 * fit.spread / fit.field[0]:.2g} % from pose to pose, which is "
            "in the uncertainties; calibrate in one spot, away from steel and currents."
        )
    if relative:
        out.append("Magnetometer: scale factors are relative to their mean, the strength of the field is not stated.")
    return out
