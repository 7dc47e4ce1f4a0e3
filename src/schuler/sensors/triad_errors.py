"""Flenniken's triads as the simulator's errors and back; only what is linear has a place there."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import numpy as np

from schuler.arrays import FloatArray
from schuler.exceptions import InputError
from schuler.rotation import unskew
from schuler.sensors.errors import ImuErrors
from schuler.sensors.noise import GaussMarkov, NoiseModel
from schuler.sensors.triads import C_FRD_FUR, AccelerometerTriad, GyroTriad, SimpleTriad


def imu_errors(gyro: SimpleTriad, accel: SimpleTriad, *, drop_nonlinear: bool = False) -> ImuErrors:
    """The same errors for the simulator, in axes forward, right, down.

    Parameters
    ----------
    gyro, accel : SimpleTriad, GyroTriad, AccelerometerTriad
    drop_nonlinear : bool
        Leave asymmetry and nonlinearity of the accelerometers out, which ImuErrors has no place for.

    Returns
    -------
    ImuErrors
        Biases, ``M = C M_fur C^T`` and noise.

    Raises
    ------
    InputError
        If noise differs between the axes of a triad, since ImuErrors has one model for three, or nonlinear terms would
        be lost.
    """
    nonlinear = [name for name in ("asymmetry", "quadratic") if np.any(getattr(accel, name, 0.0))]
    if nonlinear and not drop_nonlinear:
        raise InputError(
            f"{' and '.join(nonlinear)}: ImuErrors is linear; use AccelerometerTriad.apply, or say drop_nonlinear=True"
        )
    M = {k: t.matrix() if isinstance(t, GyroTriad) else np.zeros((3, 3)) for k, t in (("g", gyro), ("a", accel))}
    for name, triad in (("gyro", gyro), ("accel", accel)):
        if not triad.noise(0) == triad.noise(1) == triad.noise(2):
            raise InputError(
                f"{name}: expected the same N, sigma_b and tau on the three axes, as ImuErrors has one model, got "
                f"N {triad.N.tolist()}, sigma_b {triad.sigma_b.tolist()}, tau {triad.tau.tolist()}; use {name}.apply"
            )
    return ImuErrors(
        b_g=C_FRD_FUR @ gyro.bias,
        b_a=C_FRD_FUR @ accel.bias,
        M_g=C_FRD_FUR @ M["g"] @ C_FRD_FUR.T,
        M_a=C_FRD_FUR @ M["a"] @ C_FRD_FUR.T,
        gyro_noise=gyro.noise(0),
        accel_noise=accel.noise(0),
    )


def triads_of(errors: ImuErrors) -> tuple[GyroTriad, AccelerometerTriad]:
    """Triads with the linear errors of an IMU: the inverse of :func:`imu_errors`.

    Parameters
    ----------
    errors : ImuErrors

    Returns
    -------
    gyro : GyroTriad
    accel : AccelerometerTriad

    Raises
    ------
    InputError
        If there are errors the triads have no parameter for: g-sensitivity, temperature, range, rounding, other noise
        than white and one Gauss-Markov process, or elements of M beyond 1.
    """
    others = ("G_g", *(f.name for f in fields(errors) if f.name.endswith(("_temperature", "_range"))))
    others += tuple(f.name for f in fields(errors) if f.name.endswith(("_resolution", "_quantum")))
    for name in others:
        value = getattr(errors, name)
        if value is not None and np.any(value):
            raise InputError(f"{name}: the triads have no such error; expected it to be zero or None, got {value!r}")
    gyro = GyroTriad(**_linear(errors.b_g, errors.M_g, "M_g"), **_noise(errors.gyro_noise, "gyro_noise"))
    accel = AccelerometerTriad(**_linear(errors.b_a, errors.M_a, "M_a"), **_noise(errors.accel_noise, "accel_noise"))
    return gyro, accel


def _linear(b: FloatArray, M: FloatArray, name: str) -> dict[str, Any]:
    M = C_FRD_FUR.T @ M @ C_FRD_FUR
    cross = M - np.diag(np.diag(M))
    if np.abs(cross).max() > 1.0:
        raise InputError(f"{name}: expected off-diagonal elements that are sines, at most 1, got {M.tolist()}")
    angles = np.arcsin(cross)
    S = 0.5 * (angles + angles.T)
    return {
        "bias": C_FRD_FUR.T @ b,
        "scale_factor": np.diag(M).copy(),
        "misalignment": -unskew(angles),
        "non_orthogonality": np.array([S[1, 2], S[0, 2], S[0, 1]]),
    }


def _noise(model: NoiseModel, name: str) -> dict[str, Any]:
    moving = model.in_run.terms
    if len(moving) > 1 or not all(isinstance(term, GaussMarkov) for term in moving):
        raise InputError(f"{name}: expected white noise and at most one Gauss-Markov process, got {model.terms}")
    b = moving[0] if moving else GaussMarkov(0.0, 1.0)
    assert isinstance(b, GaussMarkov)
    return {
        "N": np.full(3, model.white.N),
        "sigma_b": np.full(3, b.sigma),
        "tau": np.full(3, b.tau),
        "start": b.start,
    }
