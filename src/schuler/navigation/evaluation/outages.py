"""Position errors of many GNSS outages: mean, standard deviation and covariance of the filter."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from schuler import frames
from schuler.arrays import ArrayLike, FloatArray, IntArray, as_floats
from schuler.exceptions import DivergenceError, InputError
from schuler.filtering.engine import FilterOptions, run
from schuler.filtering.initial_state import InitialState
from schuler.filtering.measurements import GNSS_KINDS, MeasurementSchedule
from schuler.navigation.aids.aiding import Sources, aiding_schedule
from schuler.navigation.aids.vehicle import weaker_without_fixes
from schuler.navigation.config import NavigationConfig, OutageSection
from schuler.navigation.evaluation.architectures import reference_of
from schuler.navigation.evaluation.consistency import chi_square_band
from schuler.navigation.inputs.preparation import filter_options, prepared_imu
from schuler.navigation.result import NavigationResult
from schuler.navigation.run import navigate
from schuler.navigation.start.alignment import advance_to_log_start
from schuler.navigation.states import imu_spec, white_noise_psd
from schuler.plotting.table import ResultTable, TabularResult
from schuler.recording.recording import Recording
from schuler.recording.series import Increments
from schuler.recording.trajectory import Trajectory

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, repr=False)
class OutageStatistics(TabularResult):
    """Position errors of many outages by their age.

    Attributes
    ----------
    lengths : ndarray, shape (k,)
        Lengths of the outages. [s]
    starts : ndarray, shape (n,)
        When GNSS was lost, from the start of the recording. [s]
    age : ndarray, shape (m,)
        Time since GNSS was lost; zero is the last aided state. [s]
    error_n : ndarray, shape (n, m, 3)
        Estimate minus reference, north, east, down. [m]
    cov_n : ndarray, shape (n, m, 3, 3)
        Covariance the filter claims. [m^2]
    name : str
        For titles.
    complete : bool
        False if interrupted: the outages that were finished.
    """

    lengths: FloatArray
    starts: FloatArray
    age: FloatArray
    error_n: FloatArray
    cov_n: FloatArray
    name: str = "outages"
    complete: bool = True

    def __len__(self) -> int:
        return len(self.starts)

    def _at(self, length: float) -> int:
        k = int(np.argmin(np.abs(self.age - length)))
        if abs(self.age[k] - length) > 1e-6:
            raise InputError(
                f"no errors {length:g} s after the loss of GNSS; there are some every {self.age[1]:g} s up to "
                f"{self.age[-1]:g} s"
            )
        return k

    def end_errors(self, length: float) -> FloatArray:
        """Errors at the end of outages of a length [s]. Shape (n, 3). [m]"""
        return self.error_n[:, self._at(length)]

    def mean(self, length: float, *, every_epoch: bool = False) -> FloatArray:
        """Mean error north, east, down, Hayal (5.1). Shape (3,). [m]"""
        value: FloatArray = self._chosen(length, every_epoch).mean(axis=0)
        return value

    def sigma(self, length: float, *, every_epoch: bool = False) -> FloatArray:
        """Standard deviation of the error about its mean, divisor n, Hayal (5.2). Shape (3,). [m]

        Parameters
        ----------
        length : float
            [s]
        every_epoch : bool
            Over all epochs of the outages instead of their last; Hayal leaves this open.
        """
        value: FloatArray = self._chosen(length, every_epoch).std(axis=0)
        return value

    def rms_horizontal(self, length: float) -> float:
        """Root mean square of the horizontal error at the end. [m]"""
        e = self.end_errors(length)
        return float(np.sqrt(np.mean(e[:, 0] ** 2 + e[:, 1] ** 2)))

    def claimed_horizontal(self, length: float) -> float:
        """Root mean square of the horizontal error as the filter claims it. [m]"""
        P = self.cov_n[:, self._at(length)]
        return float(np.sqrt(np.mean(P[:, 0, 0] + P[:, 1, 1])))

    def nees(self, length: float) -> float:
        """Mean normalised position error squared per degree of freedom at the end; 1 for an honest filter."""
        e, P = self.end_errors(length), self.cov_n[:, self._at(length)]
        return float(np.mean(np.einsum("ni,ni->n", e, np.linalg.solve(P, e[:, :, None])[:, :, 0])) / 3.0)

    def _chosen(self, length: float, every_epoch: bool) -> FloatArray:
        k = self._at(length)
        return self.error_n[:, 1 : k + 1].reshape(-1, 3) if every_epoch else self.error_n[:, k]

    def table(self) -> ResultTable:
        """One row a length: Hayal's mean and sigmas at the end, then over every epoch, and the claim."""
        rows = []
        for length in self.lengths:
            mean, sigma = self.mean(length), self.sigma(length)
            every = float(np.linalg.norm(self.sigma(length, every_epoch=True)))
            end = self.error_n[:, self._at(length)]
            rows.append(
                (
                    float(length), len(self), float(np.linalg.norm(mean)), *map(float, sigma),
                    float(np.linalg.norm(sigma)), every, self.rms_horizontal(length),
                    float(np.hypot(end[:, 0], end[:, 1]).max()), self.claimed_horizontal(length), self.nees(length),
                )
            )  # fmt: skip
        low, high = chi_square_band(3, max(len(self), 1))
        return ResultTable(
            f"{self.name}: position error after outages",
            (
                "outage_s", "outages", "mean_m", "sigma_north_m", "sigma_east_m", "sigma_down_m", "sigma_total_m",
                "sigma_total_every_epoch_m", "rms_horizontal_m", "max_horizontal_m", "claimed_horizontal_m", "nees",
            ),
            tuple(rows),
            (
                "mean is the length of the mean error vector; sigma_total the root of the sum of the three squares "
                "(Hayal 5.1 to 5.4)",
                f"were the {len(self)} outages independent, the NEES of an honest filter would lie in {low:.2f} to "
                f"{high:.2f} (95 %); those that share a slow bias are not",
            ),
            self.complete,
        )  # fmt: skip

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return {**self.table().to_dict(), "starts_s": self.starts.tolist()}

    def plot(self) -> Figure:
        """Fan of all outages with the claimed 3 sigma, see :func:`schuler.navigation.evaluation.figures.plot_fan`."""
        from schuler.navigation.evaluation.figures import plot_fan

        return plot_fan(self)


