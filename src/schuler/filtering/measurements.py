"""Aiding measurements as data: a time-sorted schedule that the engine works off, each entry at its own time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from schuler import frames
from schuler.arrays import ArrayLike, BoolArray, FloatArray, IntArray, as_floats, as_vector3
from schuler.exceptions import InputError
from schuler.filtering.limits import N_VALUES
from schuler.plotting.notebook import Abridged
from schuler.recording.series import GnssSeries

POSITION, VELOCITY, ZERO_VELOCITY, LATERAL, VERTICAL, SPEED, ZERO_RATE, PSEUDORANGE, RANGE_RATE = range(1, 10)
HEADING, HEIGHT, FIX, RESET_POSITION, RESET_VELOCITY, GNSS_HEADING = range(10, 16)
GRAVITY, GRAVITY_VECTOR, EARTH_RATE, EARTH_RATE_MAGNITUDE = range(16, 20)
CARRIER_PHASE, ARC_START = range(20, 22)
#: Names of the kinds, used in results.
KINDS = {
    POSITION: "position",
    VELOCITY: "velocity",
    ZERO_VELOCITY: "zero_velocity",
    LATERAL: "lateral",
    VERTICAL: "vertical",
    SPEED: "speed",
    ZERO_RATE: "zero_rate",
    PSEUDORANGE: "pseudorange",
    RANGE_RATE: "range_rate",
    HEADING: "heading",
    HEIGHT: "height",
    FIX: "fix",
    RESET_POSITION: "reset_position",
    RESET_VELOCITY: "reset_velocity",
    GNSS_HEADING: "gnss_heading",
    GRAVITY: "gravity",
    GRAVITY_VECTOR: "gravity_vector",
    EARTH_RATE: "earth_rate",
    EARTH_RATE_MAGNITUDE: "earth_rate_magnitude",
    CARRIER_PHASE: "carrier_phase",
    ARC_START: "arc_start",
}
#: Components of each kind; the first phase of an arc measures nothing but its ambiguity.
DIMENSIONS = {k: 3 if k in (1, 2, 3, 7, 12, 13, 14, 17) else int(k != ARC_START) for k in KINDS}
#: Kinds that come from satellites and stop in an outage.
GNSS_KINDS = (
    POSITION, VELOCITY, PSEUDORANGE, RANGE_RATE, RESET_POSITION, RESET_VELOCITY, GNSS_HEADING, CARRIER_PHASE, ARC_START
)  # fmt: skip
#: Kinds that are put into the state instead of being weighed: no innovation test, no smoother.
RESET_KINDS = (RESET_POSITION, RESET_VELOCITY)
UNUSED, ACCEPTED, REJECTED, FORCED, GATED = 0, 1, 2, 3, 4
#: What became of a measurement.
STATUS = {
    UNUSED: "unused",
    ACCEPTED: "accepted",
    REJECTED: "rejected",
    FORCED: "accepted after lock-out",
    GATED: "condition not met",
}


@dataclass(frozen=True, repr=False)
class MeasurementSchedule(Abridged):
    """Measurements in the order of their time.

    Attributes
    ----------
    t : ndarray, shape (m,)
        Time of validity, non-decreasing. [s]
    kind : ndarray of int, shape (m,)
        Keys of :data:`KINDS`.
    z : ndarray, shape (m, 8)
        Values by kind, the rest zero: Earth-fixed antenna position [m]; velocity north-east-down and the rate at which
        the lever arm changes in body axes, on a platform that turns [m/s]; lateral, vertical or forward velocity of the
        vehicle [m/s], in the last column the least speed at which it counts; mean raw angular rate at rest [rad/s];
        satellite position [m], pseudorange [m], place of its clock; satellite position, its velocity [m/s], range rate
        [m/s]; heading [rad]; height [m]; mean raw specific force [m/s^2] and rate [rad/s] at rest, gravity [m/s^2] or
        zero for the ellipsoid's, and 1 for perfect accelerometers; satellite position, carrier phase [m], channel of
        its ambiguity, from 1, and time of the phase before in its arc [s], without which, as at the start of an arc,
        the filter only sets the ambiguity.
    R : ndarray, shape (m, 3, 3)
        Covariance, of vectors in north-east-down axes (zero rate: body axes), of single numbers in the first place.
    lever : ndarray, shape (m, 3)
        From the IMU to what is measured (antenna, axle), body axes. [m]
    gate : ndarray, shape (m,)
        Largest accepted normalised innovation squared; inf accepts all; negative: its condition is not met, it is
        counted and not used.
    """

    t: FloatArray
    kind: IntArray
    z: FloatArray
    R: FloatArray
    lever: FloatArray
    gate: FloatArray

    def __len__(self) -> int:
        return len(self.t)

    @classmethod
    def empty(cls) -> MeasurementSchedule:
        """No measurement at all: free inertial navigation."""
        return cls(
            np.empty(0), np.empty(0, np.int64), np.empty((0, 8)), np.empty((0, 3, 3)), np.empty((0, 3)), np.empty(0)
        )

    @classmethod
    def of(
        cls,
        kind: int,
        t: ArrayLike,
        z: ArrayLike,
        R: ArrayLike,
        lever: ArrayLike = (0.0, 0.0, 0.0),
        gate: ArrayLike = np.inf,
    ) -> MeasurementSchedule:
        """Measurements of one kind, with shapes filled up.

        Parameters
        ----------
        kind : int
        t : array_like, shape (m,)
        z : array_like, shape (m,) or (m, k)
            First values, see above; the others are zero.
        R : array_like, shape (m,), (m, 3, 3) or scalar
            Variances of single numbers, or covariances.
        lever : array_like, shape (3,) or (m, 3)
        gate : array_like, shape () or (m,)
        """
        t = as_floats(t, "t", (None,))
        m = len(t)
        given = np.asarray(z, dtype=np.float64).reshape(m, -1) if m else np.zeros((0, 1))
        values, covariance = np.zeros((m, N_VALUES)), np.zeros((m, 3, 3))
        values[:, : given.shape[1]] = given
        R = np.asarray(R, dtype=np.float64)
        if R.ndim == 3:
            covariance[:] = R
        else:
            covariance[:, range(3), range(3)] = np.broadcast_to(R, (m,))[:, None]
        return cls(
            t,
            np.full(m, kind, dtype=np.int64),
            values,
            covariance,
            np.ascontiguousarray(np.broadcast_to(np.asarray(lever, dtype=np.float64), (m, 3))),
            np.ascontiguousarray(np.broadcast_to(np.asarray(gate, dtype=np.float64), (m,))),
        )

    def where(self, keep: ArrayLike) -> MeasurementSchedule:
        """The measurements selected by a boolean or index array."""
        k = np.asarray(keep)
        return MeasurementSchedule(self.t[k], self.kind[k], self.z[k], self.R[k], self.lever[k], self.gate[k])

    def outside(self, windows: Sequence[tuple[float, float]]) -> MeasurementSchedule:
        """The schedule without the GNSS measurements in ``start <= t < stop`` of any window. [s]"""
        return self.where(~(in_windows(self.t, windows) & np.isin(self.kind, GNSS_KINDS)))


def in_windows(t: FloatArray, windows: Sequence[tuple[float, float]]) -> BoolArray:
    """Which times lie in ``start <= t < stop`` of any window. Shape (n,)."""
    inside = np.zeros(len(t), dtype=bool)
    for start, stop in windows:
        inside |= (t >= start) & (t < stop)
    return inside


def merged(*schedules: MeasurementSchedule) -> MeasurementSchedule:
    """One schedule in order of time; equal times keep the order of the arguments."""
    parts = [s for s in schedules if len(s)]
    if not parts:
        return MeasurementSchedule.empty()
    joined = MeasurementSchedule(
        *(np.concatenate([getattr(s, name) for s in parts]) for name in ("t", "kind", "z", "R", "lever", "gate"))
    )
    return joined.where(np.argsort(joined.t, kind="stable"))


def gate_threshold(probability: float | None, dimension: int) -> float:
    """Chi-square threshold that a correct measurement passes with the given probability.

    Parameters
    ----------
    probability : float or None
        Such as 0.9999; None for no gate.
    dimension : int
        Components of the measurement.
    """
    if probability is None:
        return np.inf
    if not 0.0 < probability < 1.0:
        raise InputError(f"gate: expected a probability between 0 and 1 such as 0.9999, got {probability!r}")
    from scipy.special import gammaincinv

    return float(2.0 * gammaincinv(0.5 * dimension, probability))


def gnss_measurements(
    gnss: GnssSeries, lever_arm_b: ArrayLike, *, use_velocity: bool = True, gate: float | None = 0.9999
) -> MeasurementSchedule:
    """Loosely coupled position, and velocity where there is one, of every epoch.

    Parameters
    ----------
    gnss : GnssSeries
    lever_arm_b : array_like, shape (3,)
        From the IMU to the antenna, body axes. [m]
    use_velocity : bool
        False takes positions only.
    gate : float, optional
        Probability with which a correct measurement passes; None accepts everything.

    References
    ----------
    Groves (2013), eqs. (14.102)-(14.113).
    """
    lever = as_vector3(lever_arm_b, "lever_arm_b")
    threshold = gate_threshold(gate, 3)
    of = MeasurementSchedule.of
    positions = of(POSITION, gnss.t, frames.ecef_from_llh(gnss.llh), gnss.cov_r_n, lever, threshold)
    if not use_velocity or gnss.v_n is None or gnss.cov_v_n is None:
        return positions
    return merged(positions, of(VELOCITY, gnss.t, gnss.v_n, gnss.cov_v_n, lever, threshold))


def zero_velocity(t: ArrayLike, sigma: float, *, gate: float | None = None) -> MeasurementSchedule:
    """Zero-velocity measurements of the IMU at given times, equal in all directions.

    Parameters
    ----------
    t : array_like, shape (n,)
        Times at rest. [s]
    sigma : float
        1-sigma per axis. [m/s]
    gate : float, optional
        See :func:`gate_threshold`.
    """
    t = as_floats(t, "t", (None,))
    return MeasurementSchedule.of(ZERO_VELOCITY, t, np.zeros(len(t)), sigma**2, gate=gate_threshold(gate, 3))


def position(
    t: float, llh: ArrayLike, sigma: ArrayLike, lever_arm_b: ArrayLike = (0.0, 0.0, 0.0), *, gate: float | None = 0.9999
) -> MeasurementSchedule:
    """One position fix, for live use.

    Parameters
    ----------
    t : float
        Time of validity. [s]
    llh : array_like, shape (3,)
        Latitude, longitude [rad], ellipsoidal height [m] of the antenna.
    sigma : array_like, shape (3,) or (3, 3)
        1-sigma north, east, down [m], or the covariance [m^2].
    lever_arm_b : array_like, shape (3,)
        From the IMU to the antenna. [m]
    gate : float, optional
        See :func:`gate_threshold`.
    """
    return _one(POSITION, t, frames.ecef_from_llh(as_vector3(llh, "llh")), sigma, lever_arm_b, gate)


def velocity(
    t: float,
    v_eb_n: ArrayLike,
    sigma: ArrayLike,
    lever_arm_b: ArrayLike = (0.0, 0.0, 0.0),
    *,
    gate: float | None = 0.9999,
) -> MeasurementSchedule:
    """One velocity fix of the antenna, north-east-down [m/s]; arguments as for :func:`position`."""
    return _one(VELOCITY, t, as_vector3(v_eb_n, "v_eb_n"), sigma, lever_arm_b, gate)


def _one(
    kind: int, t: float, z: FloatArray, sigma: ArrayLike, lever: ArrayLike, gate: float | None
) -> MeasurementSchedule:
    R = np.asarray(sigma, dtype=np.float64)
    R = as_floats(R, "sigma", (3, 3)) if R.ndim == 2 else np.diag(as_vector3(sigma, "sigma") ** 2)
    if np.any(np.diag(R) <= 0.0):
        raise InputError(f"sigma: expected positive values, got {sigma!r}")
    lever = as_vector3(lever, "lever_arm_b")
    return MeasurementSchedule.of(kind, [float(t)], z[None, :], R[None, :, :], lever, gate_threshold(gate, 3))
