"""Metrics of free-inertial runs: RMS errors, their ratio over runs with its interval, period and size of swings."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schuler.arrays import ArrayLike, FloatArray, as_floats
from schuler.exceptions import InputError
from schuler.recording.trajectory import Trajectory
from schuler.rotary.free_navigation import error_history
from schuler.units import DEG

#: Order of :func:`rms_values`; horizontal ones are of both components together.
QUANTITIES = (
    "horizontal_position", "horizontal_velocity", "vertical_position", "vertical_velocity", "roll", "pitch", "azimuth",
)  # fmt: skip
#: Unit for people and its size.
UNITS = {
    "horizontal_position": ("m", 1.0), "horizontal_velocity": ("m_s", 1.0), "vertical_position": ("m", 1.0),
    "vertical_velocity": ("m_s", 1.0), "roll": ("deg", DEG), "pitch": ("deg", DEG), "azimuth": ("deg", DEG),
}  # fmt: skip


def rms_values(solved: Trajectory, true: Trajectory) -> FloatArray:
    """Root mean squares over time, as the thesis quotes its runs.

    Parameters
    ----------
    solved, true : Trajectory
        Trajectories of the vehicle, at the same times, with velocity and attitude.

    Returns
    -------
    ndarray, shape (7,)
        In the order of :data:`QUANTITIES`. [m], [m/s], [rad]

    Raises
    ------
    InputError
        If times differ, or velocity or attitude is missing.

    References
    ----------
    Du (2015), section 4.1: HP and HV are root sums of squares of the two horizontal values.
    """
    if len(solved.t) != len(true.t) or np.abs(solved.t - true.t).max() > 1e-6:
        raise InputError("expected two trajectories at the same times; use Trajectory.at")
    for s in (solved, true):
        if s.v_eb_e is None or s.q_eb is None:
            raise InputError("expected velocity and attitude of both trajectories")
    history = error_history(solved, true)
    p, v = (np.mean(x**2, axis=0) for x in (history.position, history.velocity))
    angles = np.mod(solved.rpy_nb - true.rpy_nb + np.pi, 2.0 * np.pi) - np.pi
    return np.asarray(np.sqrt([p[0] + p[1], v[0] + v[1], p[2], v[2], *np.mean(angles**2, axis=0)]))


def index(quantity: str) -> int:
    """Place of a quantity in :data:`QUANTITIES`."""
    if quantity not in QUANTITIES:
        raise InputError(f"quantity: expected one of {', '.join(QUANTITIES)}, got {quantity!r}")
    return QUANTITIES.index(quantity)


_RESAMPLES = 4000


@dataclass(frozen=True)
class Improvement:
    """Ratio of the errors of two ways of doing a thing.

    Attributes
    ----------
    ratio : float
        Mean of the first over mean of the second: above 1 if the second is better.
    low, high : float
        Interval of the ratio.
    probability : float
        Probability of the interval.
    wins : float
        Share of the runs in which the second has the smaller error.
    single_low, single_high : float
        The same share of single runs of each has its ratio in here: what a comparison of one run with one run shows.
    runs : int
    """

    ratio: float
    low: float
    high: float
    probability: float
    wins: float
    single_low: float
    single_high: float
    runs: int

    @property
    def certain(self) -> bool:
        """Whether the whole interval is above 1."""
        return self.low > 1.0

    def compared(self, claim: tuple[float, float]) -> str:
        """Verdict on a claim that the ratio lies between two numbers: holds, partly, too much, too little."""
        least, most = claim
        if least <= self.low and self.high <= most:
            return "holds"
        if self.high < least:
            return "does not hold: less"
        if self.low > most:
            return "does not hold: more"
        return "holds in part: the interval reaches beyond it"

    def summary(self) -> str:
        """One sentence."""
        return (
            f"{self.ratio:.2f} times smaller ({100 * self.probability:.0f} %: {self.low:.2f} to {self.high:.2f}, "
            f"{self.runs} runs); smaller in {100 * self.wins:.0f} % of runs; single runs give {self.single_low:.2f} "
            f"to {self.single_high:.2f}"
        )


def improvement(
    before: ArrayLike, after: ArrayLike, *, probability: float = 0.95, resamples: int = _RESAMPLES, seed: int = 0
) -> Improvement:
    """Ratio of mean errors with a bootstrap interval.

    Parameters
    ----------
    before, after : array_like, shape (n,)
        Errors of the same n runs (same seeds) both ways; positive.
    probability : float
        Probability of the intervals.
    resamples : int
        Number of bootstrap samples: runs drawn with replacement, in pairs.
    seed : int

    Raises
    ------
    InputError
        If lengths differ, there are fewer than ten runs, or an error is not positive.

    References
    ----------
    Efron and Tibshirani (1993), chapter 13 (percentile interval).
    """
    a = as_floats(before, "before", (None,))
    b = as_floats(after, "after", (len(a),))
    if len(a) < 10:
        raise InputError(f"expected ten runs or more for an interval, got {len(a)}")
    if not (np.all(a > 0.0) and np.all(b > 0.0)):
        raise InputError("before, after: expected positive errors")
    if not 0.0 < probability < 1.0:
        raise InputError(f"probability: expected a number between 0 and 1, got {probability!r}")
    rng = np.random.default_rng(seed)
    pick = rng.integers(len(a), size=(resamples, len(a)))
    ratios = a[pick].mean(axis=1) / b[pick].mean(axis=1)
    edges = (0.5 - 0.5 * probability, 0.5 + 0.5 * probability)
    low, high = np.quantile(ratios, edges)
    single = a[rng.integers(len(a), size=resamples)] / b[rng.integers(len(b), size=resamples)]
    one_low, one_high = np.quantile(single, edges)
    return Improvement(
        float(a.mean() / b.mean()), float(low), float(high), probability, float(np.mean(b < a)),
        float(one_low), float(one_high), len(a),
    )  # fmt: skip


def mean_interval(x: FloatArray) -> tuple[float, float, float]:
    """Mean over runs (n,) and its 95 % interval from the standard error."""
    from scipy.special import ndtri

    if len(x) < 2:
        raise InputError(f"expected two runs or more for an interval, got {len(x)}")
    half = float(ndtri(0.975)) * float(np.std(x, ddof=1)) / float(np.sqrt(len(x)))
    mean = float(np.mean(x))
    return mean, mean - half, mean + half


def share_below(values: FloatArray, printed: float) -> float:
    """Percentile of a printed mean: share of means of as many single runs of ours that are no larger.

    Parameters
    ----------
    values : ndarray, shape (cases, n)
        n runs of each case; the printed value is a mean over the cases, one run each.
    printed : float
    """
    rng = np.random.default_rng(0)
    cases, n = values.shape
    drawn = values[np.arange(cases), rng.integers(n, size=(_RESAMPLES, cases))]
    return float(np.mean(drawn.mean(axis=1) <= printed))


_PADDING = 8
_LEAST = 16  # samples


def swing_period(t: ArrayLike, x: ArrayLike, *, longest: float | None = None) -> float:
    """Period of the strongest swing of an error that also drifts.

    Parameters
    ----------
    t : array_like, shape (n,)
        Evenly spaced. [s]
    x : array_like, shape (n,)
    longest : float, optional
        Longest period looked for; default a quarter of the record. [s]

    Returns
    -------
    float
        Place of the largest value of the periodogram of the error's rate of change: a random walk, which would hide
        everything else, has none there. Good to ``period^2 / (2 duration)``, half a bin. [s]

    Raises
    ------
    InputError
        If there are fewer than 16 samples, they are not evenly spaced, or no period is short enough.
    """
    t, x = _series(t, x)
    dt = (t[-1] - t[0]) / (len(t) - 1)
    rate = np.diff(x) / dt
    n = len(rate)
    k = np.arange(n)
    rate = rate - np.polynomial.Polynomial.fit(k, rate, 1)(k)
    power = np.abs(np.fft.rfft(rate, _PADDING * n)) ** 2
    frequency = np.fft.rfftfreq(_PADDING * n, dt)
    limit = 0.25 * n * dt if longest is None else longest
    wanted = np.flatnonzero(frequency * limit >= 1.0)
    if not len(wanted):
        raise InputError(f"longest: no period of this record is as short as {limit:g} s")
    return float(1.0 / frequency[wanted[np.argmax(power[wanted])]])


def swing_size(t: ArrayLike, x: ArrayLike, period: float) -> float:
    """Amplitude of the swing of a known period in an error that also drifts.

    Parameters
    ----------
    t : array_like, shape (n,)
        [s]
    x : array_like, shape (n,)
    period : float
        [s]

    Returns
    -------
    float
        Amplitude of the sinusoid that is fitted together with a cubic, by least squares. Unit of ``x``.

    Raises
    ------
    InputError
        If there are fewer than 16 samples or the period is not above zero.
    """
    t, x = _series(t, x)
    if not period > 0.0:
        raise InputError(f"period: expected seconds above zero, got {period!r}")
    s = 2.0 * (t - t[0]) / (t[-1] - t[0]) - 1.0
    a = 2.0 * np.pi / period * (t - t[0])
    design = np.stack((np.ones_like(s), s, s**2, s**3, np.cos(a), np.sin(a)), axis=1)
    coefficients = np.linalg.lstsq(design, x, rcond=None)[0]
    return float(np.hypot(coefficients[4], coefficients[5]))


def _series(t: ArrayLike, x: ArrayLike) -> tuple[FloatArray, FloatArray]:
    t, x = as_floats(t, "t", (None,)), as_floats(x, "x", (None,))
    if len(t) < _LEAST or len(x) != len(t):
        raise InputError(f"expected {_LEAST} samples or more, as many times as values; got {len(t)} and {len(x)}")
    step = np.diff(t)
    if step.min() <= 0.0 or np.ptp(step) > 1e-6 * step.mean():
        raise InputError("t: expected evenly spaced times")
    return t, x
