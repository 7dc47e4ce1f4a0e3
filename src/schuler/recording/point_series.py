"""Single-point solutions as a GNSS series, for loosely coupled navigation."""

from __future__ import annotations

import numpy as np

from schuler import frames
from schuler.arrays import FloatArray
from schuler.exceptions import InputError
from schuler.gnss.point_result import PointSolution
from schuler.recording.series import GnssSeries

_SINGLE = 5  # schuler.recording.series.QUALITY


def gnss_series(points: PointSolution) -> GnssSeries:
    """The epochs with a usable position, and velocity if all of them have one.

    Returns
    -------
    GnssSeries
        Covariances are the formal ones, from the standard deviations of the ranges. Velocities are left out as a whole
        if fewer than half of the epochs have one; else the epochs without one are left out.

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
    )
