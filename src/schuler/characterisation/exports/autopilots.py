"""Noise for filters with GNSS: KF-GINS, PX4's EKF2, ArduPilot's EKF3."""

from __future__ import annotations

from math import sqrt

from schuler import units as u
from schuler.characterisation.exports.numbers import Numbers, comments, held_to, matched_sigma
from schuler.exceptions import InputError


def kf_gins(n: Numbers, *, corrtime_s: float | None = None) -> str:
    """The ``imunoise`` block of KF-GINS.

    Parameters
    ----------
    n : Numbers
    corrtime_s : float, optional
        Correlation time of all biases and scale factors, of which KF-GINS has one only. Default: that of the
        gyroscope's Gauss-Markov term, else of the accelerometer's, else one hour. [s]

    Notes
    -----
    KF-GINS models biases as Gauss-Markov processes, ``q = 2 gbstd^2 / corrtime`` (``src/kf-gins/gi_engine.cpp``), in
    deg/sqrt(h), m/s/sqrt(h), deg/h, mGal, ppm and h (``src/kf_gins.cpp``). The standard deviations written are those of
    the process with that correlation time whose Allan deviation at the horizon is that of the identified terms: if
    there is one Gauss-Markov term with that correlation time, its own.
    """
    if corrtime_s is not None and not corrtime_s > 0.0:
        raise InputError(f"corrtime_s: expected a positive time, got {corrtime_s!r}")
    own = n.gyro.gauss_markov or n.accel.gauss_markov
    tau = corrtime_s or (own[1] if own else u.HR)
    white, walk = n.common.white, n.common.walk
    gb, ab = (walk * matched_sigma(sensor.wander, tau, n.horizon) for sensor in (n.gyro, n.accel))
    gs, as_ = n.gyro.scale, n.accel.scale
    extra = {
        "arw, vrw": "N in deg/sqrt(h) and m/s/sqrt(h): N [rad/s/sqrt(Hz)] * 60 * 180/pi, N [m/s^2/sqrt(Hz)] * 60",
        "gbstd, abstd": f"1 sigma of the Gauss-Markov process with corrtime = {tau:g} s that has the Allan deviation "
        f"of the identified terms at {n.horizon:g} s",
        "gsstd, asstd": "scale factors are no result of a log at rest"
        + ("; zero holds them at their initial values" if gs == as_ == 0.0 else "; from the budget"),
        "customary": "users of such filters inflate (ethz-asl/kalibr issue 663 says 10 to 20 for a camera's IMU); "
        "initbgstd and initbastd default to gbstd and abstd, so give the turn-on bias there"
        + "".join(
            f" ({name}: {value / unit:.4g} {text})"
            for name, value, unit, text in (
                ("initbgstd", n.gyro.turn_on, u.DEG_PER_HR, "deg/h"),
                ("initbastd", n.accel.turn_on, u.MGAL, "mGal"),
            )
            if value
        ),
    }
    lines = ["imunoise:"]
    for key, value, unit, text in (
        ("arw", white * n.gyro.N, u.DEG_PER_RTHR, "deg/sqrt(h)"),
        ("vrw", white * n.accel.N, u.MPS_PER_RTHR, "m/s/sqrt(h)"),
        ("gbstd", gb, u.DEG_PER_HR, "deg/h"),
        ("abstd", ab, u.MGAL, "mGal"),
        ("gsstd", gs, u.PPM, "ppm"),
        ("asstd", as_, u.PPM, "ppm"),
    ):
        number = f"{value / unit:.6e}"
        lines.append(f"  {key}: [{number}, {number}, {number}]  # {text}")
    lines.append(f"  corrtime: {tau / u.HR:.6e}  # h")
    return comments(n, "KF-GINS (imunoise block)", extra=extra) + "\n".join(lines) + "\n"


