"""Rests before the start of a run: where the IMU shows nothing but gravity and a bias, and GNSS does not object."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schuler import frames, units
from schuler.arrays import BoolArray, FloatArray
from schuler.recording.series import GnssSeries, ImuSeries
from schuler.sensors.spec import ImuSpec, TriadSpec
from schuler.standstill.intervals import true_runs
from schuler.standstill.stationarity import LARGEST_BIAS

_BLOCK_S = 0.5  # means and deviations are taken over blocks of this length [s]
_SHORTEST = 2  # blocks of a rest, without those at its edges
_QUIET = 2.5  # deviations at rest, in those of the quietest blocks of the log
_SHAKEN_GYRO, _SHAKEN_ACCEL = 5.0 * units.DEG, 1.0  # more than an engine shakes a vehicle at rest [rad/s], [m/s^2]
_REST_SPEED = 0.3  # GNSS speed of a vehicle that may rest, before its uncertainty is added [m/s]
_SURE_SPEED = 0.5  # largest 1-sigma of a speed that confirms rest [m/s]
_MOVING_SPEED = 1.0  # speed of a vehicle that certainly moves, before its uncertainty is added [m/s]
_CHANGE_OF_SPEED = 20.0  # of a vehicle that is not known to rest, over one stretch [m/s]
_ANY_TURN = 4.0 / np.sqrt(3.0)  # RMS of a rate that passes for a bias, in its 1-sigma: uniform up to four of them
_ONE_REST_S = 30.0  # rest that a log is taken to have before any is seen [s]
_RAREST = 1e-4  # no share of quiet motion is believed to be smaller


@dataclass(frozen=True)
class StartRests:
    """Rests before a start, in order of time.

    Attributes
    ----------
    start, stop : ndarray, shape (k,)
        [s]
    rate, force : ndarray, shape (k, 3)
        Mean angular rate [rad/s] and specific force [m/s^2], body axes.
    sigma_rate, sigma_force : ndarray, shape (k,)
        1-sigma of the mean by noise and vibration, and by motion that looks like rest: a slow steady turn, a steady
        acceleration. Biases are not in it. [rad/s], [m/s^2]
    confirmed : ndarray of bool, shape (k,)
        Whether GNSS saw it stand still.
    noise_rate, noise_force : ndarray, shape (k,)
        The same 1-sigma of what certainly is a rest: without motion that looks like one.
    outside : float
        Largest mean rate of a rest confirmed by GNSS that the error budget has no room for, else 0. [rad/s]
    """

    start: FloatArray
    stop: FloatArray
    rate: FloatArray
    force: FloatArray
    sigma_rate: FloatArray
    sigma_force: FloatArray
    confirmed: BoolArray
    noise_rate: FloatArray
    noise_force: FloatArray
    outside: float = 0.0

    def __len__(self) -> int:
        return len(self.start)

    @property
    def duration(self) -> float:
        """Length of all together. [s]"""
        return float(np.sum(self.stop - self.start))

    def confirm(self, index: int) -> StartRests:
        """One of the rests taken as sure, with those that GNSS confirms; others that only the IMU shows are out."""
        sure = self.confirmed.copy()
        sure[index] = True
        return StartRests(
            self.start[sure], self.stop[sure], self.rate[sure], self.force[sure], self.noise_rate[sure],
            self.noise_force[sure], sure[sure], self.noise_rate[sure], self.noise_force[sure], self.outside,
        )  # fmt: skip

    def mean_rate(self) -> tuple[FloatArray, float]:
        """Weighted mean rate of all rests, shape (3,), and its 1-sigma with the scatter between them. [rad/s]"""
        weight = 1.0 / self.sigma_rate**2
        mean = weight @ self.rate / weight.sum()
        variance = 1.0 / weight.sum()
        if len(self) > 1:
            chi2 = float(np.sum(weight[:, None] * (self.rate - mean) ** 2)) / (3.0 * (len(self) - 1))
            variance *= max(chi2, 1.0)
        return mean, float(np.sqrt(variance))


@dataclass(frozen=True)
class _Blocks:
    """Moments of consecutive blocks of the log."""

    start: FloatArray
    stop: FloatArray
    rate: FloatArray
    force: FloatArray
    shake: FloatArray  # (n, 6) deviations of rate and force
    ratio: FloatArray  # (n,) largest deviation, in those of the quietest blocks


def rests_before(
    rates: ImuSeries, gnss: GnssSeries, until: float, spec: ImuSpec, longest: float, given: float = 0.0
) -> StartRests:
    """Rests of a log before a time.

    Parameters
    ----------
    rates : ImuSeries
        Rates, body axes; all of the log, for what is quiet in it.
    gnss : GnssSeries
        With velocities. Fixes that move veto, fixes that stand still confirm.
    until : float
        [s]
    spec : ImuSpec
        A mean rate or force at rest beyond four 1-sigma of its biases is motion, unless GNSS confirms the rest.
    longest : float
        Time at rest that is used, the latest; 0 uses none. [s]
    given : float
        Uncertainty of the specific force that is no bias, such as scale. [m/s^2]

    Notes
    -----
    **A rest that GNSS confirms** may shake as an engine does. **One that only the IMU shows** is as quiet as the
    quietest blocks of the log; its mean rate and force stay the same throughout. A vehicle that moves as smoothly
    (a ship, a simulation) may turn or accelerate steadily then. How likely that is, the log says: how many stretches
    of such length are to be expected by those that would pass for a rest while GNSS sees motion, or, if there are none,
    by the normal tail of the logarithmic deviations in motion. With that probability the turn rates of such stretches
    and a change of speed of 20 m/s over the stretch are in the claimed sigma.
    """
    none = np.empty(0)
    nothing = StartRests(none, none, np.empty((0, 3)), np.empty((0, 3)), none, none, np.empty(0, bool), none, none)
    blocks = _blocks(rates)
    if longest <= 0.0 or len(blocks.start) < _SHORTEST:
        return nothing
    moving, still = _seen_by_gnss(blocks, gnss)
    most_rate = 4.0 * _bias_sigma(spec.gyro) + 4.0 * spec.gyro.random_walk / np.sqrt(_BLOCK_S) + 1e-4
    most_force = 4.0 * _bias_sigma(spec.accel) + 3.0 * spec.accel.scale_factor * units.G0 + 0.02 * units.G0 + given
    size, off_g = np.linalg.norm(blocks.rate, axis=1), np.abs(np.linalg.norm(blocks.force, axis=1) - units.G0)
    quiet = (blocks.ratio < _QUIET) & (size < most_rate) & (off_g < most_force)
    calm = np.all(blocks.shake[:, :3] < _SHAKEN_GYRO, axis=1) & np.all(blocks.shake[:, 3:] < _SHAKEN_ACCEL, axis=1)
    allowed = (quiet | (still & calm & (size < LARGEST_BIAS) & (off_g < max(most_force, 1.0)))) & ~moving
    motion = _Motion.of(blocks, gnss, quiet & _unbroken(blocks), still, _bias_sigma(spec.gyro))
    before = blocks.stop <= until + 1e-9
    rests, outside = [], 0.0
    for a, b in true_runs(allowed & before & _unbroken(blocks)):
        for first, last in _steady(blocks, still, a, b):
            span = slice(first, last)
            T = float(blocks.stop[last - 1] - blocks.start[first])
            confirmed = bool(still[span].any()) or _stands_still(gnss, blocks.start[first], blocks.stop[last - 1])
            rate, force = blocks.rate[span].mean(axis=0), blocks.force[span].mean(axis=0)
            if confirmed:
                outside = max(outside, float(np.linalg.norm(rate)) * (np.linalg.norm(rate) > most_rate))
            vibration = [float(x[span].std(axis=0).max()) / np.sqrt(last - first) for x in (blocks.rate, blocks.force)]
            sigma_rate = max(spec.gyro.random_walk / np.sqrt(T), vibration[0])
            sigma_force = max(spec.accel.random_walk / np.sqrt(T), vibration[1])
            noise = sigma_rate, sigma_force
            if not confirmed:
                share = motion.share(T, until - float(rates.t[0]))
                sigma_rate = float(np.hypot(sigma_rate, np.sqrt(share) * motion.turn))
                sigma_force = float(np.hypot(sigma_force, np.sqrt(share) * _CHANGE_OF_SPEED / T))
            span_s = float(blocks.start[first]), float(blocks.stop[last - 1])
            rests.append((*span_s, rate, force, sigma_rate, sigma_force, confirmed, *noise))
    kept, total = [], 0.0
    for rest in reversed(rests):
        if total < longest:
            kept.append(rest)
            total += rest[1] - rest[0]
    if not kept:
        return nothing
    columns = [np.array(x) for x in zip(*kept[::-1], strict=True)]
    return StartRests(
        columns[0], columns[1], columns[2], columns[3], columns[4], columns[5], columns[6].astype(bool),
        columns[7], columns[8], outside,
    )  # fmt: skip


def _bias_sigma(triad: TriadSpec) -> float:
    """1-sigma of a bias at some time of a run, by the budget."""
    return float(np.linalg.norm([triad.turn_on_bias, triad.in_run_bias, 1.9 * triad.bias_instability]))


def _blocks(rates: ImuSeries) -> _Blocks:
    W = max(4, round(_BLOCK_S * rates.rate_hz))
    n = len(rates) // W
    cut = slice(0, n * W)
    t, w, f = rates.t[cut].reshape(n, W), rates.gyro[cut].reshape(n, W, 3), rates.accel[cut].reshape(n, W, 3)
    shake = np.concatenate((w.std(axis=1), f.std(axis=1)), axis=1)
    if not n:
        return _Blocks(t[:, 0], t[:, 0], np.empty((0, 3)), np.empty((0, 3)), shake, t[:, 0])
    lowest = np.sort(shake, axis=0)[: max(5, n // 50)]
    floor = np.maximum(np.median(lowest, axis=0), _rounding(rates))
    return _Blocks(t[:, 0], t[:, -1], w.mean(axis=1), f.mean(axis=1), shake, (shake / floor).max(axis=1))


def _rounding(rates: ImuSeries) -> FloatArray:
    """Deviation by rounding of the readings, by axis. Shape (6,)."""
    some = np.concatenate((rates.gyro[:5000], rates.accel[:5000]), axis=1)
    steps = []
    for x in some.T:
        level = np.unique(x)
        steps.append(float(np.diff(level).min()) if len(level) > 1 else 1e-12)
    return np.asarray(np.array(steps) / np.sqrt(12.0))


def _unbroken(blocks: _Blocks) -> BoolArray:
    """Blocks without a pause of the log in them."""
    return np.asarray(blocks.stop - blocks.start < 1.5 * _BLOCK_S)


def _speeds(gnss: GnssSeries) -> tuple[FloatArray, FloatArray]:
    """Horizontal speed of the fixes and its 1-sigma. Shapes (n,). [m/s]"""
    v, cov = gnss.need_velocity()
    return np.hypot(v[:, 0], v[:, 1]), np.sqrt(np.maximum(cov[:, 0, 0], cov[:, 1, 1]))


def _seen_by_gnss(blocks: _Blocks, gnss: GnssSeries) -> tuple[BoolArray, BoolArray]:
    """Blocks in which, or just after which, a fix moves, and blocks between fixes that stand still. Shapes (n,)."""
    speed, sigma = _speeds(gnss)
    moves = gnss.t[speed > _REST_SPEED + 3.0 * sigma]
    moving = np.searchsorted(moves, blocks.start) < np.searchsorted(moves, blocks.stop + _BLOCK_S, side="right")
    stands = (speed <= _REST_SPEED + 2.0 * sigma) & (sigma < _SURE_SPEED)
    i = np.clip(np.searchsorted(gnss.t, blocks.stop, side="left"), 1, max(len(gnss) - 1, 1))
    if len(gnss) < 2:
        return moving, np.zeros(len(moving), dtype=bool)
    inside = (gnss.t[i - 1] <= blocks.start) & (blocks.stop <= gnss.t[i]) & (gnss.t[i] - gnss.t[i - 1] < 5.0)
    # a block that holds fixes: those at both its sides
    j = np.clip(np.searchsorted(gnss.t, blocks.start, side="right") - 1, 0, len(gnss) - 1)
    dense = (gnss.t[j] <= blocks.start) & (blocks.stop <= gnss.t[i]) & (gnss.t[i] - gnss.t[j] < 5.0)
    return moving, np.asarray((inside & stands[i] & stands[i - 1]) | (dense & stands[i] & stands[j]))


def _stands_still(gnss: GnssSeries, start: float, stop: float) -> bool:
    """Whether positions say that nothing moved: a line through them is no faster than a rest, and sure enough."""
    inside = (gnss.t >= start) & (gnss.t <= stop)
    if inside.sum() < 5:
        return False
    fixes = gnss.where(inside)
    tau = fixes.t - fixes.t.mean()
    d_n = frames.ned_from_ecef(frames.ecef_from_llh(fixes.llh), fixes.llh[0])[:, :2]
    sigma = float(np.sqrt(np.mean(np.einsum("nii->n", fixes.cov_r_n[:, :2, :2]) / 2.0))) / np.sqrt(tau @ tau)
    return bool(sigma < _SURE_SPEED / 2.0 and np.linalg.norm(tau @ d_n) / (tau @ tau) < _REST_SPEED + 2.0 * sigma)


@dataclass(frozen=True)
class _Motion:
    """Motion that looks like rest: how rare, and how it turns.

    Attributes
    ----------
    moving, standing : float
        Time in which GNSS sees motion, and rest. [s]
    alike : ndarray, shape (k,)
        Lengths of the stretches of it that would pass for a rest. [s]
    tail : float
        Share of quiet blocks by the normal tail of the logarithmic deviations in motion.
    turn : float
        RMS rate of turn of those stretches, before any is seen that of rates which pass for a bias. [rad/s]
    """

    moving: float
    standing: float
    alike: FloatArray
    tail: float
    turn: float

    @classmethod
    def of(cls, blocks: _Blocks, gnss: GnssSeries, quiet: BoolArray, still: BoolArray, sigma_bias: float) -> _Motion:
        from scipy.special import ndtr

        speed, sigma = _speeds(gnss)
        fast = (speed > _MOVING_SPEED + 3.0 * sigma).astype(float)
        inside = (blocks.start >= gnss.t[0]) & (blocks.stop <= gnss.t[-1])
        motion = inside & (np.interp(blocks.start, gnss.t, fast) > 0.99) & (np.interp(blocks.stop, gnss.t, fast) > 0.99)
        if motion.sum() < 20:
            return cls(0.0, 0.0, np.empty(0), 1.0, _ANY_TURN * sigma_bias)
        log = np.log(blocks.ratio[motion])
        tail = float(ndtr((np.log(_QUIET) - log.mean()) / max(float(log.std()), 0.1)))
        nowhere = np.zeros(len(motion), dtype=bool)
        runs = [part for a, b in true_runs(motion & quiet) for part in _steady(blocks, nowhere, a, b)]
        lengths = np.array([blocks.stop[b - 1] - blocks.start[a] for a, b in runs])
        turn = _ANY_TURN * sigma_bias
        if runs:
            rate = np.array([blocks.rate[a:b].mean(axis=0) for a, b in runs])
            squares = np.sum((rate - np.median(rate, axis=0)) ** 2) / 3.0
            turn = float(np.sqrt((turn**2 + squares) / (1.0 + len(runs))))
        step = float(np.median(blocks.stop - blocks.start))
        return cls(step * float(motion.sum()), step * float(still.sum()), lengths, tail, turn)

    def share(self, length: float, before: float) -> float:
        """Probability that what looks like a rest of this length is motion, in so much time before the start. [s]

        The larger of two: as many stretches of motion as are expected to look so before the start, by what was seen of
        motion, against one rest; and the time that motion looks so against the time GNSS sees the vehicle stand.
        """
        if not self.moving:
            return 0.5
        n = len(self.alike)
        if n:
            # lengths are exponential, with a mean known from n of them only
            longer = (1.0 + 0.5 * length / float(self.alike.sum())) ** -(n + 1.0)
            expected = max((n + 0.5) / self.moving * before * longer, _RAREST)
            time = float(self.alike[self.alike > 0.5 * length].sum()) / (self.standing + _ONE_REST_S)
            expected = max(expected, time)
        else:
            expected = max(self.tail, _RAREST) * max(before / length, 1.0)
        return float(expected / (1.0 + expected))


def _steady(blocks: _Blocks, still: BoolArray, a: int, b: int) -> list[tuple[int, int]]:
    """Parts of a run of quiet blocks with the same mean rate and force throughout, less the blocks at their edges."""
    span = slice(a, b)
    confirmed = still[span]
    same = np.ones(b - a, dtype=bool)
    for x, least in ((blocks.rate[span], 0.02 * units.DEG), (blocks.force[span], 0.03)):
        centre = np.median(x[confirmed] if confirmed.sum() >= _SHORTEST else x, axis=0)
        scatter = 1.4826 * np.median(np.abs(x - centre), axis=0)
        same &= np.all(np.abs(x - centre) <= 4.0 * scatter + least, axis=1)
    parts = []
    for i, j in true_runs(same):
        first = a + i + (1 if a + i > 0 else 0)
        last = a + j - 1
        if last - first >= _SHORTEST:
            parts.append((first, last))
    return parts
