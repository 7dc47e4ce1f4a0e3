"""Preparation of raw satellite measurements for a tightly coupled run, and its clock at the start."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from schuler import units
from schuler.arrays import BoolArray, FloatArray, IntArray
from schuler.exceptions import InputError
from schuler.filtering.initial_state import InitialState
from schuler.filtering.measurements import in_windows
from schuler.filtering.states import CHANNELS, StateLayout
from schuler.gnss.antennas import Antenna
from schuler.gnss.carrier import carrier_changes
from schuler.gnss.carrier_noise import carrier_noise
from schuler.gnss.carrier_scale import check_carriers
from schuler.gnss.clock_noise import clock_frequency_noise
from schuler.gnss.cycle_slips import without_slips
from schuler.gnss.differences import date, listed_messages
from schuler.gnss.ephemerides import Ephemerides
from schuler.gnss.observations import Observations
from schuler.gnss.point import solve_points
from schuler.gnss.point_result import PointSolution
from schuler.gnss.ranges import REASONS, Ranges
from schuler.navigation.config import NavigationConfig
from schuler.navigation.inputs.clock_steps import without_clock_jumps, without_clock_steps
from schuler.navigation.inputs.satellite_noise import EXCLUDED, inflate_sigmas, without_reflections
from schuler.navigation.sections import CorrelatedSection, TightSection
from schuler.recording.recording import Recording
from schuler.recording.satellite_positions import gnss_series
from schuler.recording.series import GnssSeries

_MISSING_RANGE, _MISSING_RATE = 10.0, 1.0  # 1-sigma of measurements that come without one [m], [m/s]
_START_SIGMA = 10.0  # of a position that ranges are to find anew [m]
_NEAR_S = 10.0  # of the start, clocks of single points tell their drift where there are no range rates [s]
_LEAST_SIGMA = 0.003  # of a phase, by theory: a hundredth of a cycle, and multipath of a good antenna [m]


@dataclass(frozen=True)
class Points:
    """What all ranges tell before any are cut: single-point solutions, fixes from them, noise of clock and carriers.

    Attributes
    ----------
    solution : PointSolution
    gnss : GnssSeries
        The epochs that serve as fixes.
    clock_noise : float, optional
        White frequency noise of the receiver's clock, where the configuration leaves it to the log. [m/sqrt(s)]
    carrier_sigma : float, optional
        1-sigma of carrier phases for the filter, where the configuration leaves it to the log. [m]
    """

    solution: PointSolution
    gnss: GnssSeries
    clock_noise: float | None = None
    carrier_sigma: float | None = None

    def put_into(self, config: NavigationConfig) -> NavigationConfig:
        """The configuration with numbers where it leaves noise to the log."""
        numbers = {"clock_noise_m": self.clock_noise, "carrier_sigma_m": self.carrier_sigma}
        tight = config.gnss.tight.model_copy(update={k: value for k, value in numbers.items() if value is not None})
        return config.model_copy(update={"gnss": config.gnss.model_copy(update={"tight": tight})})


def satellites(recording: Recording, config: NavigationConfig, notes: list[str]) -> tuple[Ranges, Points]:
    """Ranges of a recording, prepared for a filter, and their single-point solutions.

    Parameters
    ----------
    recording : Recording
        Recording with ranges, or observations and ephemerides.
    config : NavigationConfig
        Sections ``gnss.tight`` and ``gnss.correlated``.
    notes : list of str
        Gets sentences on what was left out or changed.

    Returns
    -------
    ranges : Ranges
        Repeated measurements, faults found in snapshots and receiver clock jumps taken out; standard deviations that
        are missing filled in, and those that single points contradict enlarged.
    points : Points

    Raises
    ------
    InputError
        If there is nothing to work with, no epoch has enough satellites to start from, or carriers that are asked for
        do not change as their codes do.
    """
    section = config.gnss.tight
    ranges = recording.ranges
    if ranges is None:
        if recording.observations is None or recording.ephemerides is None:
            missing = "observations" if recording.observations is None else "ephemerides"
            raise InputError(
                f'gnss.coupling = "tight" needs raw satellite measurements and ephemerides; there are no {missing}: '
                "give a RINEX or UBX file (docs/gnss-files.md), or couple loosely"
            )
        from schuler.gnss.antennas import antenna_of

        if section.carrier != "off":
            check_carriers(recording.observations, section.systems, "rover")
        antenna = antenna_of(
            recording.ephemerides.antennas, recording.observations.antenna, section.antenna, "rover", notes
        )
        ranges = corrected_ranges(recording.observations, recording.ephemerides, section, antenna=antenna)
        notes += ranges.notes
    ranges = within_log(ranges, recording, config.imu.clock_shift_s)
    if not ranges.used.any():
        why = _why_not(ranges)
        if recording.observations is not None and recording.ephemerides is not None and "no ephemeris" in why:
            begins = recording.observations.epoch_gps_s + float(recording.observations.t[0])
            why += f"; the log begins at {date(begins)} GPS, {listed_messages(recording.ephemerides)}"
        raise InputError(f"no range is usable: check systems, masks, ephemerides and the times of both files ({why})")
    ranges, solution = screened(ranges, config, notes)
    if not solution.ok.any():
        raise InputError(
            "no epoch has a single-point solution to start from: "
            f"at most {int(solution.n_used.max())} satellites were usable; "
            + (
                "check systems, masks and ephemerides"
                if np.isfinite(ranges.pseudorange[ranges.used]).any()
                else "none has a pseudorange: log the receiver's codes (RINEX types C), too"
            )
        )
    lasting, noise = None, None
    if section.carrier_sigma_m == "log":
        short, lasts = carrier_noise(ranges, _near(ranges, solution), section.carrier_walk_m)
        sigma, lasting = max(short, _LEAST_SIGMA), max(lasts, _LEAST_SIGMA)
        notes.append(
            f"noise of carrier phases, as satellites show it: {1e3 * short:.1f} mm from epoch to epoch; it lasts and "
            f"weighs {1e3 * lasts:.1f} mm; 1-sigma in the filter: {1e3 * lasting:.1f} mm"
        )
    else:
        sigma = section.carrier_sigma_m
    if section.carrier != "off":
        ranges = with_whole_arcs(ranges, solution, sigma, notes)
    if section.clock_noise_m == "log":
        noise = clock_frequency_noise(ranges, sigma)
        notes.append(f"the receiver's clock, by its carriers: white frequency noise of {noise:.2g} m per root second")
    if section.carrier != "off":
        stated = section.clock_noise_m if noise is None else noise
        ranges, solution = without_clock_steps(ranges, solution, sigma, float(stated), notes)
    kept = _kept(ranges, section.min_satellites, section.max_satellites)
    ranges = replace(ranges, reason=np.where(ranges.used & ~kept, 8, ranges.reason))
    return ranges, Points(solution, gnss_series(solution), noise, lasting)


def _why_not(ranges: Ranges) -> str:
    """Number of ranges by the reason against them."""
    counts = [(int(np.sum(ranges.reason == k)), text) for k, text in REASONS.items() if k]
    return ", ".join(f"{n} {text}" for n, text in counts if n) or "there are none"


def corrected_ranges(
    observations: Observations, ephemerides: Ephemerides, section: TightSection, *, causal: bool = False,
    position_e: FloatArray | None = None, antenna: Antenna | None = None,
) -> Ranges:  # fmt: skip
    """Ranges of raw measurements by a configuration; see :func:`schuler.gnss.preparation.prepare_ranges`."""
    from schuler.gnss.preparation import prepare_ranges

    return prepare_ranges(
        observations,
        ephemerides,
        position_e=position_e,
        systems=section.systems,
        ionosphere=section.ionosphere,
        troposphere=section.troposphere,
        elevation_mask=section.elevation_mask_deg * units.DEG,
        cn0_mask=section.cn0_mask_dbhz,
        causal=causal,
        antenna=antenna,
    )


def screened(
    ranges: Ranges, config: NavigationConfig, notes: list[str], origin: float = 0.0, before: Ranges | None = None
) -> tuple[Ranges, PointSolution]:
    """Ranges without repetitions, reflections, faults, jumps of the receiver clock, with standard deviations to use.

    Parameters
    ----------
    ranges : Ranges
    config : NavigationConfig
        ``gnss.tight.integrity`` and ``gnss.correlated``.
    notes : list of str
        Gets sentences on what was left out or changed.
    origin : float
        See :func:`~schuler.navigation.inputs.satellite_noise.inflate_sigmas`. [s]
    before : Ranges, optional
        Those of the thirty seconds before, which are not screened, less those among ``ranges``.

    Returns
    -------
    ranges : Ranges
    solution : PointSolution
        Their single points, some of which may have failed.
    """
    ranges = with_sigmas(once_each(ranges, notes), notes)
    if config.gnss.tight.integrity:
        before = None if before is None else with_sigmas(before, [])
        ranges, solution = without_reflections(ranges, before, notes, origin)
        ranges, solution = inflate_sigmas(ranges, notes, origin, solution)
        ranges = without_faults(ranges, solution, notes)
    else:
        solution = solve_points(ranges, integrity=None)
    ranges, solution = without_clock_jumps(ranges, solution, notes)
    return inflated(ranges, config.gnss.correlated), solution


def within_log(ranges: Ranges, recording: Recording, clock_shift_s: float = 0.0) -> Ranges:
    """The ranges of the time in which there is an IMU, to a second."""
    if recording.imu is None:
        return ranges
    t = recording.imu.t + clock_shift_s
    keep = (ranges.t >= t[0] - 1.0) & (ranges.t <= t[-1] + 1.0)
    if not keep.any():
        raise InputError(
            f"the IMU log ({t[0]:.1f}..{t[-1]:.1f} s) and the satellite measurements ({ranges.t[0]:.1f}.."
            f"{ranges.t[-1]:.1f} s) have no time in common: check the clocks and time hints"
        )
    return ranges.where(keep)


def once_each(ranges: Ranges, notes: list[str]) -> Ranges:
    """Ranges without repeated rows: of a satellite that comes twice at one time the first row counts."""
    order = np.lexsort((np.arange(len(ranges)), ranges.sat, ranges.t))
    same = (np.diff(ranges.t[order]) == 0.0) & (np.diff(ranges.sat[order]) == 0)
    if not same.any():
        return ranges
    keep = np.ones(len(ranges), dtype=bool)
    keep[order[1:][same]] = False
    notes.append(f"{int(same.sum())} repeated satellite measurements were left out")
    return ranges.where(keep)


def with_sigmas(ranges: Ranges, notes: list[str]) -> Ranges:
    """Ranges whose standard deviations are positive: 10 m and 1 m/s, with a note, where there is none.

    A zero is no statement of accuracy, and a weight without bound would be the end of the filter.
    """
    filled: dict[str, FloatArray] = {}
    for name, measured, value, text in (
        ("sigma_range", ranges.pseudorange, _MISSING_RANGE, "ranges without a standard deviation were given 10 m"),
        ("sigma_rate", ranges.range_rate, _MISSING_RATE, "range rates without a standard deviation were given 1 m/s"),
    ):
        sigma = getattr(ranges, name)
        bad = ~(np.isfinite(sigma) & (sigma > 0.0))
        count = int(np.sum(bad & ranges.used & np.isfinite(measured)))
        if count:
            notes.append(f"{count} {text}")
        filled[name] = np.where(bad, value, sigma)
    return replace(ranges, sigma_range=filled["sigma_range"], sigma_rate=filled["sigma_rate"])


def without_faults(ranges: Ranges, solution: PointSolution, notes: list[str]) -> Ranges:
    """Ranges less those that snapshot fault detection found at fault.

    Epochs with a fault that could not be isolated stay: the filter's prediction isolates the satellite, where the
    others of the epoch cannot.
    """
    excluded = solution.excluded & ranges.used
    rate_excluded = (solution.rate_excluded | excluded) & ranges.used & np.isfinite(ranges.range_rate)
    if excluded.any() or rate_excluded.any():
        notes.append(
            f"{int(excluded.sum())} ranges and {int(rate_excluded.sum())} range rates excluded by fault detection "
            "among the satellites of an epoch"
        )
    return replace(
        ranges,
        reason=np.where(excluded, EXCLUDED, ranges.reason),
        range_rate=np.where(rate_excluded, np.nan, ranges.range_rate),
    )


def with_whole_arcs(ranges: Ranges, solution: PointSolution, sigma: float, notes: list[str]) -> Ranges:
    """Ranges whose carrier phases have arcs that end at every slip the satellites show among themselves.

    Parameters
    ----------
    ranges : Ranges
    solution : PointSolution
        Single-point solutions of these ranges: where the antenna is.
    sigma : float
        1-sigma of a phase of a strong satellite overhead. [m]
    notes : list of str
        Gets what :func:`~schuler.gnss.cycle_slips.without_slips` has to say.

    Raises
    ------
    InputError
        If no satellite has carrier phases at two epochs in a row.
    """
    if not len(carrier_changes(ranges, sigma).now):
        if np.isfinite(ranges.carrier_range[ranges.used]).sum() > len(np.unique(ranges.sat[ranges.used])):
            raise InputError(
                'gnss.tight.carrier = "time-differenced" or "rtk" needs carrier phases that go on from one epoch to '
                "the next, at most 10 s later: in this log every one is marked as having lost lock (RINEX's indicator "
                "is odd throughout), or epochs are further apart; clear the indicator if the receiver sets it always, "
                "or set carrier to off"
            )
        raise InputError(
            'gnss.tight.carrier = "time-differenced" or "rtk" needs carrier phases of a satellite at two epochs in a '
            "row, and there are none: give observations with carriers (RINEX types L), or set it to off"
        )
    return without_slips(ranges, _near(ranges, solution), sigma, notes)


def _near(ranges: Ranges, solution: PointSolution) -> FloatArray:
    """Antenna of each range by single points, between them on a straight line. Shape (n, 3). [m]"""
    ok = np.flatnonzero(solution.ok)
    return np.column_stack([np.interp(ranges.t, solution.t[ok], solution.r_e[ok, i]) for i in range(3)])


def inflated(ranges: Ranges, slow: CorrelatedSection) -> Ranges:
    """Ranges with standard deviations of range rates that count slow errors as often as they are new.

    Those of pseudoranges are states (:mod:`schuler.gnss.slow_errors`).

    Parameters
    ----------
    ranges : Ranges
    slow : CorrelatedSection
        ``velocity_sigma_m_s`` and ``_tau_s``.
    """
    t = np.unique(ranges.t)
    if len(t) < 2 or slow.velocity_sigma_m_s == 0.0:
        return ranges
    weight = np.tanh(0.5 * float(np.median(np.diff(t))) / slow.velocity_tau_s)
    return replace(ranges, sigma_rate=np.sqrt(ranges.sigma_rate**2 + slow.velocity_sigma_m_s**2 / weight))


def limited(
    ranges: Ranges, least: int = 1, most: int | None = None, windows: tuple[tuple[float, float], ...] | None = None
) -> Ranges:
    """Only the ``most`` highest satellites of each epoch, and no epoch with fewer than ``least``.

    Parameters
    ----------
    ranges : Ranges
    least : int
    most : int, optional
    windows : tuple of (start, stop), optional
        Where ``most`` applies; everywhere if left out. [s]
    """
    return ranges.where(_kept(ranges, least, most, windows))


def _kept(
    ranges: Ranges, least: int, most: int | None, windows: tuple[tuple[float, float], ...] | None = None
) -> BoolArray:
    used = ranges.used.copy()
    if most is not None:
        inside = np.ones(len(ranges), dtype=bool) if windows is None else in_windows(ranges.t, windows)
        used &= ~inside | (_rank(ranges, used) < most)
    _, epoch = np.unique(ranges.t, return_inverse=True)
    count = np.bincount(epoch, weights=used)
    return np.asarray(used & (count[epoch] >= least))


def _rank(ranges: Ranges, used: BoolArray) -> IntArray:
    """Place of each satellite among those used at its epoch, the highest being 0."""
    order = np.lexsort((-ranges.elevation, ~used, ranges.t))
    rank = np.empty(len(ranges), dtype=np.int64)
    first = np.concatenate(([True], np.diff(ranges.t[order]) > 0.0))
    begin = np.maximum.accumulate(np.where(first, np.arange(len(order)), 0))
    rank[order] = np.arange(len(order)) - begin
    return rank


def with_clocks(initial: InitialState, points: Points, layout: StateLayout) -> InitialState:
    """The initial state with the receiver clocks of the nearest solved epoch.

    Where slow errors of ranges are states, the position of a fix has these errors in it: it is left to the next ranges.

    Parameters
    ----------
    initial : InitialState
        At the time of a fix.
    points : Points
    layout : StateLayout
        Layout with clock blocks.
    """
    s = points.solution
    estimates = initial.parameters.copy()
    ok = np.flatnonzero(s.ok)
    k = ok[np.argmin(np.abs(s.t[ok] - initial.nav.t))]
    between = np.zeros(len(s.groups))
    for i in range(1, len(s.groups)):
        both = ok[np.isfinite(s.clock[ok, i]) & np.isfinite(s.clock[ok, 0])]
        if len(both):
            near = both[np.argsort(np.abs(s.t[both] - initial.nav.t), kind="stable")[:20]]
            between[i] = np.median(s.clock[near, i] - s.clock[near, 0])
    drift = float(s.drift[k]) if np.isfinite(s.drift[k]) else _clock_slope(s, ok[np.abs(s.t[ok] - s.t[k]) <= _NEAR_S])
    reference = float((s.clock[k] - between)[np.isfinite(s.clock[k])][0])  # a solved epoch shows one clock at least
    values = {"clock": reference + drift * (initial.nav.t - float(s.t[k])), "clock_drift": drift}
    values |= {f"clock_{i + 1}": float(between[i]) for i in range(1, len(s.groups))}
    for name, value in values.items():
        if name in layout:
            estimates[layout[name].start - 9] = value
    P = initial.P
    if CHANNELS[0] in layout:
        P = P.copy()
        P[range(6, 9), range(6, 9)] += _START_SIGMA**2
    return InitialState(initial.nav, P, estimates)


def _clock_slope(solution: PointSolution, near: IntArray) -> float:
    """Drift of a receiver clock by its offsets at some epochs, zero where fewer than three show one. [m/s]"""
    offsets = solution.clock[near]
    group = int(np.argmax(np.isfinite(offsets).sum(axis=0)))
    seen = np.isfinite(offsets[:, group])
    if np.sum(seen) < 3:
        return 0.0
    t = solution.t[near[seen]]
    return float(np.polyfit(t - t.mean(), offsets[seen, group], 1)[0])
