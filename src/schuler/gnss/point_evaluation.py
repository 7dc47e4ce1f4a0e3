"""Single points beside the ranges they were solved from, and beside a reference: verdict, numbers, tables."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from schuler import frames, units
from schuler.arrays import FloatArray
from schuler.exceptions import InputError
from schuler.gnss.point_result import LINKED, STATUS, PointSolution
from schuler.gnss.protection_errors import Direction, Stanford, stanford
from schuler.gnss.ranges import Ranges
from schuler.gnss.signals import SYSTEM_NAMES, SYSTEMS, satellite_name
from schuler.plotting.notebook import Displayed
from schuler.timebase import week_tow
from schuler.verdict import Status, Verdict

if TYPE_CHECKING:
    from schuler.plotting.table import Cell, ResultTable

_UNCHECKED, _NO_EPHEMERIS, _NOT_ASKED = 1, 1, 7  # of STATUS, of REASONS
_HALF = 0.5  # share of epochs from which a reader should ask why
_TOO_LARGE = 2.0  # residuals in units of their standard deviations


@dataclass(frozen=True, repr=False)
class PointEvaluation(Displayed):
    """Single points and what they are judged by.

    Attributes
    ----------
    points : PointSolution
    ranges : Ranges
        Those that were solved.
    true_r_e : ndarray, shape (k, 3), optional
        Antenna of a reference at each epoch, Earth-fixed; NaN where it has none. [m]
    alert_limit : float
        Protection level above which a position is not to be used, for the Stanford diagrams. [m]
    epoch_gps_s : float, optional
        GPS time of zero of the points' time axis, for the table's week and time of week. [s]

    Raises
    ------
    InputError
        If the ranges are not those of the points, or the reference has another shape.
    """

    points: PointSolution
    ranges: Ranges
    true_r_e: FloatArray | None = None
    alert_limit: float = 40.0
    epoch_gps_s: float | None = None

    def __post_init__(self) -> None:
        p, r = self.points, self.ranges
        if len(r) != len(p.sat) or not np.array_equal(r.sat, p.sat):
            raise InputError(f"expected the ranges that were solved ({len(p.sat)} rows), got other {len(r)}")
        if self.true_r_e is not None and np.shape(self.true_r_e) != p.r_e.shape:
            raise InputError(f"true_r_e: expected shape {p.r_e.shape}, got {np.shape(self.true_r_e)}")

    @property
    def errors_n(self) -> FloatArray | None:
        """Point minus reference, north, east, down; NaN where either is missing, None without. Shape (k, 3). [m]"""
        if self.true_r_e is None:
            return None
        out = np.full_like(self.points.r_e, np.nan)
        k = np.flatnonzero(self.points.ok & np.isfinite(self.true_r_e).all(axis=1))
        C_en = frames.C_en(frames.llh_from_ecef(self.true_r_e[k]))
        out[k] = np.einsum("kji,kj->ki", C_en, self.points.r_e[k] - self.true_r_e[k])
        return out

    @property
    def sigma_n(self) -> FloatArray:
        """1-sigma of the positions, north, east, down; NaN where there is none. Shape (k, 3). [m]"""
        out, p = np.full_like(self.points.r_e, np.nan), self.points
        C_en = frames.C_en(p.llh[p.ok])
        variance = np.einsum("kji,kjl,kli->ki", C_en, p.cov_r_e[p.ok], C_en)
        out[p.ok] = np.sqrt(np.maximum(variance, 0.0))
        return out

    @property
    def v_n(self) -> FloatArray:
        """Velocities, north, east, down; NaN where there is none. Shape (k, 3). [m/s]"""
        out, p = np.full_like(self.points.v_e, np.nan), self.points
        k = p.velocity_ok
        out[k] = np.einsum("kji,kj->ki", frames.C_en(p.llh[k]), p.v_e[k])
        return out

    @property
    def residual_size(self) -> float:
        """Residuals in units of their standard deviations: root of all statistics over all redundancies.

        About 1 if standard deviations are those of independent errors; NaN if nothing could be checked.
        """
        p = self.points
        k = p.ok & (p.redundancy > 0)
        return float(np.sqrt(p.statistic[k].sum() / p.redundancy[k].sum())) if k.any() else np.nan

    @property
    def verdict(self) -> Verdict:
        """Whether the positions can be believed: share that is solved and checked, residuals; never the reference."""
        p, n = self.points, len(self.points)
        unsolved = n - int(p.ok.sum())
        unchecked = int(np.sum(p.status == _UNCHECKED))
        if unsolved == n:
            return Verdict("failed", ("no epoch could be solved: " + self._unsolved(),), self._causes())
        reasons, causes, remarks = list[str](), list[str](), list[str]()
        status: Status = "ok"
        if unsolved > _HALF * n:
            reasons.append(f"{unsolved} of {n} epochs have no position: {self._unsolved()}")
            causes += self._causes()
        elif unsolved:
            remarks.append(f"{unsolved} of {n} epochs have no position: {self._unsolved()}")
        if unchecked > _HALF * (n - unsolved):
            reasons.append(
                f"{unchecked} of {n - unsolved} positions could not be checked: no satellite more than unknowns"
            )
            causes.append(
                "few satellites: lower --elevation-mask or --cn0-mask, or give more --systems and their --nav"
            )
        elif unchecked:
            remarks.append(
                f"{unchecked} of {n - unsolved} positions could not be checked, and have no protection level"
            )
        if self.residual_size > _TOO_LARGE:
            reasons.append(f"residuals are {self.residual_size:.1f} times what their standard deviations say")
            causes.append("multipath, or messages, ionosphere or antenna of another day or place")
        left_out = np.unique(p.epoch[p.excluded])
        if len(left_out):
            linked = int(np.sum(p.status == LINKED))
            by_neighbours = f", {linked} of them solved with their neighbours" if linked else ""
            remarks.append(f"faults at {len(left_out)} epochs: {int(p.excluded.sum())} ranges left out{by_neighbours}")
        if (missing := self._without_message()) is not None:
            remarks.append(missing)
        if reasons:
            status = "doubtful"
        return Verdict(status, tuple(reasons), tuple(dict.fromkeys(causes)), tuple(remarks))

    def _unsolved(self) -> str:
        """Why epochs have no position, with numbers."""
        why = Counter(STATUS[int(s)] for s in self.points.status[~self.points.ok])
        return ", ".join(f"{count} {text}" for text, count in why.most_common())

    def _causes(self) -> tuple[str, ...]:
        """What would explain epochs without a position, the likeliest first."""
        p, r = self.points, self.ranges
        of_unsolved = ~p.ok[p.epoch] & (r.reason != _NOT_ASKED)
        advice = {
            1: "satellites without a message: give more navigation files with --nav",
            3: "satellites below the mask: lower --elevation-mask",
            4: "weak signals: lower --cn0-mask",
            5: "implausible pseudoranges: the log may be damaged",
        }
        counts = [(int(np.sum(of_unsolved & (r.reason == k))), text) for k, text in advice.items()]
        causes = [text for count, text in sorted(counts, key=lambda c: -c[0]) if count]
        if np.isin(p.status, (5, 6)).any():
            causes.insert(0, "reflected signals, or messages of another day")
        no_code = np.isnan(r.pseudorange) & (r.reason != _NO_EPHEMERIS)  # without a message there is no range either
        if np.sum(of_unsolved & no_code) > _HALF * of_unsolved.sum():
            causes.insert(0, "satellites without a pseudorange: log the receiver's codes (RINEX types C), too")
        return tuple(causes) or ("few satellites in view: give more --systems and their --nav",)

    def _without_message(self) -> str | None:
        """Systems of which no satellite has a message, and how many ranges that costs; None where all have."""
        r = self.ranges
        asked = r.reason != _NOT_ASKED
        systems = r.sat // 100
        lost = [
            k for k in np.unique(systems[asked & (r.reason == _NO_EPHEMERIS)]).tolist()
            if np.all(r.reason[asked & (systems == k)] == _NO_EPHEMERIS)
        ]  # fmt: skip
        if not lost:
            return None
        count = int(np.sum(asked & np.isin(systems, lost)))
        names = ", ".join(SYSTEM_NAMES[SYSTEMS[k]] for k in lost)
        return f"no messages of {names}: {count} of {int(asked.sum())} ranges are not used; --nav takes more files"

    def stanford(self, direction: Direction) -> Stanford | None:
        """Errors against protection levels; None without a reference where there are points."""
        errors = self.errors_n
        if self.true_r_e is None or errors is None or not np.isfinite(errors[:, 0]).any():
            return None
        return stanford(self.points, self.true_r_e, alert_limit=self.alert_limit, direction=direction)

    def summary(self) -> str:
        """A few sentences: epochs, satellites, residuals, protection levels; errors where there is a reference."""
        p = self.points
        lines = [self.points.summary()]
        if np.isfinite(self.residual_size):
            lines[0] += f"; {self.residual_size:.2f} of what their standard deviations say"
        if p.ok.any():
            sizes = (_text(_median(p.hpl[p.ok])), _text(_median(p.vpl[p.ok])))
            lines.append(f"protection levels {sizes[0]} horizontal, {sizes[1]} vertical (medians)")
        if (numbers := self.error_numbers()) is not None:
            lines.append(
                f"errors against the reference, {numbers['epochs']} epochs: horizontal p50 "
                f"{numbers['p50_horizontal_m']:.2f} m, p95 {numbers['p95_horizontal_m']:.2f} m, largest "
                f"{numbers['max_horizontal_m']:.2f} m; vertical {numbers['rms_vertical_m']:.2f} m RMS; inside three of "
                f"their sigmas {', '.join(f'{100.0 * s:.0f}' for s in numbers['inside_three_sigma_ned'])} % (north, "
                "east, down)"
            )
            lines += [d.summary() for d in (self.stanford("horizontal"), self.stanford("vertical")) if d is not None]
        return "\n".join(lines)

    def error_numbers(self) -> dict[str, Any] | None:
        """Errors against the reference, and how many are beyond their levels; None without a reference. SI"""
        e = self.errors_n
        if e is None or not (seen := np.isfinite(e[:, 0])).any():
            return None
        horizontal, down = np.hypot(e[seen, 0], e[seen, 1]), e[seen, 2]
        p, inside = self.points, np.abs(e[seen]) <= 3.0 * self.sigma_n[seen]
        return {
            "epochs": int(seen.sum()), "rms_horizontal_m": float(np.sqrt(np.mean(horizontal**2))),
            "p50_horizontal_m": float(np.quantile(horizontal, 0.5)),
            "p95_horizontal_m": float(np.quantile(horizontal, 0.95)), "max_horizontal_m": float(horizontal.max()),
            "rms_vertical_m": float(np.sqrt(np.mean(down**2))), "max_vertical_m": float(np.abs(down).max()),
            "mean_ned_m": e[seen].mean(axis=0), "inside_three_sigma_ned": inside.mean(axis=0),
            "beyond_hpl": int(np.sum(horizontal > p.hpl[seen])),
            "beyond_vpl": int(np.sum(np.abs(down) > p.vpl[seen])),
        }  # fmt: skip

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers for JSON: counts, residuals, levels, satellites, errors, verdict. SI"""
        p, ok = self.points, self.points.ok
        some = ok.any()
        return {
            "epochs": len(p), "solved": int(ok.sum()), "solved_share": float(np.mean(ok)),
            "checked": int(np.sum(ok & (p.status != _UNCHECKED))), "with_velocity": int(p.velocity_ok.sum()),
            "status": {STATUS[int(s)]: int(n) for s, n in zip(*np.unique(p.status, return_counts=True), strict=True)},
            "epochs_with_faults": len(np.unique(p.epoch[p.excluded])), "ranges_left_out": int(p.excluded.sum()),
            "rates_left_out": int(p.rate_excluded.sum()),
            "mean_satellites": float(np.mean(p.n_used[ok])) if some else None,
            "median_pdop": _median(p.dilution.pdop[ok]), "rms_residual_m": _rms(p.rms[ok]),
            "residual_size": self.residual_size, "median_hpl_m": _median(p.hpl[ok]), "median_vpl_m": _median(p.vpl[ok]),
            "satellites": self.satellites().to_dict()["rows"], "errors": self.error_numbers(),
            "verdict": self.verdict.to_dict(), "notes": p.notes,
        }  # fmt: skip

    def table(self) -> ResultTable:
        """Every epoch: status, position, 1-sigma, velocity, satellites, dilutions, levels, satellites at fault.

        Errors are last, where there is a reference; week and time of week are empty where the log has no GPS time.
        """
        from schuler.plotting.table import ResultTable

        p = self.points
        llh = p.llh * (1.0 / units.DEG, 1.0 / units.DEG, 1.0)
        ok = p.ok[:, None]
        numbers = np.column_stack(
            (np.where(ok, llh, np.nan), self.sigma_n, self.v_n, p.dilution.pdop, p.dilution.hdop, p.hpl, p.vpl, p.rms)
        )
        columns = [
            "t_s", "week", "tow_s", "status", "satellites", "lat_deg", "lon_deg", "height_m", "sigma_north_m",
            "sigma_east_m", "sigma_down_m", "v_north_m_s", "v_east_m_s", "v_down_m_s", "pdop", "hdop", "hpl_m", "vpl_m",
            "rms_residual_m", "left_out",
        ]  # fmt: skip
        errors = self.errors_n
        if errors is not None:
            columns += ["error_north_m", "error_east_m", "error_down_m"]
        left_out: dict[int, list[str]] = {}
        for i in np.flatnonzero(p.excluded).tolist():
            left_out.setdefault(int(p.epoch[i]), []).append(satellite_name(int(p.sat[i])))
        rows: list[tuple[Cell, ...]] = []
        for k, t in enumerate(p.t.tolist()):
            week, tow = (None, None) if self.epoch_gps_s is None else week_tow(self.epoch_gps_s + t)
            row: tuple[Cell, ...] = (
                t, week, tow, p.why(k), int(p.n_used[k]), *map(_or_none, numbers[k].tolist()),
                " ".join(left_out.get(k, ())),
            )  # fmt: skip
            rows.append(row if errors is None else (*row, *map(_or_none, errors[k].tolist())))
        return ResultTable("Single points", tuple(columns), tuple(rows))

    def satellites(self) -> ResultTable:
        """Every satellite: ranges measured, used, left out and why, residuals of those used."""
        from schuler.plotting.table import ResultTable

        p, r = self.points, self.ranges
        used = p.ok[p.epoch] & (p.weight > 0.0)
        reason = np.where(p.excluded & (r.reason == 0), 6, r.reason)
        names = {1: "no_message", 2: "unhealthy", 3: "low", 4: "weak", 5: "implausible", 6: "at_fault"}
        rows = []
        for one in np.unique(r.sat[r.reason != _NOT_ASKED]).tolist():
            own = r.sat == one
            residual = p.residual[own & used]
            rows.append(
                (
                    satellite_name(int(one)), int(own.sum()), int(np.sum(own & used)),
                    *(int(np.sum(own & (reason == k))) for k in names),
                    _or_none(float(np.mean(residual)) if len(residual) else np.nan), _or_none(_rms(residual)),
                )
            )  # fmt: skip
        columns = ("satellite", "ranges", "used", *names.values(), "mean_residual_m", "rms_residual_m")
        return ResultTable("Satellites", columns, tuple(rows))


def _rms(values: FloatArray) -> float:
    good = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(good**2))) if len(good) else np.nan


def _median(values: FloatArray) -> float | None:
    """Median, infinite ones among the largest; None where it is infinite or there is none."""
    middle = float(np.median(values)) if len(values) else np.nan
    return middle if np.isfinite(middle) else None


def _text(value: float | None) -> str:
    return "infinite" if value is None else f"{value:.1f} m"


def _or_none(value: float) -> float | None:
    return value if np.isfinite(value) else None
