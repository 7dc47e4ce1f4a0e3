"""Single-point solutions: positions, velocities and receiver clocks epoch by epoch, with what was left out and why."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from schuler import frames
from schuler.arrays import ArrayLike, BoolArray, FloatArray, IntArray
from schuler.exceptions import InputError
from schuler.gnss.dop import Dilution
from schuler.gnss.ranges import Ranges
from schuler.gnss.signals import satellite_name
from schuler.plotting.notebook import Displayed

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from schuler.plotting import figure as content

#: What became of an epoch (of its positions, or of its velocities); 0, 1 and 8 are usable.
STATUS = MappingProxyType(
    {
        0: "solved",
        1: "solved without a check (no redundancy)",
        2: "too few satellites",
        3: "degenerate geometry",
        4: "no convergence",
        5: "fault detected, but not to be isolated",
        6: "fault detected, several exclusions explain it",
        7: "not asked for",
        8: "solved with its neighbours, by range rates",
    }
)
LINKED = 8
_USABLE = (0, 1, LINKED)
_EXCLUDED = 6  # schuler.gnss.ranges.REASONS


@dataclass(frozen=True, repr=False)
class PointSolution(Displayed):
    """One row for each epoch. Where there is no solution the numbers are NaN and ``status`` says why: ask ``ok``.

    Attributes
    ----------
    t : ndarray, shape (k,)
        [s]
    status, velocity_status : ndarray of int, shape (k,)
        Keys of :data:`STATUS`.
    r_e : ndarray, shape (k, 3)
        Antenna, Earth-fixed. Also there if a fault was detected and not removed (status 5, 6), for inspection. [m]
    cov_r_e : ndarray, shape (k, 3, 3)
        Formal covariance, from the standard deviations of the ranges. [m^2]
    groups : tuple of str
        Names of the receiver clocks.
    clock, sigma_clock : ndarray, shape (k, g)
        Receiver clock ahead of each group's time, times the speed of light; NaN where no satellite shows it. [m]
    v_e : ndarray, shape (k, 3)
        [m/s]
    cov_v_e : ndarray, shape (k, 3, 3)
        [m^2/s^2]
    drift, sigma_drift : ndarray, shape (k,)
        Rate of the receiver clock, the same for all groups. [m/s]
    n_used, n_rates : ndarray of int, shape (k,)
        Ranges and range rates in the solution.
    dilution : Dilution
    redundancy : ndarray of int, shape (k,)
        Ranges less unknowns.
    statistic, threshold : ndarray, shape (k,)
        Weighted sum of squared residuals of the final solution, and its limit.
    velocity_statistic : ndarray, shape (k,)
        The same of the range rates.
    rms : ndarray, shape (k,)
        Root mean square of the range residuals. [m]
    hpl, vpl : ndarray, shape (k,)
        Protection levels, infinite where a fault could not be seen. [m]
    epoch : ndarray of int, shape (n,)
        Epoch of each row of the ranges.
    sat : ndarray of int, shape (n,)
        Satellite of each row of the ranges.
    excluded, rate_excluded : ndarray of bool, shape (n,)
        Rows left out by fault detection (as ranges, as range rates).
    weight : ndarray, shape (n,)
        1 for ranges in the solution, 0 for others; where neighbours helped, the probability that the range is direct.
    residual, rate_residual : ndarray, shape (n,)
        Measured minus predicted by the solution, of excluded rows too; NaN where there is no measurement or no
        solution. [m], [m/s]
    notes : tuple of str
    """

    t: FloatArray
    status: IntArray
    velocity_status: IntArray
    r_e: FloatArray
    cov_r_e: FloatArray
    groups: tuple[str, ...]
    clock: FloatArray
    sigma_clock: FloatArray
    v_e: FloatArray
    cov_v_e: FloatArray
    drift: FloatArray
    sigma_drift: FloatArray
    n_used: IntArray
    n_rates: IntArray
    dilution: Dilution
    redundancy: IntArray
    statistic: FloatArray
    threshold: FloatArray
    velocity_statistic: FloatArray
    rms: FloatArray
    hpl: FloatArray
    vpl: FloatArray
    epoch: IntArray
    sat: IntArray
    excluded: BoolArray
    rate_excluded: BoolArray
    weight: FloatArray
    residual: FloatArray
    rate_residual: FloatArray
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.t)

    @property
    def ok(self) -> BoolArray:
        """Epochs with a position to be used. Shape (k,)."""
        return np.isin(self.status, _USABLE)

    @property
    def velocity_ok(self) -> BoolArray:
        """Epochs with a position and a velocity to be used. Shape (k,)."""
        return np.asarray(self.ok & np.isin(self.velocity_status, _USABLE))

    @property
    def llh(self) -> FloatArray:
        """Latitude, longitude [rad], ellipsoidal height [m]; NaN where there is no solution. Shape (k, 3)."""
        solved = np.isfinite(self.r_e).all(axis=1)
        llh = np.full_like(self.r_e, np.nan)
        llh[solved] = frames.llh_from_ecef(self.r_e[solved])
        return llh

    def excluded_at(self, k: int) -> tuple[str, ...]:
        """Names of the satellites whose ranges fault detection left out of epoch k."""
        rows = np.flatnonzero(self.excluded & (self.epoch == k))
        return tuple(satellite_name(int(s)) for s in self.sat[rows])

    def why(self, k: int) -> str:
        """In words, what became of epoch k."""
        return STATUS[int(self.status[k])]

    def left_out(self, k: int) -> tuple[str, ...]:
        """In words, what was left out of epoch k and why, a sentence for each satellite."""
        sentences = []
        for row in np.flatnonzero((self.excluded | self.rate_excluded) & (self.epoch == k)):
            name, off = satellite_name(int(self.sat[row])), self.residual[row]
            if not self.excluded[row]:
                off = self.rate_residual[row]
                sentences.append(f"{name}: range rate {off:+.2f} m/s off those of the others")
            elif self.status[k] != LINKED:
                sentences.append(f"{name}: {off:+.1f} m off the others; without it they agree")
            elif off > 0.0:
                sentences.append(f"{name}: {off:.1f} m late; suspected not to be in line of sight")
            else:
                sentences.append(f"{name}: {-off:.1f} m early; at fault")
        return tuple(sentences)

    def screened(self, ranges: Ranges) -> Ranges:
        """The ranges with what fault detection left out marked, for tight coupling.

        Parameters
        ----------
        ranges : Ranges
            Those that were solved.

        Returns
        -------
        Ranges
            Reason 6 for excluded ranges and for all ranges of epochs with a fault that could not be isolated; the
            range rate is NaN (none) where only it was excluded, or could not be made to agree. Ranges that are direct
            with some probability have standard deviations larger by one over its root.

        Raises
        ------
        InputError
            If these are not the ranges that were solved.
        """
        if len(ranges) != len(self.sat) or not np.array_equal(ranges.sat, self.sat):
            raise InputError(f"expected the ranges that were solved ({len(self.sat)} rows), got other {len(ranges)}")
        lost = (self.status == 5) | (self.status == 6)
        lost_rate = (self.velocity_status == 5) | (self.velocity_status == 6)
        out = self.excluded | lost[self.epoch]
        rate = np.where(self.rate_excluded | lost_rate[self.epoch], np.nan, ranges.range_rate)
        reason = np.where(out & (ranges.reason == 0), _EXCLUDED, ranges.reason)
        n_out, n_rate = (
            int(np.sum(reason != ranges.reason)),
            int(np.sum(np.isfinite(ranges.range_rate) & ~np.isfinite(rate))),
        )
        note = f"fault detection left out {n_out} ranges and {n_rate} range rates"
        sigma = ranges.sigma_range / np.sqrt(np.where(self.weight > 0.0, self.weight, 1.0))
        return replace(ranges, range_rate=rate, sigma_range=sigma, reason=reason, notes=(*ranges.notes, note))

    def where(self, keep: ArrayLike) -> PointSolution:
        """The epochs selected by a boolean or index array, in order."""
        index = np.arange(len(self))[np.asarray(keep)]
        place = np.full(len(self), -1)
        place[index] = np.arange(len(index))
        rows = place[self.epoch] >= 0
        by_row = {n: getattr(self, n)[rows] for n in _ROW_FIELDS}
        by_row["epoch"] = place[self.epoch][rows]
        kept = {n: getattr(self, n)[index] for n in _EPOCH_FIELDS}
        return replace(self, dilution=self.dilution.where(index), **kept, **by_row)

    def summary(self) -> str:
        """A few sentences: epochs solved, why not, satellites, dilution, exclusions."""
        n, good = len(self), int(self.ok.sum())
        parts = [f"{good} of {n} epochs solved"]
        bad = Counter(STATUS[int(s)] for s in self.status[~self.ok])
        if bad:
            parts[0] += " (" + ", ".join(f"{count} {why}" for why, count in bad.most_common()) + ")"
        if good:
            ok = self.ok
            parts.append(
                f"{np.mean(self.n_used[ok]):.1f} satellites, PDOP {np.median(self.dilution.pdop[ok]):.2f}, "
                f"residuals {np.sqrt(np.mean(self.rms[ok] ** 2)):.2f} m rms"
            )
        out = Counter(satellite_name(int(s)) for s in self.sat[self.excluded])
        if out:
            parts.append("excluded: " + ", ".join(f"{s} {count}x" for s, count in out.most_common(8)))
        late = self.excluded & (self.residual > 0.0) & (self.status == LINKED)[self.epoch]
        if late.any():
            parts.append(
                f"{int(late.sum())} ranges of {int(np.sum(self.status == LINKED))} epochs suspected not to be in line "
                f"of sight, {np.median(self.residual[late]):.0f} m late (median)"
            )
        return "; ".join(parts)

    def figure(self) -> content.Figure:
        """Positions about their mean, north over east; their 1-sigma and the satellites used, epoch by epoch.

        Raises
        ------
        InputError
            If no epoch was solved.
        """
        from schuler.plotting.figure import TIME, Figure, Markers, Panel, line, view

        ok = self.ok
        if not ok.any():
            raise InputError(f"expected an epoch with a position to draw: {self.summary()}")
        mean = frames.llh_from_ecef(self.r_e[ok].mean(axis=0))
        at = frames.ned_from_ecef(self.r_e, mean)
        C_ne = frames.C_en(mean).T
        variance = np.einsum("ij,njk,ik->ni", C_ne, self.cov_r_e, C_ne)
        sigma = np.where(ok[:, None], np.sqrt(np.maximum(variance, 0.0)), np.nan)
        horizontal, vertical = np.hypot(sigma[:, 0], sigma[:, 1]), sigma[:, 2]
        unchecked = self.status == 1
        kinds = (("not checked", unchecked, "unused"), ("solved", ok & ~unchecked, "filtered"))
        points = tuple(Markers(at[k, 1], at[k, 0], role, label) for label, k, role in kinds if k.any())
        sigmas = (line(self.t, horizontal, "filtered", "horizontal"), line(self.t, vertical, "smoothed", "vertical"))
        used = self.n_used.astype(float)
        panels = (
            Panel("east [m]", "north [m]", points, equal=True, height=2.5),
            Panel(TIME, "1-sigma [m]", sigmas, y_limits=view((horizontal, vertical))),
            Panel(TIME, "satellites [-]", (line(self.t, used, "filtered"),), y_limits=(0.0, float(used.max()) + 1.0)),
        )
        scatter = np.sqrt(np.mean(at[ok, :2] ** 2, axis=0))
        caption = (
            f"{int(ok.sum())} positions about their mean, {scatter[0]:.2f} m north and {scatter[1]:.2f} m east (root "
            "mean square, of the motion too where there is one); 1-sigma as the ranges state it."
        )
        return Figure("points", "Single points", caption, panels, linked=False)

    def plot(self) -> Figure:
        """The figure of the positions (matplotlib)."""
        from schuler.plotting.drawing import draw

        return draw(self.figure())


_ROW_FIELDS = ("sat", "excluded", "rate_excluded", "weight", "residual", "rate_residual")
_EPOCH_FIELDS = (
    "t", "status", "velocity_status", "r_e", "cov_r_e", "clock", "sigma_clock", "v_e", "cov_v_e", "drift",
    "sigma_drift", "n_used", "n_rates", "redundancy", "statistic", "threshold", "velocity_statistic", "rms",
    "hpl", "vpl",
)  # fmt: skip
