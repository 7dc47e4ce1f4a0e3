"""Tuning of a run's noise: chosen on one half of the fixes, checked on the other."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np

from schuler.arrays import BoolArray
from schuler.exceptions import InputError
from schuler.filtering.measurements import KINDS, RANGE_RATE
from schuler.navigation.inputs.gnss_faults import SLOW_LEFT
from schuler.navigation.inputs.imu_noise import NO_NOISE, is_no_noise
from schuler.navigation.prepared import LONG_S, PreparedRun, longest_without_fixes
from schuler.navigation.tuning.floors import noise_floors
from schuler.navigation.tuning.likelihood import Residuals, epochs, halves, residuals_of, trials
from schuler.navigation.tuning.noise import (
    MEASURED,
    SLOW,
    TUNING_KINDS,
    WANDERS,
    WHITE,
    terms_of,
    vertical_axis,
    wandering,
    with_factors,
    with_wander,
)
from schuler.navigation.tuning.search import LEAST_GAIN, Fit, block_scatter, fit, gain_of, proven
from schuler.navigation.tuning.slow import range_factor
from schuler.navigation.tuning.slow_search import ASKED, SHOWS, likeliest_slow_error, slow_lead
from schuler.navigation.tuning.start import with_smoothed_start
from schuler.plotting.notebook import Displayed

_LONGEST = 900.0  # of the log that is used [s]
# Epochs in each half: of fixes, and of ranges, whose errors stay on a satellite for a minute and look like less noise.
_FEWEST, _FEWEST_OF_RANGES = 10, 20
_OUTLIER = 25.0  # normalised innovation squared per component beyond which a fix is left out of the second search
_T95 = 1.96
_CONSISTENT = (0.7, 1.4)  # mean normalised innovation squared of a run that is left as it is
_CLEARLY_OFF = (0.5, 2.0)  # the same, beyond which stretches that differ are no excuse
_CERTAIN = 3.0  # standard errors beyond that
_JUDGES = 8  # fixes of a kind and spacing that judge

#: What a term is, for tables and notes.
TERM_TEXT = {
    "gyro": "white noise of the gyroscopes in motion",
    "accel": "white noise of the level accelerometers in motion",
    "accel_down": "white noise of the vertical accelerometer in motion",
    "gyro_bias": "wander of the gyroscopes' biases",
    "accel_bias": "wander of the accelerometers' biases",
    "position": "sigma of horizontal positions",
    "height": "sigma of heights",
    "velocity": "sigma of horizontal velocities",
    "climb": "sigma of vertical velocities",
    "pseudorange": "sigma of pseudoranges",
    "range_rate": "sigma of range rates",
    "lateral": "sigma of the velocity across the wheels",
    "vertical": "sigma of the velocity up",
    SLOW: "sigma of the slow error of positions",
}


@dataclass(frozen=True, repr=False)
class Tuning(Displayed):
    """Noise that makes the fixes of a recording likeliest.

    Attributes
    ----------
    factors : dict of str to float
        On 1-sigma values as configured, by term.
    intervals : dict of str to (float, float)
        95 % intervals of the factors.
    better : bool
        Whether held-back fixes are likelier with the factors, and these are noise; if not, the configured noise stays.
    gain, gain_sigma : float
        Log likelihood of held-back fixes won by the factors chosen on the other half, and its 1-sigma.
    nis_before, nis_after : dict of str to float
        Mean normalised innovation squared per degree of freedom of held-back fixes by kind, configured and tuned.
    fixes : int
        Epochs of fixes used.
    left_out : int
        Of which so many were outliers.
    models : dict
        Tuned models of the bias states, by block, as entries of ``filter.models``.
    slow : dict
        A slow error of positions that was recognised, as entries of ``gnss.correlated``.
    ranges_slow : float
        Factor on sigmas of pseudoranges for their slow errors, in that of ``pseudorange``.
    slow_lead : float
        Log likelihood by which a slow error of positions that is not taken leads the noise that is.
    vertical : int
        Axis of the accelerometers that ``accel_down`` is of, the one nearest to the vertical.
    no_noise : bool
        The IMU's white noise would be more than its log scatters: it is none, and stays as configured.
    """

    factors: dict[str, float]
    intervals: dict[str, tuple[float, float]]
    better: bool
    gain: float
    gain_sigma: float
    nis_before: dict[str, float]
    nis_after: dict[str, float]
    fixes: int
    left_out: int = 0
    models: dict[str, dict[str, float]] = field(default_factory=dict)
    slow: dict[str, float] = field(default_factory=dict)
    ranges_slow: float = 1.0
    slow_lead: float = 0.0
    vertical: int = 2
    no_noise: bool = False

    def sentences(self) -> list[str]:
        """Sentences for the notes of a run."""
        nis = ", ".join(f"{name} {self.nis_before[name]:.2f} to {self.nis_after[name]:.2f}" for name in self.nis_after)
        check = (
            f"log likelihood of the half of the fixes held back {self.gain:+.1f} +- {self.gain_sigma:.1f}, "
            f"their mean NIS {nis}"
        )
        if self.no_noise:
            largest = max(_white(self.factors))
            return [
                f"{NO_NOISE}: it would have to be {largest:.2g} times as large as stated, more than the log scatters "
                "from sample to sample, and is not taken; the heading at the start, axes, mounting or clock are "
                "wrong, or the IMU is another than the one named"
            ]
        left = slow_error_left(self.slow_lead)
        if not self.better:
            return [f"noise tuned from the log is no better than configured and is not used: {check}", *left]
        chosen = "; ".join(
            f"{TERM_TEXT[name]} x {factor:.2g} ({self.intervals[name][0]:.2g} to {self.intervals[name][1]:.2g})"
            for name, factor in self.factors.items()
        )
        notes = [f"noise tuned from {self.fixes} fixes of the log (filter.tune): {chosen}; {check}", *left]
        if self.slow:
            notes.append(
                "GNSS positions have a slow error that their accuracies leave out: it is estimated (gnss.correlated), "
                f"1-sigma {self.slow['position_sigma_m']:.2g} m, correlated over {self.slow['position_tau_s']:.0f} s"
            )
        if self.ranges_slow > 1.0:
            notes.append(
                "errors stay on satellites for many epochs: sigmas of pseudoranges are taken "
                f"{self.ranges_slow:.2g} times as large, so that they weigh in averages as they should"
            )
        return notes

    def summary(self) -> str:
        """Table of the factors with their intervals, and the check."""
        lines = [f"noise from {self.fixes} fixes of the log, {self.left_out} outliers left out"]
        lines.append(f"  {'factor on what is configured':<46}{'':>8}  95 % interval")
        for name, factor in self.factors.items():
            low, high = self.intervals[name]
            lines.append(f"  {TERM_TEXT[name]:<46}{factor:>8.3g}  {low:.3g} to {high:.3g}")
        lines.append(
            f"fixes held back: log likelihood {self.gain:+.1f} +- {self.gain_sigma:.1f}; mean NIS "
            + ", ".join(f"{name} {self.nis_before[name]:.2f} -> {self.nis_after[name]:.2f}" for name in self.nis_after)
        )
        if self.no_noise:
            lines += [*self.sentences(), "nothing is written"]
        elif not self.better:
            lines.append("that is no better than configured: the configured noise stays, nothing is written")
        return "\n".join(lines)

    def to_dict(self) -> dict[str, Any]:
        """Plain dictionary, for JSON."""
        return asdict(self)


def slow_error_left(lead: float) -> list[str]:
    """A sentence if innovations are likelier by so much in log likelihood with a slow error that is not taken."""
    if not lead > SHOWS:
        return []
    return [
        f"{SLOW_LEFT}: innovations are likelier with one (log likelihood {lead:+.1f}), but not beyond doubt; "
        "gnss.correlated estimates it, and claims grow"
    ]


def slow_error_beside_stated(prepared: PreparedRun) -> list[str]:
    """The same sentence for a run whose noise stays as it is stated."""
    if too_few(prepared):
        return []
    prepared = first_part(prepared)
    return slow_error_left(slow_lead(prepared, fixes_of(prepared)))


def tune(prepared: PreparedRun, *, aligned: bool = True) -> Tuning:
    """Noise of IMU and GNSS from the innovations of a prepared run's fixes.

    Parameters
    ----------
    prepared : PreparedRun
        As configured.
    aligned : bool
        Whether it starts from one of its fixes, whose slow error the start then has.

    Returns
    -------
    Tuning

    Raises
    ------
    InputError
        If there are too few fixes.

    Notes
    -----
    Factors are chosen on every other fix by the likelihood of innovations over 1, 4 and 15 s
    (:mod:`~schuler.navigation.tuning.likelihood`) and checked on the fixes between, which are predicted and not used.
    If these are likelier by 8, and by two standard errors or so that their mean normalised innovation squared is within
    0.7 to 1.4 now where it was not, all fixes refine the factors. A sigma of measurements that would be smaller than
    stated stays as stated where the interval holds that: beside a noisy IMU fixes are believed however good they are
    said to be. So does the wander of biases in a run without fixes for half a minute, in which it counts, unless fixes
    are less likely so by 8. The intervals hold the difference between both choices. A slow error of positions is taken
    where fixes are likelier with it (:func:`~schuler.navigation.tuning.slow_search.likeliest_slow_error`); sigmas of
    pseudoranges whose innovations stay with a satellite are enlarged first
    (:func:`~schuler.navigation.tuning.slow.range_factor`) and then left. All runs begin smoothed
    (:func:`~schuler.navigation.tuning.start.with_smoothed_start`).
    """
    minutes = longest_without_fixes(prepared) > LONG_S
    prepared = first_part(with_wander(prepared))
    if np.any(fixes_of(prepared)):
        prepared = with_smoothed_start(prepared)
    terms = terms_of(prepared)
    fixes = fixes_of(prepared)
    one, other = halves(prepared.schedule, fixes)
    count = int(epochs(prepared.schedule.where(fixes))[1].max(initial=0))
    if count < _fewest(prepared):
        raise InputError(
            f"tuning needs at least {_fewest(prepared)} GNSS fixes that the filter uses, and there are {count}; "
            "leave filter.tune out"
        )
    ranges_slow, slow_spread = range_factor(prepared)
    if ranges_slow > 1.0:
        prepared = with_factors(prepared, {"pseudorange": ranges_slow})
        terms = tuple(name for name in terms if name != "pseudorange")
    floors = noise_floors(prepared)
    chosen = residuals_of(trials(prepared, one, phases=1))
    half = fit(prepared, chosen, terms, floors=floors)
    outlying = _outliers(with_factors(prepared, half.factors), fixes)
    one, other = one & ~outlying, other & ~outlying
    held = residuals_of(trials(prepared, one, other))
    before, after = held(prepared), held(with_factors(prepared, half.factors))
    model, slow = prepared, False
    lead = 0.0
    if aligned and "position" in terms:
        wide, half, lead = likeliest_slow_error(prepared, half, (one, other), terms, floors)
        if wide is not None:
            model, after = wide, held(with_factors(wide, half.factors))
            terms, slow = (*terms, SLOW), True
    gain, gain_sigma = gain_of(before, after)
    sure = slow or proven(before, after)
    sure = sure or (gain > LEAST_GAIN and _contradict(before) and not _contradict(after))
    better = sure and not is_no_noise(prepared.imu, prepared.psd, _white(half.factors))
    final = half
    if better:
        everything = residuals_of(trials(model, fixes & ~outlying))
        final = fit(model, everything, terms, start=half.factors, floors=floors, iterations=3)
        for kept, most in ((MEASURED, np.inf), (WANDERS if minutes else (), LEAST_GAIN)):
            if unseen := _unseen(final, half, kept):
                left = tuple(name for name in terms if name not in unseen)
                stated = fit(model, everything, left, start=final.factors, floors=floors, iterations=3)
                if stated.loss - final.loss < most:
                    final, terms = stated, left
    factors, intervals = dict(final.factors), _intervals(final, half)
    if ranges_slow > 1.0:
        if not better:  # the slow errors are there all the same
            factors, intervals = {}, {}
        better = True
        factors["pseudorange"] = ranges_slow
        width = float(np.exp(_T95 * slow_spread))
        intervals["pseudorange"] = (ranges_slow / width, ranges_slow * width)
    tuned, no_noise = with_factors(model, final.factors), is_no_noise(prepared.imu, prepared.psd, _white(factors))
    return Tuning(
        factors=factors,
        intervals=intervals,
        better=better and not no_noise,
        gain=gain,
        gain_sigma=gain_sigma,
        nis_before={KINDS[k]: v for k, v in before.nis().items()},
        nis_after={KINDS[k]: v for k, v in after.nis().items()},
        fixes=count,
        left_out=int(epochs(prepared.schedule.where(outlying))[1].max(initial=0)),
        models=_bias_models(model, factors),
        slow=_slow_entries(tuned) if slow and better else {},
        ranges_slow=ranges_slow,
        slow_lead=0.0 if slow else lead,
        vertical=vertical_axis(prepared.imu),
        no_noise=no_noise,
    )


def _slow_entries(prepared: PreparedRun) -> dict[str, float]:
    """The slow error of a run's positions, as entries of a configuration."""
    model = prepared.layout.models["b_r"]
    return {"position_sigma_m": float(f"{model.sigma:.3g}"), "position_tau_s": float(model.tau or 0.0)}


