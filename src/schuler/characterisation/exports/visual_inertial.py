"""Noise for camera-IMU programs and factor graphs: Kalibr, VINS, OpenVINS, GTSAM."""

from __future__ import annotations

from math import sqrt

from schuler.characterisation.exports.numbers import Numbers, comments
from schuler.exceptions import InputError

_DENSITIES = {
    "white": "N as it is, two-sided root density; nothing to convert",
    "walk": "K as it is, root density of the bias's derivative",
    "customary": "static logs lack vibration and temperature; people inflate by 10 to 20 (ethz-asl/kalibr issue 663), "
    "OpenVINS's own d455 file white noise by 2 and the walk by 10",
}


def kalibr(n: Numbers, *, topic: str = "/imu0") -> str:
    """``imu.yaml`` of Kalibr.

    Parameters
    ----------
    n : Numbers
    topic : str
        ROS topic of the IMU.

    Notes
    -----
    Takes the densities N [x/sqrt(Hz)] and K [x*sqrt(Hz)] and the rate, with which Kalibr itself makes sample values:
    https://github.com/ethz-asl/kalibr/wiki/IMU-Noise-Model and .../wiki/yaml-formats.
    """
    return comments(n, "Kalibr (imu.yaml)", extra=_DENSITIES) + "\n".join(_kalibr_lines(n, topic)) + "\n"


def openvins(n: Numbers, *, topic: str = "/imu0", imu: str = "imu0") -> str:
    """``kalibr_imu_chain.yaml`` of OpenVINS.

    Parameters
    ----------
    n : Numbers
    topic : str
        ROS topic of the IMU.
    imu : str
        Name of the section.

    Notes
    -----
    Takes what Kalibr takes; its propagator divides N^2 by the time step and multiplies K^2 by it
    (``ov_msckf/src/state/Propagator.cpp``). The intrinsics in the file are those of a perfect IMU.
    """
    one = ["[1.0, 0.0, 0.0]", "[0.0, 1.0, 0.0]", "[0.0, 0.0, 1.0]"]
    matrices = {
        "T_i_b": ["[1.0, 0.0, 0.0, 0.0]", "[0.0, 1.0, 0.0, 0.0]", "[0.0, 0.0, 1.0, 0.0]", "[0.0, 0.0, 0.0, 1.0]"],
        "Tw": one, "R_IMUtoGYRO": one, "Ta": one, "R_IMUtoACC": one, "Tg": ["[0.0, 0.0, 0.0]"] * 3,
    }  # fmt: skip
    lines = ["%YAML:1.0", "", comments(n, "OpenVINS (kalibr_imu_chain.yaml)", extra=_DENSITIES) + f"{imu}:"]
    lines += [f"  {line}" for line in _kalibr_lines(n, topic)]
    lines += ["  time_offset: 0.0  # s, of the camera; not a property of the noise", '  model: "kalibr"']
    lines += ["  # scale, misalignment and g-sensitivity of a perfect IMU: a calibration's results belong here"]
    for name, rows in matrices.items():
        lines += [f"  {name}:", *(f"    - {row}" for row in rows)]
    return "\n".join(lines) + "\n"


def vins(n: Numbers) -> str:
    """Noise block of the configuration of VINS-Mono and VINS-Fusion.

    Parameters
    ----------
    n : Numbers

    Notes
    -----
    The keys are standard deviations of discrete samples (HKUST-Aerial-Robotics/VINS-Mono issue 102), and what they must
    be follows from how they are used (``vins_estimator/src/factor/integration_base.h``): a step of length dt adds
    ``2 (dt/2)^2 acc_n^2`` to the velocity variance, the two samples of the midpoint rule counted as independent, and
    ``dt^2 acc_w^2`` to that of the bias. They shall add N^2 dt and K^2 dt, so ``acc_n = N sqrt(2 rate)`` and
    ``acc_w = K sqrt(rate)``. The sample's own standard deviation is ``N sqrt(rate)``.
    """
    rate = n.need_rate()
    white, walk = n.common.white * sqrt(2.0 * rate), n.common.walk * sqrt(rate)
    extra = {
        "white": f"N sqrt(2 rate) at {rate:g} Hz: a step adds 2 (dt/2)^2 acc_n^2 to the velocity variance and shall "
        "add N^2 dt; the sample's own standard deviation is N sqrt(rate), smaller by 1.414",
        "walk": "K sqrt(rate): a step adds dt^2 acc_w^2 to the variance of the bias and shall add K^2 dt",
        "customary": "the program's examples (acc_n 0.1, gyr_n 0.01) lie above most sensors, as the weights of "
        "camera and IMU are balanced by them (gaowenliang/imu_utils issue 36); inflate until it behaves",
    }
    lines = [
        f"acc_n: {white * n.accel.N:.6e}  # m/s^2, accelerometer measurement noise",
        f"gyr_n: {white * n.gyro.N:.6e}  # rad/s, gyroscope measurement noise",
        f"acc_w: {walk * n.accel.K:.6e}  # m/s^3, accelerometer bias random walk",
        f"gyr_w: {walk * n.gyro.K:.6e}  # rad/s^2, gyroscope bias random walk",
    ]
    return comments(n, "VINS-Mono and VINS-Fusion", extra=extra) + "\n".join(lines) + "\n"