Progress = Callable[[float], None]


def outage_statistics(
    recording: Recording,
    config: NavigationConfig | dict[str, Any] | Path | str,
    *,
    lengths: Sequence[float] = (2.0, 10.0, 30.0, 60.0),
    starts: ArrayLike | None = None,
    settle_s: float = 60.0,
    every_s: float | None = None,
    step_s: float = 1.0,
    initial: InitialState | None = None,
    progress: Progress | None = None,
) -> OutageStatistics:
    """Position errors after GNSS outages of given lengths, from many outages over one run.

    Parameters
    ----------
    recording : Recording
        Errors are measured against its reference, or against its GNSS fixes at the antenna.
    config : NavigationConfig, dict, or path of a TOML file
        Its own outages are left out.
    lengths : sequence of float
        Multiples of ``step_s``. [s]
    starts : array_like, optional
        Starts of the outages, from the start of the recording; moved to the record of the filter before. [s]
    settle_s : float
        Without ``starts``: first one so long after the filter begins. [s]
    every_s : float, optional
        Without ``starts``: period of the losses; default a third of the longest outage, at least ``step_s``. [s]
    step_s : float
        Spacing of the errors. [s]
    initial : InitialState, optional
        Start of the aided run, see :func:`schuler.navigation.run.navigate`.
    progress : callable, optional
        Called with the fraction done.

    Returns
    -------
    OutageStatistics
        On Ctrl-C the outages that were finished.

    Raises
    ------
    InputError
        If lengths are no multiples of the step, or the recording is too short for one outage.
    DivergenceError
        If the covariance of the aided run breaks down before an outage.

    Notes
    -----
    In an outage the filter only predicts, and a prediction from time t does not depend on any measurement after t. The
    run is navigated once with all measurements and continued without GNSS from its records, as exact as a run of its
    own for every outage, with outages that may overlap. Other aids go on.

    References
    ----------
    Hayal (2010), section 5.4, eqs. (5.1) to (5.4).
    """
    config = NavigationConfig.checked(config)
    lengths_s = _checked_lengths(lengths, step_s)
    longest = float(lengths_s.max())
    config = config.model_copy(
        update={
            "outages": OutageSection(),
            "filter": config.filter.model_copy(update={"smooth": False, "record_s": step_s, "tune": False}),
        }
    )
    reference, at_antenna, _ = reference_of(recording)
    base = navigate(recording, config, initial=initial)
    if not base.complete:
        raise KeyboardInterrupt
    origin = recording.start
    last = min(float(base.trajectory.t[-1]), float(reference.t[-1])) - longest
    if starts is None:
        period = max(longest / 3.0, step_s) if every_s is None else every_s
        times = np.arange(float(base.t[0]) + settle_s, last + 1e-9, period)
    else:
        times = _given_starts(starts, base, origin, last, longest)
    if not len(times):
        raise InputError(
            f"the solution runs from {base.t[0] - origin:.1f} to {base.trajectory.t[-1] - origin:.1f} s: too short "
            f"for an outage of {longest:g} s after {settle_s:g} s of settling; give shorter lengths or settle_s"
        )
    records = _records_before(times, base, origin)
    age = step_s * np.arange(round(longest / step_s) + 1.0)
    unaided = _unaided_log(recording, config, base, step_s)
    errors, covariances, starts_done = [], [], []
    complete = True
    try:
        for k in records:
            forked = _fork(unaided, base, int(k), longest)
            first = _position_errors(base, slice(int(k), int(k) + 1), reference, at_antenna)
            after = _position_errors(forked, slice(0, len(age) - 1), reference, at_antenna)
            if len(after[0]) < len(age) - 1:
                continue  # the log ends, or a gap left a record out
            errors.append(np.concatenate((first[0], after[0])))
            covariances.append(np.concatenate((first[1], after[1])))
            starts_done.append(float(base.t[k]) - origin)
            if progress is not None:
                progress(len(starts_done) / len(records))
    except KeyboardInterrupt:
        complete = False
    if not starts_done and complete:
        raise InputError(f"no outage of {longest:g} s fits between the gaps of the log; give shorter lengths")
    n, m = len(starts_done), len(age)
    return OutageStatistics(
        lengths_s, np.array(starts_done), age, np.array(errors).reshape(n, m, 3),
        np.array(covariances).reshape(n, m, 3, 3), recording.metadata.name, complete,
    )  # fmt: skip