def _white(factors: Mapping[str, float]) -> tuple[float, float]:
    """Largest factors on the white noise of gyroscopes and accelerometers."""
    gyro, accel = (max(factors.get(name, 1.0) for name, k in WHITE.items() if k == triad) for triad in (0, 1))
    return gyro, accel


def contradicted(prepared: PreparedRun) -> bool:
    """Whether innovations contradict a run's noise so far that tuning may help.

    Parameters
    ----------
    prepared : PreparedRun

    Notes
    -----
    Fixes are thinned to 1, 4 and 15 s (:mod:`~schuler.navigation.tuning.likelihood`): noise that is right at the rate
    of the fixes may be wrong in an outage. Of each kind and spacing the mean normalised innovation squared, outliers
    capped, is outside 0.7 to 1.4 by three standard errors, which stretches of the log give (innovations are correlated
    in time where the noise is wrong), or outside 0.5 to 2 by three of chi-square; or a slow error of positions is
    likelier (:func:`~schuler.navigation.tuning.slow_search.slow_lead`). A run with too few fixes to tune is
    left, and one of pseudoranges without range rates: a slow error that stays on its satellite looks like small noise
    there (a parked VN-200, 33 s of code: sigmas were halved and the position was three of them off).
    """
    if prepared.ranges is not None and not np.any(prepared.schedule.kind == RANGE_RATE):
        return False
    prepared = first_part(prepared)
    if too_few(prepared):
        return False
    fixes = fixes_of(prepared)
    judge = residuals_of(trials(prepared, fixes, phases=1))
    seen = judge(prepared)
    if prepared.ranges is not None and (_other_noise(prepared, judge, seen) or range_factor(prepared)[0] > 1.0):
        return True
    counted = seen.weight > 0.0
    squares = np.where(counted, seen.influence() * seen.normalised**2, 0.0)
    for kind in np.unique(seen.kind):
        for horizon in np.unique(seen.horizon):
            mine = (seen.kind == kind) & (seen.horizon == horizon)
            n = int(counted[mine].sum())
            if np.sum(mine) < _JUDGES or n == 0:  # predictions that are no numbers count for nothing
                continue
            mean = float(squares[mine].sum()) / n
            off = squares[mine].sum(axis=1) - mean * counted[mine].sum(axis=1)
            chance = float(np.sqrt(2.0 / n))
            if mean - _CERTAIN * chance > _CLEARLY_OFF[1] or mean + _CERTAIN * chance < _CLEARLY_OFF[0]:
                return True
            error = float(np.hypot(np.sqrt(block_scatter(off[None, :], seen.t[mine])[0, 0]) / n, chance))
            if mean - _CERTAIN * error > _CONSISTENT[1] or mean + _CERTAIN * error < _CONSISTENT[0]:
                return True
    return slow_lead(prepared, fixes, seen) > ASKED


