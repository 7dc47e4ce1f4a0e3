"""Errors of an IMU from its calibration and its budget, in the IMU's axes and at a later time."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from schuler import units
from schuler.arrays import BoolArray, FloatArray, IntArray
from schuler.calibration.result.parameters import LINEAR
from schuler.calibration.result.result import CalibrationResult
from schuler.calibration.result.sheet import sheet
from schuler.calibration.thermal.correction import thermal_value
from schuler.exceptions import InputError
from schuler.filtering.states import BLOCKS, StateLayout
from schuler.navigation.start.sensor_errors import B_A, B_G, G_G, HELD, M_A, M_G, SIZE, SensorErrors
from schuler.sensors.spec import ImuSpec, TriadSpec

_WANDER = 1.9  # standard deviation of flicker noise over a run, in B, as in layout_for
_WARMER = 5.0  # difference to the temperature of the calibration that is worth a note [K]


@dataclass(frozen=True)
class Age:
    """Changes of the IMU between its calibration and a log.

    Attributes
    ----------
    switched : bool
        Whether it was switched off and on.
    gyro, accel : float or None
        1-sigma of the change of a bias from one switch-on to the next, None for that of the budget. [rad/s], [m/s^2]
    temperature : float or None
        Mean temperature of the log. [degC]
    """

    switched: bool = True
    gyro: float | None = None
    accel: float | None = None
    temperature: float | None = None


def at_temperature(result: CalibrationResult, temperature: float | None) -> CalibrationResult:
    """Calibration without its temperature-dependent part; itself if it is not a thermal one.

    Raises
    ------
    InputError
        If it is a thermal one and there is no temperature, or one that is out of its range.
    """
    if "thermal" not in result.extra:
        return result
    if temperature is None:
        raise InputError(
            "calibration: it depends on temperature, and the log has none; read the log with its temperature column, "
            "or give a calibration at one temperature"
        )
    sigma = np.array([float(thermal_value(result, name, temperature)[1]) for name in result.names])
    sigma = np.where(np.isfinite(result.sigma), sigma, np.inf)
    calibrated_errors = np.where(np.isfinite(sigma), sigma, 0.0)
    covariance = result.correlation * np.outer(calibrated_errors, calibrated_errors)
    np.fill_diagonal(covariance, sigma**2)
    return replace(result, values=np.zeros(len(sigma)), covariance=covariance, temperature=None, history=None)


def calibrated_errors(result: CalibrationResult, layout: StateLayout, spec: ImuSpec, notes: list[str]) -> SensorErrors:
    """All 33 errors of a calibrated IMU; those that are not calibrated have the spread of the budget.

    Parameters
    ----------
    result : CalibrationResult
    layout : StateLayout
        Its models give the uncertainty of its states that are not calibrated.
    spec : ImuSpec
        Gives the uncertainty of the others.
    notes : list of str
        Gets a sentence on what is not determined, held, or has no place in a filter.
    """
    values, variance = np.zeros(SIZE), _prior(layout, spec) ** 2
    covariance = np.diag(variance)
    measured, calibrated = np.zeros(SIZE, dtype=bool), np.zeros(SIZE, dtype=bool)
    place = {name: i for i, name in enumerate(LINEAR)}
    finite = np.isfinite(result.sigma)
    use = np.array([name in place for name in result.names], dtype=bool) & finite
    at = np.array([place[name] for name, u in zip(result.names, use, strict=True) if u], dtype=np.int64)
    values[at], measured[at], calibrated[at] = result.values[use], True, True
    covariance[np.ix_(at, at)] = result.covariance[np.ix_(use, use)]
    of_M_a = any(name.startswith("M_a") for name in result.names)
    for i in HELD.get(result.gauge, ()):
        if of_M_a and not calibrated[i]:
            covariance[i, i], measured[i], calibrated[i] = 0.0, True, True
    held = {n: v for n, v in result.fixed.items() if n in place and not calibrated[place[n]]}
    for name, value in held.items():
        values[place[name]], calibrated[place[name]] = value, True
    if _gyro_axes_own(result):
        _turn_between_triads(covariance, measured, calibrated, spec.gyro.misalignment)
        notes.append(
            "M_g of this calibration is in the gyroscopes' own axes: the rotation between the triads is taken as "
            f"unknown, 1-sigma {1e3 * spec.gyro.misalignment:.2g} mrad about each axis (misalignment of the budget)"
        )
    lost = [n for n, f in zip(result.names, finite, strict=True) if not f and n in place]
    if lost:
        notes.append(f"not determined by the calibration, as uncertain as without it: {_joined_names(lost)}")
    if held:
        notes.append(f"held in the calibration, so as uncertain as without it: {_joined_names(list(held))}")
    others = [n for n in (*result.names, *result.fixed) if n not in place]
    if others:
        notes.append(f"not used, no linear error of the sensors: {', '.join(others)}")
    return SensorErrors(values, covariance, calibrated, measured)


def aged_errors(
    errors: SensorErrors, layout: StateLayout, spec: ImuSpec, age: Age, temperature: float | None, notes: list[str]
) -> SensorErrors:
    """Add the growth of uncertainty since the calibration: wander, switch-on, temperature.

    Parameters
    ----------
    errors : SensorErrors
    layout : StateLayout
    spec : ImuSpec
    age : Age
    temperature : float or None
        Temperature of the calibration. [degC]
    notes : list of str
    """
    more = np.zeros(SIZE)
    for part, block, triad, given in ((B_G, "b_g", spec.gyro, age.gyro), (B_A, "b_a", spec.accel, age.accel)):
        more[part] = _wander(triad, f"{block}_run" in layout)
        if age.switched:
            more[part] += (triad.turn_on_bias if given is None else given) ** 2
    warmer = 0.0 if None in (temperature, age.temperature) else (age.temperature or 0.0) - (temperature or 0.0)
    for part, M, triad in ((B_G, M_G, spec.gyro), (B_A, M_A, spec.accel)):
        more[part] += (triad.bias_temperature * warmer) ** 2
        more[M] += np.eye(3).ravel() * (triad.scale_temperature * warmer) ** 2
    covariance = errors.covariance + np.diag(np.where(errors.measured, more, 0.0))
    for part, sensor, factor, unit in (
        (B_G, "gyroscopes", units.DEG_PER_HR, "deg/h"), (B_A, "accelerometers", units.MG, "mg"),
    ):  # fmt: skip
        if errors.measured[part].any():
            then, later = (np.sqrt(np.diag(C)[part].max()) / factor for C in (errors.covariance, covariance))
            notes.append(
                f"biases of the {sensor}: 1-sigma {then:.3g} {unit} when calibrated, {later:.3g} {unit} at the start"
                + ("" if age.switched else "; the unit is said to have stayed switched on")
            )
    if abs(warmer) > _WARMER:
        slopes = any(t.bias_temperature or t.scale_temperature for t in (spec.gyro, spec.accel))
        notes.append(
            f"the IMU is {abs(warmer):.0f} K {'warmer' if warmer > 0.0 else 'colder'} than when it was calibrated: "
            + ("the budget's temperature slopes are in the sigmas" if slopes else "the budget says nothing of that")
        )
    return replace(errors, covariance=covariance)


def state_places(layout: StateLayout) -> tuple[IntArray, IntArray, BoolArray]:
    """Places of the states of a layout among the 33 errors.

    Returns
    -------
    state, linear : ndarray of int, shape (k,)
        Places among the parameters of the layout and among the 33; in-run blocks beside constant biases have none.
    lasting : ndarray of bool, shape (k,)
        Whether the state keeps a value: false for Gauss-Markov processes.
    """
    rows = []
    for name, model in layout.models.items():
        if name.endswith("_run") or BLOCKS[name][0][0] < 0:
            continue
        for k, (sensor, axis, source) in enumerate(BLOCKS[name]):
            if sensor == 1:
                at = axis if source == 0 else M_A.start + 3 * axis + source - 1
            elif source > 3:
                at = M_G.start + 3 * axis + source - 4
            else:
                at = B_G.start + axis if source == 0 else G_G.start + 3 * axis + source - 1
            rows.append((layout[name].start - 9 + k, at, model.tau is None))
    table = np.array(rows, dtype=np.int64).reshape(-1, 3)
    return table[:, 0], table[:, 1], table[:, 2] == 1


def sigma_at_rest(errors: SensorErrors, bias: slice, M: slice, triad: TriadSpec) -> float:
    """1-sigma of a triad's calibrated reading at rest and level, RMS over its axes; ``M`` acts on the force."""
    C, down = errors.covariance, np.arange(M.start + 2, M.stop, 3)
    b = np.arange(bias.start, bias.stop)
    w = np.where(errors.calibrated[down], -units.G0, 0.0)
    variance = np.where(errors.calibrated[b], C[b, b], triad.turn_on_bias**2)
    variance = variance + w * (2.0 * np.where(errors.calibrated[b], C[b, down], 0.0) + w * C[down, down])
    return float(np.sqrt(np.maximum(variance, 0.0).mean()))


