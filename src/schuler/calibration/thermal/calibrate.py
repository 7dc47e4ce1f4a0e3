"""Thermal calibration: how biases and scale factors depend on temperature, from a ramp in one pose or soaks in many.

What a temperature does to a sensor is a polynomial and a table, each with uncertainty, and a check of hysteresis:
whether heating and cooling give the same.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

from schuler.arguments import explains_arguments
from schuler.arrays import ArrayLike, as_vector3
from schuler.calibration.bench.poses import Poses
from schuler.calibration.result.result import CalibrationResult
from schuler.calibration.thermal.by_ramp import calibrate_ramp
from schuler.calibration.thermal.by_soak import calibrate_soak
from schuler.calibration.thermal.correction import compensate_thermal, thermal_correction, thermal_value
from schuler.exceptions import InputError
from schuler.files import package_version
from schuler.recording.series import ImuSeries
from schuler.units import G0

__all__ = ["calibrate_thermal", "compensate_thermal", "thermal_correction", "thermal_value"]


@explains_arguments
def calibrate_thermal(
    imu: ImuSeries | Poses | Sequence[Poses],
    *,
    degree: int | Literal["auto"] = 3,
    reference_temperature: float | None = None,
    table_step: float | None = None,
    scale: bool | None = None,
    f_ib_b: ArrayLike | None = None,
    gravity: float = G0,
    noise: tuple[ArrayLike, ArrayLike] | None = None,
) -> CalibrationResult:
    """Biases, and where the poses allow scale factors, against temperature.

    Parameters
    ----------
    imu : ImuSeries, Poses or sequence of Poses
        A ramp: a log with temperature of a unit at rest in one pose while it is heated and cooled. Or soaks: poses at
        rest at several temperatures, with temperature, in order of time, one :class:`Poses` for each soak or all in
        one.
    degree : int or "auto"
        Of the polynomials. "auto": for each axis the one of least BIC, up to 6. Lowered where the data have no more.
    reference_temperature : float, optional
        Where ``values`` hold and powers are zero; None: 25 degC, or the middle of the range if that is outside. [degC]
    table_step : float, optional
        Between knots of the table of a ramp; None: about a tenth of the range. [K]
    scale : bool, optional
        Estimate scale factors of the accelerometers; None: if the poses allow. A ramp in one pose cannot.
    f_ib_b : array_like, shape (3,), optional
        True specific force during a ramp, if known; without it only the change of the accelerometer biases with
        temperature is found, which is all that one pose of unknown tilt can tell. [m/s^2]
    gravity : float
        Local gravity, for soaks. [m/s^2]
    noise : (array_like, array_like), optional
        N of gyroscopes [rad/s/sqrt(Hz)] and accelerometers [m/s^2/sqrt(Hz)], shape () or (3,), if the noise of a ramp
        is known to be white. None: from the log, slow noise included.

    Returns
    -------
    CalibrationResult
        Values at the reference temperature: ``b_g``, ``b_a`` (infinite variance after a ramp without ``f_ib_b``), and
        from soaks ``M_a`` in the gauge "lower". ``extra["thermal"]`` holds

        - ``kind``, ``reference_temperature``, ``range``: temperatures within which it is valid [degC];
        - ``coefficients``, ``covariance``, ``degree``, ``criterion`` (BIC by degree less the least): by parameter, of
          powers of ``T - reference`` [unit/K^k];
        - ``table``: ``temperature`` of the knots, and by parameter ``value``, ``sigma``, ``heating``, ``cooling``,
          ``gap``, ``gap_sigma`` (a ramp) or one row for each soak;
        - ``hysteresis``: by parameter ``checked``, ``found``, ``p_value``, and of heating less cooling the ``largest``,
          its ``sigma`` and the ``temperature`` of it; ``repeatability``: difference of two branches of one direction;
        - ``noise``, ``branches``, ``sensor``: what was found out about noise, ramps and the temperature sensor.

    Raises
    ------
    InputError
        If there is no temperature, too few samples, or an option is out of range.

    Notes
    -----
    Sensor: ``omega_meas = b_g(T) + omega``, ``f_meas = b_a(T) + (I + M_a(T)) f``, off-diagonal elements constant. The
    Earth's rate is not known at an unknown attitude: it stays in the gyroscope biases of a ramp (up to 7.3e-5 rad/s);
    over soaks it is noise of 7.3e-5/sqrt(3) rad/s. Gyroscope scale factors need a rate table at each temperature.

    A ramp is cut into 150 blocks. Noise of the block means is white plus exponentially correlated, averaged over what
    the restricted likelihood allows; what slow noise makes of the mean of the whole log is counted as bias.
    Coefficients are ordinary least squares with the covariance that this noise makes of them; degrees are compared by
    BIC after whitening. A difference between heating and cooling (quadratic in temperature) is kept in the model if
    noise makes it with less than 0.1 % probability; the polynomial is then the middle of both. A drift with time looks
    like hysteresis when every temperature is passed once each way; ``repeatability`` tells them apart if there are two
    branches of a direction.

    Poses of a soak count with their own uncertainties, enlarged where residuals contradict them.

    References
    ----------
    Soak and ramp: Hayal (2010), section 2.4.1.3; Aggarwal, Syed, El-Sheimy (2008). Sensor model: Yaman (2017), eqs.
    (2-113), (2-117), with parameters that depend on temperature.
    """
    if not (degree == "auto" or (isinstance(degree, int) and 0 <= degree <= 9)):
        raise InputError(f"degree: expected 0 to 9 or 'auto', got {degree!r}")
    if table_step is not None and not table_step > 0.0:
        raise InputError(f"table_step: expected a positive number of kelvins, got {table_step}")
    options = {
        "degree": degree, "reference_temperature": reference_temperature, "table_step": table_step, "scale": scale,
        "f_ib_b": None if f_ib_b is None else as_vector3(f_ib_b, "f_ib_b").tolist(), "gravity": gravity,
    }  # fmt: skip
    source = {"schuler": package_version(), "method": "thermal", "options": options}
    if noise is not None and not isinstance(imu, ImuSeries):
        raise InputError("noise: the poses of a soak carry their own uncertainties; give it to poses_of")
    if isinstance(imu, ImuSeries):
        force = None if f_ib_b is None else as_vector3(f_ib_b, "f_ib_b")
        if scale:
            raise InputError(
                "scale: expected None or False for a ramp in one pose, which cannot tell scale from bias; give Poses "
                "at several temperatures"
            )
        return replace(calibrate_ramp(imu, degree, reference_temperature, table_step, force, noise), provenance=source)
    poses = [imu] if isinstance(imu, Poses) else list(imu)
    return replace(calibrate_soak(poses, degree, reference_temperature, scale, gravity), provenance=source)
