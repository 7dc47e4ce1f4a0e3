"""From least-squares fits of the two triads to one result with verdicts; what all bench methods share."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from schuler.arrays import FloatArray, IntArray
from schuler.calibration.bench.linear_fit import LinearFit, describe_confounded
from schuler.calibration.result.parameters import LINEAR
from schuler.calibration.result.result import CalibrationResult, Residuals
from schuler.earth import WGS84
from schuler.files import package_version
from schuler.units import DEG, DEG_PER_HR


def bench_result(
    method: str,
    fits: Mapping[str, LinearFit],
    *,
    advice: Mapping[str, str],
    warnings: Sequence[str] = (),
    notes: Sequence[str] = (),
    residuals: Mapping[str, Residuals],
    options: Mapping[str, Any],
    names: Sequence[str] = LINEAR,
    next_pose: str = "",
    **rest: Any,
) -> CalibrationResult:
    """Join the fits of accelerometers and gyroscopes in body axes of the fixture.

    Parameters
    ----------
    method : str
    fits : mapping of str to LinearFit
        ``accel``, ``gyro``; taken as independent of each other.
    advice : mapping of str to str
        What would determine the parameters of a family (``b_a``, ``M_a``, ...) that are not determined.
    warnings, notes : sequence of str
        Sentences of the method; the first make the result a warning.
    residuals, options, rest
        As the result wants them.
    names : sequence of str
        Parameters that were asked for; those a fit lacks are held at zero.
    next_pose : str
        If there is nothing more urgent.

    Returns
    -------
    CalibrationResult
    """
    values: dict[str, float] = {}
    place: dict[str, tuple[str, int]] = {}
    for kind, fit in fits.items():
        for j, name in enumerate(fit.names):
            if not name.startswith("_"):
                values[name], place[name] = float(fit.values[j]), (kind, j)
    estimated = [name for name in LINEAR if name in values]
    C = np.zeros((len(estimated), len(estimated)))
    for kind, fit in fits.items():
        enlarged = fit.variance_of_unit_weight if _beyond_chance(fit) else 1.0
        here = [i for i, n in enumerate(estimated) if place[n][0] == kind]
        there = [place[estimated[i]][1] for i in here]
        C[np.ix_(here, here)] = enlarged * fit.covariance[np.ix_(there, there)]
    open_ends = [sentence for fit in fits.values() for sentence in describe_confounded(fit.confounded)]
    lost = [n for n in estimated if not np.isfinite(C[estimated.index(n), estimated.index(n)])]
    how = list(dict.fromkeys(advice[n[:3]] for n in lost if n[:3] in advice))
    suspicious = [s for kind, fit in fits.items() for s in _too_large(kind, fit)]
    doubts = [*warnings, *suspicious]
    freedom = sum(fit.freedom for fit in fits.values())
    chi2 = sum(fit.chi2 for fit in fits.values() if fit.freedom > 0)
    return CalibrationResult(
        method=method,
        names=tuple(estimated),
        values=np.array([values[n] for n in estimated]),
        covariance=C,
        gauge="full",
        fixed={n: 0.0 for n in names if n not in values},
        status="refused" if open_ends else "warning" if doubts else "ok",
        verdicts=(*open_ends, *(how if open_ends else ()), *doubts, *notes),
        condition=max((fit.condition for fit in fits.values()), default=float("nan")),
        variance_of_unit_weight=chi2 / freedom if freedom else float("nan"),
        freedom=freedom,
        residuals=dict(residuals),
        next_pose=how[0] if open_ends and how else next_pose,
        provenance={"schuler": package_version(), "method": method, "options": dict(options)},
        **rest,
    )


def axis_residuals(
    labels: Sequence[str],
    fit: LinearFit,
    rows: IntArray,
    before: FloatArray,
    sigma: FloatArray,
    unit: str,
    direction: FloatArray,
) -> Residuals:
    """Residuals of readings of three axes, one entry for each reading and axis.

    Parameters
    ----------
    labels : sequence of str, length n
    fit : LinearFit
    rows : ndarray of int, shape (m,)
        Which of the 3 n numbers the fit has used.
    before, sigma : ndarray, shape (n, 3)
        Measured less reference; its 1-sigma. [unit]
    unit : str
    direction : ndarray, shape (n, 3)

    Returns
    -------
    Residuals
    """
    return Residuals(
        tuple(f"{labels[r // 3]}, {'xyz'[r % 3]} axis" for r in rows),
        fit.residuals,
        sigma.ravel()[rows],
        unit,
        before.ravel()[rows],
        direction[rows // 3],
    )


def describe_level(level: float) -> list[str]:
    """A sentence on the fixture if its faces disagree."""
    if level <= 0.0:
        return []
    return [
        f"the faces disagree by more than noise: the fixture was taken to be level to {level / DEG:.2g} deg "
        f"(level_sigma = {level:.2g} rad); cross-coupling of the accelerometers is not known better than that"
    ]


def describe_earth_rate(g_sensitivity: bool) -> str:
    """A sentence on Earth rate where nobody describe_confounded the latitude."""
    return (
        f"Earth rate ({WGS84.omega_ie / DEG_PER_HR:.0f} deg/h) is not accounted for and stands in the uncertainty of "
        f"the gyro {'bias and g-sensitivity' if g_sensitivity else 'bias'}; give latitude"
    )


def _too_large(kind: str, fit: LinearFit) -> list[str]:
    if not _beyond_chance(fit):
        return []
    factor = np.sqrt(fit.variance_of_unit_weight)
    return [
        f"{kind}: the residuals are {factor:.3g} times what the stated noise explains; look at the largest, state "
        f"how much biases change between readings (instability); the uncertainties are enlarged by {factor:.3g}"
    ]


def _beyond_chance(fit: LinearFit) -> bool:
    return fit.freedom > 0 and fit.chi2 > fit.limit()
