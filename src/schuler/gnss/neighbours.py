"""Epochs with faults that one epoch cannot isolate, solved with their neighbours."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

import numpy as np

from schuler import frames
from schuler.arrays import BoolArray, FloatArray, IntArray
from schuler.gnss.dop import Dilution, design, dilution_of, inverse_normal
from schuler.gnss.epoch_fits import FAR, Padded
from schuler.gnss.integrity import Integrity, noise_quantiles, threshold, thresholds
from schuler.gnss.linked import Linked, link_epochs
from schuler.gnss.point_result import LINKED, PointSolution
from schuler.gnss.ranges import Ranges, predicted_ranges, predicted_rates

_LONGEST_LINK_S = 5.0  # between epochs that are tied [s]
_REACH_S = 30.0  # on both sides of an epoch that needs them, neighbours help [s]
_FEWEST = 10  # epochs from which shares and noises can be learned
_MOST = 4096  # epochs at a time, for the sake of memory
_COARSEST = 100.0  # 1-sigma above which a linked position is none [m]
_DIRECT = 0.5  # probability from which a range counts as used
_SHORTEST_DETOUR = 5.0  # what is late by less may be noise that lasts [m]
_CLEAR = 5.0  # times a satellite's own scatter
_AGREES = 0.1  # weight from which a range rate does


def solve_with_neighbours(
    ranges: Ranges, points: PointSolution, sigma: FloatArray, sigma_rate: FloatArray, integrity: Integrity
) -> PointSolution:
    """Solution in which epochs with a fault that could not be isolated come from a track through their neighbours.

    Parameters
    ----------
    ranges : Ranges
    points : PointSolution
        Of these ranges, each epoch by itself.
    sigma, sigma_rate : ndarray, shape (n,)
        Positive standard deviations of the ranges and range rates. [m], [m/s]
    integrity : Integrity

    Returns
    -------
    PointSolution
        Status 8 where the track was taken: for epochs of status 5 and 6; beside these also for epochs without
        redundancy, and for those that passed but are further off the track than both uncertainties admit (chi-square,
        ``false_alarm``). All others are as they were.

    Notes
    -----
    Epochs are tied if they are at most 5 s apart and most of them have four range rates; those 30 s before and after an
    epoch that needs it take part. Where the track is uncertain by more than 100 m the epoch stays without a solution.
    """
    failed = (points.status == 5) | (points.status == 6)
    for k in _stretches(points, failed):
        rows, p, linked, _ = _track(ranges, points, k, sigma, sigma_rate)
        if linked is None:
            continue
        unchecked = failed[k] | (points.status[k] == 1)
        better = _located(linked) & (unchecked | (points.ok[k] & _apart(points, k, linked, integrity)))
        if better.any():
            points = _replaced(points, rows, p, linked, k, better, integrity)
    return points


def late_ranges(ranges: Ranges, points: PointSolution, judged: BoolArray) -> BoolArray:
    """Ranges that a track through all epochs shows to be late, where one epoch alone cannot tell.

    Parameters
    ----------
    ranges : Ranges
        With positive standard deviations.
    points : PointSolution
        Of these ranges, each epoch by itself.
    judged : ndarray of bool, shape (k,)
        Epochs whose ranges are asked for; the others help.

    Returns
    -------
    ndarray of bool, shape (n,)
        Ranges rather late than direct, by 5 m and more and by five times their satellite's own scatter.

    Notes
    -----
    Epochs between pauses of 5 s are tied, if they are ten and more, most of them have four range rates, and one of
    those judged has a fault that could not be isolated (status 5 or 6). A satellite's own scatter is that of its
    residuals from epoch to epoch (median of steps): what is stated too small is not taken for reflections.
    """
    late = np.zeros(len(ranges), dtype=bool)
    failed = judged & ((points.status == 5) | (points.status == 6))
    for k in np.split(np.arange(len(points)), np.flatnonzero(np.diff(points.t) > _LONGEST_LINK_S) + 1):
        if len(k) < _FEWEST or not failed[k].any():
            continue
        rows, p, linked, sat = _track(ranges, points, k, ranges.sigma_range, ranges.sigma_rate)
        if linked is None:
            continue
        residual = _residuals(p, linked)
        least = np.maximum(_SHORTEST_DETOUR, _CLEAR * _scatter(residual, sat))
        out = p.usable & (linked.direct < _DIRECT) & (residual > least) & (judged[k] & _located(linked))[:, None]
        late[rows.start + p.row[out]] = True
    return late


def _track(
    ranges: Ranges, points: PointSolution, k: IntArray, sigma: FloatArray, sigma_rate: FloatArray
) -> tuple[slice, Padded, Linked | None, IntArray]:
    """Rows of consecutive epochs, side by side, the track through them if rates tie them, and satellites by place."""
    first, last = np.searchsorted(points.epoch, [k[0], k[-1] + 1])
    rows = slice(int(first), int(last))
    p = Padded.of(ranges, rows, points.epoch[rows] - k[0], len(k), sigma[rows], sigma_rate[rows])
    start = np.where((np.abs(points.r_e[k]).max(axis=1) < FAR)[:, None], points.r_e[k], np.nan)
    place = np.maximum(p.row, 0)
    sat = np.where(p.row >= 0, ranges.sat[rows][place], -1)
    if np.mean(np.sum(p.has_rate, axis=1) >= 4) < 0.5 or not np.isfinite(start).any():
        return rows, p, None, sat
    cn0 = np.where(p.row >= 0, ranges.cn0[rows][place], np.nan)
    return rows, p, link_epochs(p, points.t[k], sat, cn0, start), sat


def _located(linked: Linked) -> BoolArray:
    """Epochs at which the track is certain enough to say anything."""
    return np.asarray(np.einsum("kii->k", linked.cov_r_e) < _COARSEST**2)


def _residuals(p: Padded, linked: Linked) -> FloatArray:
    """Measured minus predicted ranges along the track, NaN where there is none. Shape (k, m). [m]"""
    predicted, _ = predicted_ranges(p.r_s, linked.r_e[:, None, :])
    clock = np.take_along_axis(linked.clock, p.group, axis=1)
    return np.where(p.usable, p.rho - predicted - clock, np.nan)


def _scatter(residual: FloatArray, sat: IntArray) -> FloatArray:
    """1-sigma of each satellite's residuals, by the median of their steps from epoch to epoch. Shape (k, m). [m]"""
    sigma = np.zeros(residual.shape)
    for one in np.unique(sat[np.isfinite(residual)]):
        steps = np.diff(residual[np.isfinite(residual) & (sat == one)])
        if len(steps):
            sigma[sat == one] = 1.4826 * np.median(np.abs(steps)) / np.sqrt(2.0)
    return sigma