def _checked_lengths(lengths: Sequence[float], step_s: float) -> FloatArray:
    """Lengths of outages, which are multiples of the step. Shape (n,). [s]"""
    lengths_s = as_floats(list(lengths), "lengths", (None,))
    if not len(lengths_s) or not step_s > 0.0 or np.any(lengths_s < step_s - 1e-9):
        raise InputError(f"lengths: expected one or more of at least step_s = {step_s} s, got {list(lengths)}")
    if np.any(np.abs(lengths_s / step_s - np.round(lengths_s / step_s)) > 1e-6):
        raise InputError(f"lengths: expected multiples of step_s = {step_s} s, got {list(lengths)}")
    return lengths_s


def _records_before(times: FloatArray, base: NavigationResult, origin: float) -> IntArray:
    """Records of the filter at or before times, each once; refused if the run diverged before one of them."""
    records = np.unique(np.searchsorted(base.t, times + 1e-9, side="right") - 1)
    records = records[records >= 0]
    broken = np.flatnonzero(~(np.einsum("kii->ki", base.covariance_e[records]) >= 0.0).all(axis=1))
    if len(broken):
        t = float(base.t[records[broken[0]]]) - origin
        raise DivergenceError(
            f"the run diverged with GNSS, before {t:.1f} s: its covariance is none any more, so that no outage can "
            "begin from it. Check the verdict of a run without outages, and whether the initial uncertainties are "
            "small enough for a linear filter (scale factors far below 1)"
        )
    return records


