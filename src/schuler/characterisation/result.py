"""Results of identification: findings, noise terms of every axis with their uncertainty, and the budget."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal, TypeAlias

import numpy as np

from schuler.arrays import ArrayLike, FloatArray
from schuler.characterisation.allan import AllanCurve
from schuler.plotting.notebook import Displayed
from schuler.sensors.noise import NoiseModel
from schuler.sensors.spec import ImuSpec

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from schuler.characterisation.turn_on import TurnOn

#: Names of the terms; the unit of x is rad/s or m/s^2.
TERMS = {
    "Q": "quantisation",
    "N": "white noise (angle or velocity random walk)",
    "B": "bias instability",
    "K": "rate random walk",
    "R": "rate ramp",
}
AXES = ("gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z")
Severity: TypeAlias = Literal["note", "warning", "refused"]
#: Probability of a false finding of one kind (motion, outliers, steps, stuck values) in a clean log.
FALSE_ALARM = 0.01
#: Places named for one kind of finding.
MOST_PLACES = 3


@dataclass(frozen=True, slots=True)
class Estimate:
    """A number with its uncertainty.

    Attributes
    ----------
    value : float
    sigma : float
        1-sigma uncertainty.
    low, high : float
        95 % interval, not necessarily symmetric; of a noise term over all models that the data do not tell apart, from
        zero on where some of them do without it.
    unit : str
        SI, for people.
    """

    value: float
    sigma: float
    low: float
    high: float
    unit: str = ""


@dataclass(frozen=True, slots=True)
class Candidate:
    """A combination of terms that was tried.

    Attributes
    ----------
    terms : str
        Such as ``"N + K + GM"``.
    misfit : float
        Weighted sum of squares between curve and model; near ``freedom`` if the model is right.
    freedom : int
        Averaging times less parameters.
    criterion : float
        What was minimised over the candidates.
    """

    terms: str
    misfit: float
    freedom: int
    criterion: float


@dataclass(frozen=True, repr=False)
class AxisNoise(Displayed):
    """Noise of one axis.

    Attributes
    ----------
    axis : str
        One of :data:`AXES`.
    unit : str
        Unit of the signal, ``rad/s`` or ``m/s^2``.
    rate_hz, duration_s : float
    mean : Estimate
        Mean of the log: bias plus what the sensor really felt (Earth rate, gravity). [x]
    curve : AllanCurve
        Overlapping Allan deviation, the one that is shown.
    terms : dict of str to Estimate
        Those of Q [x s], N [x/sqrt(Hz)], B [x], K [x*sqrt(Hz)], R [x/s] that the model has.
    gauss_markov : tuple of (Estimate, Estimate)
        Standard deviation [x] and correlation time [s] of each Gauss-Markov term, shortest first.
    model : NoiseModel
        The same as something to simulate.
    names : tuple of str
        Parameters in the order of ``covariance``: Q, N, B, K, R as far as they are there, sigma_1, tau_1, ...; V in
        place of Q is the rest of a vibration, which is in the model's spectrum and not among the terms.
    covariance : ndarray, shape (p, p)
        Covariance of the natural logarithms of the parameters.
    limits : dict of str to float
        Upper ends (97.5 %) of B, K and R that the model does not have and others that fit nearly as well do.
    candidates : tuple of Candidate
        All models tried, best first.
    read_off : dict of str to float
        What the eye reads from the curve, for comparison: ``N_at_1s``, ``minimum``, ``minimum_tau_s``, ``K_at_3s``.
    method : str
    findings : tuple of Finding
    """

    axis: str
    unit: str
    rate_hz: float
    duration_s: float
    mean: Estimate
    curve: AllanCurve
    terms: dict[str, Estimate]
    gauss_markov: tuple[tuple[Estimate, Estimate], ...]
    model: NoiseModel
    names: tuple[str, ...]
    covariance: FloatArray
    candidates: tuple[Candidate, ...] = ()
    limits: dict[str, float] = field(default_factory=dict)
    read_off: dict[str, float] = field(default_factory=dict)
    method: str = ""
    findings: tuple[Finding, ...] = ()

    HEADS: ClassVar[tuple[str, ...]] = ("axis", "term", "value", "95 % interval", "unit")

    def _headline(self) -> str:
        return f"{self.axis}, {self.duration_s:.1f} s at {self.rate_hz:g} Hz, {', '.join(self.names)}"

    def _facts(self) -> tuple[Sequence[str], Sequence[Sequence[str]]]:
        from schuler.characterisation.report.terms import numbers
        from schuler.characterisation.report.text import rounded

        rows = []
        for _, q, estimate in numbers(self):
            value, low, high = rounded(estimate, q.factor)
            rows.append((self.axis, q.name, value, f"{low} to {high}", q.sheet))
        return self.HEADS, rows

    def fitted(self, tau: ArrayLike) -> FloatArray:
        """Allan deviation of samples of the identified model, at ``tau`` [s] rounded to whole samples. [x]"""
        m = np.maximum(np.round(np.asarray(tau, dtype=np.float64) * self.rate_hz), 1.0).astype(np.int64)
        deviation: FloatArray = np.sqrt(self.model.discrete_allan_variance(m, 1.0 / self.rate_hz))
        return deviation


@dataclass(frozen=True, repr=False)
class NoiseIdentification(Displayed):
    """Noise of an IMU, as found in one or several recordings at rest.

    Attributes
    ----------
    name : str
    axes : dict of str to AxisNoise
        The axes that could be identified.
    refused : dict of str to tuple of Finding
        The axes that could not, and why.
    spec : ImuSpec or None
        One budget for each triad, for simulator and filter; None if a triad has no axis left.
    spec_sigma : dict of str to dict of str to float
        Relative 1-sigma uncertainty of the entries of ``spec``: ``{"gyro": {"random_walk": 0.01, ...}, "accel": ...}``.
    findings : tuple of Finding
        About the recording as a whole.
    notes : tuple of str
        What was assumed or left out.
    provenance : dict
        Version, options, sources and their SHA-256.
    turn_on : dict of str to TurnOn
        Mean over the recordings and spread from one to the next, one axis each, of three recordings and more; empty of
        fewer. The budget's turn-on bias of the gyroscopes is then their spread, not the mean.
    """

    name: str
    axes: dict[str, AxisNoise]
    refused: dict[str, tuple[Finding, ...]]
    spec: ImuSpec | None
    spec_sigma: dict[str, dict[str, float]]
    findings: tuple[Finding, ...] = ()
    notes: tuple[str, ...] = ()
    provenance: dict[str, Any] = field(default_factory=dict)
    turn_on: dict[str, TurnOn] = field(default_factory=dict)

    def summary(self) -> str:
        """Terms of every axis with their intervals, findings and the budget, as text."""
        from schuler.characterisation.report.text import summary

        return summary(self)

    def _headline(self) -> str:
        from schuler.characterisation.report.text import headline

        return headline(self)

    def _facts(self) -> tuple[Sequence[str], Sequence[Sequence[str]]]:
        rows = [row for axis in self.axes.values() for row in axis._facts()[1] if row[1].endswith(("N", "B"))]
        return AxisNoise.HEADS, rows

    def plot(self, **options: Any) -> Figure:
        """Allan figure of every axis (matplotlib), see :func:`schuler.characterisation.report.figures.allan_figure`."""
        from schuler.characterisation.report.figures import allan_figure

        return allan_figure(self, **options)

    def report(self, path: Path | str, **options: Any) -> Path:
        """Write one self-contained HTML page, see :func:`schuler.characterisation.report.document.noise_report`."""
        from schuler.characterisation.report.document import noise_report

        return noise_report(self, path, **options)


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing about a log that its reader should know before believing a number made of it.

    Attributes
    ----------
    code : str
        Short name for scripts: ``too_short``, ``step``, ``saturated``, ``stuck``, ``motion``, ``trend``,
        ``temperature``, ``gap``, ``outliers``, ``coarse``, ``not_at_rest``, ...
    text : str
        One sentence: what was seen, what it does to the result, what to do.
    start_s, stop_s : float or None
        Where, in seconds from the start of the recording; None for all of it.
    severity : {"note", "warning", "refused"}
        ``refused``: no number is given.
    """

    code: str
    text: str
    start_s: float | None = None
    stop_s: float | None = None
    severity: Severity = "warning"


def finding_at(code: str, text: str, start: float, stop: float, severity: Severity = "warning") -> Finding:
    """A finding with its place, in seconds from the start of the recording."""
    return Finding(code, text, float(start), float(stop), severity)
