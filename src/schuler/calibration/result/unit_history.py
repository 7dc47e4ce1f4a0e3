"""History of a unit: its calibrations by date, and which parameters changed beyond their uncertainty."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np

from schuler.arguments import explains_arguments
from schuler.arrays import FloatArray
from schuler.calibration.result.comparison import with_nominal
from schuler.calibration.result.parameters import LINEAR, unit
from schuler.calibration.result.result import CalibrationResult
from schuler.calibration.result.result_entries import FORMAT
from schuler.calibration.result.result_file import read_result
from schuler.calibration.result.session import session_of
from schuler.calibration.result.sheet import rounded, sheet
from schuler.exceptions import InputError, SchulerError
from schuler.plotting.notebook import Displayed

#: Probability that any parameter of a unit that did not change is called changed.
LEVEL = 0.05
CORRECTION = "Holm's correction for {tests} parameters: one unchanged unit in twenty shows any change"


@dataclass(frozen=True, eq=False)
class ParameterHistory:
    """A parameter over the dates of its calibrations.

    Attributes
    ----------
    name : str
    day : ndarray, shape (k,)
        Since the first calibration of the unit. [d]
    value, sigma : ndarray, shape (k,)
        SI, those that were determined.
    mean : float
        Weighted by the uncertainties.
    chi2 : float
        Of the values about the mean, k - 1 degrees of freedom.
    p : float
        Probability of such a chi-square by chance; NaN of a single value.
    p_corrected : float
        The same after the correction for the number of parameters.
    """

    name: str
    day: FloatArray
    value: FloatArray
    sigma: FloatArray
    mean: float
    chi2: float
    p: float
    p_corrected: float

    @property
    def changed(self) -> bool:
        """Whether it is beyond what its uncertainties and the number of parameters explain."""
        return self.p_corrected < LEVEL

    @property
    def steps(self) -> FloatArray:
        """Changes from one calibration to the next in sigmas of the difference. Shape (k - 1,)."""
        return np.asarray(np.diff(self.value) / np.hypot(self.sigma[1:], self.sigma[:-1]))


@dataclass(frozen=True, eq=False, repr=False)
class UnitHistory(Displayed):
    """Calibrations of one unit, oldest first.

    Attributes
    ----------
    serial : str
    dates : tuple of str
    files : tuple of str
        Of each, relative to the folder.
    calibrations : tuple of CalibrationResult
        In one gauge, with the nominal factors of the first.
    parameters : dict of str to ParameterHistory
    left_out : dict of str to str
        Files that are not in it, and why.
    """

    serial: str
    dates: tuple[str, ...]
    files: tuple[str, ...]
    calibrations: tuple[CalibrationResult, ...]
    parameters: dict[str, ParameterHistory]
    left_out: dict[str, str]

    @property
    def changed(self) -> tuple[str, ...]:
        """Parameters that changed, the surest first."""
        changed = [p for p in self.parameters.values() if p.changed]
        return tuple(p.name for p in sorted(changed, key=lambda p: p.p))

    @property
    def correction(self) -> str:
        """The correction for many parameters, in words."""
        return CORRECTION.format(tests=sum(np.isfinite(p.p) for p in self.parameters.values()))

    def sentences(self) -> list[str]:
        """What changed, and what was left out."""
        n, gauge = len(self.dates), self.calibrations[0].gauge
        lines = [
            f"{self.serial or 'unit without serial number'}: {n} calibrations, {self.dates[0]} to {self.dates[-1]}."
        ]
        for name in self.changed:
            p, s = self.parameters[name], sheet(name)
            k = int(np.argmax(np.abs(p.steps)))
            number, spread = rounded(
                (p.value[k + 1] - p.value[k]) / s.factor, float(np.hypot(*p.sigma[k : k + 2])) / s.factor
            )
            days = dict(zip(_days(self.dates), self.dates, strict=True))
            lines.append(
                f"{name}, {s.meaning}, changed (p = {p.p_corrected:.1g}): by {number} ± {spread} {s.unit} between "
                f"{days[p.day[k]]} and {days[p.day[k + 1]]}."
            )
        if not self.changed:
            lines.append("No parameter changed beyond its uncertainty.")
        lines.append(
            f"{self.correction}. Compared in the gauge {gauge}; biases also move from one switch-on to the next."
        )
        warm = [c.temperature for c in self.calibrations if c.temperature is not None]
        if warm and max(warm) - min(warm) > 5.0:
            lines.append(
                f"Temperatures were {min(warm):.0f} to {max(warm):.0f} degC: a change may be that of temperature."
            )
        lines += [f"Left out: {name}, {why}." for name, why in self.left_out.items()]
        return lines

    def summary(self) -> str:
        """Sentences, then a table of all parameters."""
        heads = f"{'parameter':<10}{'first':>14}{'last':>14}{'1 sigma':>12}  {'unit':<9}{'largest step':>13}{'p':>9}"
        lines = [*self.sentences(), "", heads]
        for p in self.parameters.values():
            s = sheet(p.name)
            last, spread = rounded(p.value[-1] / s.factor, p.sigma[-1] / s.factor)
            first = rounded(p.value[0] / s.factor, p.sigma[-1] / s.factor)[0]
            step = "-" if len(p.value) < 2 else f"{p.steps[np.argmax(np.abs(p.steps))]:+.1f} sigma"
            sure = "-" if not np.isfinite(p.p_corrected) else f"{p.p_corrected:.2g}"
            lines.append(f"{p.name:<10}{first:>14}{last:>14}{spread:>12}  {s.unit:<9}{step:>13}{sure:>9}")
        return "\n".join(lines)

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers for JSON. SI"""
        return {
            "serial": self.serial, "dates": list(self.dates), "calibrations": list(self.files),
            "changed": list(self.changed), "correction": self.correction, "level": LEVEL,
            "parameters": {
                p.name: {
                    "unit": unit(p.name), "day": p.day, "value": p.value, "sigma": p.sigma, "mean": p.mean,
                    "chi2": p.chi2, "p": p.p, "p_corrected": p.p_corrected, "changed": p.changed,
                }
                for p in self.parameters.values()
            },
            "left_out": self.left_out,
        }  # fmt: skip

    def report(self, path: Path | str) -> Path:
        """Write the page, see :func:`schuler.calibration.report.unit_history.history_report`."""
        from schuler.calibration.report.unit_history import history_report

        return history_report(self, path)


