"""Where the sensor states of a filter start, and what is done to a log before the filter gets it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from schuler import earth, units
from schuler.arrays import ArrayLike, FloatArray, IntArray, as_vector3
from schuler.calibration.result.result import CalibrationResult
from schuler.calibration.thermal.correction import compensate_thermal
from schuler.exceptions import InputError
from schuler.filtering.engine import InitialState
from schuler.filtering.error_model import parameter_columns, sensor_matrices
from schuler.filtering.states import StateLayout
from schuler.mechanization.alignment import Alignment
from schuler.navigation.start.calibration_mapping import Correction, SensorErrors
from schuler.recording.series import ImuSeries
from schuler.sensors.errors import ImuErrors
from schuler.sensors.spec import ImuSpec


@dataclass(frozen=True)
class CalibrationStart:
    """What a filter takes from a calibration.

    Attributes
    ----------
    calibration : CalibrationResult
    places : ndarray of int, shape (k,)
        Of the states that start from it, among the parameters of the layout.
    values : ndarray, shape (k,)
        SI.
    covariance : ndarray, shape (k, k)
        SI, with what changes from one switch-on to the next.
    errors : SensorErrors
        All 33 errors of the log that the filter gets.
    correction : Correction
        What makes it of a log in SI and the axes of the vehicle.
    sigma_gyro, sigma_accel : float
        What is left of a rate and a specific force at rest and level, RMS over the axes, 1-sigma. [rad/s], [m/s^2]
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
        """A log in SI and the axes of the vehicle without what the filter does not estimate."""
        if self.correction.nothing:
            return imu
        h: FloatArray | float = imu.increments().dt[:, None] if imu.kind == "increment" else 1.0
        gyro, accel = self.correction.of(imu.gyro, imu.accel, h)
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
        return self.correction.of(as_vector3(dtheta_ib_b, "dtheta") * gyro, as_vector3(dv_ib_b, "dv") * accel, dt)

    def compensated(self, imu: ImuSeries, layout: StateLayout) -> ImuSeries:
        """Rates without all calibrated errors: a corrected log with what the states start from taken out too."""
        rates = imu.rates()
        b_g, b_a, M_g, M_a, G_g = sensor_matrices(layout, self._parameters(layout))
        gyro, accel = ImuErrors(b_g=b_g, b_a=b_a, M_g=M_g, M_a=M_a, G_g=G_g).compensate_rates(rates.gyro, rates.accel)
        return replace(rates, gyro=gyro, accel=accel)

    def left_of(self, spec: ImuSpec) -> ImuSpec:
        """The budget with what the calibration leaves in place of the turn-on biases, for alignment."""
        gyro = replace(spec.gyro, turn_on_bias=self.sigma_gyro)
        return replace(spec, gyro=gyro, accel=replace(spec.accel, turn_on_bias=self.sigma_accel))

    def aligned(self, initial: InitialState, alignment: Alignment, layout: StateLayout) -> InitialState:
        """The start with an attitude found in the compensated log, correlated with all sensor errors that spoiled it.

        Parameters
        ----------
        initial : InitialState
            Of the layout, with the attitude; without anything of the calibration.
        alignment : Alignment
            Where the attitude came from; its own bias sigmas count only where the layout has no bias.
        layout : StateLayout

        Notes
        -----
        As :meth:`InitialState.aligned`, with scale factors, cross-coupling and g-sensitivity: at rest they act as
        biases do, and a calibration may know the sum much better than its parts.
        """
        start = self.put_into(initial)
        columns = rest_columns(start, alignment.C_nb, layout)
        A = -(alignment.psi_gyro @ columns[0] + alignment.psi_accel @ columns[1])
        P = start.P.copy()
        P_p = P[9:, 9:]
        P[:3, :3] = alignment.cov_noise_n + A @ P_p @ A.T
        P[:3, 3:9], P[:3, 9:] = 0.0, A @ P_p
        P[3:, :3] = P[:3, 3:].T
        for block, psi, sigma in (
            ("b_a", alignment.psi_accel, alignment.sigma_b_a), ("b_g", alignment.psi_gyro, alignment.sigma_b_g),
        ):  # fmt: skip
            if block not in layout:
                P[:3, :3] += sigma**2 * psi @ psi.T
        return InitialState(start.nav, P, start.parameters)

    def _parameters(self, layout: StateLayout) -> FloatArray:
        parameters = np.zeros(layout.size - 9)
        parameters[self.places] = self.values
        return parameters


def rest_columns(start: InitialState, C_nb: FloatArray, layout: StateLayout) -> tuple[FloatArray, FloatArray]:
    """How parameter errors act on compensated rate and specific force of a body that rests. Shapes (3, m), (3, m)."""
    llh = start.nav.llh
    f_b, omega_b = -C_nb.T @ earth.gravity_ned(llh[0], llh[2]), C_nb.T @ earth.earth_rate_ned(llh[0])
    return parameter_columns(layout, np.eye(3), omega_b, f_b, start.parameters)
