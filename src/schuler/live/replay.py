"""The filter of a stream with a memory of the last seconds, from which it runs again when a measurement comes late."""

from __future__ import annotations

from collections import deque
from dataclasses import asdict
from typing import Any, NamedTuple

import numpy as np

from schuler.arrays import FloatArray, IntArray
from schuler.exceptions import InputError
from schuler.filtering.engine import FilterOptions, FilterState
from schuler.filtering.filter_arrays import (
    Aiding,
    FilterArrays,
    ImuStream,
    NodeArrays,
    RecordArrays,
    Settings,
    TrajectoryArrays,
)
from schuler.filtering.initial_state import InitialState
from schuler.filtering.limits import N_VALUES
from schuler.filtering.measurements import (
    EARTH_RATE,
    FIX,
    GNSS_HEADING,
    GRAVITY,
    GRAVITY_VECTOR,
    HEADING,
    HEIGHT,
    KINDS,
    LATERAL,
    POSITION,
    PSEUDORANGE,
    RANGE_RATE,
    SPEED,
    VELOCITY,
    VERTICAL,
    ZERO_RATE,
    ZERO_VELOCITY,
    MeasurementSchedule,
)
from schuler.filtering.states import StateLayout, StateModel
from schuler.live.columns import Columns
from schuler.live.preparation import PreparedSamples
from schuler.mechanization.strapdown import NavState

SNAPSHOT_S = 0.5  # between two stored states: as much is run again at most beside what a measurement is late [s]
_NONE = np.empty(0)
_SAME = 1e-9  # measurements so close to a sample belong to its interval, as in the kernel [s]

# Order of measurements of one time, that of :func:`schuler.navigation.aids.aiding.aiding_schedule`.
_ORDER = (
    POSITION, VELOCITY, PSEUDORANGE, RANGE_RATE, LATERAL, VERTICAL, SPEED, HEADING, GNSS_HEADING, HEIGHT, FIX,
    ZERO_VELOCITY, ZERO_RATE, EARTH_RATE, GRAVITY, GRAVITY_VECTOR,
)  # fmt: skip
_MANY = (PSEUDORANGE, RANGE_RATE)  # of one time, whose epochs are told apart before
_RANK = np.zeros(max(KINDS) + 1, dtype=np.int64)
_RANK[list(_ORDER)] = np.arange(len(_ORDER))


class Judged(NamedTuple):
    """Measurements and what became of them."""

    t: FloatArray  # (m,) [s]
    kind: IntArray  # (m,)
    status: IntArray  # (m,)
    nis: FloatArray  # (m,)


