"""Live navigation: one IMU sample at a time, the same compiled filter and the same numbers as a batch run."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from schuler.arrays import ArrayLike, FloatArray, as_floats, as_vector3
from schuler.exceptions import DivergenceError, InputError
from schuler.filtering.engine import FilterOptions, FilterState
from schuler.filtering.error_model import ecef_from_ned_states
from schuler.filtering.filter_arrays import Aiding, ImuStream, NodeArrays, RecordArrays, TrajectoryArrays
from schuler.filtering.initial_state import InitialState
from schuler.filtering.measurements import DIMENSIONS, KINDS, REJECTED, STATUS, MeasurementSchedule, merged
from schuler.filtering.states import StateLayout, StateModel
from schuler.mechanization.strapdown import NavState
from schuler.navigation.inputs.imu_axes import claimed_attitude
from schuler.navigation.recent_samples import RecentSamples, Sample
from schuler.rotation import dcm_from_quat

_TO_DO = (
    "Check initial covariance, noise densities, the noise of a receiver's clock and the sigmas of measurements; align "
    "again and make a new Navigator"
)
MAX_AHEAD_S = 86_400.0  # a measurement stamped later than the newest sample by more is of another clock [s]


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
    batch run also propagates its covariance for records. Lost samples are bridged as there: an increment that is
    too small for its step is filled with the mean rate, and the covariance grows by what bridging as long a piece of
    the last minute would have missed. A single reading that no vehicle moves by is replaced by the one before,
    uncertain by the difference. :attr:`notes` says so.

    Copies, pickles and files (:meth:`save`, :meth:`load`) go on to the same last bit.

    Noise is not tuned live, as :func:`~schuler.navigate` tunes that of an IMU by name (``filter.tune``): give the
    densities that ``schuler tune`` found on an earlier log.

    Parameters
    ----------
    initial : InitialState
    layout : StateLayout
    gyro_psd, accel_psd : array_like, shape (3,)
        White-noise densities ``N**2`` by axis. [rad^2/s], [m^2/s^3]
    interval_s : float
        Nominal IMU sample interval. [s]
    options : FilterOptions, optional
        With ``gap_s`` samples are taken as they are: pauses were bridged before, increments cover all their interval.
    delay_s : float
        How long IMU samples wait for late measurements. [s]
    max_gap_s : float
        Longest step from sample to sample; longer ones are refused. [s]
    keep : int
        Number of :attr:`outcomes` and :attr:`notes` that are kept, the newest.
    axes_covariance_b : array_like, shape (3, 3), optional
        What is not known of the sensors' axes, of :func:`~schuler.navigation.inputs.imu_axes.axes_covariance`: no
        attitude is claimed better than that. [rad^2]
    on_outcome : callable, optional
        Called with every :class:`Outcome`.

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
        max_gap_s: float = 2.0,
        keep: int = 10_000,
        axes_covariance_b: ArrayLike | None = None,
        on_outcome: Callable[[Outcome], None] | None = None,
    ) -> None:
        if not (math.isfinite(interval_s) and interval_s > 0.0 and math.isfinite(delay_s) and delay_s >= 0.0):
            raise InputError(f"expected interval_s > 0 and delay_s >= 0, got {interval_s} and {delay_s}")
        if not (math.isfinite(max_gap_s) and max_gap_s > interval_s) or keep < 1:
            raise InputError(f"expected max_gap_s > interval_s and keep >= 1, got {max_gap_s} and {keep}")
        self.layout = layout
        self.interval_s, self.delay_s, self.max_gap_s, self.keep = interval_s, delay_s, max_gap_s, keep
        given = np.zeros((3, 3)) if axes_covariance_b is None else axes_covariance_b
        self._axes_b = as_floats(given, "axes_covariance_b", (3, 3))
        self._filter = FilterState(initial, layout, gyro_psd, accel_psd, options or FilterOptions(), interval_s)
        self._bridges = self._filter.options.gap_s is None
        self._recent = RecentSamples(interval_s)
        self._waiting: deque[Sample] = deque()
        self._pending = MeasurementSchedule.empty()
        self._last = initial.nav.t
        self._outcomes: deque[Outcome] = deque(maxlen=keep)
        self._notes: deque[str] = deque(maxlen=keep)
        self._on_outcome = on_outcome
        n = layout.size
        # one-sample inputs, and outputs of no length: records and smoother nodes are for batch runs
        self._in = ImuStream(np.empty((1, 3)), np.empty((1, 3)), np.empty(1), np.empty(1), ends=False)
        self._no_measurement = Aiding.of(MeasurementSchedule.empty())
        self._out = (
            TrajectoryArrays.of_size(0), RecordArrays.of_size(0, n), NodeArrays.of_size(0, 0, n, layout.n_sensor),
        )  # fmt: skip
        from schuler.filtering.kernels import run as k
        from schuler.jit import direct

        self._run_filter, self._n_measured = direct(k.run_filter), k.CNT_MEAS

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
            If time does not advance or advances by more than ``max_gap_s``, a value is not finite or beyond any sensor
            (nothing is taken then, and the next sample bridges this one).
        DivergenceError
            If the filter has failed: an innovation without a positive variance, or a place or speed that nothing has.
        """
        dt = t - self._last
        if not dt > 0.0:
            raise InputError(f"expected a sample after {self._last:.6f} s, got one at {t:.6f} s")
        if dt > self.max_gap_s:
            raise InputError(
                f"expected a sample within max_gap_s = {self.max_gap_s:g} s after {self._last:.6f} s, got one at "
                f"{t:.6f} s: leave it out if its stamp is wrong; after a pause that long align again and make a new "
                "Navigator, or raise max_gap_s if the motion was slow"
            )
        dtheta, dv = as_vector3(dtheta_ib_b, "dtheta_ib_b"), as_vector3(dv_ib_b, "dv_ib_b")
        sample, sentence = self._recent.checked(t, dt, dtheta, dv, self._bridges)
        if sentence:
            self._notes.append(sentence)
        self._last = t
        if self.delay_s == 0.0:
            self._step(sample)
            return
        self._waiting.append(sample)
        while self._waiting and self._waiting[0].t <= t - self.delay_s:
            self._step(self._waiting.popleft())

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
            If a number is not finite, a covariance is none, or the time is of another clock.
        """
        now = float(self._filter.arrays.times[0])
        _check(measurement, self._last + MAX_AHEAD_S)
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
            self._step(self._waiting.popleft())

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
        dt = np.array([w.dt for w in self._waiting])
        dtheta, dv = np.array([w.dtheta for w in self._waiting]), np.array([w.dv for w in self._waiting])
        dv = (dv - b_a * dt[:, None]) @ inverse[1].T
        dtheta = (dtheta - b_g * dt[:, None] - dv @ inverse[2].T) @ inverse[0].T
        ahead = mechanize(Increments(np.array([w.t for w in self._waiting]), dt, dtheta, dv), state)
        return NavState(float(ahead.t[-1]), ahead.r_eb_e[-1], ahead.v_eb_e[-1], ahead.q_eb[-1])

    @property
    def parameters(self) -> FloatArray:
        """Parameter estimates, order of the layout. Shape (m,)."""
        return self._filter.arrays.est.copy()

    @property
    def covariance(self) -> FloatArray:
        """Covariance at its last propagation, navigation errors in north-east-down axes. Shape (n, n).

        Symmetric, and positive definite to the rounding of its elements: eigenvalues of matrices with mixed units are
        not, below 1e-16 of the largest; test those of the correlations, or a Cholesky factor. The attitude is claimed
        no better than ``axes_covariance_b`` allows; the filter goes on without that.
        """
        P, state = self._filter.covariance_e, self.state
        if self._axes_b.any():
            P[:3, :3] = claimed_attitude(P[:3, :3], dcm_from_quat(state.q_eb), self._axes_b)
        T = ecef_from_ned_states(state.llh, self.layout.size)
        rotated: FloatArray = T.T @ P @ T
        return 0.5 * (rotated + rotated.T)

    @property
    def outcomes(self) -> list[Outcome]:
        """Outcomes of the last ``keep`` measurements."""
        return list(self._outcomes)

    @property
    def notes(self) -> list[str]:
        """Sentences on lost samples and readings taken out, the last ``keep``."""
        return list(self._notes)

    def save(self, path: Path | str) -> Path:
        """Write everything that goes on from here, so that :meth:`load` goes on to the same last bit.

        Parameters
        ----------
        path : Path or str
            Its file appears complete or not at all.
        """
        from schuler.navigation.navigator_file import write_document

        return write_document(path, self._document())

    @classmethod
    def load(cls, path: Path | str, *, on_outcome: Callable[[Outcome], None] | None = None) -> Navigator:
        """A navigator that :meth:`save` wrote.

        Parameters
        ----------
        path : Path or str
        on_outcome : callable, optional
            As for a new one: files hold no functions.

        Raises
        ------
        FileFormatError
            If the file is of another kind or version, or damaged.
        """
        from schuler.exceptions import FileFormatError
        from schuler.navigation.navigator_file import read_document

        document = read_document(path)
        try:
            return _restored(document, on_outcome)
        except (InputError, KeyError, TypeError, ValueError, IndexError, AttributeError) as error:
            raise FileFormatError(f"holds no navigator: {error}", path) from None

    def __reduce__(self) -> tuple[Any, ...]:
        return _restored, (self._document(), self._on_outcome)

    def _document(self) -> dict[str, Any]:
        """Everything that goes on, as plain data and arrays; :func:`_restored` reads it."""
        f, r = self._filter, self._recent
        return {
            "layout": self.layout.to_dict(),
            "options": asdict(f.options),
            "interval_s": self.interval_s, "delay_s": self.delay_s, "max_gap_s": self.max_gap_s, "keep": self.keep,
            "psd": f.model.psd.copy(),
            "axes_covariance_b": self._axes_b.copy(),
            "arrays": {name: np.array(value) for name, value in zip(f.arrays._fields, f.arrays, strict=True)},
            "recent": {"rows": r.rows.copy(), "largest": r.largest.copy(), "count": r.count.copy()},
            "waiting": np.array([np.hstack(w) for w in self._waiting]).reshape(-1, 10),
            "pending": {name: np.array(getattr(self._pending, name)) for name in _MEASUREMENT},
            "last": self._last,
            "outcomes": [[o.t, o.kind, o.status, o.nis, *o.innovation] for o in self._outcomes],
            "notes": list(self._notes),
        }  # fmt: skip

    def _compensation(self) -> tuple[FloatArray, FloatArray, tuple[FloatArray, FloatArray, FloatArray]]:
        s = self._filter.arrays.sens
        return s[0:3], s[3:6], (s[6:15].reshape(3, 3), s[15:24].reshape(3, 3), s[24:33].reshape(3, 3))

    def _step(self, sample: Sample) -> None:
        stream, f, t = self._in, self._filter, sample.t
        stream.dtheta[0], stream.dv[0], stream.dt[0], stream.t[0] = sample.dtheta, sample.dv, sample.dt, t
        if len(self._pending) and self._pending.t[0] <= t + 1e-9:
            due = self._pending.t <= t + 1e-9
            taken, self._pending = self._pending.where(due), self._pending.where(~due)
            aiding = Aiding.of(taken)
        else:
            taken, aiding = None, self._no_measurement
        settings = f.settings
        if sample.gyro > 0.0 or sample.accel > 0.0:
            settings = settings._replace(gap_s=0.0, gap_gyro=sample.gyro, gap_accel=sample.accel)
        f.arrays.counts[self._n_measured] = 0
        self._run_filter(stream, aiding, f.arrays, f.model, settings, f.work, *self._out)
        if taken is not None:
            for i in range(len(taken)):
                self._judge(
                    Outcome(
                        float(taken.t[i]), KINDS[int(taken.kind[i])], STATUS[int(aiding.status[i])],
                        float(aiding.nis[i]), aiding.innovation[i],
                    )
                )  # fmt: skip
            if f.is_broken:
                v, r = np.linalg.norm(f.arrays.nav[4:7]), np.linalg.norm(f.arrays.nav[7:10])
                raise DivergenceError(
                    f"the filter failed at {t:.3f} s: its measurements lead it to a speed of {v:.3g} m/s, {r:.3g} m "
                    f"from the Earth's centre. {_TO_DO}"
                )

    def _judge(self, outcome: Outcome) -> None:
        """Keep and report an outcome; an innovation whose covariance is none ends the run."""
        self._outcomes.append(outcome)
        if self._on_outcome is not None:
            self._on_outcome(outcome)
        if outcome.status == STATUS[REJECTED] and not outcome.nis >= 0.0:
            raise DivergenceError(
                f"the filter failed at {outcome.t:.3f} s: the innovation of a {outcome.kind} has no positive variance "
                f"(normalised square {outcome.nis:g}). {_TO_DO}"
            )


_MEASUREMENT = ("t", "kind", "z", "R", "lever", "gate")


def _check(measurement: MeasurementSchedule, latest: float) -> None:
    """Raise InputError if a measurement is none: numbers, covariances, times."""
    for name in ("t", "z", "R", "lever"):
        as_floats(getattr(measurement, name), f"measurement.{name}")
    if np.isnan(measurement.gate).any():
        raise InputError("measurement.gate: expected numbers, got NaN; inf accepts everything")
    if not len(measurement):
        return
    if measurement.t.max() > latest:
        raise InputError(
            f"expected measurements on the IMU's clock, got one at {measurement.t.max():.3f} s, later than its last "
            f"sample by more than {MAX_AHEAD_S:g} s: shift one of the clocks"
        )
    R = measurement.R
    used = np.where(np.array([DIMENSIONS[int(kind)] for kind in measurement.kind]) == 3, 3, 1)
    for i, d in enumerate(used):
        part = R[i, :d, :d]
        if not np.allclose(part, part.T, rtol=1e-9, atol=0.0) or np.linalg.eigvalsh(part)[0] < -1e-12 * np.trace(part):
            raise InputError(
                f"measurement.R: expected a covariance, got {part.tolist()} at {measurement.t[i]:.3f} s, which is not "
                "symmetric or has a negative variance in some direction"
            )


def _restored(document: dict[str, Any], on_outcome: Callable[[Outcome], None] | None) -> Navigator:
    """The navigator of a document; its arrays are copied into arrays of the same shapes."""
    layout = StateLayout({name: StateModel(**model) for name, model in document["layout"].items()})
    nav = document["arrays"]["nav"]
    state = NavState(float(document["arrays"]["times"][0]), nav[7:10], nav[4:7], nav[0:4] / np.linalg.norm(nav[0:4]))
    n, psd = layout.size, document["psd"]
    live = Navigator(
        InitialState(state, np.zeros((n, n)), np.zeros(n - 9)), layout, psd[:3], psd[3:],
        interval_s=document["interval_s"], delay_s=document["delay_s"], max_gap_s=document["max_gap_s"],
        keep=document["keep"], options=FilterOptions(**document["options"]),
        axes_covariance_b=document.get("axes_covariance_b"), on_outcome=on_outcome,
    )  # fmt: skip
    f, r = live._filter, live._recent
    pairs = [(getattr(f.arrays, name), document["arrays"][name], name) for name in f.arrays._fields]
    pairs += [(getattr(r, name), document["recent"][name], name) for name in ("rows", "largest", "count")]
    for target, value, name in pairs:
        if target.shape != value.shape or target.dtype != value.dtype:
            raise InputError(f"{name}: expected shape {target.shape}, got {value.shape}")
        target[:] = value
    for row in document["waiting"]:
        t, dt, gyro, accel = map(float, row[[0, 1, 8, 9]])
        live._waiting.append(Sample(t, dt, row[2:5].copy(), row[5:8].copy(), gyro, accel))
    live._pending = MeasurementSchedule(*(document["pending"][name].copy() for name in _MEASUREMENT))
    live._last = document["last"]
    live._outcomes += [Outcome(t, kind, status, nis, np.array(e)) for t, kind, status, nis, *e in document["outcomes"]]
    live._notes += document["notes"]
    return live
