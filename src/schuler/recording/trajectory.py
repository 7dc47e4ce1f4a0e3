"""Trajectory in Earth-fixed axes: a reference, the truth of a simulation, or a navigation solution."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from schuler import frames, rotation
from schuler.arrays import ArrayLike, FloatArray, as_floats
from schuler.exceptions import InputError
from schuler.plotting.notebook import Displayed
from schuler.timebase import SAME_TIME, check_times

_MANY = 20_000  # samples from which loading compiled code is worth its fraction of a second
_BLOCK = 1 << 17  # samples that are converted at a time
#: Samples from which conversions are made anew when asked for: kept, they double what a day takes.
KEPT = 1 << 20


@dataclass(frozen=True, repr=False)
class Trajectory(Displayed):
    """Position over time in Earth-fixed axes, with velocity and attitude where a file has them.

    Everything else is derived when asked for. :meth:`full` gives the trajectory to those that need all three.

    Attributes
    ----------
    t : ndarray, shape (n,)
        Time. [s]
    r_eb_e : ndarray, shape (n, 3)
        Position. [m]
    v_eb_e : ndarray, shape (n, 3), optional
        Velocity. [m/s]
    q_eb : ndarray, shape (n, 4), optional
        Attitude, body to Earth-fixed axes.
    """

    t: FloatArray
    r_eb_e: FloatArray
    v_eb_e: FloatArray | None = None
    q_eb: FloatArray | None = None
    _cache: dict[str, FloatArray] = field(default_factory=dict, repr=False, compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "t", check_times(self.t, "Trajectory.t"))
        n = len(self.t)
        object.__setattr__(self, "r_eb_e", as_floats(self.r_eb_e, "Trajectory.r_eb_e", (n, 3)))
        if self.v_eb_e is not None:
            object.__setattr__(self, "v_eb_e", as_floats(self.v_eb_e, "Trajectory.v_eb_e", (n, 3)))
        if self.q_eb is not None:
            object.__setattr__(self, "q_eb", as_floats(self.q_eb, "Trajectory.q_eb", (n, 4)))

    @classmethod
    def from_geodetic(
        cls, t: ArrayLike, llh: ArrayLike, v_eb_n: ArrayLike | None = None, C_nb: ArrayLike | None = None
    ) -> Self:
        """From latitude, longitude [rad], height [m], velocity north-east-down [m/s] and attitude ``C_nb``."""
        llh = as_floats(llh, "llh", (None, 3))
        n, C_en = len(llh), frames.C_en(llh)
        v = None if v_eb_n is None else np.einsum("nij,nj->ni", C_en, as_floats(v_eb_n, "v_eb_n", (n, 3)))
        q = None if C_nb is None else rotation.quat_from_dcm(C_en @ as_floats(C_nb, "C_nb", (n, 3, 3)))
        return cls(as_floats(t, "t", (n,)), frames.ecef_from_llh(llh), v, q)

    def __len__(self) -> int:
        return len(self.t)

    def _headline(self) -> str:
        parts = ["position", *(["velocity"] * (self.v_eb_e is not None)), *(["attitude"] * (self.q_eb is not None))]
        return f"{len(self)} samples of {', '.join(parts)}" + (
            f", {self.t[0]:.3f}..{self.t[-1]:.3f} s" if len(self) else ""
        )

    def full(self) -> FullTrajectory:
        """The same trajectory, of which velocity and attitude are certain.

        Raises
        ------
        InputError
            If it has no velocity, or no attitude.
        """
        return FullTrajectory(self.t, self.r_eb_e, self._velocity(), self._attitude(), self._cache)

    def _velocity(self) -> FloatArray:
        if self.v_eb_e is None:
            raise InputError("this trajectory has no velocity: expected one made with v_eb_e")
        return self.v_eb_e

    def _attitude(self) -> FloatArray:
        if self.q_eb is None:
            raise InputError("this trajectory has no attitude: expected one made with q_eb")
        return self.q_eb

    @property
    def llh(self) -> FloatArray:
        """Latitude, longitude [rad], ellipsoidal height [m]. Shape (n, 3)."""
        if "llh" not in self._cache:
            if len(self) >= KEPT:
                return self.mapped(lambda part: part.llh)
            if len(self) < _MANY:
                llh = frames.llh_from_ecef(self.r_eb_e)
            else:
                llh = np.empty_like(self.r_eb_e)
                _axes_kernels().geodetic(self.r_eb_e, llh)
            return self._kept("llh", llh)
        return self._cache["llh"]

    @property
    def v_eb_n(self) -> FloatArray:
        """Velocity north, east, down. Shape (n, 3). [m/s]"""
        if "v_eb_n" not in self._cache:
            if len(self) >= KEPT:
                return self.mapped(lambda part: part.v_eb_n)
            v_eb_e = self._velocity()
            if len(self) < _MANY:
                v_n = rotation.rotate(rotation.quat_conjugate(frames.q_en(self.llh)), v_eb_e)
            else:
                v_n = np.empty_like(v_eb_e)
                _axes_kernels().vectors_to_ned(v_eb_e, self.llh, v_n)
            return self._kept("v_eb_n", v_n)
        return self._cache["v_eb_n"]

    @property
    def q_nb(self) -> FloatArray:
        """Attitude, body to north-east-down axes. Shape (n, 4)."""
        if "q_nb" not in self._cache:
            if len(self) >= KEPT:
                return self.mapped(lambda part: part.q_nb)
            q_eb = self._attitude()
            if len(self) < _MANY:
                q_nb = rotation.quat_multiply(rotation.quat_conjugate(frames.q_en(self.llh)), q_eb)
            else:
                q_nb = np.empty_like(q_eb)
                _axes_kernels().attitudes_to_ned(q_eb, self.llh, q_nb)
            return self._kept("q_nb", q_nb)
        return self._cache["q_nb"]

    @property
    def C_nb(self) -> FloatArray:
        """Attitude matrix, body to north-east-down axes. Shape (n, 3, 3)."""
        return rotation.dcm_from_quat(self.q_nb)

    @property
    def rpy_nb(self) -> FloatArray:
        """Roll, pitch, yaw. Shape (n, 3). [rad]"""
        if "rpy_nb" in self._cache:
            return self._cache["rpy_nb"]
        if len(self) >= KEPT:
            return self.mapped(lambda part: part.rpy_nb)
        return self._kept("rpy_nb", rotation.rpy_from_quat(self.q_nb))

    def blocks(self) -> list[slice]:
        """Rows of equal parts of at most 131072 samples, to work on a long trajectory in little memory."""
        n = len(self)
        edges = np.linspace(0, n, -(-n // _BLOCK) + 1).astype(np.int64).tolist()
        return [slice(a, b) for a, b in itertools.pairwise(edges)]

    def mapped(self, function: Callable[[Self], FloatArray]) -> FloatArray:
        """Values of every sample, of a long trajectory made a block at a time.

        Parameters
        ----------
        function : callable
            Takes a trajectory of n samples, returns an array of n rows, none of which depends on another sample.
        """
        if len(self) < KEPT:
            return function(self)
        values = np.empty(0)
        for rows in self.blocks():
            part = function(self.samples(rows))
            if not rows.start:
                values = np.empty((len(self), *part.shape[1:]))
            values[rows] = part
        return values

    def _kept(self, name: str, values: FloatArray) -> FloatArray:
        self._cache[name] = values
        return values

    def at(self, t: ArrayLike) -> Self:
        """State at other times within the span, by cubic Hermite curves and constant turns between samples.

        Parameters
        ----------
        t : array_like, shape (m,)
            Increasing times within ``[self.t[0], self.t[-1]]``. [s]

        Raises
        ------
        InputError
            If a time is outside the span: nothing is extrapolated.

        Notes
        -----
        Without velocities positions are interpolated linearly. Between samples of 0.25 s a car's position is good to a
        millimetre (error ``a'' dt^4 / 384``).
        """
        t = as_floats(t, "t", (None,))
        if len(t) and (t[0] < self.t[0] - 1e-9 or t[-1] > self.t[-1] + 1e-9):
            raise InputError(
                f"asked for {t[0]:.3f}..{t[-1]:.3f} s of a trajectory that runs {self.t[0]:.3f}..{self.t[-1]:.3f} s"
            )
        if len(self.t) == 1:
            return self._samples(np.zeros(len(t), dtype=np.int64), t)
        k = np.searchsorted(self.t, t, side="right") - 1
        if np.array_equal(self.t[k], t):  # the samples themselves, as where truth and solution have the same times
            return self._samples(k, t)
        k = np.clip(k, 0, len(self.t) - 2)
        h = (self.t[k + 1] - self.t[k])[:, None]
        s = (t - self.t[k])[:, None] / h
        r0, r1 = self.r_eb_e[k], self.r_eb_e[k + 1]
        q = None if self.q_eb is None else rotation.interpolate_quat(t, self.t, self.q_eb)
        if self.v_eb_e is None:
            return type(self)(t, r0 + s * (r1 - r0), None, q)
        v0, v1 = self.v_eb_e[k], self.v_eb_e[k + 1]
        d = r1 - r0
        r = r0 + s * (h * v0 + s * (3.0 * d - h * (2.0 * v0 + v1) + s * (h * (v0 + v1) - 2.0 * d)))
        v = v0 + s * (6.0 * d / h - 4.0 * v0 - 2.0 * v1 + s * (3.0 * (v0 + v1) - 6.0 * d / h))
        return type(self)(t, r, v, q)

    def between(self, start: float, stop: float) -> Self:
        """The samples with ``start <= t <= stop``. [s]"""
        return self.samples((self.t >= start - SAME_TIME) & (self.t <= stop + SAME_TIME))

    def samples(self, k: NDArray[Any] | slice) -> Self:
        """The samples of the given indices, flags or rows."""
        return self._samples(k, self.t[k])

    def _samples(self, k: NDArray[Any] | slice, t: FloatArray) -> Self:
        """The samples of the given indices, flags or rows, at times ``t``."""
        return type(self)(
            t,
            self.r_eb_e[k],
            None if self.v_eb_e is None else self.v_eb_e[k],
            None if self.q_eb is None else self.q_eb[k],
        )

    def moved_by(self, l_bp_b: ArrayLike) -> Trajectory:
        """Trajectory of another point of the body, for example the antenna.

        Parameters
        ----------
        l_bp_b : array_like, shape (3,) or (n, 3)
            From this trajectory's point to the other one, body axes; one, or one for each time. [m]

        Returns
        -------
        Trajectory
            Position and attitude; velocities need the angular rate and are left out.
        """
        if (q_eb := self.q_eb) is None:
            raise InputError("a lever arm needs an attitude, and this trajectory has none")
        arm = np.asarray(l_bp_b)
        arm = as_floats(l_bp_b, "l_bp_b", (len(self.t), 3) if arm.ndim == 2 else (3,))
        r = np.empty((len(self), 3))
        for rows in self.blocks():
            part = self.samples(rows)
            np.add(part.r_eb_e, rotation.rotate(part._attitude(), arm[rows] if arm.ndim == 2 else arm), out=r[rows])
        return Trajectory(self.t, r, None, q_eb)


@dataclass(frozen=True, repr=False)
class FullTrajectory(Trajectory):
    """Trajectory with velocity and attitude: truth of a simulation, mechanization, solution of a filter.

    Attributes
    ----------
    t : ndarray, shape (n,)
        Time. [s]
    r_eb_e : ndarray, shape (n, 3)
        Position. [m]
    v_eb_e : ndarray, shape (n, 3)
        Velocity. [m/s]
    q_eb : ndarray, shape (n, 4)
        Attitude, body to Earth-fixed axes.
    """

    v_eb_e: FloatArray = field()
    q_eb: FloatArray = field()

    def __post_init__(self) -> None:
        self._velocity()
        self._attitude()
        super().__post_init__()

    def full(self) -> FullTrajectory:
        """Itself."""
        return self


def _axes_kernels() -> Any:
    from schuler.recording import _kernels

    _kernels.prepare_axes()
    return _kernels
