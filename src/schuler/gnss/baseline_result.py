"""Result of a baseline between two receivers: what it is, whether it can be believed, figures."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from schuler import frames
from schuler.arrays import BoolArray, FloatArray, IntArray
from schuler.gnss.signals import satellite_name
from schuler.plotting.notebook import Displayed
from schuler.verdict import Status, Verdict

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from schuler.plotting import figure as content
    from schuler.plotting.table import ResultTable

SAME_IONOSPHERE = 10_000.0  # length up to which both antennas' ionospheres are taken to be one [m]
_ANOTHER_SKY = 100_000.0  # length from which integers are hopeless without a model of the ionosphere [m]
_MOST_FLOAT = 0.5  # share of epochs without a fix from which a reader should ask why
_CONTRADICTING = 16.27  # squared distance of fixed and float: 99.9 % of chi-square with 3 degrees of freedom
_TOO_LARGE = 2.0  # residuals in units of their standard deviations


@dataclass(frozen=True, repr=False)
class BaselineSolution(Displayed):
    """Baselines from the base antenna to the rover antenna, one row for each epoch both receivers measured.

    Attributes
    ----------
    t : ndarray, shape (k,)
        Time of reception by the rover, on the axis of its observations, corrected for its clock. [s]
    baseline_n : ndarray, shape (k, 3)
        North, east, down at the base: fixed where ``fixed``, else float; NaN where there is none. [m]
    cov_baseline_n : ndarray, shape (k, 3, 3)
        [m^2]
    float_n, cov_float_n : ndarray, shape (k, 3), (k, 3, 3)
        The same before integers were used. [m], [m^2]
    fixed : ndarray of bool, shape (k,)
    ratio, success_rate : ndarray, shape (k,)
        See :class:`schuler.gnss.ambiguities.AmbiguityFix`; NaN where nothing could be tried.
    n_satellites : ndarray of int, shape (k,)
        Satellites used.
    n_ambiguities, n_fixed : ndarray of int, shape (k,)
        Double-difference ambiguities, and combinations of them that were fixed.
    sat : ndarray of int, shape (s,)
        Satellite of each slot: a satellite on a band.
    band : tuple of str
        RINEX band of each slot.
    residual_code, residual_carrier : ndarray, shape (k, s)
        Double differences minus what baseline and ambiguities say, in the row's solution; NaN of reference satellites
        and where there is none. [m]
    sigma_code, sigma_carrier : ndarray, shape (k, s)
        1-sigma of the single differences. [m]
    slipped : ndarray of bool, shape (k, s)
        Carrier phases that jumped against the epoch before, each of which has a new ambiguity.
    base_llh : ndarray, shape (3,)
        Base antenna. [rad, rad, m]
    static : bool
        One baseline was solved for all epochs: each row uses the epochs up to it, the last row all of them.
    integers : bool
        Whether ambiguities were to be fixed.
    notes : tuple of str
    ionosphere : {"same", "free"}
        Above both antennas the same, or taken out by two bands.
    """

    t: FloatArray
    baseline_n: FloatArray
    cov_baseline_n: FloatArray
    float_n: FloatArray
    cov_float_n: FloatArray
    fixed: BoolArray
    ratio: FloatArray
    success_rate: FloatArray
    n_satellites: IntArray
    n_ambiguities: IntArray
    n_fixed: IntArray
    sat: IntArray
    band: tuple[str, ...]
    residual_code: FloatArray
    residual_carrier: FloatArray
    sigma_code: FloatArray
    sigma_carrier: FloatArray
    slipped: BoolArray
    base_llh: FloatArray
    static: bool
    integers: bool
    notes: tuple[str, ...] = ()
    ionosphere: str = "same"

    def __len__(self) -> int:
        return len(self.t)

    @property
    def ok(self) -> BoolArray:
        """Epochs with a baseline, fixed or float. Shape (k,)."""
        return np.isfinite(self.baseline_n[:, 0])

    @property
    def slips(self) -> IntArray:
        """Carrier phases that jumped against the epoch before. Shape (k,)."""
        return np.asarray(self.slipped.sum(axis=1), dtype=np.int64)

    @property
    def fix_share(self) -> float:
        """Part of all epochs that is fixed, 0 to 1."""
        return float(np.mean(self.fixed))

    @property
    def length(self) -> float:
        """Median length of the baseline; NaN if there is none. [m]"""
        return float(np.median(np.linalg.norm(self.baseline_n[self.ok], axis=1))) if self.ok.any() else np.nan

    @property
    def r_e(self) -> FloatArray:
        """Rover antenna, Earth-fixed. Shape (k, 3). [m]"""
        r: FloatArray = frames.ecef_from_llh(self.base_llh) + self.baseline_n @ frames.C_en(self.base_llh).T
        return r

    @property
    def llh(self) -> FloatArray:
        """Rover antenna. Shape (k, 3). [rad, rad, m]"""
        llh = np.full((len(self), 3), np.nan)
        llh[self.ok] = frames.llh_from_ecef(self.r_e[self.ok])
        return llh

    @property
    def verdict(self) -> Verdict:
        """Whether the baselines can be believed: fixes, residuals, fixed against float, length."""
        if not self.ok.any():
            return Verdict(
                "failed",
                ("no epoch could be solved",),
                (
                    "too few satellites in common: lower --elevation-mask or --cn0-mask, or give more --systems",
                    "slips at every epoch: an antenna indoors, or a receiver that does not keep its carriers",
                ),
            )
        reasons, causes, remarks = [], [], []
        status: Status = "ok"
        if self.length > _ANOTHER_SKY:
            reasons.append(f"the base is {self.length / 1e3:.0f} km away: both receivers are under different skies")
            causes.append("a base too far away, or a wrong one: take one within 10 km")
        elif self.length > SAME_IONOSPHERE and self.ionosphere == "same":
            reasons.append(f"the base is {self.length / 1e3:.0f} km away, and both ionospheres are taken to be one")
            causes.append("ionosphere: take a base within 10 km, or two bands with --ionosphere free")
        if self.integers and 1.0 - self.fix_share > _MOST_FLOAT:
            reasons.append(
                f"{100.0 * (1.0 - self.fix_share):.0f} % of the epochs have no fix: float is good to decimetres"
            )
            causes.append("multipath, few satellites, or one frequency and a short log: two bands fix at once")
        apart = self._float_distance()
        if len(apart) and np.median(apart) > _CONTRADICTING:
            reasons.append("fixed and float baselines are further apart than both claim")
            causes.append("wrong integers, or code with more multipath than sigma_code says")
        for name, residual, sigma in (
            ("code", self.residual_code, self.sigma_code),
            ("carrier", self.residual_carrier, self.sigma_carrier),
        ):
            size = _rms(residual / sigma)
            if size > _TOO_LARGE:
                reasons.append(f"residuals of {name} are {size:.1f} times what their standard deviations say")
                causes.append(f"multipath: give a larger sigma of {name}")
        solved = int(self.ok.sum())
        if solved < len(self):
            remarks.append(f"{len(self) - solved} of {len(self)} epochs have no baseline")
        if reasons:
            status = "doubtful"
        return Verdict(status, tuple(reasons), tuple(causes), tuple(remarks))

    def _float_distance(self) -> FloatArray:
        """Squared distance of fixed and float baselines over the difference of their covariances. Shape (fixed,)."""
        k = self.fixed
        apart = self.baseline_n[k] - self.float_n[k]
        weight = np.linalg.pinv(self.cov_float_n[k] - self.cov_baseline_n[k], hermitian=True)
        return np.asarray(np.einsum("ki,kij,kj->k", apart, weight, apart))

    def summary(self) -> str:
        """A few sentences: epochs, share that is fixed, baseline, satellites, slips."""
        n, ok = len(self), self.ok
        kind = "static" if self.static else "kinematic"
        if not ok.any():
            return f"{n} epochs, {kind}: none could be solved"
        last = self.baseline_n[ok][-1]
        sigma = np.sqrt(np.diag(self.cov_baseline_n[ok][-1]))
        north, east, down = (f"{v:.4f} m {axis}" for v, axis in zip(last, ("north", "east", "down"), strict=True))
        return (
            f"{int(ok.sum())} of {n} epochs solved, {kind}, {100.0 * self.fix_share:.1f} % fixed; "
            f"last baseline {north}, {east}, {down} (1-sigma {', '.join(f'{s:.4f}' for s in sigma)} m); "
            f"{np.mean(self.n_satellites[ok]):.1f} satellites, {int(self.slips.sum())} cycle slips"
        )

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers for JSON: counts, the last baseline and its uncertainty, satellites, verdict. SI"""
        ok = self.ok
        last = (self.baseline_n[ok][-1], np.sqrt(np.diag(self.cov_baseline_n[ok][-1]))) if ok.any() else (None, None)
        return {
            "epochs": len(self), "solved": int(ok.sum()), "fixed": int(self.fixed.sum()), "fix_share": self.fix_share,
            "static": self.static, "length_m": self.length, "last_baseline_ned_m": last[0], "last_sigma_ned_m": last[1],
            "median_ratio": float(np.median(self.ratio[self.fixed])) if self.fixed.any() else None,
            "mean_satellites": float(np.mean(self.n_satellites[ok])) if ok.any() else None,
            "slips": int(self.slips.sum()), "rms_code_m": _rms(self.residual_code),
            "rms_carrier_m": _rms(self.residual_carrier), "base_llh": self.base_llh,
            "satellites": self.satellites().to_dict()["rows"], "verdict": self.verdict.to_dict(), "notes": self.notes,
        }  # fmt: skip

    def table(self) -> ResultTable:
        """Every epoch: baseline, 1-sigma, fixed or not."""
        from schuler.plotting.table import ResultTable

        sigma = np.sqrt(np.diagonal(self.cov_baseline_n, axis1=1, axis2=2))
        numbers = np.column_stack((self.t, self.baseline_n, sigma))
        rows = [
            (*map(_or_none, line.tolist()), bool(fixed), _or_none(float(ratio)), int(n), int(slips))
            for line, fixed, ratio, n, slips in zip(
                numbers, self.fixed, self.ratio, self.n_satellites, self.slips, strict=True
            )
        ]
        names = (
            "t_s", "north_m", "east_m", "down_m", "sigma_north_m", "sigma_east_m", "sigma_down_m", "fixed", "ratio",
            "satellites", "slips",
        )  # fmt: skip
        return ResultTable("Baselines", names, tuple(rows))

    def satellites(self) -> ResultTable:
        """Every satellite on every band: epochs, slips, residuals."""
        from schuler.plotting.table import ResultTable

        used = np.isfinite(self.sigma_code)
        rows = [
            (
                satellite_name(int(one)), band, int(used[:, k].sum()), int(self.slipped[:, k].sum()),
                _or_none(_rms(self.residual_code[:, k])), _or_none(_rms(self.residual_carrier[:, k])),
            )
            for k, (one, band) in enumerate(zip(self.sat, self.band, strict=True))
        ]  # fmt: skip
        return ResultTable(
            "Satellites", ("satellite", "band", "epochs", "slips", "rms_code_m", "rms_carrier_m"), tuple(rows)
        )

    def figure(self) -> content.Figure:
        """Baseline over time, fixed and float, a panel for each axis, and the ratio."""
        from schuler.plotting.figure import TIME, Figure, Item, Panel, line, markers

        floating = self.ok & ~self.fixed
        panels = []
        for i, axis in enumerate(("north", "east", "down")):
            items: list[Item] = []
            if floating.any():
                items.append(markers(self.t[floating], self.baseline_n[floating, i], "smoothed", "float"))
            if self.fixed.any():
                items.append(markers(self.t[self.fixed], self.baseline_n[self.fixed, i], "filtered", "fixed"))
            panels.append(Panel(TIME, f"{axis} [m]", tuple(items)))
        ratio = np.minimum(self.ratio, 100.0)
        panels.append(Panel(TIME, "ratio, at most 100", (line(self.t, ratio, "filtered"),)))
        return Figure("baseline", "Baseline from base to rover", self.summary() + ".", tuple(panels), columns=2)

    def plot(self) -> Figure:
        """The figure of the baseline (matplotlib)."""
        from schuler.plotting.drawing import draw

        return draw(self.figure())

    def report(self, path: Path | str, title: str = "Baseline") -> Path:
        """Write the page, see :func:`schuler.gnss.baseline_report.baseline_report`."""
        from schuler.gnss.baseline_report import baseline_report

        return baseline_report(self, path, title)


def _rms(values: FloatArray) -> float:
    """Root mean square of the finite values; NaN without any."""
    good = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(good**2))) if len(good) else np.nan


def _or_none(value: float) -> float | None:
    return value if np.isfinite(value) else None
