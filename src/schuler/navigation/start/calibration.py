"""Start of a filter from a calibration: values and covariance of its sensor states, the remainder taken out of the log.

The corrected log and the initial states together explain the readings as the calibration does: errors with a state stay
in the log and are states with the calibration's value and uncertainty, correlations included; errors without a state
are taken out beforehand.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from schuler import earth, rotation, units
from schuler.arrays import ArrayLike, FloatArray, IntArray, as_vector3
from schuler.calibration.result.result import CalibrationResult
from schuler.calibration.result.result_file import read_result, result_text
from schuler.calibration.thermal.correction import compensate_thermal
from schuler.exceptions import ConfigError, FileFormatError, InputError
from schuler.files import sha256
from schuler.filtering.error_model import parameter_columns, sensor_matrices
from schuler.filtering.initial_state import InitialState
from schuler.filtering.states import StateLayout
from schuler.mechanization.alignment import Alignment
from schuler.navigation.config import NavigationConfig
from schuler.navigation.start.calibrated_errors import (
    Age,
    aged_errors,
    at_temperature,
    calibrated_errors,
    sigma_at_rest,
    state_places,
    with_gravity_share,
)
from schuler.navigation.start.sensor_errors import (
    B_A,
    B_G,
    G_G,
    HELD,
    M_A,
    SIZE,
    Correction,
    SensorErrors,
    rotated_errors,
    split_errors,
    upper_gauge_errors,
)
from schuler.navigation.states import imu_spec, sensor_layout
from schuler.plotting.notebook import Abridged
from schuler.recording.series import ImuSeries
from schuler.sensors.errors import ImuErrors
from schuler.sensors.spec import ImuSpec


@dataclass(frozen=True, repr=False)
class CalibrationStart(Abridged):
    """Sensor states and correction of the log that follow from a calibration.

    Attributes
    ----------
    calibration : CalibrationResult
    places : ndarray of int, shape (k,)
        Places of the states that start from it, among the parameters of the layout.
    values : ndarray, shape (k,)
        SI.
    covariance : ndarray, shape (k, k)
        SI, with what changes from one switch-on to the next.
    errors : SensorErrors
        All 33 errors of the log that the filter gets.
    correction : Correction
        Correction of a log in SI and the axes of the vehicle.
    sigma_gyro, sigma_accel : float
        1-sigma of rate and specific force at rest and level after calibration, RMS over the axes. [rad/s], [m/s^2]
    notes : tuple of str
    provenance : dict
    """

    calibration: CalibrationResult
    places: IntArray
    values: FloatArray
    covariance: FloatArray
    errors: SensorErrors
    correction: Correction
    sigma_gyro: float
    sigma_accel: float
    notes: tuple[str, ...] = ()
    provenance: dict[str, Any] = field(default_factory=dict)

    def put_into(self, initial: InitialState) -> InitialState:
        """An initial state with the calibrated parameters and their covariance.

        Parameters
        ----------
        initial : InitialState
            Its own estimates of these parameters, and what correlates with them, are dropped.

        Raises
        ------
        InputError
            If it has fewer parameters than the layout of this start.
        """
        if len(self.places) and self.places.max() >= len(initial.parameters):
            raise InputError(
                f"initial: expected the states of the calibration's layout, at least {self.places.max() + 10}, got "
                f"{len(initial.P)}; make both with the same layout"
            )
        parameters, P = initial.parameters.copy(), initial.P.copy()
        at = 9 + self.places
        parameters[self.places] = self.values
        P[at, :] = P[:, at] = 0.0
        P[np.ix_(at, at)] = self.covariance
        return InitialState(initial.nav, P, parameters)

    def in_si(self, imu: ImuSeries) -> ImuSeries:
        """A log as recorded, in the IMU's axes, times the factors of the calibration; temperature's part taken out.

        Raises
        ------
        InputError
            If the log is not in the units of the calibrated one, or lacks the temperature that the calibration needs.
        """
        accel, gyro = self.calibration.nominal
        if (accel, gyro) != (1.0, 1.0):
            imu = replace(imu, accel=imu.accel * accel, gyro=imu.gyro * gyro)
            # biases of a converter without sign are half of its range, tens of g
            f = imu.rates().accel - self.calibration.errors.b_a
            size = float(np.median(np.linalg.norm(f, axis=1))) / units.G0
            if not 0.5 < size < 2.0:
                raise InputError(
                    f"calibration: made of a log in units of {accel:g} m/s^2 and {gyro:g} rad/s (nominal); with these "
                    f"factors the specific force of this log, less biases, has a median of {size:.3g} g; read the log "
                    "in the units (counts) that the calibrated one was read in"
                )
        return compensate_thermal(self.calibration, imu) if "thermal" in self.calibration.extra else imu

    def corrected(self, imu: ImuSeries) -> ImuSeries:
        """A log in SI and the axes of the vehicle, less the errors that the filter does not estimate."""
        if self.correction.is_identity:
            return imu
        h: FloatArray | float = imu.increments().dt[:, None] if imu.kind == "increment" else 1.0
        gyro, accel = self.correction.apply(imu.gyro, imu.accel, h)
        return replace(imu, gyro=gyro, accel=accel)

    def sample(self, dtheta_ib_b: ArrayLike, dv_ib_b: ArrayLike, dt: float) -> tuple[FloatArray, FloatArray]:
        """One sample for :class:`~schuler.navigation.navigator.Navigator`, the same as :meth:`corrected` has.

        Parameters
        ----------
        dtheta_ib_b, dv_ib_b : array_like, shape (3,)
            Increments in the units of the calibrated log ([rad], [m/s] unless it was in counts), axes of the vehicle.
        dt : float
            Interval. [s]

        Raises
        ------
        InputError
            If the calibration depends on temperature: that has to be taken out by
            :func:`~schuler.calibration.thermal.correction.compensate_thermal`.
        """
        if "thermal" in self.calibration.extra:
            raise InputError(
                "calibration: a thermal one needs the temperature of every sample; take it out with "
                "compensate_thermal before, and start from a calibration without it"
            )
        accel, gyro = self.calibration.nominal
        return self.correction.apply(as_vector3(dtheta_ib_b, "dtheta") * gyro, as_vector3(dv_ib_b, "dv") * accel, dt)

    def compensated(self, imu: ImuSeries, layout: StateLayout) -> ImuSeries:
        """Rates without any calibrated error: a corrected log less the initial values of the states."""
        rates = imu.rates()
        b_g, b_a, M_g, M_a, G_g = sensor_matrices(layout, self._parameters(layout))
        gyro, accel = ImuErrors(b_g=b_g, b_a=b_a, M_g=M_g, M_a=M_a, G_g=G_g).compensate_rates(rates.gyro, rates.accel)
        return replace(rates, gyro=gyro, accel=accel)

    def remaining_budget(self, spec: ImuSpec) -> ImuSpec:
        """Budget for alignment: the uncertainty that remains after calibration in place of the turn-on biases."""
        gyro = replace(spec.gyro, turn_on_bias=self.sigma_gyro)
        return replace(spec, gyro=gyro, accel=replace(spec.accel, turn_on_bias=self.sigma_accel))

    def aligned(self, initial: InitialState, alignment: Alignment, layout: StateLayout) -> InitialState:
        """Initial state with an attitude from the compensated log, correlated with all sensor errors that act on it.

        Parameters
        ----------
        initial : InitialState
            State of the layout with the attitude, before the calibration is put in.
        alignment : Alignment
            Source of the attitude; its own bias sigmas count only where the layout has no bias.
        layout : StateLayout

        Notes
        -----
        :meth:`InitialState.aligned` with the covariance of the calibration, which may know the sum of errors that act
        alike at rest much better than its parts.
        """
        return self.put_into(initial).aligned(alignment, layout)

    def _parameters(self, layout: StateLayout) -> FloatArray:
        parameters = np.zeros(layout.size - 9)
        parameters[self.places] = self.values
        return parameters


def rest_columns(start: InitialState, C_nb: FloatArray, layout: StateLayout) -> tuple[FloatArray, FloatArray]:
    """Effect of parameter errors on compensated rate and specific force at rest. Shapes (3, m), (3, m)."""
    llh = start.nav.llh
    f_b, omega_b = -C_nb.T @ earth.gravity_ned(llh[0], llh[2]), C_nb.T @ earth.earth_rate_ned(llh[0])
    return parameter_columns(layout, np.eye(3), omega_b, f_b, start.parameters)


__all__ = ["Age", "CalibrationStart", "calibration_start", "configured_start"]


def calibration_start(
    calibration: CalibrationResult | Path | str,
    layout: StateLayout,
    spec: ImuSpec,
    *,
    age: Age | None = None,
    C_bs: FloatArray | None = None,
) -> CalibrationStart:
    """Initial sensor states and correction of the log for a filter of this layout.

    Parameters
    ----------
    calibration : CalibrationResult, or path of its file
    layout : StateLayout
        Only its sensor blocks count.
    spec : ImuSpec
        Change of biases with time, and uncertainty of parameters that are not calibrated.
    age : Age, optional
        What happened to the IMU since; default: it was switched on again.
    C_bs : ndarray, shape (3, 3), optional
        Maps the IMU's components to those of the log that the filter gets; default the same axes.

    Returns
    -------
    CalibrationStart

    Raises
    ------
    InputError
        If the calibration was refused, depends on a temperature the log does not have, or has no right-handed response.
    FileFormatError
        If there is no such file, or it holds no calibration.

    Notes
    -----
    - Covariance of a bias: that of the calibration, plus the repeatability from one switch-on to the next unless the
      unit stayed on, plus twice the variance of what wanders in a run (once where a state ``b_g_run`` has the other
      half): the bias found then and the bias now are two moments of the same process. Temperature slopes of the budget
      times the difference of mean temperatures are added too.
    - M_a in the layout means the gauge "upper", M_a6 takes any as it is. Of a calibration in another gauge the elements
      below the diagonal are taken out of the log, so that body axes stay what they were; their uncertainty is that of
      a small turn of the axes, and so becomes one of M_a, M_g and G_g, correlated (the derivative of
      :meth:`CalibrationResult.in_gauge`).
    - A state that is a Gauss-Markov process would forget the calibrated value with its correlation time; the value is
      taken out of the log and the state starts at zero, as uncertain as it is.
    - What is taken out and not estimated keeps its uncertainty nowhere but in this: the share that gravity makes of it
      when the body is level, M_a and G_g times g, is added to the variances of the biases. At other attitudes and
      accelerations sigmas do not cover it; the notes have its size.
    - Not determined (infinite variance) counts as not calibrated. Held parameters (``fixed``) are values without
      uncertainty: they take the budget's, but for the zeros of a gauge, which are exact by the choice of axes.
    - M_g of a multi-position calibration in the gyroscopes' own axes gets the rotation between the triads, one
      misalignment of the budget about each axis, as correlated uncertainty.

    References
    ----------
    Hayal (2010), section 5.4: states and P0 of an extended Kalman filter from a calibration.
    """
    result, label, checksum = _read(calibration)
    if result.status == "refused":
        raise InputError(
            f"calibration {label}: expected one that can be used, got a refused one: "
            f"{' '.join(result.verdicts) or 'no reason is given.'} Repeat it, or take an earlier one of this unit"
        )
    age, notes = age or Age(), list[str]()
    remaining = at_temperature(result, age.temperature)
    errors = aged_errors(
        calibrated_errors(remaining, layout, spec, notes), layout, spec, age, remaining.temperature, notes
    )
    if C_bs is not None and not np.array_equal(C_bs, np.eye(3)):
        errors = rotated_errors(errors, C_bs)
    state, linear, lasting = state_places(layout)
    estimated, not_estimated = np.zeros(SIZE, dtype=bool), np.ones(SIZE, dtype=bool)
    estimated[linear[lasting]], not_estimated[linear] = True, False
    errors, correction = split_errors(errors, estimated)
    lower = list(HELD["upper"])
    if "M_a" in layout:
        not_estimated[lower] = False
        angle = float(np.sqrt(np.where(errors.calibrated, np.diag(errors.covariance), 0.0)[lower].max()))
        if angle > 0.0 or correction.T_a[2, :2].any() or correction.T_a[1, 0]:
            errors = upper_gauge_errors(errors)
            notes.append(
                f'body axes stay those of the calibration (gauge "{result.gauge}"): what M_a has below its diagonal '
                f"there is taken out of the log, and its 1-sigma of {1e3 * angle:.2g} mrad is one of these axes"
            )
    sigma_gyro, sigma_accel = sigma_at_rest(errors, B_G, G_G, spec.gyro), sigma_at_rest(errors, B_A, M_A, spec.accel)
    errors = with_gravity_share(errors, not_estimated, notes)
    determined = errors.calibrated[linear]
    state, linear = state[determined], linear[determined]
    blocks = [name for name in layout.models if np.isin(np.arange(layout.size)[layout[name]] - 9, state).any()]
    what = f"values and covariance of {', '.join(blocks)} at the start" if blocks else "nothing the filter estimates"
    head = f"calibration {label} ({result.method}, status {result.status}): {what}"
    warnings = (f"the calibration says: {text}" for text in result.verdicts)
    return CalibrationStart(
        result, state, errors.values[linear], errors.covariance[np.ix_(linear, linear)], errors, correction,
        sigma_gyro, sigma_accel, (head, *notes, *warnings),
        {
            "name": label, "sha256": checksum, "method": result.method, "gauge": result.gauge, "states": blocks,
            "switched_on_again": age.switched,
        },
    )  # fmt: skip


def configured_start(
    config: NavigationConfig, imu: ImuSeries, calibration: CalibrationResult | Path | str | None = None
) -> CalibrationStart | None:
    """The start from the calibration that a configuration names, or from one given instead; None without any.

    Parameters
    ----------
    config : NavigationConfig
        Section ``imu``: ``calibration``, ``calibration_session``, repeatabilities and ``mount_rpy_deg``.
    imu : ImuSeries
        Log as recorded.
    calibration : CalibrationResult or path, optional

    Raises
    ------
    ConfigError
        If the file that the configuration names cannot be read.
    InputError, FileFormatError
        See :func:`calibration_start`.
    """
    section, given = config.imu, calibration if calibration is not None else config.imu.calibration
    if given is None:
        return None
    spec = imu_spec(config)
    gyro, accel = section.gyro_repeatability_deg_hr, section.accel_repeatability_mg
    age = Age(
        section.calibration_session == "earlier",
        None if gyro is None else gyro * units.DEG_PER_HR,
        None if accel is None else accel * units.MG,
        None if imu.temperature is None else float(imu.temperature.mean()),
    )
    C_bs = rotation.dcm_from_rpy(np.array(section.mount_rpy_deg) * units.DEG) if any(section.mount_rpy_deg) else None
    try:
        return calibration_start(given, sensor_layout(config, spec), spec, age=age, C_bs=C_bs)
    except FileFormatError as error:
        if calibration is not None:
            raise
        raise ConfigError(f"imu.calibration: {error}") from None


def _read(calibration: CalibrationResult | Path | str) -> tuple[CalibrationResult, str, str]:
    """Result, its name, and the SHA-256 of its file or of the file that would be written."""
    if isinstance(calibration, CalibrationResult):
        return calibration, "as given", hashlib.sha256(result_text(calibration).encode()).hexdigest()
    path = Path(calibration)
    return read_result(path), path.name, sha256(path)
