"""Stefanisko's filter with the signs he prints, and with three sets that work, on his figure-eight.

He takes F from a book whose errors are INS minus truth and the correction step from a program whose errors are truth
minus INS. As printed, tilt is fed back with the wrong sign and the filter diverges. The engine of this package has one
convention and cannot show this; the fifteen states are written out here as in the source.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from schuler import frames, rotation
from schuler.arrays import FloatArray
from schuler.earth import WGS84
from schuler.exceptions import InputError
from schuler.mechanization.strapdown import NavState, mechanize
from schuler.recording.series import Increments
from schuler.reproduce.stefanisko.study.experiment import (
    ACCEL_NOISE,
    GYRO_NOISE,
    IMU_INTERVAL_S,
    SIGMA_POSITION,
    SIGMA_VELOCITY,
    Draw,
    FigureEight,
    Track,
    figure_eight_draw,
)
from schuler.simulation.imu import truth

Progress = Callable[[float], None]


@dataclass(frozen=True)
class SignSet:
    """Signs of one convention.

    Attributes
    ----------
    force : float
        Of ``[f x]`` in the velocity row of F.
    gyro : float
        Of ``C_eb`` in the attitude row.
    observation : float
        H is plus or minus identity; the measurement is GNSS minus INS always.
    position : float
        Sign of the corrections of position and velocity.
    attitude : float
        ``C <- (I + attitude E) C``.
    bias : float
        ``f + bias b_a``, ``omega + bias b_g``.
    """

    force: float
    gyro: float
    observation: float
    position: float
    attitude: float
    bias: float


#: A: F as printed and the rest to match; B: Groves (2013); C: the correction step as printed and the rest to match.
SIGN_SETS: MappingProxyType[str, SignSet] = MappingProxyType(
    {
        "A": SignSet(-1.0, 1.0, 1.0, 1.0, 1.0, 1.0),
        "B": SignSet(-1.0, 1.0, -1.0, -1.0, -1.0, -1.0),
        "C": SignSet(1.0, -1.0, 1.0, 1.0, -1.0, 1.0),
        "printed, biases added": SignSet(-1.0, 1.0, 1.0, 1.0, -1.0, 1.0),
        "printed, biases subtracted": SignSet(-1.0, 1.0, 1.0, 1.0, -1.0, -1.0),
    }
)
_BLOCK = 50  # samples of 6 ms in 0.3 s
_SUB = 25  # samples of a covariance step


@dataclass(frozen=True, eq=False)
class SignStudy:
    """Errors by sign set.

    Attributes
    ----------
    t : ndarray, shape (k,)
        Every 0.3 s. [s]
    errors : dict of str to ndarray, shape (runs, k, 9)
        Position, velocity, attitude: estimate minus truth, Earth-fixed axes. [m], [m/s], [rad]
    sigma : dict of str to ndarray, shape (runs, k, 3)
        Root of the trace of the claimed covariance of the three. [m], [m/s], [rad]
    """

    t: FloatArray
    errors: dict[str, FloatArray]
    sigma: dict[str, FloatArray]

    def rms(self, name: str, part: slice, t: float) -> float:
        """Root mean square over the runs of the norm of some of the nine at a time [s]."""
        e = self.errors[name][:, int(np.argmin(np.abs(self.t - t))), part]
        return float(np.sqrt(np.mean(np.sum(e**2, axis=-1))))

    def ratio(self, name: str, t: float) -> float:
        """True over claimed position error; 1 for an honest filter."""
        k = int(np.argmin(np.abs(self.t - t)))
        return self.rms(name, slice(0, 3), t) / float(np.sqrt(np.mean(self.sigma[name][:, k, 0] ** 2)))


def sign_study(
    case: FigureEight | None = None, runs: int = 4, seed: int = 1, names: tuple[str, ...] = tuple(SIGN_SETS),
    *, progress: Progress | None = None,
) -> SignStudy:  # fmt: skip
    """Run his filter with several sets of signs on the same draws.

    Parameters
    ----------
    case : FigureEight, optional
        Fixes every 0.3 s.
    runs, seed : int
        As in :func:`schuler.reproduce.stefanisko.study.campaign.figure_eight`: the same draws.
    names : tuple of str
        Keys of :data:`SIGN_SETS`.
    progress : callable, optional

    Returns
    -------
    SignStudy

    Raises
    ------
    InputError
        If a name is unknown or the fixes are not every 0.3 s.

    References
    ----------
    Stefanisko (2015), eqs. (3.3) to (3.21), with Phi to second order in F, P0 and Q as variances.
    """
    case = case or FigureEight()
    if wrong := [n for n in names if n not in SIGN_SETS]:
        raise InputError(f"names: expected some of {', '.join(SIGN_SETS)}, got {', '.join(wrong)}")
    if abs(case.update_s - _BLOCK * IMU_INTERVAL_S) > 1e-9:
        raise InputError(f"update_s: expected {_BLOCK * IMU_INTERVAL_S:g} s, got {case.update_s:g}")
    track = Track.of(case)
    by_name: dict[str, list[tuple[FloatArray, FloatArray]]] = {name: [] for name in names}
    t = np.empty(0)
    for k, child in enumerate(np.random.SeedSequence(seed).spawn(runs)):
        drawn = figure_eight_draw(track, np.random.default_rng(child))
        for name in names:
            t, errors, sigma = _filter(track, drawn, SIGN_SETS[name])
            by_name[name].append((errors, sigma))
        if progress is not None:
            progress((k + 1) / runs)
    return SignStudy(
        t,
        {name: np.array([e for e, _ in kept]) for name, kept in by_name.items()},
        {name: np.array([s for _, s in kept]) for name, kept in by_name.items()},
    )


def _filter(track: Track, drawn: Draw, signs: SignSet) -> tuple[FloatArray, FloatArray, FloatArray]:
    """One run: times, errors, claims."""
    case, log, h = track.case, drawn.log, IMU_INTERVAL_S
    nav, biases = drawn.nav, np.zeros(6)
    C0 = frames.C_en(track.start.llh)
    P = np.zeros((15, 15))
    for k, sigma in enumerate((SIGMA_POSITION, np.full(3, case.sigma_v), drawn.sigma_psi)):
        P[3 * k : 3 * k + 3, 3 * k : 3 * k + 3] = C0 @ np.diag(np.square(sigma)) @ C0.T
    P[9:12, 9:12], P[12:, 12:] = np.eye(3) * case.sigma_b_a**2, np.eye(3) * case.sigma_b_g**2
    R = np.zeros((6, 6))
    R[:3, :3] = C0 @ np.diag(case.r_factor * SIGMA_POSITION**2) @ C0.T
    R[3:, 3:] = C0 @ np.diag(case.r_factor * SIGMA_VELOCITY**2) @ C0.T
    H = signs.observation * np.eye(6, 15)
    fix_at = {round(time / h): k for k, time in enumerate(drawn.gnss.t)} if case.gnss else {}
    r_fix, v_fix = frames.ecef_from_llh(drawn.gnss.llh), _earth_fixed(drawn)
    states, sigmas = [], []
    for first in range(0, len(log) - _BLOCK + 1, _BLOCK):
        part = slice(first, first + _BLOCK)
        dv = log.dv_ib_b[part] + signs.bias * biases[:3] * h
        dtheta = log.dtheta_ib_b[part] + signs.bias * biases[3:] * h
        path = mechanize(Increments(log.t[part], log.dt[part], dtheta, dv), nav)
        P = _predicted(P, rotation.dcm_from_quat(path.q_eb), dv, h, signs, case.q_factor)
        r, v, q = path.r_eb_e[-1], path.v_eb_e[-1], path.q_eb[-1]
        fix = fix_at.get(first + _BLOCK)
        if fix is not None:
            z = np.concatenate((r_fix[fix] - r, v_fix[fix] - v))
            K = np.linalg.solve(H @ P @ H.T + R, H @ P).T
            x = K @ z
            left = np.eye(15) - K @ H
            P = left @ P @ left.T + K @ R @ K.T
            r, v = r + signs.position * x[:3], v + signs.position * x[3:6]
            q = rotation.quat_multiply(rotation.quat_from_rotvec(signs.attitude * x[6:9]), q)
            q, biases = q / np.linalg.norm(q), biases + x[9:]
        nav = NavState(float(log.t[first + _BLOCK - 1]), r, v, q)
        states.append(nav)
        sigmas.append(np.sqrt([np.trace(P[i : i + 3, i : i + 3]) for i in (0, 3, 6)]))
    t = np.array([state.t for state in states])
    true = truth(case.motion(), t)
    turned = rotation.quat_multiply(np.array([s.q_eb for s in states]), rotation.quat_conjugate(true.q_eb))
    errors = (
        np.array([s.r_eb_e for s in states]) - true.r_eb_e,
        np.array([s.v_eb_e for s in states]) - true.v_eb_e,
        rotation.rotvec_from_quat(turned),
    )
    return t, np.concatenate(errors, axis=1), np.array(sigmas)


def _earth_fixed(drawn: Draw) -> FloatArray:
    v_n = drawn.gnss.v_n
    if v_n is None:
        raise InputError("expected fixes with velocities")
    return np.asarray(np.einsum("nij,nj->ni", frames.C_en(drawn.gnss.llh), v_n))


def _predicted(P: FloatArray, C: FloatArray, dv: FloatArray, h: float, signs: SignSet, q_factor: float) -> FloatArray:
    """(3.8) to (3.10), (3.14), (3.17) over a block."""
    tau = _SUB * h
    earth = rotation.skew((0.0, 0.0, WGS84.omega_ie))
    for first in range(0, _BLOCK, _SUB):
        C_eb = C[first + _SUB // 2]
        force = C_eb @ dv[first : first + _SUB].sum(axis=0) / tau
        F = np.zeros((15, 15))
        F[:3, 3:6] = np.eye(3)
        F[3:6, 3:6], F[3:6, 6:9], F[3:6, 9:12] = -2.0 * earth, signs.force * rotation.skew(force), C_eb
        F[6:9, 6:9], F[6:9, 12:] = -earth, signs.gyro * C_eb
        Phi = np.eye(15) + F * tau + 0.5 * F @ F * tau**2
        P = Phi @ P @ Phi.T
        P[3:6, 3:6] += np.eye(3) * q_factor * ACCEL_NOISE**2 * tau
        P[6:9, 6:9] += np.eye(3) * q_factor * GYRO_NOISE**2 * tau
    return P
