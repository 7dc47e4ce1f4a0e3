"""Two calibrations of one unit: what changed beyond its uncertainty."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from schuler.arrays import FloatArray
from schuler.calibration.result.parameters import GAUGES, MATRIX_A, MATRIX_G, Gauge
from schuler.calibration.result.result import CalibrationResult
from schuler.calibration.result.sheet import probability, rounded, sheet
from schuler.exceptions import InputError

_ROUNDING = 1e-12  # differences of parameters held in both that are no change [SI]


@dataclass(frozen=True, eq=False)
class Difference:
    """What two calibrations disagree in: the second minus the first.

    Attributes
    ----------
    names : tuple of str
        Parameters that both have.
    difference : ndarray, shape (p,)
        Second minus first. [SI]
    covariance : ndarray, shape (p, p)
        Of the difference: the sum of both. Infinite variances mean: one of them did not determine it.
    gauge : str
        The body axes both were brought to.
    beyond : float
        From how many sigma on something is called a change.
    chi2, freedom, p_value : float, int, float
        ``d^T C^-1 d`` over what both determined, its degrees of freedom, and the probability of one as large if
        nothing changed; NaN and 0 if there is nothing to compare.
    only_first, only_second : tuple of str
        Estimated in one, unknown to the other.
    temperature_change : float or None
        Second minus first. [K]
    """

    names: tuple[str, ...]
    difference: FloatArray
    covariance: FloatArray
    gauge: Gauge
    beyond: float
    chi2: float
    freedom: int
    p_value: float
    only_first: tuple[str, ...] = ()
    only_second: tuple[str, ...] = ()
    temperature_change: float | None = None

    @property
    def sigma(self) -> FloatArray:
        """1-sigma uncertainty of the differences. Shape (p,). [SI]"""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @property
    def z(self) -> FloatArray:
        """Differences over their uncertainty. Shape (p,); 0 where not determined, infinite if both were held."""
        s, d = self.sigma, self.difference
        held = np.where(np.abs(d) > _ROUNDING, np.copysign(np.inf, d), 0.0)
        return np.asarray(np.where(s > 0.0, d / np.where(s > 0.0, s, 1.0), held))

    @property
    def changed(self) -> tuple[str, ...]:
        """Parameters that changed by more than ``beyond`` sigma, largest first."""
        order = np.argsort(-np.abs(self.z), kind="stable")
        return tuple(self.names[i] for i in order if abs(self.z[i]) > self.beyond)

    @property
    def undetermined(self) -> tuple[str, ...]:
        """Parameters one of the two did not determine."""
        return tuple(n for n, s in zip(self.names, self.sigma, strict=True) if not np.isfinite(s))

    def __getitem__(self, name: str) -> tuple[float, float]:
        """Difference and its 1-sigma uncertainty by name. [SI]"""
        if name not in self.names:
            raise InputError(f"name: expected one of {', '.join(self.names)}, got {name!r}")
        i = self.names.index(name)
        return float(self.difference[i]), float(self.sigma[i])

    def sentences(self) -> list[str]:
        """The finding in words."""
        lines = []
        if self.changed:
            what = ", ".join(f"{sheet(n).meaning} ({n})" for n in self.changed)
            lines.append(f"Changed by more than {self.beyond:g} sigma: {what}.")
        elif self.freedom:
            lines.append(f"No parameter changed by more than {self.beyond:g} sigma.")
        if self.freedom:
            word = "together they agree" if self.p_value >= 0.01 else "together they do not agree"
            lines.append(
                f"All together: chi-square {self.chi2:.3g} with {self.freedom} degrees of freedom, "
                f"{probability(self.p_value)}: {word}."
            )
        else:
            lines.append("Nothing was determined in both, so nothing can be said about changes.")
        if self.undetermined:
            lines.append(f"Not determined in one of the two: {', '.join(self.undetermined)}.")
        for names, which in ((self.only_first, "first"), (self.only_second, "second")):
            if names:
                lines.append(f"Only in the {which}: {', '.join(names)}.")
        if self.temperature_change is not None and abs(self.temperature_change) >= 0.1:
            word = "warmer" if self.temperature_change > 0.0 else "colder"
            lines.append(f"The second was {abs(self.temperature_change):.1f} K {word}: part of a change may be that.")
        return lines

    def rows(self) -> list[tuple[str, str, str, str, str]]:
        """Name, difference, 1 sigma, unit of data sheets, number of sigma, as text, one row a parameter."""
        rows = []
        for name, d, s, z in zip(self.names, self.difference, self.sigma, self.z, strict=True):
            unit = sheet(name)
            value, spread = rounded(d / unit.factor, s / unit.factor)
            rows.append((name, value, spread, unit.unit, f"{z:+.1f}" if np.isfinite(s) else "-"))
        return rows

    def summary(self) -> str:
        """Differences with uncertainty in data-sheet units, the chi-square test, and the finding in words."""
        lines = [
            f"{'parameter':<10}{'second - first':>16}{'1 sigma':>16}  {'unit':<9}{'sigmas':>8}",
            *(f"{n:<10}{v:>16}{s:>16}  {unit:<9}{z:>8}" for n, v, s, unit, z in self.rows()),
            f"body axes of both (gauge {self.gauge}): {GAUGES[self.gauge]}",
        ]
        return "\n".join(lines + self.sentences())


def compare(a: CalibrationResult, b: CalibrationResult, *, beyond: float = 3.0) -> Difference:
    """Compare two calibrations of one unit: ``b`` minus ``a``.

    Parameters
    ----------
    a, b : CalibrationResult
        Of different recordings: their errors are taken as independent. Two evaluations of one recording share its
        noise, and differ by less than this says.
    beyond : float
        From how many sigma on a parameter is called changed.

    Returns
    -------
    Difference
        In one gauge: the common one; else that of ``a``, unless ``a`` is "full", from which one can come to the other's
        but not back. In the nominal factors of ``a``.

    Raises
    ------
    InputError
        If no parameter is in both, or a response is left-handed.

    Notes
    -----
    A parameter that is held at a value in one is compared with the estimate of the other; what is in neither's list
    is left out. The chi-square goes over the eigenvectors of the correlations that are determined, so that elements a
    gauge makes equal (symmetric M_a) count once.
    """
    if not beyond > 0.0:
        raise InputError(f"beyond: expected a positive number of sigma, got {beyond!r}")
    gauge: Gauge = b.gauge if a.gauge == "full" else a.gauge
    first = a.in_gauge(gauge)
    second = with_nominal(b, a.nominal).in_gauge(gauge)
    determined = [dict.fromkeys((*r.names, *r.fixed)) for r in (first, second)]
    names = tuple(n for n in determined[0] if n in determined[1] and not (n in first.fixed and n in second.fixed))
    held = tuple(n for n in first.fixed if n in second.fixed and abs(first.fixed[n] - second.fixed[n]) > _ROUNDING)
    names += held
    if not names:
        raise InputError(
            f"expected two calibrations with parameters in common, got {', '.join(first.names) or 'none'} "
            f"and {', '.join(second.names) or 'none'}"
        )
    difference = np.array([second[n][0] - first[n][0] for n in names])
    C = _covariance(first, names) + _covariance(second, names)
    chi2, freedom, p = _chi_square(difference, C)
    change = None if a.temperature is None or b.temperature is None else b.temperature - a.temperature
    return Difference(
        names, difference, C, gauge, beyond, chi2, freedom, p,
        tuple(n for n in first.names if n not in determined[1]),
        tuple(n for n in second.names if n not in determined[0]), change,
    )  # fmt: skip


def with_nominal(result: CalibrationResult, nominal: tuple[float, float]) -> CalibrationResult:
    """The same calibration with other nominal factors: what they take more, scale factors and biases take less.

    Parameters
    ----------
    result : CalibrationResult
    nominal : (float, float)
        Of accelerometer and gyroscope. [SI per unit of the log]

    Returns
    -------
    CalibrationResult
        ``s y = b + (I + M) f`` with ``s' = k s`` becomes ``b' = k b``, ``I + M' = k (I + M)``, ``G' = k G``,
        ``Q' = k Q``. Without ``extra``, residuals and history, which are in the old units.
    """
    k = {"a": nominal[0] / result.nominal[0], "g": nominal[1] / result.nominal[1], "m": 1.0}
    if all(abs(v - 1.0) < 1e-15 for v in k.values()):
        return result

    def factor(name: str) -> float:
        return 1.0 if name[0] in "rd" else k[name[2]]

    def changed(name: str, value: float) -> float:
        diagonal = name[0] == "M" and name[4] == name[5]
        return factor(name) * value + (factor(name) - 1.0 if diagonal else 0.0)

    J = np.array([factor(n) for n in result.names])
    families = {n[:3] for n in (*result.names, *result.fixed)}
    unnamed = [n for n in (*MATRIX_A, *MATRIX_G) if n[4] == n[5] and n[:3] in families and n not in result.parameters]
    return replace(
        result,
        values=np.array([changed(n, v) for n, v in zip(result.names, result.values, strict=True)]),
        covariance=result.covariance * np.outer(J, J),
        fixed={n: changed(n, v) for n, v in {**result.fixed, **dict.fromkeys(unnamed, 0.0)}.items()},
        nominal=nominal, prior_sigma={n: s * factor(n) for n, s in result.prior_sigma.items()},
        residuals={}, history=None, extra={},
    )  # fmt: skip


def _covariance(result: CalibrationResult, names: tuple[str, ...]) -> FloatArray:
    """Covariance of parameters by name; zero for those that were held."""
    place = {n: i for i, n in enumerate(result.names)}
    there = [i for i, n in enumerate(names) if n in place]
    C = np.zeros((len(names), len(names)))
    C[np.ix_(there, there)] = result.covariance[
        np.ix_([place[names[i]] for i in there], [place[names[i]] for i in there])
    ]
    return C


def _chi_square(d: FloatArray, C: FloatArray) -> tuple[float, int, float]:
    from scipy.special import chdtrc

    s = np.sqrt(np.diag(C))
    use = np.isfinite(s) & (s > 0.0)
    if not use.any():
        return float("nan"), 0, float("nan")
    values, vectors = np.linalg.eigh(C[np.ix_(use, use)] / np.outer(s[use], s[use]))
    kept = values > 1e-9
    y = vectors[:, kept].T @ (d[use] / s[use])
    total, freedom = float(np.sum(y**2 / values[kept])), int(kept.sum())
    return total, freedom, float(chdtrc(freedom, total))