class ReplayFilter:
    """A running filter that takes measurements late: it goes back to a stored state and runs again from there.

    The numbers are those of a batch run of the same samples and measurements, in whatever order they came.

    Parameters
    ----------
    initial : InitialState
    layout : StateLayout
    psd : (ndarray, ndarray), shapes (3,)
        White noise of gyroscopes and accelerometers, ``N**2`` by axis. [rad^2/s], [m^2/s^3]
    options : FilterOptions
    interval_s : float
        Nominal sample interval. [s]
    lag_s : float
        How late a measurement may come. [s]
    """

    def __init__(
        self,
        initial: InitialState,
        layout: StateLayout,
        psd: tuple[FloatArray, FloatArray],
        options: FilterOptions,
        interval_s: float,
        lag_s: float,
    ) -> None:
        self.layout, self.options, self.psd = layout, options, psd
        self.interval_s, self.lag_s = interval_s, lag_s
        self.state = FilterState(initial, layout, *psd, options, interval_s)
        self.samples = Columns(t=0, dt=0, dtheta=3, dv=3, unknown=2)
        self.bridged_at = -np.inf  # end of the newest interval that bridges a pause [s]
        self._measurements = Columns(
            ("kind", "status"), t=0, kind=0, z=N_VALUES, R=9, lever=3, gate=0, status=0, nis=0, innovation=3, variance=3
        )
        self.snapshots: deque[FilterArrays] = deque([copied(self.state.arrays)])
        n = layout.size
        # one record that is not read: a batch run propagates its covariance for records, and so does this one
        self._out = TrajectoryArrays.of_size(0), RecordArrays.of_size(1, n), NodeArrays.of_size(0, 0, n, 0)
        from schuler.filtering.kernels import run as k
        from schuler.jit import direct

        self._run_filter, self._n_measured = direct(k.run_filter), k.CNT_MEAS

    @property
    def time(self) -> float:
        """Time of the state. [s]"""
        return float(self.state.arrays.times[0])

    @property
    def aiding(self) -> Aiding:
        """Measurements of the replay window in order of time, views."""
        return self._aiding(0)

    @property
    def oldest(self) -> float:
        """Measurements of this time and before come too late. [s]"""
        return float(self.snapshots[0].times[0])

    @property
    def propagation_s(self) -> float:
        """Longest time between two propagations of the covariance. [s]"""
        return self.state.settings.every * self.interval_s

    def extend(self, samples: PreparedSamples) -> None:
        """Append samples; those that begin before the filter's start are left out."""
        first = int(np.searchsorted(samples.t - samples.dt, self.oldest - 1e-6))
        part = slice(first, None)
        self.samples.append(
            t=samples.t[part], dt=samples.dt[part], dtheta=samples.dtheta[part], dv=samples.dv[part],
            unknown=samples.unknown[part],
        )  # fmt: skip
        bridged = np.flatnonzero(samples.unknown[part].any(axis=1))
        if len(bridged):
            self.bridged_at = float(samples.t[part][bridged[-1]])

    def aid(self, measurements: MeasurementSchedule) -> tuple[FloatArray, FloatArray]:
        """Put measurements in, each at its own time.

        Returns
        -------
        late, repeated : ndarray
            Times of those left out that came too late, and of those whose kind is there already at their time. [s]
        """
        if self._goes_on(measurements):
            m = measurements
            self._measurements.append(
                t=m.t, kind=m.kind, z=m.z, R=m.R.reshape(-1, 9), lever=m.lever, gate=m.gate, status=0, nis=np.nan,
                innovation=np.nan, variance=np.nan,
            )  # fmt: skip
            return _NONE, _NONE
        late = measurements.t <= self.oldest + 1e-6
        used, repeated = measurements.where(~late) if late.any() else measurements, np.empty(0)
        if len(used):
            if used.t.min() <= self.time + _SAME:
                self._go_back(float(used.t.min()))
            both = [np.concatenate(pair) for pair in zip(self.aiding, Aiding.of(used), strict=True)]
            t, kind = both[0], both[1]
            order = np.lexsort((_RANK[kind], t))
            again = (np.diff(t[order]) == 0.0) & (np.diff(kind[order]) == 0) & ~np.isin(kind[order[1:]], _MANY)
            if again.any():
                repeated = t[order[1:][again]]
                order = order[np.concatenate(([True], ~again))]
            self._take(Aiding._make(np.ascontiguousarray(x[order]) for x in both))
        return measurements.t[late], repeated

    def exchange(self, times: FloatArray, measurements: MeasurementSchedule) -> None:
        """Put ranges of satellites and their rates in place of those of some times, shape (k,), unless too old. [s]"""
        times = times[times > self.oldest + 1e-6]
        t, kind = self._measurements["t"], self._measurements["kind"]
        gone = np.isin(kind, _MANY) & np.isin(t, times)
        if gone.any():
            first = float(t[gone][0])
            if first <= self.time + _SAME:
                self._go_back(first)
            self._take(Aiding._make(np.ascontiguousarray(x[~gone]) for x in self.aiding))
        self.aid(measurements.where(measurements.t > self.oldest + 1e-6))

    def run(self) -> None:
        """Filter up to the newest sample."""
        t, arrays = self.samples["t"], self.state.arrays
        n = len(t)
        if not n or t[-1] <= arrays.times[0]:
            return
        first = int(t.searchsorted(arrays.times[0], side="right"))
        due = float(self.snapshots[-1].times[0]) + SNAPSHOT_S
        while first < n:
            stop = self._piece(first, due)
            self._call(arrays, self.state.settings, slice(first, stop), False, self._out)
            first = stop
            if arrays.times[0] >= due - 1e-9:
                self.snapshots.append(copied(arrays))
                due = float(arrays.times[0]) + SNAPSHOT_S

    def run_again(self, arrays: FilterArrays, first: int, trajectory: TrajectoryArrays, nodes: NodeArrays) -> None:
        """Carry another state, that of a sample's beginning, to the newest sample, with all that a log's run keeps."""
        out = trajectory, self._out[1], nodes
        settings, n = self.state.settings._replace(output_every=1), len(self.samples)
        while first < n:
            stop = self._piece(first, np.inf)
            self._call(arrays, settings, slice(first, stop), stop == n, out)
            first = stop

    def forget(self) -> Judged:
        """Drop what is older than the lag; the measurements that cannot change any more."""
        while len(self.snapshots) > 1 and float(self.snapshots[1].times[0]) <= self.time - self.lag_s:
            self.snapshots.popleft()
        self.samples.drop_before(self.oldest)
        old = int(self._measurements["t"].searchsorted(self.oldest + _SAME, side="right"))
        judged = Judged(*(self._measurements[name][:old].copy() for name in Judged._fields))
        self._measurements.drop(old)
        return judged

    def judged(self) -> Judged:
        """The measurements that were worked off and may still be run again."""
        done = int(self._measurements["t"].searchsorted(self.time + _SAME, side="right"))
        return Judged(*(self._measurements[name][:done] for name in Judged._fields))

    def document(self) -> dict[str, Any]:
        """State, stored states, samples and measurements of the replay window, for files."""
        return {
            "layout": self.layout.to_dict(), "options": asdict(self.options), "psd": np.concatenate(self.psd),
            "interval_s": self.interval_s, "lag_s": self.lag_s,
            "state": _named(self.state.arrays), "snapshots": [_named(s) for s in self.snapshots],
            "samples": self.samples.document(), "aiding": _named(self.aiding),
        }  # fmt: skip

    @classmethod
    def restored(cls, document: dict[str, Any]) -> ReplayFilter:
        """The filter of a :meth:`document`.

        Raises
        ------
        InputError
            If an array has not the shape that the states ask for.
        """
        layout = StateLayout({name: StateModel(**model) for name, model in document["layout"].items()})
        nav, n, psd = document["state"]["nav"], layout.size, document["psd"]
        t = float(document["state"]["times"][0])
        state = NavState(t, nav[7:10], nav[4:7], nav[0:4] / np.linalg.norm(nav[0:4]))
        run = cls(
            InitialState(state, np.zeros((n, n)), np.zeros(n - 9)), layout, (psd[:3], psd[3:]),
            FilterOptions(**document["options"]), document["interval_s"], document["lag_s"],
        )  # fmt: skip
        own = run.state.arrays
        for stored in (document["state"], *document["snapshots"]):
            for name, array in zip(own._fields, own, strict=True):
                if stored[name].shape != array.shape or stored[name].dtype != array.dtype:
                    raise InputError(f"{name}: expected shape {array.shape}, got {stored[name].shape}")
        for name, array in zip(own._fields, own, strict=True):
            array[...] = document["state"][name]
        run.snapshots = deque(FilterArrays(**stored) for stored in document["snapshots"])
        run.samples.restore(document["samples"])
        bridged = np.flatnonzero(run.samples["unknown"].any(axis=1))
        run.bridged_at = float(run.samples["t"][bridged[-1]]) if len(bridged) else -np.inf
        run._take(Aiding(**document["aiding"]))
        return run

    def _aiding(self, first: int) -> Aiding:
        """Measurements from one on."""
        return Aiding(*(self._measurements[name][first:] for name in Aiding._fields))

    def _take(self, aiding: Aiding) -> None:
        """Take measurements in place of those that there are."""
        self._measurements.drop(len(self._measurements))
        self._measurements.append(**aiding._asdict())

    def _goes_on(self, measurements: MeasurementSchedule) -> bool:
        """Whether measurements come after all others and after the state, each kind in its order and none again."""
        t, stored = measurements.t.tolist(), self._measurements["t"]
        if not t or t[0] <= self.time + _SAME or (len(stored) and t[0] <= stored[-1]):
            return False
        kind = measurements.kind.tolist()
        rank = _RANK[measurements.kind].tolist()
        return all(
            t[i] < t[i + 1] or (t[i] == t[i + 1] and (rank[i] < rank[i + 1] or kind[i] == kind[i + 1] in _MANY))
            for i in range(len(t) - 1)
        )

    def _call(
        self,
        arrays: FilterArrays,
        settings: Settings,
        rows: slice,
        ends: bool,
        out: tuple[TrajectoryArrays, RecordArrays, NodeArrays],
    ) -> None:
        """Filter samples that are a bridged pause, or without one, in one call of the kernel."""
        x, state = self.samples, self.state
        if x["t"][rows.start] <= self.bridged_at and (unknown := x["unknown"][rows.start]).any():
            settings = settings._replace(gap_s=0.0, gap_gyro=float(unknown[0]), gap_accel=float(unknown[1]))
        stream = ImuStream(x["dtheta"][rows], x["dv"][rows], x["dt"][rows], x["t"][rows], ends)
        j = int(self._measurements["t"].searchsorted(arrays.times[0] + _SAME, side="right"))
        arrays.counts[self._n_measured] = 0
        self._run_filter(stream, self._aiding(j), arrays, state.model, settings, state.work, *out)

    def _piece(self, first: int, due: float) -> int:
        """End of the samples that one call of the kernel takes: to the next state to be stored, or bridged pause."""
        t = self.samples["t"]
        stop = min(int(t.searchsorted(due - 1e-9)) + 1, len(t)) if t[-1] > due - 1e-9 else len(t)
        stop = max(stop, first + 1)
        if t[first] > self.bridged_at:
            return stop
        unknown = self.samples["unknown"]
        bridged = np.flatnonzero(unknown[first:stop, 0] + unknown[first:stop, 1] > 0.0)
        if not len(bridged):
            return stop
        return first + (int(bridged[0]) or 1)

    def _go_back(self, t: float) -> None:
        """Restore the latest stored state before a time."""
        while len(self.snapshots) > 1 and float(self.snapshots[-1].times[0]) + _SAME >= t:
            self.snapshots.pop()
        for name, stored in zip(FilterArrays._fields, self.snapshots[-1], strict=True):
            getattr(self.state.arrays, name)[...] = stored


def _named(arrays: FilterArrays | Aiding) -> dict[str, Any]:
    return {name: np.array(value) for name, value in arrays._asdict().items()}


def copied(arrays: FilterArrays) -> FilterArrays:
    """A state of its own with the same numbers."""
    return FilterArrays._make(x.copy() for x in arrays)
