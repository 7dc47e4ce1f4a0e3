"""Field calibration: an IMU turned by hand between rests, calibrated by the filter that also navigates."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from schuler.arguments import explains_arguments
from schuler.arrays import FloatArray
from schuler.calibration.field.blocks import Blocks, rest_blocks
from schuler.calibration.field.filter_pass import Pass, filter_pass
from schuler.calibration.field.heading import (
    first_pass,
    heading_at,
    level_attitude,
    next_pass,
    search_heading,
    smoothed_heading,
)
from schuler.calibration.field.held_rests import resolve_earth_rate
from schuler.calibration.field.history import FieldHistory, Innovations, innovations_by_kind, parameter_history
from schuler.calibration.field.noise_inflation import scale_variances, variance_factors
from schuler.calibration.field.options import FieldOptions
from schuler.calibration.field.problem import GIVEN_HEADING, Problem, field_layout, field_problem, parameter_names
from schuler.calibration.field.verdicts import field_verdicts, rest_residuals
from schuler.calibration.magnetometer.calibrate import estimates_soft_iron, magnetic_means, with_magnetometer
from schuler.calibration.result.halves import checked, tried
from schuler.calibration.result.parameters import LINEAR
from schuler.calibration.result.result import CalibrationResult, Residuals
from schuler.exceptions import InputError
from schuler.plotting.notebook import Displayed
from schuler.recording.series import ImuSeries
from schuler.standstill.rests import field_rests, given_rests
from schuler.standstill.stationarity import StaticIntervals

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from schuler.sensors.spec import ImuSpec

Progress = Callable[[float], None]

_REST_HALF = 8  # rests of a half that is calibrated by itself
#: Share of its 1-sigma before the log below which a parameter of halves is compared.
LARGEST_SHARE = 0.3
_UPRIGHT = 1.2  # pitch beyond which a half does not begin: the heading of an upright x axis says little [rad]
_NEARLY = 0.5  # largest change over sigma in a pass whose residuals are tested for their noise


@dataclass(frozen=True, repr=False)
class FieldCalibration(Displayed):
    """Result of a field calibration, with the rests, passes and innovations behind it.

    Attributes
    ----------
    calibration : CalibrationResult
        Parameters with covariance, as in every other method.
    history : FieldHistory
        Estimates and uncertainties over the log.
    passes : ndarray, shape (n, p)
        Parameters after each pass.
    rests : StaticIntervals
    nis : dict of str to (float, int)
        Mean normalised innovation squared and number of components, by kind of measurement, of the last pass.
    heading : (float, float) or None
        Heading at the start and its 1-sigma, where it was estimated. [rad]
    innovations : dict of str to Innovations
        Innovations of the last pass over time, by kind of measurement.
    """

    calibration: CalibrationResult
    history: FieldHistory
    passes: FloatArray
    rests: StaticIntervals
    nis: dict[str, tuple[float, int]]
    heading: tuple[float, float] | None = None
    innovations: dict[str, Innovations] = field(default_factory=dict)

    def summary(self) -> str:
        """The calibration, its passes and its innovations as text."""
        return f"{self.calibration.summary()}\n\n{self.course()}"

    def course(self) -> str:
        """Rests, passes and innovations as text."""
        lines = [self.rests.summary().splitlines()[0]]
        if len(self.passes) > 1:
            moved = f"the last moved no parameter by more than {self.last_move:.2g} sigma"
            lines.append(f"{len(self.passes)} passes, {moved}")
        for kind, (mean, count) in self.nis.items():
            lines.append(f"{kind}: {count} components, mean normalised innovation squared {mean:.2f}")
        slow = [name for name, t in self.history.reached().items() if not np.isfinite(t)]
        if slow:
            lines.append(f"not below a tenth of what was known before: {', '.join(slow)}")
        return "\n".join(lines)

    @property
    def last_move(self) -> float:
        """Largest change of a parameter in the last pass, over its sigma; NaN after a single pass. [-]"""
        if len(self.passes) < 2:
            return float("nan")
        sigma = self.calibration.sigma[: self.passes.shape[1]]  # a magnetometer comes after what the filter estimates
        return float(np.max(np.abs(self.passes[-1] - self.passes[-2]) / sigma))

    def _headline(self) -> str:
        return f"{self.calibration._headline()}; {self.rests.summary().partition(chr(10))[0]}"

    def _facts(self) -> tuple[Sequence[str], Sequence[Sequence[str]]]:
        return self.calibration._facts()

    def plot(self, **options: Any) -> Figure:
        """Estimates and uncertainties over time (matplotlib), see :mod:`schuler.calibration.report.field_figures`."""
        from schuler.calibration.report.field_figures import field_figure

        return field_figure(self, **options)

    def report(self, path: Path | str, **options: Any) -> Path:
        """Write one self-contained HTML page, see :mod:`schuler.calibration.report.document`."""
        from schuler.calibration.report.document import calibration_report

        return calibration_report(self.calibration, path, field=self, **options)

    def to_file(self, path: Path | str) -> Path:
        """Write the history as CSV or Parquet, see :mod:`schuler.calibration.field.history`."""
        from schuler.calibration.field.history import write_history

        return write_history(self.history, path)


@explains_arguments
def calibrate_field(
    imu: ImuSeries,
    spec: ImuSpec,
    *,
    latitude: float,
    height: float = 0.0,
    gravity: float | None = None,
    heading: tuple[float, float] | None = None,
    options: FieldOptions | None = None,
    prior: CalibrationResult | None = None,
    rests: StaticIntervals | None = None,
    progress: Progress | None = None,
    halves: bool = True,
    linearised_at: CalibrationResult | None = None,
    field_strength: float | None = None,
    soft_iron: bool | None = None,
) -> FieldCalibration:
    """Calibrate both triads, and a magnetometer of the log, from rests and turns by hand.

    Parameters
    ----------
    imu : ImuSeries
        Raw readings, SI.
    spec : ImuSpec
        1-sigma of the errors of the IMU before the log, and its noise.
    latitude, height : float
        Place of the calibration. [rad], [m]
    gravity : float, optional
        Local gravity where that of the ellipsoid is not good enough (off by 1e-4 in mountains). [m/s^2]
    heading : (float, float), optional
        Heading of the first rest, from north over east, and its 1-sigma [rad]. Where it is not given, or to more than
        half a radian, it is estimated: the Earth's horizontal rate depends on it.
    options : FieldOptions, optional
    prior : CalibrationResult, optional
        An earlier calibration, whose values and variances replace zero and the specification.
    rests : StaticIntervals, optional
        Rests of the unit; detected by :func:`schuler.standstill.rests.field_rests` by default.
    progress : callable, optional
        Called with the fraction done.
    halves : bool
        Calibrate the first and the second half of the rests by themselves too, from sixteen rests on and with more than
        one pass, and hold the claims against it, see :func:`schuler.calibration.result.halves.checked`. Each half
        begins with the heading that the complete log has there. It takes a tenth to three quarters of the time again.
    linearised_at : CalibrationResult, optional
        Parameters the first pass is linearised at, instead of the prior: those of a log this one is a part of.
    field_strength : float, optional
        Strength of the local magnetic field, for the scale of a magnetometer. None: relative. [T]
    soft_iron : bool, optional
        Estimate the soft iron of a magnetometer. None: with nine rests or more.

    Returns
    -------
    FieldCalibration
        Refused, with advice on what to collect, where the log does not suffice.

    Raises
    ------
    InputError
        If the log does not fit the place, the rests or the specification.

    Notes
    -----
    At rest the mean specific force is compared with gravity in the axes of the attitude that the gyroscopes carried
    there, all columns kept (secondary), and the mean rate with the Earth's, all three axes, unless the log shows that
    the unit sways (primary; see :mod:`schuler.calibration.field.held_rests`). Velocity is held with large noise, so no
    reading is used twice. Passes are repeated, each linearised at the result of the one before, until the parameters
    settle; the prior counts once (see :mod:`schuler.calibration.field.filter_pass`).

    Axes: upper gauge, body z is the z accelerometer.

    References
    ----------
    Yaman (2017), chapters 4 and 5. Departures: vectors instead of magnitudes, rests held, iterated.

    Examples
    --------
    >>> import numpy as np
    >>> from schuler.sensors import catalogue
    >>> unit = schuler.simulate("examples/field_routine.toml")  # or schuler.read("turned.csv")
    >>> field = schuler.calibrate_field(
    ...     unit.imu, catalogue.spec("yaman-automotive"), latitude=np.radians(39.92), height=1000.0
    ... )
    >>> field.calibration.status
    'ok'
    """
    options = options or FieldOptions()
    rests = field_rests(imu) if rests is None else rests
    if not len(rests):
        raise InputError(
            "no rest was found in the log: lay the unit down or hold it still for ten seconds between turns, or give "
            "the rests yourself"
        )
    layout = field_layout(spec, options)
    blocks = rest_blocks(imu, rests, options.block_s)
    chosen, options = options.earth_rate, resolve_earth_rate(options, spec, blocks, rests)
    swaying = options.earth_rate != chosen and options.earth_rate == "vertical"
    problem = field_problem(imu, spec, blocks, rests, layout, options, latitude, height, gravity, heading, prior)
    problem = replace(problem, near=linearised_at is not None)
    rpy = level_attitude(blocks, problem, problem.prior if linearised_at is None else linearised_at.values)
    if heading is not None:
        rpy[2] = heading[0]
    observable = options.secondary != "off" or options.earth_rate != "off"
    heading_given = not observable or (heading is not None and heading[1] <= GIVEN_HEADING)
    if not heading_given:
        near = None if linearised_at is None else (linearised_at.values, 3.0 * linearised_at.sigma)
        best = search_heading(problem, blocks, rpy, np.inf if heading is None else heading[1], near)
    else:  # a single pass is that of the thesis, from the prior itself
        best = first_pass(problem, blocks, rpy) if options.passes > 1 else filter_pass(problem, rpy)
    problem, best, passes, scales = _relinearised(problem, blocks, rests, options, best, heading_given, progress)
    if progress is not None:
        progress(1.0)
    complete = _field_result(imu, spec, problem, best, passes, blocks, rests, scales, options, heading_given, swaying)
    six_axes = complete.calibration
    complete = replace(complete, calibration=_with_magnetometer(six_axes, imu, rests, field_strength, soft_iron))
    if not halves or options.passes < 2 or len(rests) < 2 * _REST_HALF:
        return complete

    def part(which: slice) -> CalibrationResult:
        a, b = rests.index[which][0, 0], rests.index[which][-1, 1]
        some = imu.between(float(imu.t[a]), float(imu.t[b - 1]))
        spans = [(float(imu.t[i]), float(imu.t[j - 1])) for i, j in rests.index[which]]
        result = calibrate_field(
            some, spec, latitude=latitude, height=height, gravity=gravity, heading=headings[a],
            options=options, prior=prior, rests=given_rests(some, spans), halves=False,
            linearised_at=six_axes, field_strength=field_strength,
            soft_iron=estimates_soft_iron(complete.calibration),
        ).calibration  # fmt: skip
        return _without_prior(result)

    # half a log finds a wrong heading now and then: it begins with that of the complete one, in a pose that has one
    second, heading_there = _second_start(problem, best, rests)
    headings = {rests.index[0, 0]: heading, rests.index[second, 0]: heading_there}
    if not heading_given:
        headings[rests.index[0, 0]] = smoothed_heading(problem, best)
    parts = tried(part, (slice(0, len(rests) // 2), slice(second, None)))
    calibration = checked(
        complete.calibration, {"first and second half": parts}, needs="not compared: a half is refused"
    )
    return replace(complete, calibration=calibration)


def _relinearised(
    problem: Problem,
    blocks: Blocks,
    rests: StaticIntervals,
    options: FieldOptions,
    best: Pass,
    heading_given: bool,
    progress: Progress | None,
) -> tuple[Problem, Pass, FloatArray, dict[str, float]]:
    """Passes, each linearised at the one before, until the parameters settle.

    Returns
    -------
    problem : Problem
        With the variances that the residuals of the rests ask for.
    best : Pass
        The last one.
    passes : ndarray, shape (n, k)
        Parameters after each.
    scales : dict of str to float
        Factors of variances, by kind of measurement.
    """
    passes, names = [best.values], parameter_names(problem.layout)
    scales: dict[str, float] = {}
    tested = False
    while len(passes) < options.passes:
        best = next_pass(problem, blocks, best, heading_given)
        change = np.max(np.abs(best.values - passes[-1]) / np.sqrt(np.diag(best.covariance)))
        passes.append(best.values)
        if progress is not None:
            progress(min(0.95, len(passes) / 4.0))
        if best.noise_inflation > 1.0:
            continue
        if options.rescale and not tested and change < _NEARLY:
            tested = True
            residuals = rest_residuals(blocks, rests, dict(zip(names, best.values, strict=True)), problem)
            scales = variance_factors(best, problem, residuals, names, 0.5 * (rests.start + rests.stop))
            if scales:
                problem = replace(problem, schedule=scale_variances(problem.schedule, scales))
                continue
        if change < options.settled:
            break
    return problem, best, np.array(passes), scales


def _without_prior(result: CalibrationResult) -> CalibrationResult:
    """Calibration with infinite variance where the prior still contributes, which both halves have in common."""
    vague = result.sigma > LARGEST_SHARE * np.array([result.prior_sigma.get(n, np.inf) for n in result.names])
    P = result.covariance.copy()
    P[vague, vague] = np.inf
    return replace(result, covariance=P)


def _is_positive_definite(P: FloatArray) -> bool:
    """Whether a covariance is one, whatever the units of its parameters: rounding that wins in a filter ends there."""
    diagonal = np.diag(P)
    if not (np.isfinite(P).all() and (diagonal > 0.0).all()):
        return False
    weights = 1.0 / np.sqrt(diagonal)
    return bool(np.linalg.eigvalsh(P * np.outer(weights, weights))[0] > 0.0)


def _second_start(problem: Problem, best: Pass, rests: StaticIntervals) -> tuple[int, tuple[float, float]]:
    """First rest of the second half in a pose that has a heading, with that heading and its 1-sigma. [rad]"""
    middle = len(rests) // 2
    starts = {k: heading_at(problem, best, float(rests.start[k])) for k in range(middle, middle + _REST_HALF // 2)}
    second = min(starts, key=lambda k: (abs(starts[k][2]) > _UPRIGHT, k))
    return second, starts[second][:2]


def _field_result(
    imu: ImuSeries,
    spec: ImuSpec,
    problem: Problem,
    last: Pass,
    passes: FloatArray,
    blocks: Blocks,
    rests: StaticIntervals,
    scales: dict[str, float],
    options: FieldOptions,
    heading_given: bool,
    swaying: bool,
) -> FieldCalibration:
    """Result, verdicts and history of the last pass."""
    names = parameter_names(problem.layout)
    if not (np.isfinite(last.values).all() and _is_positive_definite(last.covariance)):
        raise InputError(
            f"the filter diverged: the log does not fit the specification {spec.name}. Check units and axes of the "
            "log, and that the uncertainties of the specification allow for the errors of the IMU"
        )
    history = parameter_history(problem, last, names)
    prior_sigma = dict(zip(names, np.sqrt(problem.layout.initial_variances()).tolist(), strict=True))
    sigma = np.sqrt(np.diag(last.covariance))
    weights = 1.0 / sigma
    normal = np.linalg.inv(last.covariance * np.outer(weights, weights))
    d = np.sqrt(np.diag(normal))
    condition = float(np.linalg.cond(normal / np.outer(d, d)))
    families = {name[:3] for name in names}
    fixed = {n: 0.0 for n in LINEAR if n not in names and (n[:3] in families or n[:3] in ("M_a", "M_g"))}
    heading = None if heading_given else smoothed_heading(problem, last)
    moved = np.abs(passes[-1] - passes[-2]) / sigma if len(passes) > 1 else None
    left_out = tuple(name for name in options.blocks if name not in problem.layout)
    verdict = field_verdicts(
        names, last.covariance, prior_sigma, rests, blocks, scales, heading, off=last.values - problem.prior,
        moved=moved, settled=options.settled, left_out=left_out, swaying=swaying,
    )  # fmt: skip
    dof = sum(count for _, count in last.nis.values())
    residuals: dict[str, Residuals] = rest_residuals(blocks, rests, dict(zip(names, last.values, strict=True)), problem)
    result = CalibrationResult(
        "field", names, last.values, last.covariance, "upper",
        fixed=fixed, status=verdict.status, verdicts=verdict.sentences, condition=condition,
        prior_sigma=prior_sigma, variance_of_unit_weight=last.cost / dof if dof else float("nan"), freedom=dof,
        residuals=residuals, next_pose=verdict.advice,
        temperature=None if imu.temperature is None else float(np.mean(imu.temperature)), history=passes,
        extra={"noise_enlarged": scales} | ({"heading": list(heading)} if heading else {}),
        provenance={"spec": spec.name, "options": _options_as_dict(options), "latitude": float(problem.llh[0])},
    )  # fmt: skip
    nis = {kind: (total / count if count else float("nan"), count) for kind, (total, count) in last.nis.items()}
    innovations = innovations_by_kind(problem.schedule, last.run)
    return FieldCalibration(result, history, passes, rests, nis, heading, innovations)


def _with_magnetometer(
    result: CalibrationResult, imu: ImuSeries, rests: StaticIntervals, field: float | None, soft_iron: bool | None
) -> CalibrationResult:
    """The magnetometer of the log in the same rests; the result as it was without one, or without accelerometers."""
    magnetic = magnetic_means(imu, rests.index)
    if magnetic is None or "M_a_xx" not in result.parameters:
        return result
    labels = result.residuals["accel"].label
    return with_magnetometer(result, rests.means(imu)[1], *magnetic, labels, field=field, soft_iron=soft_iron)


def _options_as_dict(options: FieldOptions) -> dict[str, Any]:
    """Options in the form of the provenance."""
    plain = {name: getattr(options, name) for name in options.__slots__ if name != "models"}
    plain["blocks"] = list(options.blocks)
    return plain | {"models": {k: v.describe() for k, v in options.models.items()}}
