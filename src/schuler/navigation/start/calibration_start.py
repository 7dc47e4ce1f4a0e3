"""A calibration as the start of a filter: values and covariance of its sensor states, the rest taken out of the log.

The log that the filter gets and the states it starts from explain the readings together exactly as the calibration
does: what the filter has states for stays in the log and is a state with the calibration's value and uncertainty,
correlations included; what it has none for is taken out beforehand.
"""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np

from schuler import rotation, units
from schuler.arrays import FloatArray
from schuler.calibration.result.result import CalibrationResult
from schuler.calibration.result.result_file import read_result, result_text
from schuler.exceptions import ConfigError, FileFormatError, InputError
from schuler.files import sha256
from schuler.filtering.states import StateLayout
from schuler.navigation.config import NavigationConfig
from schuler.navigation.configured import imu_spec, sensor_layout
from schuler.navigation.start.calibration_known import (
    Age,
    aged,
    at_rest,
    at_temperature,
    carried_by_biases,
    known,
    places,
)
from schuler.navigation.start.calibration_mapping import B_A, B_G, G_G, HELD, M_A, SIZE, split, turned, upper
from schuler.navigation.start.sensor_start import CalibrationStart
from schuler.recording.series import ImuSeries
from schuler.sensors.spec import ImuSpec

__all__ = ["Age", "CalibrationStart", "calibration_start", "configured_start"]


def calibration_start(
    calibration: CalibrationResult | Path | str,
    layout: StateLayout,
    spec: ImuSpec,
    *,
    age: Age | None = None,
    C_bs: FloatArray | None = None,
) -> CalibrationStart:
    """What a filter of this layout takes from a calibration.

    Parameters
    ----------
    calibration : CalibrationResult, or path of its file
    layout : StateLayout
        Only its sensor blocks count.
    spec : ImuSpec
        Says how biases change, and how uncertain is what the calibration does not say.
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
      accelerations sigmas do not cover it; the notes say how large it is.
    - Not determined (infinite variance) counts as not calibrated. Held parameters (``fixed``) are values without
      uncertainty: they take the budget's, but for the zeros of a gauge, which are exact by the choice of axes.
    - M_g of a multi-position calibration in the gyroscopes' own axes gets the rotation between the triads, one
      misalignment of the budget about each axis, as correlated uncertainty.

    References
    ----------
    Hayal (2010), section 5.4: states and P0 of an extended Kalman filter from a calibration.
    """
    result, label, digest = _read(calibration)
    if result.status == "refused":
        raise InputError(
            f"calibration {label}: expected one that can be used, got a refused one: "
            f"{' '.join(result.verdicts) or 'no reason is given.'} Repeat it, or take an earlier one of this unit"
        )
    age, notes = age or Age(), list[str]()
    left = at_temperature(result, age.temperature)
    errors = aged(known(left, layout, spec, notes), layout, spec, age, left.temperature, notes)
    if C_bs is not None and not np.array_equal(C_bs, np.eye(3)):
        errors = turned(errors, C_bs)
    state, linear, lasting = places(layout)
    kept, missing = np.zeros(SIZE, dtype=bool), np.ones(SIZE, dtype=bool)
    kept[linear[lasting]], missing[linear] = True, False
    errors, correction = split(errors, kept)
    lower = list(HELD["upper"])
    if "M_a" in layout:
        missing[lower] = False
        angle = float(np.sqrt(np.where(errors.said, np.diag(errors.covariance), 0.0)[lower].max()))
        if angle > 0.0 or correction.T_a[2, :2].any() or correction.T_a[1, 0]:
            errors = upper(errors)
            notes.append(
                f'body axes stay those of the calibration (gauge "{result.gauge}"): what M_a has below its diagonal '
                f"there is taken out of the log, and its 1-sigma of {1e3 * angle:.2g} mrad is one of these axes"
            )
    sigma_gyro, sigma_accel = at_rest(errors, B_G, G_G, spec.gyro), at_rest(errors, B_A, M_A, spec.accel)
    errors = carried_by_biases(errors, missing, notes)
    taken = errors.said[linear]
    state, linear = state[taken], linear[taken]
    blocks = [name for name in layout.models if np.isin(np.arange(layout.size)[layout[name]] - 9, state).any()]
    what = f"values and covariance of {', '.join(blocks)} at the start" if blocks else "nothing the filter estimates"
    head = f"calibration {label} ({result.method}, status {result.status}): {what}"
    warnings = (f"the calibration says: {text}" for text in result.verdicts)
    return CalibrationStart(
        result, state, errors.values[linear], errors.covariance[np.ix_(linear, linear)], errors, correction,
        sigma_gyro, sigma_accel, (head, *notes, *warnings),
        {
            "name": label, "sha256": digest, "method": result.method, "gauge": result.gauge, "states": blocks,
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
        As recorded.
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
    """Result, what to call it, and the hash of its file; the same hash if it was not in a file."""
    if isinstance(calibration, CalibrationResult):
        return calibration, "as given", hashlib.sha256(result_text(calibration).encode()).hexdigest()
    path = Path(calibration)
    return read_result(path), path.name, sha256(path)
