"""Series of positions from solutions of satellites: single points, and baselines from a base station."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from schuler import frames
from schuler.arrays import FloatArray
from schuler.exceptions import InputError
from schuler.recording.series import GnssSeries, stated_dilution

if TYPE_CHECKING:
    from schuler.gnss.baseline_result import BaselineSolution
    from schuler.gnss.point_result import PointSolution

_FIXED, _FLOAT, _SINGLE = 1, 2, 5  # of QUALITY


def gnss_series(points: PointSolution) -> GnssSeries:
    """The epochs with a usable position, and velocity if all of them have one.

    Returns
    -------
    GnssSeries
        With the dilutions of the points. Covariances are the formal ones, from the standard deviations of the ranges.
        Velocities are left out as a whole if fewer than half of the epochs have one; else the epochs without one are
        left out.

    Raises
    ------
    InputError
        If no epoch has a usable position.
    """
    keep = points.ok
    if not keep.any():
        raise InputError(f"no epoch has a usable position: {points.summary()}")
    moving = points.velocity_ok
    with_velocity = bool(moving.sum() >= 0.5 * keep.sum())
    if with_velocity:
        keep = moving
    llh = points.llh[keep]
    C_ne = np.swapaxes(frames.C_en(llh), 1, 2)

    def to_n(cov: FloatArray) -> FloatArray:
        rotated: FloatArray = C_ne @ cov @ np.swapaxes(C_ne, 1, 2)
        return np.asarray(0.5 * (rotated + np.swapaxes(rotated, 1, 2)))

    return GnssSeries(
        points.t[keep],
        llh,
        to_n(points.cov_r_e[keep]),
        np.einsum("kij,kj->ki", C_ne, points.v_e[keep]) if with_velocity else None,
        to_n(points.cov_v_e[keep]) if with_velocity else None,
        np.full(int(keep.sum()), _SINGLE),
        points.n_used[keep],
        dop=stated_dilution(points.dilution.hdop[keep], points.dilution.vdop[keep]),
    )


def baseline_series(baseline: BaselineSolution) -> GnssSeries:
    """The rover's positions of a baseline, fixed and float; errors of the base position are not in their covariance.

    Raises
    ------
    InputError
        If no epoch has a baseline.
    """
    keep = baseline.ok
    if not keep.any():
        raise InputError(f"no epoch has a baseline: {baseline.summary()}")
    llh = baseline.llh[keep]
    turn = np.swapaxes(frames.C_en(llh), 1, 2) @ frames.C_en(baseline.base_llh)
    cov = turn @ baseline.cov_baseline_n[keep] @ np.swapaxes(turn, 1, 2)
    return GnssSeries(
        baseline.t[keep], llh, 0.5 * (cov + np.swapaxes(cov, 1, 2)),
        quality=np.where(baseline.fixed[keep], _FIXED, _FLOAT), n_satellites=baseline.n_satellites[keep],
    )  # fmt: skip