def px4(n: Numbers, *, filter_rate_hz: float = 100.0) -> str:
    """Parameters of PX4's EKF2 as a file for QGroundControl.

    Parameters
    ----------
    n : Numbers
    filter_rate_hz : float
        Rate of the filter's prediction: 1e6 / EKF2_PREDICT_US, 100 Hz by default. [Hz]

    Notes
    -----
    ``src/modules/ekf2/EKF/covariance.cpp`` adds ``(dt EKF2_GYR_NOISE)^2`` per prediction of length dt to an angle and
    ``(dt EKF2_GYR_B_NOISE)^2`` to a bias; they shall add N^2 dt and K^2 dt. So the parameters are N and K times the
    square root of the filter's rate, not of the sensor's. Ranges, units and defaults: ``module.yaml``,
    ``params_gyro_bias.yaml`` and ``params_accel_bias.yaml`` in the same folder.
    """
    values = _per_step(n, filter_rate_hz)
    rows = [
        ("EKF2_GYR_NOISE", values[0], 1e-4, 0.1, 0.015, "rad/s"),
        ("EKF2_ACC_NOISE", values[1], 0.01, 1.0, 0.35, "m/s^2"),
        ("EKF2_GYR_B_NOISE", values[2], 0.0, 0.01, 0.001, "rad/s^2"),
        ("EKF2_ACC_B_NOISE", values[3], 0.0, 0.01, 0.003, "m/s^3"),
    ]
    if n.gyro.turn_on:
        rows.append(("EKF2_GBIAS_INIT", n.gyro.turn_on, 0.0, 0.2, 0.1, "rad/s"))
    if n.accel.turn_on:
        rows.append(("EKF2_ABIAS_INIT", n.accel.turn_on, 0.0, 0.5, 0.2, "m/s^2"))
    head = comments(n, "PX4 (EKF2)", extra=_step_comments(filter_rate_hz, "EKF2_PREDICT_US"))
    lines = [_described(*row) for row in rows]
    lines += ["# Vehicle-Id Component-Id Name Value Type"]
    lines += [f"1\t1\t{row[0]}\t{row[1]:.9f}\t9" for row in rows]
    return head + "\n".join(lines) + "\n"


def ardupilot(n: Numbers, *, filter_rate_hz: float = 1.0 / 0.012) -> str:
    """Parameters of ArduPilot's EKF3 as a parameter file.

    Parameters
    ----------
    n : Numbers
    filter_rate_hz : float
        Rate of the filter: EKF3 predicts about every 12 ms (``EKF_TARGET_DT``). [Hz]

    Notes
    -----
    ``libraries/AP_NavEKF3/AP_NavEKF3_core.cpp`` adds ``(dt EK3_GYRO_P_NSE)^2`` per prediction to an angle and, to a
    bias that is kept as an angle increment, ``(dt^2 EK3_GBIAS_P_NSE)^2``, that is ``(dt EK3_GBIAS_P_NSE)^2`` to a bias
    as a rate. So, as for PX4, the parameters are N and K times the square root of the filter's rate. Ranges and units:
    ``AP_NavEKF3.cpp`` in the same folder, whence the parameter list on ardupilot.org; defaults are Copter's.
    """
    values = _per_step(n, filter_rate_hz)
    rows = [
        ("EK3_GYRO_P_NSE", values[0], 1e-4, 0.1, 0.015, "rad/s"),
        ("EK3_ACC_P_NSE", values[1], 0.01, 1.0, 0.35, "m/s/s"),
        ("EK3_GBIAS_P_NSE", values[2], 1e-5, 1e-3, 1e-3, "rad/s/s"),
        ("EK3_ABIAS_P_NSE", values[3], 1e-5, 0.02, 0.02, "m/s/s/s"),
    ]
    head = comments(n, "ArduPilot (EKF3)", extra=_step_comments(filter_rate_hz, "EKF_TARGET_DT"))
    lines = [_described(*row) for row in rows] + [f"{row[0]},{row[1]:.9f}" for row in rows]
    return head + "\n".join(lines) + "\n"


def _per_step(n: Numbers, filter_rate: float) -> tuple[float, float, float, float]:
    """Gyroscope and accelerometer noise, gyroscope and accelerometer bias noise, per prediction."""
    if not filter_rate > 0.0:
        raise InputError(f"filter_rate_hz: expected a positive rate, got {filter_rate!r}")
    root = sqrt(filter_rate)
    white, walk = n.common.white * root, n.common.walk * root
    return white * n.gyro.N, white * n.accel.N, walk * n.gyro.K, walk * n.accel.K


def _step_comments(filter_rate: float, parameter: str) -> dict[str, str]:
    return {
        "conversion": f"N sqrt(f) and K sqrt(f) with the rate of the filter's predictions, f = {filter_rate:g} Hz "
        f"({parameter}): a prediction over dt adds (dt noise)^2 to the variance and shall add N^2 dt, K^2 dt",
        "customary": "the defaults, in the lines below, stand also for vibration, scale factors and timing, which no "
        "log at rest shows; lower them with care and look at the innovations",
    }


def _described(name: str, value: float, low: float, high: float, default: float, unit: str) -> str:
    ratio = f", {default / value:.3g} times this" if value > 0.0 else ""
    return f"# {name} [{unit}]: {held_to(value, low, high)}default {default:g}{ratio}"
