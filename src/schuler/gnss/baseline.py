"""Baseline between two receivers from double differences of code and carrier, ambiguities fixed by LAMBDA."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from schuler import frames
from schuler.arrays import ArrayLike, BoolArray, FloatArray, IntArray, as_floats
from schuler.gnss.ambiguities import fix_ambiguities
from schuler.gnss.baseline_result import BaselineSolution
from schuler.gnss.differences import SingleDifferences, cycle_slips, single_differences
from schuler.units import DEG

if TYPE_CHECKING:
    from schuler.gnss.antennas import Antenna
    from schuler.gnss.ephemerides import Ephemerides
    from schuler.gnss.observations import Observations

_FREE_POSITION = 100.0  # 1-sigma of a position before an epoch's ranges [m]
_UNSOLVED = 30.0  # 1-sigma of a position that was hardly measured [m]
_FREE_AMBIGUITY = 100.0  # 1-sigma of an ambiguity before its first phase, about code minus carrier [cycles]
_LEAST_FIXED = 4  # combinations of ambiguities that make a position fixed


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
    antennas: tuple[Antenna | None, Antenna | None] = (None, None),
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
    antennas : (rover, base) of Antenna, optional
        Phase centres of the receivers' antennas, which point to north; the baseline is then that of their reference
        points, as is ``base_llh``. See :func:`schuler.gnss.antennas.receiver_antenna`.

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
    epoch and not held: a wrong fix does not outlive its epoch. Troposphere: Saastamoinen. The ionosphere of both
    antennas is taken to be the same, good to 10 km.

    References
    ----------
    Teunissen, P. J. G., Montenbruck, O. (eds., 2017), Springer Handbook of GNSS, chapters 21, 23 and 26; Groves (2013),
    section 10.2.
    """
    given = None if base_llh is None else as_floats(base_llh, "base_llh", (3,))
    d = single_differences(
        rover, base, ephemerides, given, systems=systems, elevation_mask=elevation_mask, cn0_mask=cn0_mask,
        sigma_code=sigma_code, sigma_carrier=sigma_carrier, static=static, antennas=antennas,
    )  # fmt: skip
    begins, slipped = cycle_slips(d, static=static)
    k = len(d.t)
    r_float, r_best = np.full((2, k, 3), np.nan)
    cov_float, cov_best = np.full((2, k, 3, 3), np.nan)
    quotient, success = np.full((2, k), np.nan)
    n_sat, n_amb, n_fixed = np.zeros((3, k), dtype=np.int64)
    residual_code, residual_carrier = np.full((2, *d.code.shape), np.nan)
    state = _State(np.zeros(0, dtype=np.int64), np.zeros(3), _FREE_POSITION**2 * np.eye(3))
    start, pairs = np.eye(0), np.zeros((0, 2), dtype=np.int64)
    for i in range(k):
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
            Q = D @ state.P[3:, 3:] @ D.T
            result = fix_ambiguities(
                start.T @ D @ state.x[3:], start.T @ (0.5 * (Q + Q.T)) @ start,
                ratio=ratio, least_success=least_success, partial=partial,
            )  # fmt: skip
            start = start @ result.Z  # nearly decorrelates the next epoch, too
            quotient[i], success[i] = result.ratio, result.success_rate
            m = len(result.integers)
            if result.accepted and m >= min(_LEAST_FIXED, len(D)):
                best, cov_best[i] = _conditioned(state, start[:, len(D) - m :].T @ D, result.integers)
                r_best[i] = d.r_e[i] + best[:3]
                n_fixed[i] = m
        differenced = _pairs(D, state.slots)[:, 0]
        residual_code[i, differenced], residual_carrier[i, differenced] = np.split(y - H @ best, 2)
    C_en, origin = frames.C_en(d.base_llh), frames.ecef_from_llh(d.base_llh)
    return BaselineSolution(
        d.t, (r_best - origin) @ C_en, C_en.T @ cov_best @ C_en, (r_float - origin) @ C_en, C_en.T @ cov_float @ C_en,
        n_fixed > 0, quotient, success, n_sat, n_amb, n_fixed, d.sat, d.band, residual_code, residual_carrier,
        d.sigma_code, d.sigma_carrier, slipped, d.base_llh, static, fix, d.notes,
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


def _pairs(D: FloatArray, slots: IntArray) -> IntArray:
    """Slot and reference slot of each difference. Shape (m, 2)."""
    return np.stack((slots[np.argmax(D, axis=1)], slots[np.argmin(D, axis=1)]), axis=1)


def _conditioned(state: _State, T: FloatArray, integers: IntArray) -> tuple[FloatArray, FloatArray]:
    """State, and covariance of its position, given integer combinations ``T`` of the ambiguities. (n,), (3, 3)"""
    cross = state.P[:, 3:] @ T.T
    gain = np.linalg.solve(T @ state.P[3:, 3:] @ T.T, cross.T).T
    cov = state.P[:3, :3] - gain[:3] @ cross[:3].T
    return state.x - gain @ (T @ state.x[3:] - integers), 0.5 * (cov + cov.T)