@explains_arguments
def calibration_history(folder: Path | str, *, serial: str = "") -> UnitHistory:
    """Calibrations of a unit among the files of a folder and its folders.

    Parameters
    ----------
    folder : Path or str
        Every ``.yaml`` or ``.yml`` file in it that is a calibration of this package counts.
    serial : str
        Of the unit, where the folder has several.

    Returns
    -------
    UnitHistory

    Raises
    ------
    InputError
        If there are fewer than two calibrations with a date, or those of several units and no serial number.

    Examples
    --------
    >>> from schuler.calibration import Session, result_from, with_session, write_result
    >>> for day, bias in (("2025-03-03", 1.0e-3), ("2025-09-01", 1.2e-3)):
    ...     result = result_from("sixposition", {"b_g_x": (bias, 1e-5)}, "full")
    ...     _ = write_result(with_session(result, Session(serial="SN-0417", date=day)), f"unit-{day}.yaml")
    >>> schuler.calibration_history(".", serial="SN-0417").changed
    ('b_g_x',)
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise InputError(f"{folder}: expected a folder with calibrations, got none")
    results: dict[str, CalibrationResult] = {}
    left_out: dict[str, str] = {}
    for path in sorted(p for p in folder.rglob("*") if p.suffix in (".yaml", ".yml") and p.is_file()):
        with path.open("rb") as stream:
            if f"format: {FORMAT}".encode() not in stream.read(4096):
                continue
        name = path.relative_to(folder).as_posix()
        try:
            results[name] = read_result(path)
            session_of(results[name])
        except SchulerError as error:
            left_out[name] = str(error)
            results.pop(name, None)
    units = sorted({session_of(r).serial for r in results.values()})
    if not serial and len(units) > 1:
        stated = ", ".join(u or "(none stated)" for u in units)
        raise InputError(f"{folder}: expected calibrations of one unit, got those of {stated}; name it (serial)")
    if serial and serial not in units:
        stated = ", ".join(u for u in units if u) or "none"
        raise InputError(f"{folder}: expected calibrations of the unit {serial}, got those of {stated}")
    wanted = serial or (units[0] if units else "")
    return history_of({n: r for n, r in results.items() if session_of(r).serial == wanted}, left_out=left_out)


def history_of(results: Mapping[str, CalibrationResult], *, left_out: Mapping[str, str] | None = None) -> UnitHistory:
    """History of one unit.

    Parameters
    ----------
    results : mapping of str to CalibrationResult
        By name of their files, of different recordings: errors are taken as independent.
    left_out : mapping of str to str, optional
        Passed on.

    Returns
    -------
    UnitHistory

    Raises
    ------
    InputError
        If fewer than two have a date.

    Notes
    -----
    A parameter is tested for one value at all dates: chi-square of its values about their weighted mean. The
    probabilities of the m parameters are corrected by Holm's rule, which keeps the probability of any wrong "changed"
    at :data:`LEVEL` however the parameters depend on each other.

    References
    ----------
    Holm (1979), A simple sequentially rejective multiple test procedure, Scand. J. Statist. 6.
    """
    from scipy.special import chdtrc

    left = dict(left_out or {})
    dated: list[tuple[str, str, CalibrationResult]] = []
    for name, result in results.items():
        if not (day := session_of(result).date):
            left[name] = "it has no date (calibrate with --date, or add it under provenance.session)"
        elif result.status == "refused":
            left[name] = "it was refused"
        else:
            dated.append((day, name, result))
    dated.sort(key=lambda entry: entry[:2])
    gauges = {r.gauge for _, _, r in dated}
    usable: list[tuple[str, str, CalibrationResult]] = []
    for day, name, result in dated:
        try:
            turned = result if len(gauges) == 1 else result.in_gauge(min(gauges - {"full"}))
        except InputError as error:
            left[name] = str(error)
            continue
        first = usable[0][2].nominal if usable else turned.nominal
        usable.append((day, name, with_nominal(turned, first)))
    if len(usable) < 2:
        reasons = "; ".join(f"{n}: {why}" for n, why in left.items())
        raise InputError(
            f"history: expected two dated calibrations or more, got {len(usable)}{'; ' if reasons else ''}{reasons}"
        )
    days = _days([day for day, _, _ in usable])
    series: dict[str, tuple[FloatArray, FloatArray, FloatArray]] = {}
    names = dict.fromkeys(n for _, _, r in usable for n in r.names)
    order = {n: k for k, n in enumerate(LINEAR)}
    for name in sorted(names, key=lambda n: order.get(n, len(order))):
        rows = [
            (d, *r[name])
            for d, (_, _, r) in zip(days, usable, strict=True)
            if name in r.names and 0.0 < r[name][1] < np.inf
        ]
        if rows:
            series[name] = tuple(np.array(column) for column in zip(*rows, strict=True))  # type: ignore[assignment]
    tests = {}
    for name, (_, value, sigma) in series.items():
        weight = sigma**-2.0
        mean = float(np.sum(weight * value) / weight.sum())
        total = float(np.sum(weight * (value - mean) ** 2))
        tests[name] = (mean, total, float(chdtrc(len(value) - 1, total)) if len(value) > 1 else float("nan"))
    corrected = holm({n: p for n, (_, _, p) in tests.items() if np.isfinite(p)})
    parameters = {n: ParameterHistory(n, *series[n], *tests[n], corrected.get(n, float("nan"))) for n in series}
    return UnitHistory(
        session_of(usable[0][2]).serial, tuple(day for day, _, _ in usable), tuple(n for _, n, _ in usable),
        tuple(r for _, _, r in usable), parameters, left,
    )  # fmt: skip


def holm(p: Mapping[str, float]) -> dict[str, float]:
    """Probabilities of several tests by name, corrected for their number by Holm's rule."""
    ordered, corrected, largest = sorted(p, key=lambda n: p[n]), {}, 0.0
    for k, name in enumerate(ordered):
        largest = max(largest, min(1.0, (len(ordered) - k) * p[name]))
        corrected[name] = largest
    return corrected


def _days(dates: Sequence[str]) -> list[float]:
    """Days since the first date."""
    parsed = [date.fromisoformat(text) for text in dates]
    return [float((d - parsed[0]).days) for d in parsed]