def too_few(prepared: PreparedRun) -> bool:
    """Whether a run has too few fixes to tune its noise."""
    return int(epochs(prepared.schedule.where(fixes_of(prepared)))[1].max(initial=0)) < _fewest(prepared)


def _fewest(prepared: PreparedRun) -> int:
    """Epochs that tuning needs."""
    return 2 * (_FEWEST if prepared.ranges is None else _FEWEST_OF_RANGES)


def _other_noise(prepared: PreparedRun, judge: Callable[[PreparedRun], Residuals], seen: Residuals) -> bool:
    """Whether white noise of the IMU three times as large or small is likelier, by three standard errors.

    Innovations of ranges are mostly noise of the ranges: their size does not tell the IMU's as that of fixes does.
    """
    for factor in (3.0, 1.0 / 3.0):
        gain, sigma = gain_of(seen, judge(with_factors(prepared, dict.fromkeys(WHITE, factor))))
        if gain > max(_CERTAIN * sigma, LEAST_GAIN):
            return True
    return False


def likelier(prepared: PreparedRun, other: PreparedRun) -> bool:
    """Whether fixes held back are likelier under another model of the same log.

    Parameters
    ----------
    prepared, other : PreparedRun
        With the same schedule of measurements; every other fix is used, those between are predicted and judge.

    Notes
    -----
    By two standard errors, which stretches of the log give; both runs begin smoothed.
    """
    prepared, other = (with_smoothed_start(first_part(run)) for run in (prepared, other))
    later = max(prepared.initial.nav.t, other.initial.nav.t)
    prepared, other = (replace(run, schedule=run.schedule.where(run.schedule.t > later)) for run in (prepared, other))
    tests = trials(prepared, *halves(prepared.schedule, fixes_of(prepared)), phases=1)
    if not tests:
        return False
    judged = residuals_of(tests)
    return proven(judged(prepared), judged(other))


