"""Errors of a walk against a motion capture: positions only, in axes whose heading nobody knows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from schuler import frames
from schuler.arrays import FloatArray, IntArray
from schuler.exceptions import InputError
from schuler.recording.trajectory import Trajectory

if TYPE_CHECKING:
    from schuler.navigation.foot.result import FootResult

Fit = Literal["start", "all"]


@dataclass(frozen=True)
class WalkErrors:
    """Estimate minus reference, after both were moved to a common start and turned to a common heading.

    Attributes
    ----------
    t : ndarray, shape (n,)
        [s]
    position_n : ndarray, shape (n, 3)
        Error in the axes of the reference, third one down. [m]
    turned : float
        Angle about down by which the estimate was turned. [rad]
    at_rest : ndarray of int, shape (k,)
        Samples in the middle of the rests, the first rest left out.
    covariance_n : ndarray, shape (k, 3, 3)
        What the filter claims at these samples, in the same axes, less what it cannot know of the heading at the
        start. [m^2]
    """

    t: FloatArray
    position_n: FloatArray
    turned: float
    at_rest: IntArray
    covariance_n: FloatArray

    @property
    def horizontal(self) -> FloatArray:
        """Horizontal error. Shape (n,). [m]"""
        return np.hypot(self.position_n[:, 0], self.position_n[:, 1])

    @property
    def author_error(self) -> float:
        """The error stored in PyShoe's files: mean over time of the root mean square of the x and y errors. [m]

        That is the mean horizontal error over the square root of two, called RMSE by its author.
        """
        return float(self.horizontal.mean() / np.sqrt(2.0))

    @property
    def rms_horizontal(self) -> float:
        """Root of the mean squared horizontal error. [m]"""
        return float(np.sqrt(np.mean(self.horizontal**2)))

    @property
    def rms_vertical(self) -> float:
        """Root of the mean squared vertical error. [m]"""
        return float(np.sqrt(np.mean(self.position_n[:, 2] ** 2)))

    @property
    def end_horizontal(self) -> float:
        """Horizontal error at the last sample. [m]"""
        return float(self.horizontal[-1])

    def nees(self) -> tuple[float, float]:
        """Mean normalised error squared per degree of freedom at the rests: horizontal, vertical; honest filters: 1.

        One angle was fitted to the horizontal errors, which lowers the first by about 1 / (2 k) of k rests.
        """
        if not len(self.at_rest):
            raise InputError("there is no rest after the first one to take the errors at")
        e, P = self.position_n[self.at_rest], self.covariance_n
        horizontal = np.einsum("ki,ki->k", e[:, :2], np.linalg.solve(P[:, :2, :2], e[:, :2, None])[:, :, 0]) / 2.0
        return float(horizontal.mean()), float(np.mean(e[:, 2] ** 2 / P[:, 2, 2]))

    def statistics(self) -> dict[str, float]:
        """RMS, maxima and NEES, with units in the names."""
        numbers = {
            "author_error_m": self.author_error,
            "rms_horizontal_m": self.rms_horizontal,
            "max_horizontal_m": float(self.horizontal.max()),
            "end_horizontal_m": self.end_horizontal,
            "rms_vertical_m": self.rms_vertical,
            "max_vertical_m": float(np.abs(self.position_n[:, 2]).max()),
        }
        if len(self.at_rest):
            numbers["nees_horizontal"], numbers["nees_vertical"] = self.nees()
        return numbers


def walk_errors(
    result: FootResult, reference: Trajectory, *, fit: Fit = "start", fit_distance_m: float = 0.8, smoothed: bool = True
) -> WalkErrors:
    """Compare a walk with a motion capture.

    Parameters
    ----------
    result : FootResult
    reference : Trajectory
        Positions, at times that cover the walk; interpolated linearly.
    fit : {"start", "all"}
        Where the heading of the two is made the same: at the first sample at which the estimate is
        ``fit_distance_m`` away from its start, as PyShoe's author does, or in the mean over the rests (least
        squares), which does not multiply the error of that one sample by the size of the walk.
    fit_distance_m : float
        [m]
    smoothed : bool
        Take the smoothed solution where there is one.

    Returns
    -------
    WalkErrors
        At the IMU samples.

    Raises
    ------
    InputError
        If the reference does not cover the walk, or the walk has no extent to take a heading from.

    References
    ----------
    Wagstaff, Peretroukhin, Kelly (2020), programs of the data set, for ``author_error`` and ``fit = "start"``.
    """
    t = result.t
    inside = (t >= reference.t[0] - 1e-9) & (t <= reference.t[-1] + 1e-9)
    if not inside.all():
        raise InputError(
            f"the reference ({reference.t[0]:.3f}..{reference.t[-1]:.3f} s) does not cover the walk "
            f"({t[0]:.3f}..{t[-1]:.3f} s): cut the log to the span of the reference"
        )
    truth = frames.ned_from_ecef(reference.r_eb_e, frames.llh_from_ecef(reference.r_eb_e[0]))
    truth = np.stack([np.interp(t, reference.t, truth[:, i]) for i in range(3)], axis=1)
    truth = truth - truth[0]
    estimate = result.position_n(smoothed=smoothed)
    middle = result.rests.middle[1:]
    if fit == "start":
        away = np.flatnonzero(np.hypot(estimate[:, 0], estimate[:, 1]) >= fit_distance_m)
        if not len(away):
            raise InputError(f"the walk never gets {fit_distance_m} m away from its start, so it shows no heading")
        k = np.array([max(away[0] - 1, 0)])  # the author takes the sample before
    elif fit == "all":
        k = middle
    else:
        raise InputError(f"fit: expected 'start' or 'all', got {fit!r}")
    x, y = estimate[k, 0], estimate[k, 1]
    c, s = float(x @ truth[k, 0] + y @ truth[k, 1]), float(x @ truth[k, 1] - y @ truth[k, 0])
    if np.hypot(c, s) < 1e-6:
        raise InputError("the walk has no horizontal extent to take a heading from")
    turned = float(np.arctan2(s, c))
    C = np.array([[np.cos(turned), -np.sin(turned), 0.0], [np.sin(turned), np.cos(turned), 0.0], [0.0, 0.0, 1.0]])
    solution = result.best if smoothed else result.navigation
    at = np.clip(np.searchsorted(solution.t, t[middle] - 1e-9), 0, len(solution.t) - 1)
    P = solution.covariance[at][:, 6:9, 6:9]
    return WalkErrors(t, estimate @ C.T - truth, turned, middle, C @ P @ C.T)