def _given_starts(starts: ArrayLike, base: NavigationResult, origin: float, last: float, longest: float) -> FloatArray:
    """Times of outages in the time of the log, none before the solution and none after ``last`` [s]."""
    times = origin + as_floats(starts, "starts", (None,))
    if np.any(times < base.t[0]) or np.any(times > last + 1e-9):
        raise InputError(
            f"starts: expected times from {base.t[0] - origin:.1f} to {last - origin:.1f} s, so that the "
            f"filter runs before and {longest:g} s of the log are left, got {times.min() - origin:.1f} to "
            f"{times.max() - origin:.1f} s"
        )
    return times


class _UnaidedLog(NamedTuple):
    """Increments, aids and options of a run that goes on without GNSS."""

    increments: Increments
    schedule: MeasurementSchedule
    gyro_psd: FloatArray
    accel_psd: FloatArray
    options: FilterOptions
    factor: float  # on sigmas of wheels long after the last fix


def _unaided_log(recording: Recording, config: NavigationConfig, base: NavigationResult, step: float) -> _UnaidedLog:
    """The log and all aids but GNSS, as :func:`schuler.navigation.run.navigate` prepares them."""
    spec = imu_spec(config)
    imu = prepared_imu(recording.need_imu(), config, [], begins=float(base.trajectory.t[0]))
    wheels = config.aiding.non_holonomic
    off = config.model_copy(update={"gnss": config.gnss.model_copy(update={"coupling": "off"})})
    # GNSS must not help to find rest, so all of the log is an outage
    schedule, _ = aiding_schedule(
        Sources(imu, recording.gnss, None, recording.odometer, recording.heading, recording.height),
        off, spec, float(base.trajectory.t[0]), recording.start, ((-np.inf, np.inf),),
    )  # fmt: skip
    options = replace(filter_options(config, imu), output_rate_hz=1.0 / step)
    return _UnaidedLog(
        imu.increments(order=config.imu.rate_order), schedule.where(~np.isin(schedule.kind, GNSS_KINDS)),
        *white_noise_psd(config, spec), options, 1.0 if wheels is None else wheels.unaided_factor,
    )  # fmt: skip


def _fork(unaided: _UnaidedLog, base: NavigationResult, k: int, longest: float) -> NavigationResult:
    """The run from its k-th record on, without GNSS."""
    t = float(base.t[k])
    start = base.state_at(k)
    step = unaided.options.record_s
    increments = unaided.increments.between(t - 1e-9, t + longest + 1.5 * step)
    forked = unaided.schedule.where((unaided.schedule.t > t + 1e-6) & (unaided.schedule.t <= increments.t[-1]))
    forked = weaker_without_fixes(forked, unaided.factor, np.array([t]))
    forward = run(
        increments,
        forked,
        advance_to_log_start(start, increments),
        base.layout,
        unaided.gyro_psd,
        unaided.accel_psd,
        unaided.options,
    )
    return NavigationResult.from_run(
        forward, forked.t, forked.kind, base.layout, lever_arm_b=base.lever_arm_b, outages=((t, t + longest),)
    )


def _position_errors(
    result: NavigationResult, part: slice, reference: Trajectory, at_antenna: bool
) -> tuple[FloatArray, FloatArray]:
    """Position errors and claimed covariance at records. Shapes (k, 3), (k, 3, 3). [m], [m^2]"""
    states = result.states.moved_by(result.lever_arm_b) if at_antenna else result.states
    t = result.t[part]
    truth = reference.at(t)
    C = frames.C_en(truth.llh)
    error: FloatArray = np.einsum("nji,nj->ni", C, states.r_eb_e[part] - truth.r_eb_e)
    P = result.filter_covariance_e(part)  # of an antenna that fixes placed, whatever its attitude is
    T = np.zeros((len(t), 3, P.shape[1]))
    T[:, :, 6:9] = np.eye(3)
    if at_antenna:
        # the antenna's error is dr + dpsi x (C l) = dr - [C l x] dpsi
        arm = states.r_eb_e[part] - result.states.r_eb_e[part]
        x, y, z = arm.T
        zero = np.zeros(len(t))
        T[:, :, 0:3] = np.stack(
            (np.stack((zero, z, -y), -1), np.stack((-z, zero, x), -1), np.stack((y, -x, zero), -1)), 1
        )
    TC = np.swapaxes(C, 1, 2) @ T
    cov: FloatArray = TC @ P @ np.swapaxes(TC, 1, 2)
    return error, cov