def fixes_of(prepared: PreparedRun) -> BoolArray:
    """Measurements that tune: those a filter would use."""
    return np.isin(prepared.schedule.kind, TUNING_KINDS) & (prepared.schedule.gate > 0.0)


def first_part(prepared: PreparedRun, span_s: float = _LONGEST) -> PreparedRun:
    """The run cut to its first so many seconds, by default the longest stretch that tuning uses."""
    start = prepared.initial.nav.t
    if prepared.increments.t[-1] - start <= span_s:
        return prepared
    schedule = prepared.schedule
    return replace(
        prepared,
        increments=prepared.increments.between(prepared.increments.start, start + span_s),
        schedule=schedule.where(schedule.t <= start + span_s),
    )


def _outliers(prepared: PreparedRun, fixes: BoolArray) -> BoolArray:
    """Fixes far off where all others put them; none if they are more than a twentieth."""
    residuals = residuals_of(trials(prepared, fixes, phases=1)[:1])(prepared)
    z2 = np.where(residuals.weight > 0.0, residuals.normalised**2, 0.0)
    wrong = z2.max(axis=1) > _OUTLIER
    times = {(int(k), float(t)) for k, t in zip(residuals.kind[wrong], residuals.t[wrong], strict=True)}
    schedule = prepared.schedule
    out = np.zeros(len(schedule), dtype=bool)
    for kind, t in times:
        out |= (schedule.kind == kind) & (schedule.t == t)
    return out & fixes if wrong.mean() <= 0.05 else np.zeros(len(schedule), dtype=bool)


