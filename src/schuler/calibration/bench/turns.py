"""Turns about known axes: at the constant rates of a table, or by a known angle on a bench."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from schuler.arrays import ArrayLike, FloatArray, as_floats
from schuler.calibration.bench.gyro_readings import GyroReadings
from schuler.calibration.bench.poses import sample_mean_sigma
from schuler.calibration.result.parameters import AXES
from schuler.earth import WGS84, earth_rate_ned
from schuler.exceptions import InputError
from schuler.plotting.notebook import Abridged
from schuler.recording.series import ImuSeries
from schuler.units import DEG

#: Mean specific force along the axis of a turn, as a share of gravity, from which the axis is taken as vertical.
VERTICAL = 0.9


@dataclass(frozen=True, eq=False, repr=False)
class Turns(Abridged):
    """Means of a sensor over turns.

    Attributes
    ----------
    rate : ndarray, shape (n, 3)
        Mean rate relative to the Earth in the axes of the fixture: rate of the table, or angle over duration, times
        the axis of the turn. [rad/s]
    omega, sigma_omega : ndarray, shape (n, 3)
        Mean angular rate as measured and its 1-sigma. [rad/s]
    f : ndarray, shape (n, 3), or None
        Mean specific force as measured. [m/s^2]
    start, stop : ndarray, shape (n,)
        [s]
    left : ndarray, shape (n,), or None
        What is left of a vector across the axis, fixed to the Earth, in the mean over a turn. [-] None: that of a turn
        at constant rate, ``|sin(a/2)/(a/2)|`` for the angle a.
    """

    rate: FloatArray
    omega: FloatArray
    sigma_omega: FloatArray
    f: FloatArray | None
    start: FloatArray
    stop: FloatArray
    left: FloatArray | None = None

    def __post_init__(self) -> None:
        n = len(as_floats(self.rate, "rate", (None, 3)))
        for name, shape in (
            ("rate", (n, 3)),
            ("omega", (n, 3)),
            ("sigma_omega", (n, 3)),
            ("start", (n,)),
            ("stop", (n,)),
        ):
            object.__setattr__(self, name, as_floats(getattr(self, name), name, shape))
        if self.f is not None:
            object.__setattr__(self, "f", as_floats(self.f, "f", (n, 3)))
        left = np.abs(np.sinc(0.5 * self.speed * self.duration / np.pi)) if self.left is None else self.left
        object.__setattr__(self, "left", as_floats(left, "left", (n,)))
        if (self.sigma_omega <= 0.0).any():
            raise InputError("sigma_omega: expected positive numbers; a gyroscope without any noise is stuck")
        if (self.speed <= 0.0).any():
            raise InputError("rate: expected turns, got a rate of zero; what is at rest belongs to the poses")
        if (self.stop <= self.start).any():
            raise InputError("stop: expected times after start")

    def __len__(self) -> int:
        return len(self.rate)

    @property
    def duration(self) -> FloatArray:
        """[s]"""
        return np.asarray(self.stop - self.start)

    @property
    def speed(self) -> FloatArray:
        """Magnitude of the rate. [rad/s]"""
        return np.asarray(np.linalg.norm(self.rate, axis=1))

    @property
    def axis(self) -> FloatArray:
        """Axes of the turns as unit vectors, right-handed. Shape (n, 3)."""
        return np.asarray(self.rate / self.speed[:, None])

    @property
    def labels(self) -> list[str]:
        """Such as ``"turn about -x at 60 deg/s (12.0..40.0 s)"``; the rate is the mean."""
        out = []
        for k, u in enumerate(self.axis):
            j = int(np.abs(u).argmax())
            name = f"{'+' if u[j] > 0 else '-'}{AXES[j]}" if abs(u[j]) > 0.999 else np.array2string(u, precision=3)
            out.append(
                f"turn about {name} at {self.speed[k] / DEG:.3g} deg/s ({self.start[k]:.1f}..{self.stop[k]:.1f} s)"
            )
        return out


def joined(several: Sequence[Turns]) -> Turns:
    """Turns of several logs as one, in that order; without specific force if one of them has none.

    Raises
    ------
    InputError
        If there are none.
    """
    if not several:
        raise InputError("several: expected turns of one log or more, got none")

    def together(name: str) -> FloatArray:
        return np.concatenate([getattr(turns, name) for turns in several])

    f = None if any(turns.f is None for turns in several) else together("f")
    rate, omega, sigma, start, stop, left = (
        together(name) for name in ("rate", "omega", "sigma_omega", "start", "stop", "left")
    )
    return Turns(rate, omega, sigma, f, start, stop, left)


def turns_of(
    imu: ImuSeries,
    spans: Sequence[tuple[float, float]],
    *,
    rate: ArrayLike | None = None,
    angle: ArrayLike | None = None,
    noise: ArrayLike | None = None,
) -> Turns:
    """Means over turns of a log.

    Parameters
    ----------
    imu : ImuSeries
    spans : sequence of (start, stop)
        First and last time of each. [s]
    rate : array_like, shape (n, 3)
        Constant rate of the table about the axes of the fixture. [rad/s]
    angle : array_like, shape (n, 3)
        Or the angle of each turn times its axis: ``(2 pi, 0, 0)`` is once around x, right-handed. [rad]
    noise : array_like, shape () or (3,), optional
        N of the gyroscopes, for the uncertainty. [rad/s/sqrt(Hz)] None: from the scatter, only at constant rates.

    Returns
    -------
    Turns
        The integral of the rate is the sum of the samples times the sampling interval, over as many intervals as
        samples.

    Raises
    ------
    InputError
        If not exactly one of ``rate`` and ``angle`` is given, a turn by an angle comes without ``noise``, or one holds
        fewer than 20 samples.
    """
    if (rate is None) == (angle is None):
        raise InputError("rate, angle: expected one of them, got both or none")
    if angle is not None and noise is None:
        raise InputError("noise: expected N of the gyroscopes, because a turn by hand shows scatter of its own")
    given = [(name, value) for name, value in (("rate", rate), ("angle", angle)) if value is not None]
    stated = as_floats(given[0][1], given[0][0], (len(spans), 3))
    rates = imu.rates()
    dt = imu.interval
    omega, f, sigma, duration, left = [], [], [], [], []
    for (start, stop), row in zip(spans, stated, strict=True):
        a = int(np.searchsorted(rates.t, start - 1e-9))
        b = int(np.searchsorted(rates.t, stop + 1e-9, side="right"))
        if b - a < 20:
            raise InputError(f"spans: expected 20 samples or more in {start:.2f}..{stop:.2f} s, got {max(b - a, 0)}")
        duration.append((b - a) * dt)
        omega.append(rates.gyro[a:b].mean(axis=0))
        f.append(rates.accel[a:b].mean(axis=0))
        # where the unit has got to, from the gyroscope about the axis, brought to the angle that is known
        travelled = np.cumsum(rates.gyro[a:b] @ row)
        total = np.linalg.norm(row) * (duration[-1] if angle is None else 1.0)
        left.append(abs(np.exp(1j * travelled * (total / travelled[-1])).mean()) if travelled[-1] else 1.0)
        if noise is None:
            sigma.append(sample_mean_sigma(rates.gyro[a:b]))
        else:
            sigma.append(np.broadcast_to(np.asarray(noise, dtype=np.float64), (3,)) / np.sqrt(duration[-1]))
    T = np.array(duration)
    starts = np.array([s for s, _ in spans], dtype=np.float64)
    return Turns(
        stated if angle is None else stated / T[:, None],
        np.array(omega).reshape(-1, 3),
        np.array(sigma).reshape(-1, 3),
        np.array(f).reshape(-1, 3),
        starts,
        starts + T,
        np.array(left),
    )


def readings_of_turns(
    turns: Turns,
    f: FloatArray | None,
    *,
    gravity: float,
    latitude: float | None = None,
    axis_n: ArrayLike | None = None,
    angle_sigma: float = 0.0,
    rate_sigma: float = 0.0,
    axis_sigma: float = 0.0,
    instability: float = 0.0,
) -> tuple[GyroReadings, list[str]]:
    """Readings while turning, Earth rate included.

    Parameters
    ----------
    turns : Turns
    f : ndarray, shape (n, 3), or None
        Mean specific force, calibrated. [m/s^2]
    gravity : float
        [m/s^2]
    latitude : float, optional
        [rad]
    axis_n : array_like, shape (n, 3), optional
        Where each axis of turning points, north, east, down. None: up or down, as the specific force says.
    angle_sigma : float
        1 sigma of the angle of each turn. [rad]
    rate_sigma : float
        1 sigma of the rate of each turn, relative. [-]
    axis_sigma : float
        1 sigma of the direction of an axis in the fixture, the same for all turns about it, either way. [rad]
    instability : float
        How much a gyro bias changes from turn to turn, 1 sigma. [rad/s]

    Returns
    -------
    readings : GyroReadings
    warnings : list of str

    Notes
    -----
    Earth rate across the axis averages to ``turns.left`` of itself in an unknown direction: zero for whole turns at
    constant rate. Along the axis it counts in full.
    """
    n, u = len(turns), turns.axis
    warnings: list[str] = []
    if axis_n is not None:
        a_n = as_floats(axis_n, "axis_n", (n, 3))
        a_n = a_n / np.linalg.norm(a_n, axis=1, keepdims=True)
    else:
        lift = np.zeros(n) if f is None else (f * u).sum(axis=1)
        a_n = np.zeros((n, 3))
        a_n[:, 2] = np.where(np.abs(lift) > VERTICAL * gravity, -np.sign(lift), 0.0)
        lost = np.flatnonzero(a_n[:, 2] == 0.0)
        if len(lost):
            why = "come without specific force" if f is None else "are not about the vertical"
            which = "the turns" if len(lost) == n else ", ".join(turns.labels[k] for k in lost)
            warnings.append(f"{which} {why}, so Earth rate along their axes stands in the uncertainty; give axis_n")
    across = 1.0 - u**2
    stated = np.abs(a_n).sum(axis=1) > 0.0
    common = []
    if latitude is None:
        along, vertical, horizontal = np.zeros(n), WGS84.omega_ie / np.sqrt(3.0), WGS84.omega_ie / np.sqrt(3.0)
        common.append(-a_n[:, 2:] * u * vertical)
        unknown = np.where(stated, np.hypot(a_n[:, 0], a_n[:, 1]) * horizontal, vertical)
        beside = np.full(n, WGS84.omega_ie * np.sqrt(2.0 / 3.0))
    else:
        omega_n = earth_rate_ned(latitude)
        along = a_n @ omega_n
        common.append(np.zeros((n, 3)))
        unknown = np.where(stated, 0.0, WGS84.omega_ie / np.sqrt(3.0))
        beside = np.sqrt(np.maximum(WGS84.omega_ie**2 - along**2, 0.0))
    own = (angle_sigma / turns.duration) ** 2 + (rate_sigma * turns.speed) ** 2 + unknown**2
    doubt = np.sqrt(u**2 * own[:, None] + across * ((turns.left * beside) ** 2 / 2.0)[:, None])
    noise = np.sqrt(np.square(turns.sigma_omega) + instability**2)
    if axis_sigma > 0.0:
        common.extend(_axes_off(turns, axis_sigma))
    return GyroReadings(
        tuple(turns.labels), turns.omega, turns.rate + along[:, None] * u,
        np.zeros((n, 3)) if f is None else f, noise, doubt,
        np.array(common),
    ), warnings  # fmt: skip


def _axes_off(turns: Turns, sigma: float) -> list[FloatArray]:
    """What an axis in the wrong direction adds, for each axis and the two directions it can be wrong in."""
    out: list[FloatArray] = []
    left = np.ones(len(turns), dtype=bool)
    while left.any():
        u = turns.axis[int(np.flatnonzero(left)[0])]
        along = turns.axis @ u
        group = left & (np.abs(along) > 0.999)
        _, _, Vt = np.linalg.svd(u[None, :])
        out.extend(np.outer(group * turns.speed * along * sigma, side) for side in Vt[1:])
        left &= ~group
    return out
