"""Flenniken's sensor models: the simple triad, and the advanced gyroscope and accelerometer triads (48 parameters).

Axes here are those of the thesis, x forward, y up, z right: a gyroscope triad is (roll, yaw, pitch) with yaw positive
to the left. :func:`frd_from_fur` turns vectors to the axes of everything else, forward, right, down. For navigation use
:class:`~schuler.sensors.errors.ImuErrors`, which :func:`imu_errors` makes of two triads; the triads are for
studies of one error source at a time.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np

from schuler.arrays import ArrayLike, FloatArray, as_floats, readonly
from schuler.exceptions import InputError
from schuler.plotting.notebook import Abridged
from schuler.rotation import skew, unskew
from schuler.sensors.errors import ImuErrors
from schuler.sensors.noise import GaussMarkov, NoiseModel, Start, White

#: Components forward, right, down of a vector given forward, up, right; its transpose goes back.
C_FRD_FUR: FloatArray = readonly(np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]))


def frd_from_fur(v: ArrayLike) -> FloatArray:
    """Forward, right, down components of vectors given forward, up, right. Shapes (..., 3).

    Specific force, angular rate and bias alike: both axes are right-handed.
    """
    return np.asarray(as_floats(v, "v") @ C_FRD_FUR.T)


def fur_from_frd(v: ArrayLike) -> FloatArray:
    """Forward, up, right components of vectors given forward, right, down. Shapes (..., 3)."""
    return np.asarray(as_floats(v, "v") @ C_FRD_FUR)


def _zeros3() -> FloatArray:
    return np.zeros(3)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class SimpleTriad(Abridged):
    """Three sensors, each ``y = u + c + b + w``: constant, moving bias, wide-band noise.

    Attributes
    ----------
    bias : ndarray, shape (3,)
        c, constant. [x]
    N : ndarray, shape (3,)
        Two-sided root density of w. [x/sqrt(Hz)]
    sigma_b, tau : ndarray, shape (3,)
        Standard deviation [x] and correlation time [s] of b, a first-order Gauss-Markov process.
    start : {"stationary", "zero"}
        Start of b. The thesis does not state it; its chapter 3 fits zero, its chapter 7 stationary.

    Raises
    ------
    InputError
        If a shape is not (3,), a density or deviation negative or a correlation time not positive.

    Notes
    -----
    Units of x are rad/s or m/s^2. Table 6.1 lists variances of samples; a density does not depend on the rate. Where
    the source divides by the rate (5.10-5.23, 6.4, 6.10) it is multiplied, as in its (2.2) and (2.8).

    References
    ----------
    Flenniken (2005), eqs. (2.1)-(2.9), (5.1)-(5.6).
    """

    bias: FloatArray = field(default_factory=_zeros3)
    N: FloatArray = field(default_factory=_zeros3)
    sigma_b: FloatArray = field(default_factory=_zeros3)
    tau: FloatArray = field(default_factory=lambda: np.ones(3))
    start: Start = "stationary"

    def __post_init__(self) -> None:
        for name in self.names():
            # a copy, so that freezing it does not freeze the caller's array
            object.__setattr__(self, name, readonly(as_floats(getattr(self, name), name, (3,)).copy()))
        for axis in range(3):
            self.noise(axis)

    @classmethod
    def names(cls) -> tuple[str, ...]:
        """Names of the fields that hold parameters, three each."""
        return tuple(f.name for f in fields(cls) if f.name not in ("start", "printed"))

    def parameters(self) -> dict[str, float]:
        """All parameters by name, such as ``"scale_factor_y"``: 12, of a gyroscope triad 21, an accelerometer 27."""
        columns = ((name, getattr(self, name)) for name in self.names())
        return {f"{name}_{axis}": float(value[k]) for name, value in columns for k, axis in enumerate("xyz")}

    def noise(self, axis: int) -> NoiseModel:
        """White noise and moving bias of one axis, 0 to 2."""
        moving = GaussMarkov(float(self.sigma_b[axis]), float(self.tau[axis]), self.start)
        return NoiseModel((White(float(self.N[axis])), moving))

    def respond(self, u: ArrayLike) -> FloatArray:
        """Readings without bias and noise. Shapes (n, 3). [x]"""
        return as_floats(u, "u", (None, 3)).copy()

    def apply(self, u: ArrayLike, dt: float, rng: np.random.Generator) -> FloatArray:
        """Readings of the triad.

        Parameters
        ----------
        u : array_like, shape (n, 3)
            True rate [rad/s] or specific force [m/s^2]; axes forward, up, right.
        dt : float
            Sampling interval. [s]
        rng : numpy.random.Generator
            Each axis draws from a child of its own, so that one parameter changes nothing but its own effect.

        Returns
        -------
        ndarray, shape (n, 3)
            [x]

        Raises
        ------
        InputError
            If the shape is another or dt is not positive.
        """
        y = self.respond(u)
        noise = [self.noise(k).sample(len(y), dt, child) for k, child in enumerate(rng.spawn(3))]
        return np.asarray(y + self.bias + np.stack(noise, axis=1))


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class GyroTriad(SimpleTriad):
    """Gyroscope triad with scale-factor errors, misalignment and non-orthogonality: 21 parameters.

    Attributes
    ----------
    scale_factor : ndarray, shape (3,)
        SF. [-]
    misalignment : ndarray, shape (3,)
        delta about x, y, z: the triad as a whole is turned; the skew part of the response. [rad]
    non_orthogonality : ndarray, shape (3,)
        Delta about x, y, z: two sensing axes lean towards each other; the symmetric part. [rad]
    printed : bool
        Take the roll row of (6.7) with the signs of the printed thesis. Only to reproduce its chapter 7.

    Notes
    -----
    Response ``I + diag(SF) + E``, rows x, y, z = roll, yaw, pitch, with D = Delta and d = delta::

        E = [       0           sin(Dz + dz)    sin(Dy - dy) ]
            [ sin(Dz - dz)           0          sin(Dx + dx) ]
            [ sin(Dy + dy)      sin(Dx - dx)         0       ]

    For small angles E is ``symmetric(D) - [d x]``: a triad turned by d senses ``C(d)^T u``. Departure: (6.7) prints
    ``Dy + dy`` and ``Dz - dz`` in the roll row, which contradicts (6.1)-(6.3), (6.8) and (6.9) and makes dy the same as
    Dy.

    References
    ----------
    Flenniken (2005), eqs. (6.7)-(6.15), Table 6.1.
    """

    scale_factor: FloatArray = field(default_factory=_zeros3)
    misalignment: FloatArray = field(default_factory=_zeros3)
    non_orthogonality: FloatArray = field(default_factory=_zeros3)
    printed: bool = False

    def matrix(self, *, small_angle: bool = False) -> FloatArray:
        """M, the deviation of the linear response from identity; rows are sensing axes. Shape (3, 3).

        Parameters
        ----------
        small_angle : bool
            Angles in place of their sines: exactly ``diag(SF) + symmetric(Delta) - skew(delta)``.
        """
        d, D = self.misalignment, self.non_orthogonality
        angles = _symmetric(D) - skew(d)
        if self.printed:
            angles[0] = _symmetric(D)[0] + skew(d)[0]
        return np.diag(self.scale_factor) + (angles if small_angle else np.sin(angles))

    def respond(self, u: ArrayLike) -> FloatArray:
        """``(I + M) u``. Shapes (n, 3). [x]"""
        u = as_floats(u, "u", (None, 3))
        return np.asarray(u + u @ self.matrix().T)

    def compensate(self, y: ArrayLike) -> FloatArray:
        """Undo bias and response: the inverse of :meth:`apply` without noise. Shapes (n, 3). [x]

        Raises
        ------
        InputError
            If the response cannot be inverted.
        """
        return _inverse(self.matrix(), as_floats(y, "y", (None, 3)) - self.bias)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class AccelerometerTriad(GyroTriad):
    """Accelerometer triad: as :class:`GyroTriad`, with asymmetry and nonlinearity, 27 parameters.

    Attributes
    ----------
    asymmetry : ndarray, shape (3,)
        SFA: adds ``SFA |u|``, u along the axis; the scale factor is ``SF + SFA`` forwards, ``SF - SFA`` backwards. [-]
    quadratic : ndarray, shape (3,)
        SFN: adds ``SFN u^2``. Table 6.1 prints ppm; it is ppm/g. [1/(m/s^2)]

    References
    ----------
    Flenniken (2005), eqs. (6.1)-(6.6), Table 6.1.
    """

    asymmetry: FloatArray = field(default_factory=_zeros3)
    quadratic: FloatArray = field(default_factory=_zeros3)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.printed:
            raise InputError("printed: only the gyroscope's eq. (6.7) has other signs in print; leave it out here")

    def respond(self, u: ArrayLike) -> FloatArray:
        """``(I + M) u + SFA |u| + SFN u^2``. Shapes (n, 3). [m/s^2]"""
        u = as_floats(u, "u", (None, 3))
        return np.asarray(super().respond(u) + self.asymmetry * np.abs(u) + self.quadratic * u**2)

    def compensate(self, y: ArrayLike) -> FloatArray:
        """Undo bias and response: the inverse of :meth:`apply` without noise. Shapes (n, 3). [m/s^2]

        Raises
        ------
        InputError
            If the response cannot be inverted, or asymmetry and nonlinearity are no small part of it.

        Notes
        -----
        The rest of the response is taken at the last u until u stands still; each step gains the factor
        ``|SFA| + 2 |SFN u|``, a thousand or more for any real sensor.
        """
        linear = as_floats(y, "y", (None, 3)) - self.bias
        M, u = self.matrix(), linear
        for _ in range(60):
            last, u = u, _inverse(M, linear - self.asymmetry * np.abs(u) - self.quadratic * u**2)
            if not np.isfinite(u).all() or np.abs(u).max(initial=0.0) > 1e12:
                break
            if np.allclose(u, last, rtol=1e-14, atol=1e-14):
                return u
        raise InputError(
            "asymmetry and quadratic: expected a small part of the response, so that it can be inverted, got "
            f"{self.asymmetry.tolist()} and {self.quadratic.tolist()} 1/(m/s^2), up to {np.abs(linear).max():g} m/s^2"
        )


def _symmetric(D: FloatArray) -> FloatArray:
    return np.array([[0.0, D[2], D[1]], [D[2], 0.0, D[0]], [D[1], D[0], 0.0]])


def _inverse(M: FloatArray, y: FloatArray) -> FloatArray:
    try:
        return np.asarray(np.linalg.solve(np.eye(3) + M, y.T).T)
    except np.linalg.LinAlgError as error:
        raise InputError(f"I + M has no inverse, so measurements cannot be compensated; M is {M.tolist()}") from error


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