def with_gravity_share(errors: SensorErrors, not_estimated: BoolArray, notes: list[str]) -> SensorErrors:
    """Add to the biases what gravity makes of the errors that are taken out and not estimated, at a level attitude.

    Parameters
    ----------
    errors : SensorErrors
        Errors of the corrected log.
    missing : ndarray of bool, shape (33,)
        Errors without a state.
    notes : list of str
        Gets a sentence on what is taken out, and how uncertain it is.
    """
    removed = errors.calibrated & not_estimated
    if not removed.any():
        return errors
    C = errors.covariance.copy()
    variance = np.where(removed, np.diag(C), 0.0)
    for bias, M in ((B_A, M_A), (B_G, G_G)):
        at = np.arange(bias.start, bias.stop)
        C[at, at] += np.where(not_estimated[at], 0.0, units.G0**2 * variance[M][2::3])
    families = dict.fromkeys(sheet(LINEAR[i]).family for i in np.flatnonzero(removed))
    parts = ((M_A, units.PPM, "ppm of specific force"), (M_G, units.PPM, "ppm of rate"),
             (G_G, units.DEG_PER_HR_PER_G, "deg/h/g"))  # fmt: skip
    sizes = [
        f"{np.sqrt(variance[part].max()) / factor:.3g} {unit}" for part, factor, unit in parts if variance[part].any()
    ]
    text = f"taken out of the log, with no state to improve them: {', '.join(families)}"
    if sizes:
        text += f"; uncertain by up to {', '.join(sizes)}: gravity's share is in the biases, the rest in no sigma"
    notes.append(text)
    return replace(errors, covariance=C)


