"""Baseline between two receivers from double differences of code and carrier, ambiguities fixed by LAMBDA."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np

from schuler import frames
from schuler.arguments import explains_arguments
from schuler.arrays import ArrayLike, BoolArray, FloatArray, IntArray, as_floats
from schuler.exceptions import InputError
from schuler.gnss.ambiguities import fix_ambiguities
from schuler.gnss.baseline_result import BaselineSolution
from schuler.gnss.differences import SingleDifferences, cycle_slips, single_differences
from schuler.gnss.integrity import thresholds
from schuler.gnss.wide_lanes import without_ionosphere
from schuler.units import DEG

if TYPE_CHECKING:
    from schuler.gnss.antennas import Antenna
    from schuler.gnss.ephemerides import Ephemerides
    from schuler.gnss.observations import Observations

_FREE_POSITION = 100.0  # 1-sigma of a position before an epoch's ranges [m]
_UNSOLVED = 30.0  # 1-sigma of a position that was hardly measured [m]
_FREE_AMBIGUITY = 100.0  # 1-sigma of an ambiguity before its first phase, about code minus carrier [cycles]
_FIXED = 0.1  # largest 1-sigma of a position that is called fixed; a part of the integers may leave more [m]
_HELD = 0.001  # 1-sigma of an integer that is held [cycles]
_CONTRADICTED = 1e-6  # probability of residuals as large as those by which held integers are given up
_LEAST_FIXED = 4  # combinations of ambiguities that make a position fixed


@explains_arguments
def solve_baseline(
    rover: Observations,
    base: Observations,
    ephemerides: Ephemerides,
    base_llh: ArrayLike | None = None,
    *,
    static: bool = False,
    systems: str = "GEC",
    elevation_mask: float = 15.0 * DEG,
    cn0_mask: float = 30.0,
    sigma_code: float = 0.3,
    sigma_carrier: float = 0.003,
    ratio: float = 3.0,
    least_success: float = 0.999,
    partial: bool = True,
    fix: bool = True,
    hold: int = 0,
    antennas: tuple[Antenna | None, Antenna | None] = (None, None),
    eccentricities_n: ArrayLike | None = None,
    ionosphere: Literal["same", "free"] = "same",
) -> BaselineSolution:
    """Position of a rover relative to a base by carrier phases (RTK), epoch by epoch.

    Parameters
    ----------
    rover, base : Observations
        With code and carrier. Receivers may name their time axes differently (``epoch_gps_s``) and be some
        milliseconds apart.
    ephemerides : Ephemerides
    base_llh : array_like, shape (3,), optional
        Base antenna. Its error shifts the rover's position, and hardly the baseline. By default the mean of the base's
        single points, good to metres. [rad, rad, m]
    static : bool
        The rover does not move; otherwise its position is free at each epoch.
    systems : str
        Letters out of ``GECJ``. Every band that both receivers measured is used.
    elevation_mask : float
        [rad]
    cn0_mask : float
        In either receiver. [dB-Hz]
    sigma_code, sigma_carrier : float
        1-sigma of one receiver's measurement of a strong satellite overhead; it grows as
        :func:`schuler.gnss.weighting.noise_scale`. [m]
    ratio, least_success, partial
        See :func:`schuler.gnss.ambiguities.fix_ambiguities`.
    fix : bool
        Use integers; otherwise the float solution is all there is.
    hold : int
        Epochs in a row in which the integer of an ambiguity must come out the same to be held from then on; 0: never.
    antennas : (rover, base) of Antenna, optional
        Phase centres of the receivers' antennas, which point to north; the baseline is then that of their reference
        points, as is ``base_llh``. See :func:`schuler.gnss.antennas.antenna_pair`.
    eccentricities_n : array_like, shape (2, 3), optional
        Antenna reference points of rover and base from the marks of their stations, north, east, down: the baseline,
        and ``base_llh``, are then those of the marks. [m]
    ionosphere : {"same", "free"}
        Above both antennas the same, good to 10 km; or taken out by two bands, whose wide lanes are fixed first
        (:func:`schuler.gnss.wide_lanes.without_ionosphere`): noise is three times as large, and a fix takes minutes.

    Returns
    -------
    BaselineSolution

    Raises
    ------
    InputError
        If the receivers have no common epochs, satellites or carriers, if ``base_llh`` is not where the base's own
        ranges place it, or if an option makes no sense.

    Notes
    -----
    States of the filter: rover position and one ambiguity for each satellite, band and arc, all between receivers.
    Measurements are differenced between satellites of a system and band against the highest one, which makes clocks
    and receiver delays vanish; an ambiguity is an integer only as such a difference. Positions have no memory (or,
    static, no process noise), ambiguities are constants until a slip or a pause. Integers are tried anew at each
    epoch and, unless asked for, not held: a wrong fix does not outlive its epoch. Those that are held are given up
    where carriers contradict them. A position is called fixed if integers leave it a 1-sigma below 0.1 m. Troposphere:
    Saastamoinen.

    References
    ----------
    Teunissen, P. J. G., Montenbruck, O. (eds., 2017), Springer Handbook of GNSS, chapters 21, 23 and 26; Groves (2013),
    section 10.2.
    """
    if hold < 0:
        raise InputError(f"hold: expected a number of epochs, 0 for never, got {hold}")
    if ionosphere not in ("same", "free"):
        raise InputError(f'ionosphere: expected "same" or "free", got {ionosphere!r}')
    given = None if base_llh is None else as_floats(base_llh, "base_llh", (3,))
    to_antenna = (
        np.zeros((2, 3)) if eccentricities_n is None else as_floats(eccentricities_n, "eccentricities_n", (2, 3))
    )
    d = single_differences(
        rover, base, ephemerides, given, systems=systems, elevation_mask=elevation_mask, cn0_mask=cn0_mask,
        sigma_code=sigma_code, sigma_carrier=sigma_carrier, static=static, antennas=antennas,
        base_eccentricity_n=to_antenna[1],
    )  # fmt: skip
    begins, slipped = cycle_slips(d, static=static)
    if ionosphere == "free":
        d, begins, slipped = without_ionosphere(d, begins, slipped, least_success=least_success)
    k = len(d.t)
    r_float, r_best = np.full((2, k, 3), np.nan)
    cov_float, cov_best = np.full((2, k, 3, 3), np.nan)
    quotient, success = np.full((2, k), np.nan)
    n_sat, n_amb, n_fixed = np.zeros((3, k), dtype=np.int64)
    residual_code, residual_carrier = np.full((2, *d.code.shape), np.nan)
    alike, last = np.zeros(len(d.sat), dtype=np.int64), np.full(len(d.sat), np.nan)
    state = _State(np.zeros(0, dtype=np.int64), np.zeros(3), _FREE_POSITION**2 * np.eye(3))
    start, pairs = np.eye(0), np.zeros((0, 2), dtype=np.int64)
    for i in range(k):
        alike[begins[i] | ~np.isfinite(d.carrier[i])] = 0
        state = _advance(state, d, i, begins[i], static=static)
        D = _between_satellites(d, i, state.slots)
        state = _update(state, d, i, D)
        n_sat[i], n_amb[i] = len(np.unique(d.sat[state.slots])), len(D)
        if not len(D) or np.diag(state.P)[:3].max() > _UNSOLVED**2:
            continue
        r_float[i], cov_float[i] = d.r_e[i] + state.x[:3], state.P[:3, :3]
        r_best[i], cov_best[i] = r_float[i], cov_float[i]
        best, H, y = state.x, *_double_differences(state, d, i, D)
        if fix:
            if not np.array_equal(pairs, _pairs(D, state.slots)):
                pairs, start = _pairs(D, state.slots), np.eye(len(D))
            tried = _with_integers(state, D, start, ratio=ratio, least_success=least_success, partial=partial)
            start, quotient[i], success[i] = tried.start, tried.ratio, tried.success
            if tried.fixed:
                best, cov_best[i], n_fixed[i] = tried.x, tried.cov_r, tried.fixed
                r_best[i] = d.r_e[i] + best[:3]
            if hold and n_fixed[i] == len(D):
                alike[state.slots] = np.where(_alike(best[3:], last[state.slots], D), alike[state.slots] + 1, 1)
                last[state.slots] = best[3:]
                state = _held(state, best, D, alike[state.slots] >= hold)
        differenced = _pairs(D, state.slots)[:, 0]
        residual_code[i, differenced], residual_carrier[i, differenced] = np.split(y - H @ best, 2)
        if hold and _contradicted(residual_carrier[i, differenced], d.sigma_carrier[i, state.slots], D):
            # integers that are held are wrong, and with them the float solution: all begin anew
            n_fixed[i], r_best[i], r_float[i], cov_best[i], cov_float[i] = 0, *np.full(4, np.nan)
            begins[i + 1 : i + 2] = np.isfinite(d.carrier[i + 1 : i + 2])
    sigma_largest = np.where(n_fixed > 0, np.sqrt(np.diagonal(cov_best, axis1=1, axis2=2).max(axis=1)), np.inf)
    C_en = frames.C_en(d.base_llh)
    origin = frames.ecef_from_llh(d.base_llh) + frames.C_en(frames.llh_from_ecef(d.r_e)) @ to_antenna[0]
    return BaselineSolution(
        d.t, (r_best - origin) @ C_en, C_en.T @ cov_best @ C_en, (r_float - origin) @ C_en, C_en.T @ cov_float @ C_en,
        sigma_largest < _FIXED, quotient, success, n_sat, n_amb, n_fixed, d.sat, d.band, residual_code,
        residual_carrier, d.sigma_code, d.sigma_carrier, slipped, d.base_llh, static, fix, d.notes, ionosphere,
    )  # fmt: skip


@dataclass(frozen=True)
class _State:
    """Filter between epochs: offset from the approximate position [m], then ambiguities of slots between receivers."""

    slots: IntArray
    x: FloatArray
    P: FloatArray


def _advance(before: _State, d: SingleDifferences, i: int, begins: BoolArray, *, static: bool) -> _State:
    """State for the slots of epoch i: what goes on, free positions, new ambiguities from code minus carrier."""
    measured = np.flatnonzero(np.isfinite(d.carrier[i]))
    groups, counts = np.unique(d.group[measured], return_counts=True)
    slots = measured[np.isin(d.group[measured], groups[counts > 1])]  # one alone has no difference
    n = 3 + len(slots)
    x, P = np.zeros(n), np.zeros((n, n))
    x[3:] = (d.carrier[i, slots] - d.code[i, slots]) / d.wavelength[slots]
    P[3:, 3:] = _FREE_AMBIGUITY**2 * np.eye(len(slots))
    P[:3, :3] = _FREE_POSITION**2 * np.eye(3)
    old = np.flatnonzero(np.isin(slots, before.slots) & ~begins[slots])
    now, then = 3 + old, 3 + np.searchsorted(before.slots, slots[old])
    if static:
        now, then = np.append([0, 1, 2], now), np.append([0, 1, 2], then)
    x[now] = before.x[then]
    P[np.ix_(now, now)] = before.P[np.ix_(then, then)]
    return _State(slots, x, P)


class _Tried(NamedTuple):
    """State given the integers that were accepted, their number, the tests, and the start of the next search."""

    x: FloatArray
    cov_r: FloatArray
    fixed: int
    ratio: float
    success: float
    start: FloatArray


def _with_integers(state: _State, D: FloatArray, start: FloatArray, **tests: Any) -> _Tried:
    """Integers of the differences ``D``, searched for from the combinations that decorrelated the epoch before."""
    Q = D @ state.P[3:, 3:] @ D.T
    result = fix_ambiguities(start.T @ D @ state.x[3:], start.T @ (0.5 * (Q + Q.T)) @ start, **tests)
    start = start @ result.Z  # nearly decorrelates the next epoch, too
    m = len(result.integers)
    if not result.accepted or m < min(_LEAST_FIXED, len(D)):
        return _Tried(state.x, state.P[:3, :3], 0, result.ratio, result.success_rate, start)
    x, cov_r = _conditioned(state, start[:, len(D) - m :].T @ D, result.integers)
    return _Tried(x, cov_r, m, result.ratio, result.success_rate, start)


def _between_satellites(d: SingleDifferences, i: int, slots: IntArray) -> FloatArray:
    """Matrix that subtracts from each slot the highest satellite of its group. Shape (m, slots)."""
    D = np.eye(len(slots))
    highest = []
    for g in np.unique(d.group[slots]):
        mine = np.flatnonzero(d.group[slots] == g)
        reference = mine[np.argmax(d.elevation[i, slots[mine]])]
        D[mine, reference] -= 1.0
        highest.append(reference)
    return np.delete(D, highest, axis=0)


def _update(state: _State, d: SingleDifferences, i: int, D: FloatArray) -> _State:
    """Update with double differences of code and carrier."""
    if not len(D):
        return state
    A, y = _double_differences(state, d, i, D)
    slots, n = state.slots, len(state.x)
    m = len(D)
    R = np.zeros((2 * m, 2 * m))
    R[:m, :m] = (D * d.sigma_code[i, slots] ** 2) @ D.T
    R[m:, m:] = (D * d.sigma_carrier[i, slots] ** 2) @ D.T
    K = np.linalg.solve(A @ state.P @ A.T + R, A @ state.P).T
    left = np.eye(n) - K @ A
    P = left @ state.P @ left.T + K @ R @ K.T
    return _State(slots, state.x + K @ (y - A @ state.x), 0.5 * (P + P.T))


def _double_differences(state: _State, d: SingleDifferences, i: int, D: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Rows of H and measurements, of code and then of carrier. Shapes (2 m, 3 + slots), (2 m,). [m]"""
    slots = state.slots
    H = np.zeros((2, len(slots), len(state.x)))
    H[:, :, :3] = d.gradient[i, slots]
    H[1, :, 3:] = np.diag(d.wavelength[slots])
    return np.concatenate((D @ H[0], D @ H[1])), np.concatenate((D @ d.code[i, slots], D @ d.carrier[i, slots]))


