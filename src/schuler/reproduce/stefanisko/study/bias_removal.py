"""Stefanisko's two ways to take the bias out of a log at rest before integrating it, and what they are worth.

Mean value: subtract the mean over a stretch at rest, less what a perfect sensor reads there (the source takes that for
zero, although an accelerometer at rest reads the reaction to gravity). Moving mean: subtract the mean of the second
before; a high-pass filter, which takes true motion out as well and is refused for a log that moves.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from schuler import earth, frames
from schuler.arrays import ArrayLike, FloatArray, as_floats
from schuler.exceptions import InputError
from schuler.mechanization.strapdown import NavState, mechanize
from schuler.plotting.table import ResultTable, TabularResult
from schuler.recording.series import ImuSeries, Increments
from schuler.reproduce.stefanisko.study.experiment import ACCEL_NOISE, ESIEE, GYRO_NOISE, IMU_INTERVAL_S
from schuler.standstill.stationarity import static_intervals
from schuler.units import DEG

Progress = Callable[[float], None]
Strategy = Literal["none", "mean, same stretch", "mean, stretch before", "moving mean, sliding", "moving mean, blocks"]
STRATEGIES: tuple[Strategy, ...] = (
    "none", "mean, same stretch", "mean, stretch before", "moving mean, sliding", "moving mean, blocks",
)  # fmt: skip

#: Constant errors that explain the source's drift without correction: 100, 70, 18 m in 20 s. [m/s^2], [rad/s]
BIAS_ACCEL = np.array([0.50, 0.35, 0.09])
BIAS_GYRO = np.full(3, 0.02 * DEG)
#: End errors of an independent simulation of 400 runs, north, east, down. [m]
CHECK = {
    "none": (95.0, 75.0, 18.0),
    "mean, same stretch": (0.24, 0.27, 0.10),
    "mean, stretch before": (0.52, 0.52, 0.25),
    "moving mean, sliding": (0.11, 0.11, 0.04),
    "moving mean, blocks": (0.19, 0.18, 0.08),
}


def mean_removed(samples: ArrayLike, rest: ArrayLike, expected: ArrayLike) -> FloatArray:
    """Samples less the bias found over a stretch at rest.

    Parameters
    ----------
    samples : array_like, shape (n, 3)
        Angular rate [rad/s] or specific force [m/s^2], body axes.
    rest : array_like, shape (m, 3)
        The stretch. The same samples (in-sample), or others (out-of-sample).
    expected : array_like, shape (3,)
        What a perfect sensor reads in the stretch: ``C_nb' omega_ie_n``, or ``-C_nb' g_n``.

    Returns
    -------
    ndarray, shape (n, 3)

    References
    ----------
    Stefanisko (2015), section 4.4; there ``expected`` is zero, which takes gravity, tilt and Earth rate for bias.
    """
    x, r = as_floats(samples, "samples", (None, 3)), as_floats(rest, "rest", (None, 3))
    if not len(r):
        raise InputError("rest: expected at least one sample, got none")
    corrected: FloatArray = x - (r.mean(axis=0) - as_floats(expected, "expected", (3,)))
    return corrected


def moving_mean_removed(
    samples: ArrayLike, window: int, expected: ArrayLike, *, blocks: bool = False, before: ArrayLike | None = None
) -> FloatArray:
    """Samples less the mean of the ``window`` samples before each.

    Parameters
    ----------
    samples : array_like, shape (n, 3)
        At rest; any true motion longer than the window is lost: displacement tends to half a window times velocity.
    window : int
        Samples in a second.
    expected : array_like, shape (3,)
        See :func:`mean_removed`.
    blocks : bool
        One mean for each block of ``window`` samples, that of the block before (the time shift of the source's Fig.
        4.7), instead of a window that slides with every sample.
    before : array_like, shape (>= window, 3), optional
        What came before the first sample; without it the first window, which has no past, takes its own mean.

    Returns
    -------
    ndarray, shape (n, 3)

    References
    ----------
    Stefanisko (2015), section 4.4, Figs. 4.7 and 4.9.
    """
    x = as_floats(samples, "samples", (None, 3))
    n = len(x)
    if not 1 <= window <= n:
        raise InputError(f"window: expected 1 to {n} samples, got {window}")
    past = x[:window] if before is None else as_floats(before, "before", (None, 3))[-window:]
    if len(past) < window:
        raise InputError(f"before: expected at least {window} samples, got {len(past)}")
    total = np.cumsum(np.concatenate((np.zeros((1, 3)), past, x)), axis=0)
    means = (total[window:] - total[:-window])[:n] / window  # mean of the window that ends before each sample
    if blocks:
        means = means[(np.arange(n) // window) * window]
    removed: FloatArray = x - (means - as_floats(expected, "expected", (3,)))
    return removed


def expected_at_rest(llh: ArrayLike, C_nb: ArrayLike | None = None) -> tuple[FloatArray, FloatArray]:
    """Readings of perfect sensors at rest: angular rate [rad/s], specific force [m/s^2], body axes. Shapes (3,), (3,).

    Parameters
    ----------
    llh : array_like, shape (3,)
        Latitude, longitude [rad], height [m].
    C_nb : array_like, shape (3, 3), optional
        Attitude; default level, x to the north.
    """
    p = as_floats(llh, "llh", (3,))
    C = np.eye(3) if C_nb is None else as_floats(C_nb, "C_nb", (3, 3))
    return C.T @ earth.earth_rate_ned(float(p[0])), -C.T @ earth.gravity_ned(float(p[0]), float(p[2]))


def corrected_log(
    imu: ImuSeries, strategy: Strategy, start: float, stop: float, llh: ArrayLike,
    *, check_rest: bool = True,
) -> ImuSeries:  # fmt: skip
    """A stretch of a log, corrected.

    Parameters
    ----------
    imu : ImuSeries
        Body axes. For ``mean, stretch before`` it must begin as long before ``start`` as the stretch lasts, for moving
        means it is used before ``start`` where it is there.
    strategy : str
        One of :data:`STRATEGIES`.
    start, stop : float
        [s]
    llh
        See :func:`expected_at_rest`; level, heading north.
    check_rest : bool
        Refuse a stretch that is not at rest, by the detector of :mod:`schuler.standstill.stationarity`, which
        needs a log of ten seconds or more.

    Returns
    -------
    ImuSeries
        Rates, from ``start`` to ``stop``.

    Raises
    ------
    InputError
        If the strategy is unknown, the log is too short, or it moves.
    """
    if strategy not in STRATEGIES:
        raise InputError(f"strategy: expected one of {', '.join(STRATEGIES)}, got {strategy!r}")
    rates = imu.rates()
    part = rates.between(start, stop)
    length = stop - start
    before = rates.t < part.t[0] - 1e-9
    if check_rest and strategy != "none":
        begin = start - length if strategy == "mean, stretch before" else start
        within = (rates.t >= begin) & (rates.t <= stop)
        share = float(static_intervals(rates).mask[within].mean())  # the detector learns from all of the log
        if share < 0.9:
            raise InputError(
                f"bias removal needs rest, but only {100.0 * share:.0f} % of {begin:.1f}..{stop:.1f} s is at rest; a "
                "moving mean would take true motion out with the bias. Choose a stretch at rest, or navigate with "
                "bias states and zero-velocity updates"
            )
    omega, f = expected_at_rest(llh)
    columns = []
    for x, past, expected in ((part.gyro, rates.gyro[before], omega), (part.accel, rates.accel[before], f)):
        if strategy == "none":
            columns.append(x)
        elif strategy == "mean, same stretch":
            columns.append(mean_removed(x, x, expected))
        elif strategy == "mean, stretch before":
            earlier = past[rates.t[before] >= start - length - 1e-9]
            if len(earlier) < 0.9 * len(x):
                raise InputError(f"the log begins less than {length:.1f} s before {start:.1f} s: no stretch before")
            columns.append(mean_removed(x, earlier, expected))
        else:
            w = max(1, round(rates.rate_hz))  # moving means of a second
            columns.append(
                moving_mean_removed(
                    x, w, expected, blocks=strategy.endswith("blocks"), before=past if len(past) >= w else None
                )
            )
    return replace(part, gyro=columns[0], accel=columns[1])


def resting_log(rng: np.random.Generator, samples: int, llh: ArrayLike = ESIEE) -> ImuSeries:
    """A simulated log at rest, level, with constant biases and white noise.

    Parameters
    ----------
    rng : numpy.random.Generator
    samples : int
        At :data:`~schuler.reproduce.stefanisko.study.experiment.IMU_INTERVAL_S`, the first one interval after zero.
    llh : array_like, shape (3,)
    """
    omega, f = expected_at_rest(llh)
    h = IMU_INTERVAL_S
    gyro = omega + BIAS_GYRO + GYRO_NOISE / np.sqrt(h) * rng.standard_normal((samples, 3))
    accel = f + BIAS_ACCEL + ACCEL_NOISE / np.sqrt(h) * rng.standard_normal((samples, 3))
    return ImuSeries(h * np.arange(1.0, samples + 1), gyro, accel)


def corrected_track(
    log: ImuSeries, strategy: Strategy, start_s: float, length_s: float, llh: ArrayLike = ESIEE
) -> FloatArray:
    """Position north, east, down from a stretch of a log at rest, corrected and integrated from a true start.

    Parameters
    ----------
    log : ImuSeries
        Of :func:`resting_log`.
    strategy : str
        One of :data:`STRATEGIES`.
    start_s, length_s : float
        [s]
    llh : array_like, shape (3,)

    Returns
    -------
    ndarray, shape (n, 3)
        After each sample. [m]
    """
    place, h = as_floats(llh, "llh", (3,)), IMU_INTERVAL_S
    part = corrected_log(log, strategy, start_s + h, start_s + length_s, place, check_rest=False)
    start = NavState.from_geodetic(start_s, place, np.zeros(3), np.zeros(3))
    increments = Increments(part.t, np.full(len(part), h), part.gyro * h, part.accel * h)
    track: FloatArray = (mechanize(increments, start).r_eb_e - start.r_eb_e) @ frames.C_en(place)
    return track


@dataclass(frozen=True)
class BiasStudy(TabularResult):
    """End errors of a log at rest that was corrected and integrated, over many runs.

    Attributes
    ----------
    end_n : dict of str to ndarray, shape (runs, 3)
        Position north, east, down at the end, by strategy. [m]
    length_s : float
    complete : bool
    """

    end_n: dict[str, FloatArray]
    length_s: float
    complete: bool = True

    def rms(self, strategy: str) -> FloatArray:
        """Root mean square over the runs. Shape (3,). [m]"""
        value: FloatArray = np.sqrt(np.mean(self.end_n[strategy] ** 2, axis=0))
        return value

    def table(self) -> ResultTable:
        """One row a strategy, numbers of the independent check beside ours."""
        rows = tuple((name, *map(float, self.rms(name)), *CHECK[name]) for name in STRATEGIES if len(self.end_n[name]))
        return ResultTable(
            f"Stefanisko, bias removal at rest, {self.length_s:g} s, {len(self.end_n['none'])} runs",
            ("strategy", "rms_north_m", "rms_east_m", "rms_down_m", "check_north_m", "check_east_m", "check_down_m"),
            rows,
            (
                "'same stretch' is estimated and tested on the same data (in-sample), 'stretch before' on others; the "
                "source's order of strategies turns over with that choice",
                "moving means take out true motion too: they are for rest only",
            ),
            self.complete,
        )


def bias_study(
    runs: int = 400, seed: int = 1, *, length_s: float = 20.0, progress: Progress | None = None
) -> BiasStudy:
    """Simulate logs at rest with constant biases and white noise, correct, integrate.

    Parameters
    ----------
    runs : int
    seed : int
        Run k is child k of it.
    length_s : float
        [s]
    progress : callable, optional

    Returns
    -------
    BiasStudy
        On Ctrl-C the runs that were finished.

    Notes
    -----
    Closed forms for accelerometer noise N alone, error at the end after T: uncorrected ``N sqrt(T^3 / 3)``; mean of the
    same stretch ``N sqrt(T^3 / 12)``; mean of as long a stretch before ``N sqrt(7 T^3 / 12)``.
    """
    place = as_floats(ESIEE, "llh", (3,))
    n = round(length_s / IMU_INTERVAL_S)
    begin, span = IMU_INTERVAL_S * n, IMU_INTERVAL_S * n
    end_errors: dict[str, list[FloatArray]] = {name: [] for name in STRATEGIES}
    complete = True
    try:
        for k, child in enumerate(np.random.SeedSequence(seed).spawn(runs)):
            log = resting_log(np.random.default_rng(child), 2 * n, place)
            ends = [corrected_track(log, name, begin, span, place)[-1] for name in STRATEGIES]
            for name, end in zip(STRATEGIES, ends, strict=True):
                end_errors[name].append(end)
            if progress is not None:
                progress((k + 1) / runs)
    except KeyboardInterrupt:
        complete = False
    return BiasStudy({name: np.array(v).reshape(-1, 3) for name, v in end_errors.items()}, length_s, complete)