def gtsam(n: Numbers, *, integration: float = 1e-8, bias_init: float = 1e-6) -> str:
    """Python module with the preintegration parameters of GTSAM.

    Parameters
    ----------
    n : Numbers
    integration : float
        Covariance of the position integration, no property of the IMU. [m^2/s]
    bias_init : float
        Covariance of the bias that is used while preintegrating, no property of the IMU either.

    Notes
    -----
    GTSAM takes continuous-time covariances, N^2 and K^2 (``gtsam/navigation/PreintegratedRotation.h``,
    ``PreintegrationParams.h``); ``CombinedImuFactor.cpp`` divides the former by the step and multiplies the latter by
    it. All default to the identity, hence all are written.
    """
    for name, value in (("integration", integration), ("bias_init", bias_init)):
        if not value >= 0.0:
            raise InputError(f"{name}: expected a covariance, not negative, got {value!r}")
    white, walk = n.common.white, n.common.walk
    extra = {
        "conversion": "covariances N^2 [x^2/Hz] of white noise, K^2 [x^2 Hz] of the bias random walk, same on all axes",
        "customary": "no figure of its own; for Kalibr people inflate root densities by 10 to 20 (its issue 663)",
    }
    return (
        comments(n, "GTSAM (PreintegrationCombinedParams)", extra=extra)
        + f'''import numpy as np

GYRO_NOISE = {white * n.gyro.N:.6e}  # (rad/s)/sqrt(Hz)
ACCEL_NOISE = {white * n.accel.N:.6e}  # (m/s^2)/sqrt(Hz)
GYRO_BIAS_WALK = {walk * n.gyro.K:.6e}  # (rad/s)*sqrt(Hz)
ACCEL_BIAS_WALK = {walk * n.accel.K:.6e}  # (m/s^2)*sqrt(Hz)


def preintegration_params(gtsam, gravity=9.81, up=True):
    """Parameters for a navigation frame whose z axis points up (ENU), or down (NED)."""
    make = gtsam.PreintegrationCombinedParams.MakeSharedU if up else gtsam.PreintegrationCombinedParams.MakeSharedD
    params = make(gravity)
    one = np.eye(3)
    params.setGyroscopeCovariance(GYRO_NOISE**2 * one)
    params.setAccelerometerCovariance(ACCEL_NOISE**2 * one)
    params.setBiasOmegaCovariance(GYRO_BIAS_WALK**2 * one)
    params.setBiasAccCovariance(ACCEL_BIAS_WALK**2 * one)
    params.setIntegrationCovariance({integration!r} * one)  # of the integration, not of the IMU
    params.setBiasAccOmegaInit({bias_init!r} * np.eye(6))  # of the bias used; older: setBiasAccOmegaInt
    return params
'''
    )


def _kalibr_lines(n: Numbers, topic: str) -> list[str]:
    white, walk = n.common.white, n.common.walk
    return [
        f"accelerometer_noise_density: {white * n.accel.N:.6e}  # m/s^2/sqrt(Hz)",
        f"accelerometer_random_walk: {walk * n.accel.K:.6e}  # m/s^3/sqrt(Hz)",
        f"gyroscope_noise_density: {white * n.gyro.N:.6e}  # rad/s/sqrt(Hz)",
        f"gyroscope_random_walk: {walk * n.gyro.K:.6e}  # rad/s^2/sqrt(Hz)",
        f"rostopic: {topic}",
        f"update_rate: {float(n.need_rate())!r}  # Hz",
    ]
