"""Single-point position and velocity: iterated weighted least squares on each epoch's ranges and range rates.

The models are those of :mod:`schuler.gnss.ranges`.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from schuler import frames
from schuler.arguments import explains_arguments
from schuler.arrays import ArrayLike, BoolArray, FloatArray, IntArray, as_floats
from schuler.earth import WGS84
from schuler.exceptions import InputError
from schuler.gnss.dop import Dilution, design, dilution_of, inverse_normal
from schuler.gnss.epoch_fits import FAR, Fit, Padded, fit_ranges, fit_rates, linearised, robust_positions
from schuler.gnss.integrity import DEFAULT_INTEGRITY, Integrity, identify, protection_levels, thresholds
from schuler.gnss.neighbours import solve_with_neighbours
from schuler.gnss.point_result import PointSolution
from schuler.gnss.ranges import Ranges, predicted_ranges, predicted_rates

_CHUNK = 2048  # epochs at a time, for the sake of memory
_MISSING_SIGMA = 10.0  # of a range without a standard deviation [m]
_MISSING_SIGMA_RATE = 1.0  # [m/s]


@explains_arguments
def solve_points(
    ranges: Ranges,
    *,
    start: ArrayLike | None = None,
    integrity: Integrity | None = DEFAULT_INTEGRITY,
    velocity: bool = True,
    progress: Callable[[float], None] | None = None,
) -> PointSolution:
    """Position, clocks, velocity and drift of every epoch, faults found and left out.

    Parameters
    ----------
    ranges : Ranges
        Rows with reason 0 and a finite pseudorange are used.
    start : array_like, shape (3,) or (k, 3), optional
        Start of the iteration, Earth-fixed; by default the Earth's centre, which serves any receiver below the
        satellites. [m]
    integrity : Integrity or None
        Settings of the search for faults; ``None`` looks for none.
    velocity : bool
        Whether range rates are solved too.
    progress : callable, optional
        Called with the fraction done.

    Returns
    -------
    PointSolution
        One row for each distinct time, also where there is no solution; ask its ``ok``.

    Raises
    ------
    InputError
        If there is no row at all, or the start has another shape.

    Notes
    -----
    Unknowns are the position and one clock for each group an epoch shows, so every group costs a satellite. An epoch
    whose weighted sum of squared residuals exceeds its chi-square limit is linearised again about a robust solution
    (Huber's weights, so that outliers of kilometres do not spoil it), the smallest set of ranges that explains it is
    left out (:func:`schuler.gnss.integrity.identify`) and what remains is solved and tested again. Range rates are
    treated alike, after the ranges; a satellite excluded there keeps its range, but not the other way round. Epochs
    that had to be given up are solved along a track through their neighbours
    (:func:`schuler.gnss.neighbours.solve_with_neighbours`).

    A row without a positive standard deviation is given 10 m, or 1 m/s, and a note says so. Errors common to all
    satellites of a group go into its clock and no test sees them.

    References
    ----------
    Yaman (2017), eqs. (3-12) to (3-18), with the geometric range of each satellite in its denominators (the text swaps
    range and pseudorange), weights, several clocks, the rotation of the Earth during travel and its rate
    (Groves (2013), sections 8.5.3 and 9.4.1).

    Examples
    --------
    >>> log = schuler.simulate("examples/town_tight.toml")
    >>> points = schuler.solve_points(log.ranges)
    >>> print(points.summary())
    177 of 207 epochs solved (30 too few satellites); 13.9 satellites, PDOP 1.53, ...
    """
    if len(ranges) == 0:
        raise InputError("expected ranges, got none; check the ephemerides and the reasons of the preparation")
    t, epoch = np.unique(ranges.t, return_inverse=True)
    epoch = np.asarray(epoch, dtype=np.int64).reshape(-1)
    first = _start(start, len(t))
    sigma, sigma_rate, notes = _sigmas(ranges)
    edges = np.searchsorted(epoch, np.arange(0, len(t) + _CHUNK, _CHUNK))
    parts = []
    for i, begin in enumerate(range(0, len(t), _CHUNK)):
        rows = slice(int(edges[i]), int(edges[i + 1]))
        count = min(_CHUNK, len(t) - begin)
        padded = Padded.of(ranges, rows, epoch[rows] - begin, count, sigma[rows], sigma_rate[rows])
        parts.append(_solve(padded, first[begin : begin + count], integrity, velocity, rows.stop - rows.start))
        if progress is not None:
            progress((begin + count) / len(t))
    joined = {name: np.concatenate([p[name] for p in parts]) for name in parts[0]}
    dops = Dilution(*(joined.pop(name) for name in ("gdop", "pdop", "hdop", "vdop", "tdop")))
    points = PointSolution(t=t, groups=ranges.groups, epoch=epoch, sat=ranges.sat, dilution=dops, notes=notes, **joined)
    if integrity is None or not integrity.neighbours:
        return points
    return solve_with_neighbours(ranges, points, sigma, sigma_rate, integrity)


def _status(fit: Fit, unknowns: IntArray, limit: FloatArray) -> IntArray:
    n = np.sum(fit.used, axis=1)
    conditions = [
        n < unknowns, ~fit.solvable, ~fit.converged, fit.redundancy == 0, fit.statistic > limit,
    ]  # fmt: skip
    return np.asarray(np.select(conditions, [2, 3, 4, 1, 5], 0), dtype=np.int64)


def _judge(fit: Fit, integrity: Integrity | None) -> IntArray:
    limit = np.full(len(fit.x), np.inf) if integrity is None else thresholds(integrity.false_alarm, fit.redundancy)
    return _status(fit, 3 + np.maximum(np.sum(fit.seen, axis=1), 1), limit)


def _exclude_ranges(p: Padded, fit: Fit, status: IntArray, integrity: Integrity) -> None:
    """Solve the epochs that failed again without what spoils them; ``fit`` and ``status`` are changed in place."""
    failed = np.flatnonzero(status == 5)
    if len(failed) == 0:
        return
    q = p.of_epochs(failed)
    r = robust_positions(q, fit.used[failed], fit.x[failed])
    sane = np.isfinite(r).all(axis=1) & (np.abs(np.where(np.isfinite(r), r, 0.0)).max(axis=1) < FAR)
    r[~sane] = fit.x[failed[~sane]]
    about = linearised(q, fit.used[failed], r, fit.converged[failed])
    used, identified, rivals = _identified(about, integrity)
    k = np.flatnonzero(identified)
    if len(k):
        again = fit_ranges(q.of_epochs(k), used[k], about.x[k])
        better = _judge(again, integrity)
        good = better == 0
        better[good & (rivals[k] > 0)] = 6
        keep = np.flatnonzero(good)
        fit.replace_at(failed[k[keep]], again.at(keep))
        status[failed[k[keep]]] = better[keep]


def _exclude_rates(p: Padded, fit: Fit, status: IntArray, r: FloatArray, integrity: Integrity) -> None:
    failed = np.flatnonzero(status == 5)
    if len(failed) == 0:
        return
    used, identified, rivals = _identified(fit.at(failed), integrity)
    k = failed[identified]
    if len(k):
        again = fit_rates(p.of_epochs(k), used[identified], r[k])
        fit.replace_at(k, again)
        status[k] = np.where(rivals[identified] > 0, 6, _judge(again, integrity))


def _identified(fit: Fit, integrity: Integrity) -> tuple[BoolArray, BoolArray, IntArray]:
    """Rows in use after exclusion, whether a fault was identified, and the number of rival explanations, by epoch."""
    used, identified, rivals = fit.used.copy(), np.zeros(len(fit.x), dtype=bool), np.zeros(len(fit.x), dtype=np.int64)
    for k in range(len(fit.x)):
        rows = np.flatnonzero(fit.used[k])
        answer = identify(fit.A[k, rows], fit.y[k, rows], integrity)
        if answer.rows:
            used[k, rows[list(answer.rows)]] = False
            identified[k], rivals[k] = True, answer.rivals
    return used, identified, rivals


def _solve(
    p: Padded, start: FloatArray, integrity: Integrity | None, velocity: bool, n_rows: int
) -> dict[str, np.ndarray]:
    """All that is known of some epochs, by the names of the result."""
    fit = fit_ranges(p, p.usable.copy(), start)  # exclusions are written into it
    status = _judge(fit, integrity)
    if integrity is not None:
        _exclude_ranges(p, fit, status, integrity)
    solved = (status != 2) & (status != 3) & (status != 4)
    r = np.where(solved[:, None], fit.x, start)
    rates = fit_rates(p, fit.used & p.has_rate, r)
    rate_status = np.where(status >= 2, status, _judge(rates, integrity))
    if integrity is not None:
        _exclude_rates(p, rates, rate_status, r, integrity)
    if not velocity:
        rate_status[:] = 7
    moving = (rate_status <= 1) | (rate_status == 5) | (rate_status == 6)
    moving &= solved & rates.solvable & velocity
    seen = fit.seen & solved[:, None]
    sigmas = np.sqrt(np.maximum(np.einsum("kii->ki", fit.cofactor), 0.0))
    fields = _of_geometry(p, fit, r, solved, integrity)
    fields |= {
        "status": status,
        "velocity_status": rate_status,
        "r_e": _nan_unless(solved, fit.x),
        "cov_r_e": _nan_unless(solved, fit.cofactor[:, :3, :3]),
        "clock": np.where(seen, fit.clocks, np.nan),
        "sigma_clock": np.where(seen, sigmas[:, 3:], np.nan),
        "v_e": _nan_unless(moving, rates.x),
        "cov_v_e": _nan_unless(moving, rates.cofactor[:, :3, :3]),
        "drift": _nan_unless(moving, rates.clocks[:, 0]),
        "sigma_drift": _nan_unless(moving, np.sqrt(np.maximum(rates.cofactor[:, 3, 3], 0.0))),
        "n_used": np.sum(fit.used, axis=1),
        "n_rates": np.sum(rates.used, axis=1) * moving,
        "redundancy": fit.redundancy,
        "statistic": _nan_unless(solved, fit.statistic),
        "velocity_statistic": _nan_unless(moving, rates.statistic),
    }
    residual, rate_residual = _residuals(p, fit, rates, solved, seen, moving)
    count = np.maximum(np.sum(fit.used, axis=1), 1)
    squares = np.sum(np.where(fit.used & solved[:, None], residual, 0.0) ** 2, axis=1)
    fields["rms"] = _nan_unless(solved, np.sqrt(squares / count))
    at = p.row >= 0
    rows = p.row[at]
    excluded = p.usable & ~fit.used & (status <= 1)[:, None]
    rate_excluded = p.has_rate & fit.used & ~rates.used & (rate_status <= 1)[:, None]
    for name, values in (
        ("excluded", excluded), ("rate_excluded", rate_excluded), ("weight", fit.used.astype(float)),
        ("residual", residual), ("rate_residual", rate_residual),
    ):  # fmt: skip
        fields[name] = np.empty(n_rows, dtype=values.dtype)
        fields[name][rows] = values[at]
    return fields


def _of_geometry(
    p: Padded, fit: Fit, r: FloatArray, solved: BoolArray, integrity: Integrity | None
) -> dict[str, np.ndarray]:
    """Dilutions, limit of the test and protection levels."""
    place = np.where(solved[:, None], r, [WGS84.a, 0.0, 0.0])
    C_en = frames.C_en(frames.llh_from_ecef(place))
    d = p.r_s - place[:, None, :]
    u_n = np.matmul(d / np.sqrt(np.sum(d * d, axis=-1))[..., None], C_en)
    H = design(-u_n, p.group, p.n_groups, fit.used)
    cofactor, solvable, seen = inverse_normal(H, fit.used, p.group, p.n_groups)
    dops = dilution_of(cofactor, solvable & solved, seen)
    fields = {name: getattr(dops, name) for name in dops.__dataclass_fields__}
    k = len(r)
    if integrity is None:
        return fields | {"threshold": np.full(k, np.inf), "hpl": np.full(k, np.inf), "vpl": np.full(k, np.inf)}
    hpl, vpl = protection_levels(fit.A, fit.cofactor, C_en, fit.used, fit.redundancy, integrity)
    fields["threshold"] = thresholds(integrity.false_alarm, fit.redundancy)
    return fields | {"hpl": np.where(solved, hpl, np.inf), "vpl": np.where(solved, vpl, np.inf)}


def _residuals(
    p: Padded, fit: Fit, rates: Fit, solved: BoolArray, seen: BoolArray, moving: BoolArray
) -> tuple[FloatArray, FloatArray]:
    """Measured minus predicted of all rows, used or not."""
    r = np.where(solved[:, None], fit.x, 0.0)[:, None, :]
    predicted, _ = predicted_ranges(p.r_s, r)
    clock = np.where(seen, fit.clocks, np.nan)[np.arange(len(seen))[:, None], p.group]
    residual = np.where(p.usable & solved[:, None], p.rho - predicted - clock, np.nan)
    speed, _ = predicted_rates(p.r_s, p.v_s, r, np.where(moving[:, None], rates.x, 0.0)[:, None, :])
    rate_residual = np.where(p.has_rate & moving[:, None], p.rate - speed - rates.clocks, np.nan)
    return residual, rate_residual


def _nan_unless(valid: BoolArray, values: FloatArray) -> FloatArray:
    return np.where(valid.reshape((-1,) + (1,) * (values.ndim - 1)), values, np.nan)


def _start(start: ArrayLike | None, n: int) -> FloatArray:
    if start is None:
        return np.zeros((n, 3))
    s = np.asarray(start)
    if s.shape not in ((3,), (n, 3)):
        raise InputError(f"start: expected shape (3,) or ({n}, 3), one for each epoch, got {s.shape}")
    return np.broadcast_to(as_floats(start, "start"), (n, 3)).copy()


def _sigmas(ranges: Ranges) -> tuple[FloatArray, FloatArray, tuple[str, ...]]:
    """Standard deviations, positive ones in the places of missing ones, and what to say about it."""
    notes, out = list(ranges.notes), []
    for name, values, missing, unit, measured in (
        ("range", ranges.sigma_range, _MISSING_SIGMA, "m", ranges.pseudorange),
        ("range rate", ranges.sigma_rate, _MISSING_SIGMA_RATE, "m/s", ranges.range_rate),
    ):
        bad = ~(np.isfinite(values) & (values > 0.0))
        n = int(np.sum(bad & ranges.used & np.isfinite(measured)))
        if n:
            notes.append(f"{n} {name}s without a positive standard deviation were given {missing:g} {unit}")
        out.append(np.where(bad, missing, values))
    return out[0], out[1], tuple(notes)
