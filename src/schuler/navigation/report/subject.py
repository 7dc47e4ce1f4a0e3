"""Subject of a report: a solution, what it is compared with, and the quantities derived from both."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from schuler import frames, rotation
from schuler.arrays import ArrayLike, FloatArray, IntArray
from schuler.exceptions import InputError
from schuler.filtering.measurements import CARRIER_PHASE, KINDS, POSITION, PSEUDORANGE, UNUSED, in_windows
from schuler.gnss.carrier import carrier_changes
from schuler.gnss.point_result import PointSolution
from schuler.gnss.ranges import Ranges
from schuler.navigation.evaluation.consistency import (
    SAME_TIME,
    Separation,
    matched_satellites,
    nearest,
    nees,
    separation,
    state_errors,
)
from schuler.navigation.evaluation.errors import TrajectoryErrors
from schuler.navigation.report.backdrop import Backdrop, read_backdrop
from schuler.navigation.result import NavigationResult
from schuler.recording.series import QUALITY, GnssSeries, ImuSeries
from schuler.recording.trajectory import Trajectory

#: What became of a fix, beside the filter's own status: inside an outage and never offered to the filter.
WITHHELD = -1
_AT_REST = 0.3  # speed of a solution at rest, its own error included [m/s]
_NEAR_FIX = 2.0  # time to a fix whose type is still that of the track [s]
_BLOCK = 1 << 17  # errors that are compared at a time
_SHORT_STEP = 0.1  # output steps up to this let fixes be recovered from innovations to a centimetre or two [s]


@dataclass(frozen=True)
class Subject:
    """Solution, reference and the series they are compared with.

    Attributes
    ----------
    result : NavigationResult
        Filtered, or smoothed if that is all there is.
    smoothed : NavigationResult, optional
        The smoothed solution of the same run.
    reference : Trajectory, optional
        Truth or a better solution.
    at_antenna : bool
        The reference is the antenna's, not the IMU's; the track is then drawn there too.
    truth_parameters : array_like, shape (m,) or (k, m), optional
        True parameters in the order of the layout, constant or at each record, SI.
    origin : float, optional
        Time that is called zero: the start of the recording; the first time of the solution if left out. [s]
    gnss : GnssSeries, optional
        The fixes, to show those withheld too; without it they are found from the reference or the innovations.
    ranges : Ranges, optional
        Ranges of a tightly coupled run, with the reason of each that was left out; they identify the satellites.
    points : PointSolution, optional
        Single-point solutions of these ranges.
    background : Backdrop, Path or str, optional
        Map behind the track, see :func:`schuler.navigation.report.backdrop.read_backdrop`.
    imu : ImuSeries, optional
        The IMU's log, to show it sample by sample, its rests and its spectrogram.
    still : list of (start, stop), optional
        Stretches in which it is still, :func:`still_stretches`, where they are known already. [s]
    """

    result: NavigationResult
    smoothed: NavigationResult | None = None
    reference: Trajectory | None = None
    at_antenna: bool = False
    truth_parameters: ArrayLike | None = None
    origin: float | None = None
    gnss: GnssSeries | None = None
    ranges: Ranges | None = None
    points: PointSolution | None = None
    background: Backdrop | Path | str | None = None
    imu: ImuSeries | None = None
    still: list[tuple[float, float]] | None = None

    def __post_init__(self) -> None:
        r = self.result
        if self.smoothed is not None and len(self.smoothed.t) != len(r.t):
            raise InputError(
                f"smoothed: expected the smoothed solution of the same run with {len(r.t)} records, got "
                f"{len(self.smoothed.t)}"
            )
        if self.truth_parameters is not None:
            m, shape = r.layout.size - 9, np.shape(self.truth_parameters)
            if shape not in ((m,), (len(r.t), m)):
                raise InputError(f"truth_parameters: expected shape ({m},) or ({len(r.t)}, {m}), got {shape}")

    @cached_property
    def map(self) -> Backdrop | None:
        """The map behind the track, read."""
        if self.background is None or isinstance(self.background, Backdrop):
            return self.background
        return read_backdrop(self.background)

    @cached_property
    def rests(self) -> list[tuple[float, float]]:
        """Start and stop of the stretches in which the IMU is still and the solution does not move. [s]"""
        if self.imu is None:
            return []
        still = still_stretches(self.imu) if self.still is None else self.still
        if not still:
            return []
        T = self.result.trajectory
        speed = T.mapped(lambda part: np.asarray(np.linalg.norm(part.v_eb_n, axis=1)))

        def stands(a: float, b: float) -> bool:  # an even drive is as still; before the solution there is no telling
            inside = speed[np.searchsorted(T.t, a) : np.searchsorted(T.t, b, side="right")]
            return not len(inside) or float(np.median(inside)) < _AT_REST

        return [(a, b) for a, b in still if stands(a, b)]

    def fix_type(self, t: FloatArray) -> NDArray[np.str_] | None:
        """Type of the fix nearest to each time, none beyond two seconds; None where the receiver stated none."""
        if self.gnss is None or self.gnss.quality is None or not len(self.gnss):
            return None
        k, distance = nearest(t, self.gnss.t + self.result.fixes_moved_s)
        names = np.array([QUALITY.get(int(q), f"type {q}") for q in self.gnss.quality])
        return np.where(distance < _NEAR_FIX, names[k], "none")

    def satellite_of(self, kind: str) -> IntArray:
        """Satellite of each innovation of ``pseudorange``, ``range_rate`` or ``carrier_phase``, 0 if unknown."""
        if kind not in self._satellites:
            t = self.result.innovations.of(kind).t
            self._satellites[kind] = (
                np.zeros(len(t), dtype=np.int64)
                if self.ranges is None
                else matched_satellites(t, self.ranges, self._offered(kind, self.ranges))
            )
        return self._satellites[kind]

    @staticmethod
    def _offered(kind: str, ranges: Ranges) -> FloatArray:
        """What each row of the ranges offers of a kind, NaN where nothing. Shape (n,)."""
        if kind != KINDS[CARRIER_PHASE]:
            return ranges.pseudorange if kind == KINDS[PSEUDORANGE] else ranges.range_rate
        c, offered = carrier_changes(ranges, 1.0), np.full(len(ranges), np.nan)
        offered[c.now] = c.change
        return offered

    @cached_property
    def _satellites(self) -> dict[str, IntArray]:
        return {}

    @property
    def start(self) -> float:
        """The time that is called zero. [s]"""
        return float(self.result.trajectory.t[0]) if self.origin is None else float(self.origin)

    def seconds(self, t: ArrayLike) -> FloatArray:
        """Times as they stand on the axes. [s]"""
        return np.asarray(t, dtype=np.float64) - self.start

    @property
    def span(self) -> tuple[float, float]:
        """First and last time of the solution, as on the axes. [s]"""
        t = self.result.trajectory.t
        return float(t[0]) - self.start, float(t[-1]) - self.start

    @property
    def solutions(self) -> list[tuple[str, NavigationResult]]:
        """Role and solution: what was given as the result, then the smoothed one if it is another."""
        pairs = [("smoothed" if self.result.smoothed else "filtered", self.result)]
        if self.smoothed is not None and not self.result.smoothed:
            pairs.append(("smoothed", self.smoothed))
        return pairs

    @cached_property
    def errors(self) -> dict[str, TrajectoryErrors]:
        """Errors by role; empty without a reference."""
        if self.reference is None:
            return {}
        return {role: r.errors(self.reference, at_antenna=self.at_antenna) for role, r in self.solutions}

    @cached_property
    def apart(self) -> Separation | None:
        """Filtered minus smoothed solution at the records; None if there is only one of them."""
        if self.smoothed is None or self.result.smoothed or not len(self.result.t):
            return None
        return separation(self.result, self.smoothed)

    @cached_property
    def truth(self) -> FloatArray | None:
        """True parameters at every record. Shape (k, m)."""
        if self.truth_parameters is None:
            return None
        p = np.asarray(self.truth_parameters, dtype=np.float64)
        return np.broadcast_to(p, (len(self.result.t), self.result.layout.size - 9))

    @cached_property
    def nees(self) -> tuple[FloatArray, FloatArray, int] | None:
        """Times [s], normalised errors squared per degree of freedom, and degrees; None where it cannot be known."""
        T = self.reference
        if T is None or self.at_antenna or T.q_eb is None or T.v_eb_e is None or not len(self.result.t):
            return None
        t, dx, _ = state_errors(self.result, T, self.truth_parameters)
        with np.errstate(invalid="ignore"):  # negative variances are reported by the verdict
            values = nees(self.result, T, self.truth_parameters)
        finite = np.isfinite(values)
        return (t[finite], values[finite], dx.shape[1]) if finite.any() else None

    @cached_property
    def inside_three_sigma(self) -> dict[str, FloatArray]:
        """Share of the position errors north, east, down inside three of their sigmas, by role."""
        satellite = {}
        for role, result in self.solutions:
            if role in self.errors:
                e, sigma = self.errors[role], self.position_sigma(result)
                satellite[role] = inside_shares(e.t, e.position_n, result.t, sigma)
        return satellite

    @cached_property
    def reference_is_fixes(self) -> bool:
        """Whether the reference consists of the fixes that the filter used."""
        if self.reference is None or not self.at_antenna:
            return False
        t = self.result.innovations.of(KINDS[POSITION]).t
        return bool(len(t)) and float(np.mean(nearest(t, self.reference.t)[1] < SAME_TIME)) > 0.9

    @property
    def reference_name(self) -> str:
        """Name of the reference in sentences."""
        if self.reference_is_fixes:
            return "the GNSS fixes"
        return "the reference at the antenna" if self.at_antenna else "the reference"

    @staticmethod
    def sigma(result: NavigationResult, block: str) -> FloatArray:
        """1-sigma of a block at the records, NaN where its variance is negative. Shape (k, block size)."""
        with np.errstate(invalid="ignore"):  # reported by the verdict
            return result.sigma(block)

    def position_sigma(self, result: NavigationResult) -> FloatArray:
        """1-sigma that a position error north, east, down may show at the records. Shape (k, 3). [m]

        The filter's own for a reference of the IMU. For one of the antenna the lever arm is taken along, and if it is
        made of the fixes, what a fix is uncertain by is added: an error against it cannot be smaller than that.
        """
        if not self.at_antenna:
            return self.sigma(result, "dr")
        C = frames.C_en(result.states.llh)
        arm = rotation.rotate(result.states.q_eb, np.broadcast_to(result.lever_arm_b, (len(C), 3)))
        J = np.concatenate([-rotation.skew(arm), np.broadcast_to(np.eye(3), (len(C), 3, 3))], axis=2)
        J = np.swapaxes(C, -1, -2) @ J
        k = np.r_[result.layout["dpsi"], result.layout["dr"]]
        P = result.covariance_e[:, k[:, None], k[None, :]]
        variance = np.einsum("kij,kjl,kil->ki", J, P, J)
        if self.reference_is_fixes:
            # of the innovation, which is that of the fix and a little more; the median passes over the ends of outages
            variance = np.where(variance < 0.0, np.nan, variance + self._fix_sigma**2)
        with np.errstate(invalid="ignore"):
            sigma: FloatArray = np.sqrt(variance)
        return sigma

    @cached_property
    def _fix_sigma(self) -> FloatArray:
        inn = self.result.innovations.of(KINDS[POSITION])
        finite = inn.sigma[np.all(np.isfinite(inn.sigma), axis=1)]
        return np.median(finite, axis=0) if len(finite) else np.zeros(3)

    @cached_property
    def fixes(self) -> tuple[FloatArray, FloatArray, IntArray] | None:
        """Times, Earth-fixed positions and status of the GNSS fixes in the solution's span; None if not to be had.

        Positions are of the point the track is of: the antenna's, or moved to the IMU with the solution's attitude.
        Status as in :data:`~schuler.filtering.measurements.STATUS`, or :data:`WITHHELD`.
        """
        T, offered = self.result.trajectory, self.result.innovations.of(KINDS[POSITION])
        if self.gnss is not None:
            t, r = self.gnss.t + self.result.fixes_moved_s, frames.ecef_from_llh(self.gnss.llh)
        elif self.reference_is_fixes and self.reference is not None:
            t, r = self.reference.t, self.reference.r_eb_e
        else:
            return self._fixes_from_innovations()
        inside = (t >= T.t[0]) & (t <= T.t[-1])
        t, r = t[inside], r[inside]
        status = np.full(len(t), UNUSED, dtype=np.int64)
        if len(offered) and len(t):
            k, distance = nearest(t, offered.t)
            status = np.where(distance < SAME_TIME, offered.status[k], status)
        status[(status == UNUSED) & in_windows(t, self.result.outages)] = WITHHELD
        if not self.at_antenna and len(t) and T.q_eb is not None:
            q = rotation.interpolate_quat(t, T.t, T.q_eb) if len(T.t) > 1 else T.q_eb
            r = r - rotation.rotate(q, np.broadcast_to(self.result.lever_arm_b, r.shape))
        return t, r, status

    def _fixes_from_innovations(self) -> tuple[FloatArray, FloatArray, IntArray] | None:
        """Fix = prediction + innovation, predicted from the output epoch before it; only the filtered run has those."""
        T, offered = self.result.trajectory, self.result.innovations.of(KINDS[POSITION])
        offered = offered.where(np.isfinite(offered.nis) & (offered.t > T.t[0]))
        close = len(T) > 1 and float(np.median(np.diff(T.t))) <= _SHORT_STEP
        if self.result.smoothed or not len(offered) or not close or T.v_eb_e is None:
            return None
        k = np.searchsorted(T.t, offered.t - SAME_TIME) - 1
        offered, k = offered.where(k >= 0), k[k >= 0]
        r = T.r_eb_e[k] + T.v_eb_e[k] * (offered.t - T.t[k])[:, None]
        r = r + np.einsum("nij,nj->ni", frames.C_en(frames.llh_from_ecef(r)), offered.innovation)
        if self.at_antenna and T.q_eb is not None:
            r = r + rotation.rotate(T.q_eb[k], np.broadcast_to(self.result.lever_arm_b, r.shape))
        return offered.t, r, offered.status


def still_stretches(imu: ImuSeries) -> list[tuple[float, float]]:
    """Start and stop of the stretches in which an IMU is still, even if it is driven evenly. [s]"""
    from schuler.standstill.stationarity import static_intervals

    try:
        still = static_intervals(imu)
    except InputError:  # too short, too coarse: a log may be without
        return []
    return [(float(a), float(b)) for a, b in zip(still.start, still.stop, strict=True)]


def inside_shares(t: FloatArray, error: FloatArray, t_sigma: FloatArray, sigma: FloatArray) -> FloatArray:
    """Shares of the errors of each component that lie within three sigmas.

    Parameters
    ----------
    t : ndarray, shape (n,)
    error : ndarray, shape (n, c)
        Those that are not finite, or whose sigma is not, are left out.
    t_sigma : ndarray, shape (k,)
        Records; errors before the first and after the last are left out.
    sigma : ndarray, shape (k, c)

    Returns
    -------
    ndarray, shape (c,)
        NaN where no error lies in the span of the records.

    Notes
    -----
    Between two records the larger sigma holds: the first fix after an outage makes it a hundred times smaller, and an
    interpolated one would accuse the errors just before that fix.
    """
    if not len(t_sigma):
        return np.full(error.shape[1], np.nan)
    compared, within = np.zeros((2, error.shape[1]), dtype=np.int64)
    for start in range(0, len(t), _BLOCK):
        part = t[start : start + _BLOCK]
        spanned = (part >= t_sigma[0] - 1e-9) & (part <= t_sigma[-1] + 1e-9)
        part, e = part[spanned], error[start : start + _BLOCK][spanned]
        right = np.clip(np.searchsorted(t_sigma, part - 1e-9), 0, len(t_sigma) - 1)
        left = np.clip(np.searchsorted(t_sigma, part + 1e-9, side="right") - 1, 0, len(t_sigma) - 1)
        bound = 3.0 * np.maximum(sigma[left], sigma[right])
        compared += np.count_nonzero(np.isfinite(e) & np.isfinite(bound), axis=0)
        within += np.count_nonzero(np.abs(e) <= bound, axis=0)
    return np.where(compared > 0, within / np.maximum(compared, 1), np.nan)
