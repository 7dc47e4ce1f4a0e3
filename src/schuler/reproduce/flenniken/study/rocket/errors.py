"""All errors of a flight by name: 48 parameters of the advanced sensor model and six of the start."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from schuler.arrays import FloatArray, as_vector3, readonly
from schuler.exceptions import InputError
from schuler.sensors.errors import ImuErrors
from schuler.sensors.initial_errors import InitialErrors
from schuler.sensors.noise import Start
from schuler.sensors.spec import ImuSpec
from schuler.sensors.triads import AccelerometerTriad, GyroTriad, imu_errors

AXES = "xyz"
#: Fields of the triads that are random in time; tau is only the colour of sigma_b.
RANDOM = ("N", "sigma_b", "tau")
#: Names of the six errors of the start: north, up, east, and roll, yaw, pitch.
STARTS = ("start_north", "start_up", "start_east", "start_roll", "start_yaw", "start_pitch")


@dataclass(frozen=True, eq=False)
class RocketErrors:
    """Errors of one inertial navigation system; the default has none.

    Attributes
    ----------
    gyro : GyroTriad
        21 parameters; axes x, y, z are roll, yaw, pitch. SI
    accel : AccelerometerTriad
        27 parameters; axes x, y, z are longitudinal, vertical, lateral. SI
    start_position : ndarray, shape (3,)
        North, up, east; estimate minus truth. [m]
    start_attitude : ndarray, shape (3,)
        Roll, yaw (to the left), pitch; estimate minus truth. [rad]

    Notes
    -----
    The source has actual = assumed + error, the other sign. Its (6.17) and (6.18) exchange up and east (E28) and its
    Table 6.2 the units of positions and angles (E29).

    References
    ----------
    Flenniken (2005), Tables 6.1 and 6.2, eqs. (6.1)-(6.23).
    """

    gyro: GyroTriad = field(default_factory=GyroTriad)
    accel: AccelerometerTriad = field(default_factory=AccelerometerTriad)
    start_position: FloatArray = field(default_factory=lambda: np.zeros(3))
    start_attitude: FloatArray = field(default_factory=lambda: np.zeros(3))

    def __post_init__(self) -> None:
        for name in ("start_position", "start_attitude"):
            object.__setattr__(self, name, readonly(as_vector3(getattr(self, name), name).copy()))

    @classmethod
    def of(cls, values: dict[str, float], *, start: Start = "stationary", printed: bool = False) -> RocketErrors:
        """From values by name, such as ``{"gyro_misalignment_y": 5e-4, "start_roll": 1e-3}``; the rest is zero.

        Parameters
        ----------
        values : dict
            Names as of :meth:`parameters`, SI.
        start : {"stationary", "zero"}
            Start of the moving biases.
        printed : bool
            Roll row of (6.7) with the signs in print, see :class:`~schuler.sensors.triads.GyroTriad`.

        Raises
        ------
        InputError
            If a name is unknown.
        """
        names = parameter_names()
        for name in values:
            if name not in names:
                raise InputError(f"{name}: no such parameter; there are {', '.join(names)}")
        fields_: dict[str, dict[str, Any]] = {"gyro": {}, "accel": {}}
        for triad, kind in (("gyro", GyroTriad), ("accel", AccelerometerTriad)):
            for name in kind.names():
                default = 1.0 if name == "tau" else 0.0
                fields_[triad][name] = np.array([values.get(f"{triad}_{name}_{axis}", default) for axis in AXES])
        begin = np.array([values.get(name, 0.0) for name in STARTS])
        gyro = GyroTriad(start=start, printed=printed, **fields_["gyro"])
        return cls(gyro, AccelerometerTriad(start=start, **fields_["accel"]), begin[:3], begin[3:])

    @classmethod
    def simple(cls, spec: ImuSpec, *, start: Start = "stationary") -> RocketErrors:
        """The simple model of an IMU: white noise, moving bias, and turn-on bias at its 1-sigma value.

        Random walks and flicker have no parameter in the source's model and are left out.
        """
        values: dict[str, float] = {}
        for name, triad in (("gyro", spec.gyro), ("accel", spec.accel)):
            for axis in AXES:
                values |= {
                    f"{name}_bias_{axis}": triad.turn_on_bias, f"{name}_N_{axis}": triad.random_walk,
                    f"{name}_sigma_b_{axis}": triad.in_run_bias, f"{name}_tau_{axis}": triad.in_run_time or 1.0,
                }  # fmt: skip
        return cls.of(values, start=start)

    def parameters(self) -> dict[str, float]:
        """All 54 by name: ``gyro_...`` 21, ``accel_...`` 27, ``start_...`` 6. SI"""
        values = {f"gyro_{k}": v for k, v in self.gyro.parameters().items()}
        values |= {f"accel_{k}": v for k, v in self.accel.parameters().items()}
        begin = np.concatenate((self.start_position, self.start_attitude))
        return values | dict(zip(STARTS, begin.tolist(), strict=True))

    def replaced(self, **values: float) -> RocketErrors:
        """The same with some parameters of other value."""
        return RocketErrors.of(self.parameters() | values, start=self.gyro.start, printed=self.gyro.printed)

    def only(self, name: str) -> RocketErrors:
        """Only one parameter as it is and the others zero; a ``sigma_b`` keeps its ``tau``."""
        values = self.parameters()
        if name not in values:
            raise InputError(f"{name}: no such parameter; there are {', '.join(values)}")
        kept = {name: values[name]} | {k: v for k, v in values.items() if "_tau_" in k}
        return RocketErrors.of(kept, start=self.gyro.start, printed=self.gyro.printed)

    def fixed(self) -> RocketErrors:
        """Without what is random in time."""
        zero, one = np.zeros(3), np.ones(3)
        gyro = replace(self.gyro, N=zero, sigma_b=zero, tau=one)
        return replace(self, gyro=gyro, accel=replace(self.accel, N=zero, sigma_b=zero, tau=one))

    def drawn(self, rng: np.random.Generator) -> RocketErrors:
        """Each constant parameter drawn from a normal distribution with its value for 1-sigma; noise stays."""
        values = self.parameters()
        z = dict(zip(values, rng.standard_normal(len(values)).tolist(), strict=True))
        return self.replaced(**{k: v * z[k] for k, v in values.items() if not is_random(k)})

    def imu_errors(self, *, drop_nonlinear: bool = False) -> ImuErrors:
        """The same for the simulator, where it has a place: biases, M_g, M_a and noise, forward-right-down.

        See :func:`~schuler.sensors.triads.imu_errors` for what is refused.
        """
        return imu_errors(self.gyro, self.accel, drop_nonlinear=drop_nonlinear)

    def initial_errors(self) -> InitialErrors:
        """Errors of the start for the simulator, north-east-down."""
        (north, up, east), (roll, yaw, pitch) = self.start_position, self.start_attitude
        return InitialErrors(np.array([north, east, -up]), np.array([roll, pitch, -yaw]))


def parameter_names() -> tuple[str, ...]:
    """Names of the 54 parameters."""
    gyro = [f"gyro_{name}_{axis}" for name in GyroTriad.names() for axis in AXES]
    accel = [f"accel_{name}_{axis}" for name in AccelerometerTriad.names() for axis in AXES]
    return (*gyro, *accel, *STARTS)


def is_random(name: str) -> bool:
    """Whether a parameter is of noise, which no single value of an error belongs to."""
    return any(f"_{part}_" in name for part in RANDOM)


def all_angles(angle: float, *, printed: bool = False) -> RocketErrors:
    """All twelve angles of the triads alike. [rad]

    With 500 urad, (6.7) as printed and variant A the mean is what section 7.3 reports across the track; the source
    does not print the values it took, so this is inference.
    """
    names = [n for n in parameter_names() if "misalignment" in n or "orthogonality" in n]
    return RocketErrors.of(dict.fromkeys(names, angle), printed=printed)