def _joined_names(names: list[str]) -> str:
    """Names of parameters, or of their families if they are many."""
    return ", ".join(names if len(names) < 7 else dict.fromkeys(sheet(name).family for name in names))


def _prior(layout: StateLayout, spec: ImuSpec) -> FloatArray:
    """1-sigma of all errors without a calibration. Shape (33,)."""
    sigma = np.zeros(SIZE)
    for b, M, triad in ((B_A, M_A, spec.accel), (B_G, M_G, spec.gyro)):
        sigma[b] = np.sqrt(triad.turn_on_bias**2 + 0.5 * _wander(triad, False))
        sigma[M] = np.where(np.eye(3, dtype=bool).ravel(), triad.scale_factor, triad.misalignment)
    sigma[G_G] = spec.gyro.g_sensitivity
    state, linear, _ = state_places(layout)
    sigma[linear] = np.sqrt(layout.initial_variances()[state])
    return sigma


def _wander(triad: TriadSpec, separate: bool) -> float:
    """Variance of the change of a bias between two moments far apart; with a state for the in-run part less that."""
    return (1.0 if separate else 2.0) * triad.in_run_bias**2 + 2.0 * (_WANDER * triad.bias_instability) ** 2


def _gyro_axes_own(result: CalibrationResult) -> bool:
    """Whether M_g is in the gyroscopes' own axes, off its diagonal too, as calibrate_multiposition gives it."""
    own = result.method == "multiposition" and "gyro" in result.extra and "turn" not in result.extra
    return own and any(name.startswith("M_g") and name[-1] != name[-2] for name in result.names)


def _turn_between_triads(covariance: FloatArray, measured: BoolArray, calibrated: BoolArray, sigma: float) -> None:
    """A rotation of the gyroscopes' axes, 1-sigma [rad] about each: M_g is triangular in them, not in the body's."""
    for i, j in ((0, 1), (0, 2), (1, 2)):
        a, b = M_G.start + 3 * i + j, M_G.start + 3 * j + i
        for k in (a, b):
            if not measured[k]:
                covariance[k, k] = 0.0
        covariance[np.ix_((a, b), (a, b))] += sigma**2 * np.array([[1.0, -1.0], [-1.0, 1.0]])
        measured[[a, b]] = calibrated[[a, b]] = True