def _stretches(points: PointSolution, failed: BoolArray) -> list[IntArray]:
    """Epochs without long pauses, around those that failed."""
    t = points.t
    at = t[failed]
    if len(at) == 0:
        return []
    after = np.minimum(np.searchsorted(at, t), len(at) - 1)
    near = np.minimum(np.abs(t - at[after]), np.abs(t - at[np.maximum(after - 1, 0)])) <= _REACH_S
    k = np.flatnonzero(near)
    parts = np.split(k, np.flatnonzero((np.diff(k) > 1) | (np.diff(t[k]) > _LONGEST_LINK_S)) + 1)
    parts = [piece for part in parts for piece in np.array_split(part, -(-len(part) // _MOST))]
    return [part for part in parts if len(part) >= _FEWEST and failed[part].any()]


def _apart(points: PointSolution, k: IntArray, linked: Linked, integrity: Integrity) -> BoolArray:
    """Epochs whose own solution is further from the track than their uncertainties admit."""
    d = points.r_e[k] - linked.r_e
    P = points.cov_r_e[k] + linked.cov_r_e
    given = np.isfinite(P).all(axis=(1, 2)) & np.isfinite(d).all(axis=1)
    P[~given], d[~given] = np.eye(3), 0.0
    distance = np.einsum("ki,ki->k", d, np.linalg.solve(P, d[..., None])[..., 0])
    return np.asarray(distance > threshold(integrity.false_alarm, 3))


def _replaced(
    points: PointSolution, rows: slice, p: Padded, linked: Linked, k: IntArray, better: BoolArray, integrity: Integrity
) -> PointSolution:
    """The solution with the epochs ``k[better]`` taken from the track."""
    used = p.usable & (linked.direct >= _DIRECT)
    used_rate = p.has_rate & (linked.rate_weight >= _AGREES)
    residual = _residuals(p, linked)
    speed, _ = predicted_rates(p.r_s, p.v_s, linked.r_e[:, None, :], linked.v_e[:, None, :])
    rate_residual = np.where(p.has_rate, p.rate - speed - linked.drift[:, None], np.nan)
    C_en = frames.C_en(frames.llh_from_ecef(linked.r_e))
    dilution, seen = _dilution(p, linked.r_e, C_en, used)
    n_used = np.sum(used, axis=1)
    redundancy = np.maximum(n_used - 3 - np.sum(seen, axis=1), 0)
    hpl, vpl = _levels(linked, C_en, integrity)
    moving = better & (points.velocity_status[k] != 7)
    by_epoch: dict[str, np.ndarray] = {
        "status": np.full(len(k), LINKED), "r_e": linked.r_e, "cov_r_e": linked.cov_r_e, "clock": linked.clock,
        "sigma_clock": linked.sigma_clock, "n_used": n_used, "redundancy": redundancy,
        "statistic": np.sum(np.where(used, linked.direct * (residual * p.w) ** 2, 0.0), axis=1),
        "threshold": thresholds(integrity.false_alarm, redundancy),
        "rms": np.sqrt(np.sum(np.where(used, residual, 0.0) ** 2, axis=1) / np.maximum(n_used, 1)),
        "hpl": hpl, "vpl": vpl,
    }  # fmt: skip
    of_velocity = {
        "velocity_status": np.full(len(k), LINKED), "v_e": linked.v_e, "cov_v_e": linked.cov_v_e,
        "drift": linked.drift, "sigma_drift": linked.sigma_drift, "n_rates": np.sum(used_rate, axis=1),
        "velocity_statistic": np.sum(np.where(used_rate, linked.rate_weight * (rate_residual * p.w_rate) ** 2, 0), 1),
    }  # fmt: skip
    new: dict[str, Any] = {
        name: _put(getattr(points, name), k[better], values[better]) for name, values in by_epoch.items()
    }
    new |= {name: _put(getattr(points, name), k[moving], values[moving]) for name, values in of_velocity.items()}
    dops = {f.name: _put(getattr(points.dilution, f.name), k[better], getattr(dilution, f.name)[better])
            for f in fields(Dilution)}  # fmt: skip
    at = (p.row >= 0) & better[:, None]
    by_row = {"excluded": p.usable & ~used, "residual": residual, "weight": np.where(used, linked.direct, 0.0)}
    if moving.any():
        by_row |= {"rate_excluded": p.has_rate & used & ~used_rate, "rate_residual": rate_residual}
    new |= {n: _put(getattr(points, n), rows.start + p.row[at], values[at]) for n, values in by_row.items()}
    return replace(points, dilution=Dilution(**dops), **new)


def _put(values: np.ndarray, at: IntArray, new: np.ndarray) -> np.ndarray:
    out = values.copy()
    out[at] = new
    return out


def _dilution(p: Padded, r_e: FloatArray, C_en: FloatArray, used: BoolArray) -> tuple[Dilution, BoolArray]:
    d = p.r_s - r_e[:, None, :]
    u_n = np.matmul(d / np.sqrt(np.sum(d * d, axis=-1))[..., None], C_en)
    cofactor, solvable, seen = inverse_normal(design(-u_n, p.group, p.n_groups, used), used, p.group, p.n_groups)
    return dilution_of(cofactor, solvable, seen), seen


def _levels(linked: Linked, C_en: FloatArray, integrity: Integrity) -> tuple[FloatArray, FloatArray]:
    """Protection levels of a track: noise, and the worst satellite late by as much as passes for direct. [m]"""
    k_h, k_v = noise_quantiles(integrity.missed_detection)
    P = np.swapaxes(C_en, 1, 2) @ linked.cov_r_e @ C_en
    half = 0.5 * (P[:, 0, 0] + P[:, 1, 1])
    larger = half + np.sqrt((0.5 * (P[:, 0, 0] - P[:, 1, 1])) ** 2 + P[:, 0, 1] ** 2)
    hidden = linked.hidden @ C_en
    hpl = k_h * np.sqrt(larger) + np.hypot(hidden[..., 0], hidden[..., 1]).max(axis=1)
    return hpl, k_v * np.sqrt(P[:, 2, 2]) + np.abs(hidden[..., 2]).max(axis=1)