def _alike(ambiguities: FloatArray, before: FloatArray, D: FloatArray) -> BoolArray:
    """Slots whose double difference is that of the epoch before; reference slots are. Shape (slots,)."""
    same = np.ones(len(before), dtype=bool)
    change, slot, reference = ambiguities - before, np.argmax(D, axis=1), np.argmin(D, axis=1)
    same[slot] = np.abs(change[slot] - change[reference]) < 0.5
    return same


def _held(state: _State, best: FloatArray, D: FloatArray, sure: BoolArray) -> _State:
    """State in which the double differences of slots that are sure are their integers."""
    T = D[sure[np.argmax(D, axis=1)] & sure[np.argmin(D, axis=1)]]
    if not len(T):
        return state
    A = np.hstack((np.zeros((len(T), 3)), T))
    R = _HELD**2 * np.eye(len(T))
    K = np.linalg.solve(A @ state.P @ A.T + R, A @ state.P).T
    left = np.eye(len(state.x)) - K @ A
    P = left @ state.P @ left.T + K @ R @ K.T
    return _State(state.slots, state.x + K @ (np.round(T @ best[3:]) - A @ state.x), 0.5 * (P + P.T))


def _contradicted(residual: FloatArray, sigma: FloatArray, D: FloatArray) -> bool:
    """Whether carrier residuals are far beyond their noise, for as many degrees of freedom as there are differences."""
    size = residual @ np.linalg.solve((D * sigma**2) @ D.T, residual)
    return bool(size > thresholds(_CONTRADICTED, np.array([len(D)]))[0])


def _pairs(D: FloatArray, slots: IntArray) -> IntArray:
    """Slot and reference slot of each difference. Shape (m, 2)."""
    return np.stack((slots[np.argmax(D, axis=1)], slots[np.argmin(D, axis=1)]), axis=1)


def _conditioned(state: _State, T: FloatArray, integers: IntArray) -> tuple[FloatArray, FloatArray]:
    """State, and covariance of its position, given integer combinations ``T`` of the ambiguities. (n,), (3, 3)"""
    cross = state.P[:, 3:] @ T.T
    gain = np.linalg.solve(T @ state.P[3:, 3:] @ T.T, cross.T).T
    cov = state.P[:3, :3] - gain[:3] @ cross[:3].T
    return state.x - gain @ (T @ state.x[3:] - integers), 0.5 * (cov + cov.T)
