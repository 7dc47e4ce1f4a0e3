"""Errors beside claims: how far off, how far off it says it is, and what can be said of both from one run."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from schuler import frames
from schuler.arrays import BoolArray, FloatArray
from schuler.filtering.error_model import ecef_from_ned_states
from schuler.navigation.evaluation.consistency import chi_square_band
from schuler.navigation.result import NavigationResult
from schuler.recording.series import GnssSeries
from schuler.recording.trajectory import Trajectory
from schuler.rotation import skew

Windows = Sequence[tuple[float, float]]


class Judge(NamedTuple):
    """What a solution is compared with.

    Attributes
    ----------
    t : ndarray, shape (n,)
        [s]
    llh : ndarray, shape (n, 3)
        [rad], [m]
    cov_n : ndarray, shape (n, 3, 3)
        Its own covariance, which is added to what the solution claims; zero of a truth. [m^2]
    at_antenna : bool
    offset_n : ndarray, shape (3,)
        Mean of solution minus judge that is the judge's fault (a base station off its place). [m]
    apart : bool
        Whether its errors are others than the solution's; claims cannot be judged by one that shares them.
    """

    t: FloatArray
    llh: FloatArray
    cov_n: FloatArray
    at_antenna: bool
    offset_n: FloatArray
    apart: bool = True

    @classmethod
    def of_fixes(cls, gnss: GnssSeries) -> Judge:
        """Fixes that the run did not see."""
        return cls(gnss.t, gnss.llh, gnss.cov_r_n, True, np.zeros(3))

    @classmethod
    def of_truth(cls, truth: Trajectory, rate_hz: float = 5.0) -> Judge:
        """A true trajectory of the IMU, thinned."""
        step = max(1, round(1.0 / (rate_hz * float(np.median(np.diff(truth.t))))))
        t, llh = truth.t[::step], truth.llh[::step]
        return cls(t, llh, np.zeros((len(t), 3, 3)), False, np.zeros(3))


class Errors(NamedTuple):
    """Horizontal errors and what is claimed for them: (n,), (n, 2) [m], (n, 2, 2) [m^2] each."""

    t: FloatArray
    error: FloatArray
    claim: FloatArray
    total: FloatArray  # with the judge's own, as the run believes it
    stated: FloatArray | None = None  # with the judge's own, as it states it, where that is another

    def where(self, keep: BoolArray) -> Errors:
        return Errors(*(None if values is None else values[keep] for values in self))  # type: ignore[arg-type]


def horizontal_errors(result: NavigationResult, judge: Judge) -> Errors:
    """North and east errors at the times of the judge that the solution covers, with its claims."""
    path = result.antenna() if judge.at_antenna else result.trajectory
    if judge.at_antenna:  # fixes held back have the stamps of those that were used
        judge = judge._replace(t=judge.t + result.fixes_later_s)
    errors = horizontal_errors_of(path, judge, start=float(result.t[0]))
    own = errors.total * np.outer(*[judge_scale(result)] * 2) if judge.at_antenna else errors.total
    P = antenna_covariance(result) if judge.at_antenna else result.covariance[:, 6:9, 6:9]
    claim = [np.interp(errors.t, result.t, P[:, i, j]) for i in (0, 1) for j in (0, 1)]
    claimed = np.stack(claim, axis=-1).reshape(-1, 2, 2)
    return errors._replace(claim=claimed, total=claimed + own, stated=claimed + errors.total)


def judge_scale(result: NavigationResult) -> FloatArray:
    """Factors on the 1-sigma north and east that fixes state, as the run took them from tuning. Shape (2,).

    A fix held back is as good as those the run was given: what the run made of their sigmas is part of its claim. A
    run that shrinks them too far is found out by the fixes it did not see.
    """
    config = result.provenance.get("config", {}).get("gnss", {})
    return np.array(config.get("position_sigma_scale", (1.0, 1.0, 1.0)))[:2]


def antenna_covariance(result: NavigationResult) -> FloatArray:
    """Covariance of the antenna's position at the records, north, east, down. Shape (k, 3, 3) [m^2]

    With a lever arm or time offset that is estimated the antenna at a fix is better known than the IMU:
    ``dr + dpsi x l + C_nb dl + v dt``. The path is compared at the offset of the end, not of the moment: what is left
    of ``dt`` by then goes with the error ``x`` of the moment as far as ``P_x,dt / P_dt,dt`` says.
    """
    T = ecef_from_ned_states(result.states.llh, result.layout.size)
    P = np.swapaxes(T, 1, 2) @ result.filter_covariance_e() @ T  # fixes place the antenna, whatever the attitude is
    H = np.zeros((len(P), 3, P.shape[1]))
    H[:, :, 6:9] = np.eye(3)
    if "lever" in result.layout:
        C = result.states.C_nb
        l_n = np.einsum("kij,kj->ki", C, result.lever_arm_b + result.parameter("lever"))
        H[:, :, :3] = -skew(l_n)
        H[:, :, result.layout["lever"]] = C
    if "delay" in result.layout:
        k = result.layout["delay"].start
        at_end = float(P[-1, k, k])
        g = P[:, :, k] / np.maximum(P[:, k, k, None], 1e-300)  # of all errors by the offset's; its own is 1
        P = P.copy()
        P[:, :, k], P[:, k, :] = at_end * g, at_end * g
        H[:, :, k] = result.states.v_eb_n
    return np.asarray(H @ P @ np.swapaxes(H, 1, 2))


def horizontal_errors_of(path: Trajectory, judge: Judge, start: float = -np.inf) -> Errors:
    """The same of a path without a claim, from a time on. [s]"""
    inside = (judge.t >= max(path.t[0], start)) & (judge.t <= path.t[-1])
    t, llh = judge.t[inside], judge.llh[inside]
    e = np.einsum("nji,nj->ni", frames.C_en(llh), path.at(t).r_eb_e - frames.ecef_from_llh(llh)) - judge.offset_n
    own = judge.cov_n[inside][:, :2, :2]
    return Errors(t, e[:, :2], np.zeros_like(own), own)


def within(t: FloatArray, windows: Windows, lead_s: float = 0.0) -> BoolArray:
    """Which times lie in one of the windows, ``lead_s`` after its start or later. [s]"""
    inside = np.zeros(len(t), dtype=bool)
    for start, stop in windows:
        inside |= (t > start + lead_s) & (t < stop)
    return inside


def nees(errors: Errors, total: FloatArray | None = None) -> FloatArray:
    """Normalised horizontal error squared per degree of freedom. Shape (n,)."""
    z = np.linalg.solve(errors.total if total is None else total, errors.error[:, :, None])[:, :, 0]
    return np.asarray(np.einsum("ni,ni->n", errors.error, z) / 2.0)


def independent(x: FloatArray) -> float:
    """Number of independent values in a series of errors, from its autocorrelation up to the first zero."""
    n = len(x)
    if n < 4 or not np.isfinite(x).all() or not x.any():
        return float(max(n, 1))
    size = 1 << (2 * n - 1).bit_length()
    power = np.abs(np.fft.rfft(x, size)) ** 2
    r = np.fft.irfft(power, size)[:n] / float(x @ x)
    below = np.flatnonzero(r <= 0.0)
    lag = int(below[0]) if len(below) else n
    return float(np.clip(n / (1.0 + 2.0 * r[1:lag].sum()), 1.0, n))


def consistency(errors: Errors, groups: int | None = None) -> dict[str, Any]:
    """Claim, NEES with its 95 % band, and shares of components inside 1, 2 and 3 sigma.

    Parameters
    ----------
    errors : Errors
    groups : int, optional
        Number of independent stretches (outages); default from the autocorrelation of the errors.
    """
    squared = nees(errors)
    z = errors.error / np.sqrt(np.einsum("nii->ni", errors.total))
    n = groups if groups is not None else round(np.mean([independent(z[:, k]) for k in (0, 1)]))
    band = chi_square_band(2, max(int(n), 1))
    return {
        "claimed": float(np.sqrt(np.mean(np.einsum("nii->n", errors.claim)))),
        "nees": float(squared.mean()),
        "nees_stated": float(nees(errors, errors.stated).mean()),
        "nees_band": list(band),
        "inside": [float(np.mean(np.abs(z) < k)) for k in (1.0, 2.0, 3.0)],
        "median_sigmas": float(np.median(np.sqrt(2.0 * squared))),
    }


def rms(errors: Errors) -> float:
    """Root mean square of the horizontal error. [m]"""
    return float(np.sqrt(np.mean(np.sum(errors.error**2, axis=1))))


def largest(errors: Errors, windows: Windows) -> list[float]:
    """Largest horizontal error in each window that has any. [m]"""
    size = np.hypot(*errors.error.T)
    inside = [(errors.t > a) & (errors.t < b) for a, b in windows]
    return [float(size[k].max()) for k in inside if k.any()]
