"""Stretches without fixes as long as a run's own, made where it has fixes: what errors grow to beside their claims."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from schuler.arrays import FloatArray
from schuler.filtering.measurements import GNSS_KINDS, LATERAL, POSITION, gate_threshold, merged
from schuler.navigation.aids.vehicle import UNAIDED_S, times_of_fixes, weaker_without_fixes
from schuler.navigation.config import NavigationConfig
from schuler.navigation.inputs.gnss_faults import UNAIDED_UNTESTED, UNAIDED_WRONG
from schuler.navigation.prepared import LONG_S, PreparedRun, longest_without_fixes
from schuler.navigation.tuning.likelihood import NEVER, Residuals, spacing_of
from schuler.navigation.tuning.tuning import first_part

# Chosen on oan_phone_drive, rtkexp_drive, morpinet_car 2 and 4, MH_04 and V2_01, as docs/robustness.md has them.
_PARTS = 4.0  # of the time with fixes: a stretch made is at most one of them, so that three or so do not overlap
_LONGEST = 300.0  # [s]
_COUNT = 12  # stretches made
_WARM = 1.0 / 3.0  # of the time with fixes, before the first: the run is as settled as in its own stretch
_FACTORS = (2.0, 4.0, 8.0, 16.0, 32.0)
_WRONG = 4.0  # mean normalised square of errors: they are twice what is claimed
_TAIL = 0.999  # of chi-square
_FEWEST = 6  # stretches that say something
_BEYOND = 8.0  # lengths of what was tested that no claim reaches whose drift nobody states


@dataclass(frozen=True)
class Stretches:
    """Errors of stretches without fixes.

    Attributes
    ----------
    length_s : float
        Of each. [s]
    apart : float
        How many do not overlap.
    residuals : Residuals
        Horizontal, of the fix at the end of each.
    """

    length_s: float
    apart: float
    residuals: Residuals

    @property
    def nees(self) -> float:
        """Mean normalised horizontal error squared at the ends, per degree of freedom."""
        counted = self.residuals.weight > 0.0
        return float(np.mean(self.residuals.normalised[counted] ** 2)) if counted.any() else 1.0

    @property
    def loss(self) -> float:
        """Negative log likelihood of a stretch in the mean, outliers capped."""
        return float(self.residuals.scores().mean())

    @property
    def is_wrong(self) -> bool:
        """Whether errors are clearly larger than claimed."""
        freedom = 2 * max(1, round(self.apart))
        return self.nees > max(_WRONG, gate_threshold(_TAIL, freedom) / freedom)


class Withheld:
    """Stretches without fixes, made in a run: each a run of its own, whose fixes end where it begins.

    Parameters
    ----------
    prepared : PreparedRun
        Loosely coupled.

    Attributes
    ----------
    length_s : float
        Of each: the longest that the run has without fixes, or what it has fixes enough to make. [s]
    """

    def __init__(self, prepared: PreparedRun) -> None:
        longest = longest_without_fixes(prepared)
        self.run = first_part(prepared)
        self._judges = (self.run.schedule.kind == POSITION) & (self.run.schedule.gate > 0.0)
        self.fixes: FloatArray = np.unique(self.run.schedule.t[self._judges])
        self._usual = spacing_of(self.run.schedule, self._judges)
        step = np.diff(self.fixes)
        self._near = step <= max(5.0 * self._usual, UNAIDED_S / 3.0)
        self.covered_s = float(step[self._near].sum())
        self.length_s = min(longest, self.covered_s / _PARTS, _LONGEST)

    @property
    def can_judge(self) -> bool:
        """Whether there are fixes enough for stretches much longer than those that noise is tuned by."""
        return self.length_s >= LONG_S and len(self.starts) >= _FEWEST

    @cached_property
    def starts(self) -> FloatArray:
        """Fixes after which a stretch begins that has fixes throughout, evenly over the run. Shape (n,). [s]"""
        t = self.fixes[self.fixes >= self.fixes[0] + _WARM * self.covered_s]
        first = len(self.fixes) - len(t)
        end = np.searchsorted(self.fixes, t + self.length_s)
        pauses = np.concatenate(([0], np.cumsum(~self._near)))
        t = t[(end < len(self.fixes)) & (pauses[first:] == pauses[np.minimum(end, len(pauses) - 1)])]
        k = np.unique(np.linspace(0, len(t) - 1, _COUNT).astype(np.int64)) if len(t) else np.empty(0, np.int64)
        return np.asarray(t[k])

    def errors(self, factor: float = 1.0) -> Stretches:
        """Errors with :attr:`NonHolonomicSection.unaided_factor`.

        Parameters
        ----------
        factor : float
        """
        parts = [self._one(float(t), factor) for t in self.starts]
        y, v = np.array([part[0] for part in parts]), np.array([part[1] for part in parts])
        good = np.isfinite(y) & (v > 0.0)
        y, v, weight = np.where(good, y, 0.0), np.where(good, v, 1.0), good * np.array([1.0, 1.0, 0.0])
        n = len(parts)
        apart = max(1.0, min(float(len(self.starts)), self.covered_s / self.length_s - 1.0))
        t, kind, horizon = self.starts, np.full(n, POSITION), np.full(n, self.length_s)
        return Stretches(self.length_s, apart, Residuals(t, kind, horizon, y, v, weight))

    def _one(self, t: float, factor: float) -> tuple[FloatArray, FloatArray]:
        """Innovation of the fix at the end of a stretch, and its variance. Shapes (3,).

        That fix alone is offered: several beyond the gate would be let in, and enlarge the covariance.
        """
        run, schedule = self.run, self.run.schedule
        usable = np.flatnonzero(self._judges)
        at = usable[np.searchsorted(schedule.t[usable], t + self.length_s)]
        end = float(schedule.t[at])
        offered = schedule.where(np.where(np.isin(schedule.kind, GNSS_KINDS), schedule.t <= t, schedule.t <= end))
        offered = weaker_without_fixes(offered, factor, times_of_fixes(offered, run.initial.nav.t))
        judge = schedule.where(np.array([at]))
        offered = merged(offered, replace(judge, gate=np.full(1, NEVER)))
        increments = run.increments.between(run.increments.start - 1e-9, end + 0.1)
        options = replace(run.options, record_s=1e9, output_rate_hz=0.01, smoother=False)
        forward = replace(run, increments=increments, schedule=offered, options=options).run()
        k = int(np.flatnonzero(offered.kind == POSITION)[-1])
        return forward.innovation[k], forward.variance[k]


def as_sure_as_withheld(config: NavigationConfig, run: PreparedRun) -> tuple[NavigationConfig, PreparedRun, list[str]]:
    """A run with wheels as sure, in long stretches without fixes, as such stretches made where it has fixes bear out.

    Parameters
    ----------
    config : NavigationConfig
    run : PreparedRun
        Of it.

    Returns
    -------
    config, run
        With ``aiding.non_holonomic.unaided_factor``.
    notes : list of str
        On the factor, and on claims that stretches contradict or none tested.

    Notes
    -----
    Noise is tuned by fixes up to :data:`~schuler.navigation.aids.vehicle.UNAIDED_S` apart. What wheels slip and what
    their mount is off is no white noise; in minutes a filter that takes it for that averages it away in its claim only.
    The factor is the likeliest of powers of two, and 1 where errors are no larger than claimed.
    """
    longest = longest_without_fixes(run)
    if longest <= LONG_S or config.gnss.coupling != "loose" or not np.any(run.schedule.kind == POSITION):
        return config, run, []
    withheld = Withheld(run)
    if not withheld.can_judge:
        return config, run, _beyond(config, longest, UNAIDED_S)
    wheels = config.aiding.non_holonomic
    factor = 1.0 if wheels is None else wheels.unaided_factor
    best = withheld.errors(factor)
    notes: list[str] = []
    sure = wheels is not None and np.any(run.schedule.kind == LATERAL) and best.nees > 1.0
    if wheels is not None and sure and "unaided_factor" not in wheels.model_fields_set:
        before = best
        for other in _FACTORS:
            now = withheld.errors(other)
            if now.loss > best.loss:
                break
            best, factor = now, other
        if factor != 1.0:
            wheels = wheels.model_copy(update={"unaided_factor": factor})
            config = config.model_copy(update={"aiding": config.aiding.model_copy(update={"non_holonomic": wheels})})
            notes.append(
                f"wheels that do not slip are taken {factor:g} times less surely later than {UNAIDED_S:.0f} s after "
                f"the last fix (aiding.non_holonomic.unaided_factor): in {len(withheld.starts)} stretches of "
                f"{best.length_s:.0f} s made without fixes errors were {np.sqrt(before.nees):.2g} times their claims, "
                f"and are {np.sqrt(best.nees):.2g} times with it"
            )
            times = times_of_fixes(run.schedule, run.initial.nav.t)
            run = replace(run, schedule=weaker_without_fixes(run.schedule, factor, times))
    if best.is_wrong:
        notes.append(
            f"{UNAIDED_WRONG}: in {len(withheld.starts)} stretches of {best.length_s:.0f} s made without fixes errors "
            f"are {np.sqrt(best.nees):.2g} times their claims, and up to {longest:.0f} s are without a fix"
        )
        return config, run, notes
    return config, run, [*notes, *_beyond(config, longest, best.length_s)]


def _beyond(config: NavigationConfig, longest: float, tested: float) -> list[str]:
    """A sentence where a stretch is far longer than any tested, and nobody states what the IMU drifts over it."""
    if longest <= _BEYOND * tested or not config.is_named_by_grade:
        return []
    return [
        f"{UNAIDED_UNTESTED}: up to {longest:.0f} s are without a fix, and no more than {tested:.0f} s could be tested "
        f"where there are fixes; what an IMU of unknown make ({config.imu.catalogue}) drifts over that time is not "
        "known"
    ]
