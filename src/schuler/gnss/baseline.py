"""Baseline between two receivers from double differences of code and carrier, ambiguities fixed by LAMBDA."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from schuler import frames
from schuler.arrays import ArrayLike, BoolArray, FloatArray, IntArray, as_floats
from schuler.gnss.ambiguities import fix_ambiguities
from schuler.gnss.differences import SingleDifferences, cycle_slips, single_differences
from schuler.units import DEG

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from schuler.gnss.ephemerides import Ephemerides
    from schuler.gnss.observations import Observations
    from schuler.plotting import figure as content

_FREE_POSITION = 100.0  # 1-sigma of a position before an epoch's ranges [m]
_UNSOLVED = 30.0  # 1-sigma of a position that was hardly measured [m]
_FREE_AMBIGUITY = 100.0  # 1-sigma of an ambiguity before its first phase, about code minus carrier [cycles]
_LEAST_FIXED = 4  # combinations of ambiguities that make a position fixed


@dataclass(frozen=True)
class BaselineSolution:
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
    slips : ndarray of int, shape (k,)
        Carrier phases that jumped against the epoch before, each of which has a new ambiguity.
    base_llh : ndarray, shape (3,)
        Base antenna. [rad, rad, m]
    static : bool
        One baseline was solved for all epochs: each row uses the epochs up to it, the last row all of them.
    notes : tuple of str
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
    slips: IntArray
    base_llh: FloatArray
    static: bool
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.t)

    @property
    def ok(self) -> BoolArray:
        """Epochs with a baseline, fixed or float. Shape (k,)."""
        return np.isfinite(self.baseline_n[:, 0])

    @property
    def fix_share(self) -> float:
        """Part of all epochs that is fixed, 0 to 1."""
        return float(np.mean(self.fixed))

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

    def figure(self) -> content.Figure:
        """Baseline over time, fixed and float, a panel for each axis, and the ratio."""
        from schuler.plotting.figure import Figure, Item, Panel, line, markers

        floating = self.ok & ~self.fixed
        panels = []
        for i, axis in enumerate(("north", "east", "down")):
            items: list[Item] = []
            if floating.any():
                items.append(markers(self.t[floating], self.baseline_n[floating, i], "smoothed", "float"))
            if self.fixed.any():
                items.append(markers(self.t[self.fixed], self.baseline_n[self.fixed, i], "filtered", "fixed"))
            panels.append(Panel("time [s]", f"{axis} [m]", tuple(items)))
        ratio = np.minimum(self.ratio, 100.0)
        panels.append(Panel("time [s]", "ratio, at most 100", (line(self.t, ratio, "filtered"),)))
        return Figure("baseline", "Baseline from base to rover", self.summary() + ".", tuple(panels), columns=2)

    def plot(self) -> Figure:
        """The figure (matplotlib)."""
        from schuler.plotting.drawing import draw

        return draw(self.figure())


def solve_baseline(
    rover: Observations,
    base: Observations,
    ephemerides: Ephemerides,
    base_llh: ArrayLike,
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
) -> BaselineSolution:
    """Position of a rover relative to a base by carrier phases (RTK), epoch by epoch.

    Parameters
    ----------
    rover, base : Observations
        With code and carrier. Receivers may name their time axes differently (``epoch_gps_s``) and be some
        milliseconds apart.
    ephemerides : Ephemerides
    base_llh : array_like, shape (3,)
        Base antenna. Its error shifts the rover's position, and hardly the baseline. [rad, rad, m]
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
    base_llh = as_floats(base_llh, "base_llh", (3,))
    d = single_differences(
        rover, base, ephemerides, base_llh, systems=systems, elevation_mask=elevation_mask, cn0_mask=cn0_mask,
        sigma_code=sigma_code, sigma_carrier=sigma_carrier, static=static,
    )  # fmt: skip
    begins, slips = cycle_slips(d, static=static)
    k = len(d.t)
    r_float, r_best = np.full((2, k, 3), np.nan)
    cov_float, cov_best = np.full((2, k, 3, 3), np.nan)
    quotient, success = np.full((2, k), np.nan)
    n_sat, n_amb, n_fixed = np.zeros((3, k), dtype=np.int64)
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
        if not fix:
            continue
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
            shift, cov_best[i] = _conditioned(state, start[:, len(D) - m :].T @ D, result.integers)
            r_best[i] = d.r_e[i] + shift
            n_fixed[i] = m
    C_en, origin = frames.C_en(base_llh), frames.ecef_from_llh(base_llh)
    return BaselineSolution(
        d.t, (r_best - origin) @ C_en, C_en.T @ cov_best @ C_en, (r_float - origin) @ C_en, C_en.T @ cov_float @ C_en,
        n_fixed > 0, quotient, success, n_sat, n_amb, n_fixed, slips, base_llh, static, d.notes,
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
    slots, n = state.slots, len(state.x)
    H = np.zeros((2, len(slots), n))
    H[:, :, :3] = d.gradient[i, slots]
    H[1, :, 3:] = np.diag(d.wavelength[slots])
    y = np.concatenate((D @ d.code[i, slots], D @ d.carrier[i, slots]))
    A = np.concatenate((D @ H[0], D @ H[1]))
    m = len(D)
    R = np.zeros((2 * m, 2 * m))
    R[:m, :m] = (D * d.sigma_code[i, slots] ** 2) @ D.T
    R[m:, m:] = (D * d.sigma_carrier[i, slots] ** 2) @ D.T
    K = np.linalg.solve(A @ state.P @ A.T + R, A @ state.P).T
    left = np.eye(n) - K @ A
    P = left @ state.P @ left.T + K @ R @ K.T
    return _State(slots, state.x + K @ (y - A @ state.x), 0.5 * (P + P.T))


def _pairs(D: FloatArray, slots: IntArray) -> IntArray:
    """Slot and reference slot of each difference. Shape (m, 2)."""
    return np.stack((slots[np.argmax(D, axis=1)], slots[np.argmin(D, axis=1)]), axis=1)


def _conditioned(state: _State, T: FloatArray, integers: IntArray) -> tuple[FloatArray, FloatArray]:
    """Position and its covariance given integer combinations ``T`` of the ambiguities. Shapes (3,), (3, 3)."""
    cross = state.P[:3, 3:] @ T.T
    gain = np.linalg.solve(T @ state.P[3:, 3:] @ T.T, cross.T).T
    cov = state.P[:3, :3] - gain @ cross.T
    return state.x[:3] - gain @ (T @ state.x[3:] - integers), 0.5 * (cov + cov.T)
