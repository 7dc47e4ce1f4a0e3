"""Live navigation: one IMU sample at a time, the same compiled filter and the same numbers as a batch run."""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import numpy as np

from schuler.arrays import ArrayLike, FloatArray, as_vector3
from schuler.exceptions import InputError
from schuler.filtering.engine import FilterOptions, FilterState
from schuler.filtering.error_model import ecef_from_ned_states
from schuler.filtering.filter_arrays import Aiding, ImuStream, NodeArrays, RecordArrays, TrajectoryArrays
from schuler.filtering.initial_state import InitialState
from schuler.filtering.measurements import KINDS, STATUS, MeasurementSchedule, merged
from schuler.filtering.states import StateLayout
from schuler.mechanization.strapdown import NavState


class Outcome(NamedTuple):
    """Outcome of one measurement: time [s], kind, status, normalised innovation squared, innovation (3,)."""

    t: float
    kind: str
    status: str
    nis: float
    innovation: FloatArray


class Navigator:
    """A filter fed sample by sample.

    Measurements must be announced with :meth:`aid` before the IMU sample whose interval they fall into. Receivers
    report late, so a ``delay_s`` can be given: IMU samples are then held back that long before the filter takes them,
    and :attr:`predicted` carries the state on to the newest sample.

    The numbers are those of a batch run: to the last bit with ``covariance_rate_hz=None``, else to 1e-8 m, since a
    batch run also propagates its covariance for records.

    Parameters
    ----------
    initial : InitialState
    layout : StateLayout
    gyro_psd, accel_psd : array_like, shape (3,)
        White-noise densities ``N**2`` by axis. [rad^2/s], [m^2/s^3]
    interval_s : float
        Nominal IMU sample interval. [s]
    options : FilterOptions, optional
    delay_s : float
        How long IMU samples wait for late measurements. [s]

    Examples
    --------
    ``nav.imu(t, dtheta, dv)`` for every IMU sample, ``nav.aid(position(t, llh, sigma, lever))`` for every fix,
    ``nav.state.llh`` whenever wanted.
    """

    def __init__(
        self,
        initial: InitialState,
        layout: StateLayout,
        gyro_psd: ArrayLike,
        accel_psd: ArrayLike,
        *,
        interval_s: float,
        options: FilterOptions | None = None,
        delay_s: float = 0.0,
    ) -> None:
        from schuler.filtering.kernels import run as _run_kernels

        if not interval_s > 0.0 or delay_s < 0.0:
            raise InputError(f"expected interval_s > 0 and delay_s >= 0, got {interval_s} and {delay_s}")
        self.layout = layout
        self.delay_s = delay_s
        self._k = _run_kernels
        self._filter = FilterState(initial, layout, gyro_psd, accel_psd, options or FilterOptions(), interval_s)
        self._waiting: deque[tuple[float, float, FloatArray, FloatArray]] = deque()
        self._pending = MeasurementSchedule.empty()
        self._last = initial.nav.t
        self._outcomes: list[Outcome] = []
        n = layout.size
        # one-sample inputs, and outputs of no length: records and smoother nodes are for batch runs
        self._in = ImuStream(np.empty((1, 3)), np.empty((1, 3)), np.empty(1), np.empty(1), ends=False)
        self._no_measurement = Aiding.of(MeasurementSchedule.empty())
        self._out = (
            TrajectoryArrays.of_size(0), RecordArrays.of_size(0, n), NodeArrays.of_size(0, 0, n, layout.n_sensor),
        )  # fmt: skip

    def imu(self, t: float, dtheta_ib_b: ArrayLike, dv_ib_b: ArrayLike) -> None:
        """Take one IMU sample.

        Parameters
        ----------
        t : float
            End of its interval, which began at the previous sample. [s]
        dtheta_ib_b, dv_ib_b : array_like, shape (3,)
            Integrals of angular rate [rad] and specific force [m/s] over the interval, body axes.

        Raises
        ------
        InputError
            If time does not advance or a value is not finite.
        """
        dt = t - self._last
        if not dt > 0.0:
            raise InputError(f"expected a sample after {self._last:.6f} s, got one at {t:.6f} s")
        dtheta, dv = as_vector3(dtheta_ib_b, "dtheta_ib_b"), as_vector3(dv_ib_b, "dv_ib_b")
        self._last = t
        if self.delay_s == 0.0:
            self._step(t, dt, dtheta, dv)
            return
        self._waiting.append((t, dt, dtheta, dv))
        while self._waiting and self._waiting[0][0] <= t - self.delay_s:
            self._step(*self._waiting.popleft())

    def aid(self, measurement: MeasurementSchedule) -> None:
        """Announce one or more measurements, each at its own time.

        Parameters
        ----------
        measurement : MeasurementSchedule
            Such as :func:`~schuler.filtering.measurements.position` returns.

        Raises
        ------
        InputError
            If the filter is already past its time: nothing is used at a wrong time. Announce earlier or give a delay.
        """
        now = self.state.t
        if len(measurement) and measurement.t.min() <= now:
            raise InputError(
                f"a measurement of {measurement.t.min():.4f} s comes too late, the filter is at {now:.4f} s; "
                "announce it before the IMU sample that covers it, or use a Navigator with delay_s > "
                f"{now - measurement.t.min():.3f}"
            )
        self._pending = merged(self._pending, measurement)

    def finish(self) -> None:
        """Take the samples that are still waiting for late measurements."""
        while self._waiting:
            self._step(*self._waiting.popleft())

    @property
    def state(self) -> NavState:
        """Navigation state of the filter, ``delay_s`` behind the newest sample."""
        return self._filter.navigation

    @property
    def predicted(self) -> NavState:
        """State at the newest sample: the filter's, carried on through the samples that wait."""
        state = self._filter.navigation
        if not self._waiting:
            return state
        from schuler.mechanization.strapdown import mechanize
        from schuler.recording.series import Increments

        b_g, b_a, inverse = self._compensation()
        dt = np.array([w[1] for w in self._waiting])
        dtheta, dv = np.array([w[2] for w in self._waiting]), np.array([w[3] for w in self._waiting])
        dv = (dv - b_a * dt[:, None]) @ inverse[1].T
        dtheta = (dtheta - b_g * dt[:, None] - dv @ inverse[2].T) @ inverse[0].T
        ahead = mechanize(Increments(np.array([w[0] for w in self._waiting]), dt, dtheta, dv), state)
        return NavState(float(ahead.t[-1]), ahead.r_eb_e[-1], ahead.v_eb_e[-1], ahead.q_eb[-1])

    @property
    def parameters(self) -> FloatArray:
        """Parameter estimates, order of the layout. Shape (m,)."""
        return self._filter.arrays.est.copy()

    @property
    def covariance(self) -> FloatArray:
        """Covariance at its last propagation, navigation errors in north-east-down axes. Shape (n, n)."""
        T = ecef_from_ned_states(self.state.llh, self.layout.size)
        rotated: FloatArray = T.T @ self._filter.covariance_e @ T
        return rotated

    @property
    def outcomes(self) -> list[Outcome]:
        """Outcomes of all measurements so far."""
        return list(self._outcomes)

    def _compensation(self) -> tuple[FloatArray, FloatArray, tuple[FloatArray, FloatArray, FloatArray]]:
        s = self._filter.arrays.sens
        return s[0:3], s[3:6], (s[6:15].reshape(3, 3), s[15:24].reshape(3, 3), s[24:33].reshape(3, 3))

    def _step(self, t: float, dt: float, dtheta: FloatArray, dv: FloatArray) -> None:
        stream, f = self._in, self._filter
        stream.dtheta[0], stream.dv[0], stream.dt[0], stream.t[0] = dtheta, dv, dt, t
        if len(self._pending) and self._pending.t[0] <= t + 1e-9:
            due = self._pending.t <= t + 1e-9
            taken, self._pending = self._pending.where(due), self._pending.where(~due)
            aiding = Aiding.of(taken)
        else:
            taken, aiding = None, self._no_measurement
        f.arrays.counts[self._k.CNT_MEAS] = 0
        self._k.run_filter(stream, aiding, f.arrays, f.model, f.settings, f.work, *self._out)
        if taken is not None:
            self._outcomes += [
                Outcome(
                    float(taken.t[i]), KINDS[int(taken.kind[i])], STATUS[int(aiding.status[i])], float(aiding.nis[i]),
                    aiding.innovation[i],
                )
                for i in range(len(taken))
            ]  # fmt: skip
