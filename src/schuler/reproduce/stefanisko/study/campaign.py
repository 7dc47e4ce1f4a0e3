"""Many runs of Stefanisko's experiment: root mean square errors, and what the filter claims of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from schuler import frames
from schuler.arrays import FloatArray
from schuler.exceptions import InputError
from schuler.navigation.evaluation.consistency import attitude_difference
from schuler.navigation.result import NavigationResult
from schuler.plotting.table import ResultTable, TabularResult
from schuler.recording.trajectory import FullTrajectory
from schuler.reproduce.stefanisko.study.experiment import FigureEight, Track, figure_eight_run
from schuler.units import DEG

Progress = Callable[[float], None]


@dataclass(frozen=True)
class FigureEightResult(TabularResult):
    """Many runs of one case.

    Attributes
    ----------
    case : FigureEight
    t : ndarray, shape (k,)
        Every second. [s]
    errors : ndarray, shape (runs, k, 15)
        ``dpsi``, ``dv``, ``dr`` north, east, down, biases. [rad], [m/s], [m], [m/s^2], [rad/s]
    variances : ndarray, shape (runs, k, 15)
        What the filter claims of them.
    nees : ndarray, shape (runs, k)
        NEES of all states, per degree of freedom.
    nis : ndarray, shape (runs,)
        Mean per degree of freedom.
    complete : bool
    """

    case: FigureEight
    t: FloatArray
    errors: FloatArray
    variances: FloatArray
    nees: FloatArray
    nis: FloatArray
    complete: bool = True

    def _index(self, t: float) -> int:
        return int(np.argmin(np.abs(self.t - t)))

    def rms(self, part: slice, t: float) -> float:
        """Root mean square over the runs of the norm of some states at a time [s]."""
        e = self.errors[:, self._index(t), part]
        return float(np.sqrt(np.mean(np.sum(e**2, axis=1))))

    def claimed(self, part: slice, t: float) -> float:
        """The same from the covariance: root of the mean trace."""
        return float(np.sqrt(np.mean(np.sum(self.variances[:, self._index(t), part], axis=1))))

    def position(self, t: float) -> float:
        """RMS position error, three-dimensional. [m]"""
        return self.rms(slice(6, 9), t)

    def velocity(self, t: float) -> float:
        """RMS velocity error, three-dimensional. [m/s]"""
        return self.rms(slice(3, 6), t)

    def heading(self, t: float) -> float:
        """RMS heading error. [rad]"""
        return self.rms(slice(2, 3), t)

    def ratio(self, t: float) -> float:
        """True over claimed position error; consistent between 0.7 and 1.3."""
        return self.position(t) / self.claimed(slice(6, 9), t)

    def table(self, times: tuple[float, ...] = (50.0, 90.0, 93.0, 120.0)) -> ResultTable:
        """Errors and claims at some times."""
        rows = tuple(
            (
                float(t), self.position(t), self.claimed(slice(6, 9), t), self.velocity(t), self.heading(t) / DEG,
                self.rms(slice(9, 12), t), float(np.mean(self.nees[:, self._index(t)])),
            )
            for t in times
            if t <= self.t[-1] + 0.5
        )  # fmt: skip
        moving = "figure-eight" if self.case.moving else "at rest"
        return ResultTable(
            f"Stefanisko, {moving}, {len(self.nis)} runs, fixes every {self.case.update_s:g} s",
            (
                "t_s", "rms_position_m", "claimed_position_m", "rms_velocity_m_s", "rms_heading_deg", "rms_b_a_m_s2",
                "nees",
            ),
            rows,
            (f"mean NIS per degree of freedom {float(np.mean(self.nis)):.3f}",),
            self.complete,
        )  # fmt: skip


def figure_eight(case: FigureEight, runs: int, seed: int = 1, progress: Progress | None = None) -> FigureEightResult:
    """Monte Carlo of one case.

    Parameters
    ----------
    case : FigureEight
    runs : int
        Do not depend on each other's number: run k is child k of the seed. Cases with one seed share all draws.
    seed : int
    progress : callable, optional
        Called with the fraction done.

    Returns
    -------
    FigureEightResult
        On Ctrl-C the runs that were finished, at least one.
    """
    if runs < 1:
        raise InputError(f"runs: expected at least one, got {runs}")
    track = Track.of(case)
    kept: list[tuple[FloatArray, FloatArray, FloatArray, float]] = []
    t = np.empty(0)
    complete = True
    try:
        for k, child in enumerate(np.random.SeedSequence(seed).spawn(runs)):
            result, biases = figure_eight_run(track, np.random.default_rng(child))
            if not result.complete:
                raise KeyboardInterrupt
            t = result.t
            kept.append(_scored(result, track.reference, biases))
            if progress is not None:
                progress((k + 1) / runs)
    except KeyboardInterrupt:
        if not kept:
            raise
        complete = False
    errors, variances, nees, nis = (np.array([run[i] for run in kept]) for i in range(4))
    return FigureEightResult(case, t, errors, variances, nees, nis, complete)


def _scored(
    result: NavigationResult, reference: FullTrajectory, biases: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, float]:
    """Errors and variances north-east-down, NEES at the records, mean NIS of a run."""
    s = result.states
    at = reference.at(np.clip(result.t, reference.t[0], reference.t[-1]))
    C = frames.C_en(at.llh)
    dx_e = (attitude_difference(s.q_eb, at.q_eb), s.v_eb_e - at.v_eb_e, s.r_eb_e - at.r_eb_e)
    dx = np.concatenate([*(np.einsum("nji,nj->ni", C, e) for e in dx_e), result.parameters - biases], axis=1)
    P = result.covariance
    sigma = np.sqrt(np.einsum("kii->ki", P))
    z = dx / sigma
    correlation = P / (sigma[:, :, None] * sigma[:, None, :])
    nees = np.einsum("ki,ki->k", z, np.linalg.solve(correlation, z[:, :, None])[:, :, 0]) / dx.shape[1]
    return dx, sigma**2, nees, result.innovations.mean_nis()