def _contradict(residuals: Residuals) -> bool:
    """Whether the mean normalised innovation squared of a kind of fixes is not that of right noise."""
    return any(not _CONSISTENT[0] <= nis <= _CONSISTENT[1] for nis in residuals.nis().values())


def _unseen(final: Fit, half: Fit, names: Collection[str]) -> list[str]:
    """Terms, of those named, that would be smaller than stated although the log does not exclude the stated ones."""
    intervals = _intervals(final, half)
    return [name for name, factor in final.factors.items() if name in names and factor < 1.0 < intervals[name][1]]


def _intervals(final: Fit, half: Fit) -> dict[str, tuple[float, float]]:
    """95 % intervals of the factors; what both halves do not share widens them."""
    intervals = {}
    for name, factor in final.factors.items():
        apart = abs(np.log(factor / half.factors[name]))
        width = _T95 * float(np.hypot(final.spread[name], apart))
        intervals[name] = (factor * float(np.exp(-width)), factor * float(np.exp(width)))
    return intervals


def _bias_models(prepared: PreparedRun, factors: dict[str, float]) -> dict[str, dict[str, float]]:
    """Tuned models of the bias states, by block."""
    models = {}
    layout = with_factors(prepared, factors).layout
    for term in ("gyro_bias", "accel_bias"):
        name = wandering(layout, term)
        if name is not None and term in factors:
            model = layout.models[name]
            models[name] = {"sigma": model.sigma, "noise": float(f"{model.noise:.3g}")}
            if model.tau is not None:
                models[name]["tau_s"] = model.tau
    return models
