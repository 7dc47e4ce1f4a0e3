"""Roll and pitch of a start: at rest, carried from a rest by the gyroscopes, or in motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from schuler import earth, frames, rotation, units
from schuler.arrays import FloatArray
from schuler.exceptions import InputError
from schuler.mechanization.alignment import Alignment, levelling
from schuler.mechanization.strapdown import NavState, mechanize
from schuler.navigation.config import AlignmentSection
from schuler.navigation.start.rests import StartRests
from schuler.recording.series import GnssSeries, ImuSeries
from schuler.sensors.spec import ImuSpec

_SHORT_S = 1.5  # shorter parts are not turned into the axes of one time [s]
_LONGEST_S = 4.0  # longest time between velocities that level in motion, where there are some closer [s]
_SPARSE_S = 15.0  # and where there are none [s]
_UPRIGHT = np.cos(30.0 * units.DEG)
CARRIED_S = 120.0  # longest time over which the gyroscopes carry an attitude [s]


def level_at_rest(
    rates: ImuSeries,
    rests: StartRests,
    bias: tuple[FloatArray, float],
    t: float,
    llh: FloatArray,
    section: AlignmentSection,
    spec: ImuSpec,
) -> Alignment | None:
    """Attitude of a rest, carried to the start by the gyroscopes; None without a rest, or if it is too long ago.

    Of several rests that one whose attitude is surest at the start, the last if they are alike.

    Parameters
    ----------
    rates : ImuSeries
    rests : StartRests
    bias : (ndarray of shape (3,), float)
        Gyro bias of the start and its 1-sigma. [rad/s]
    t : float
        Time of the start. [s]
    llh : ndarray, shape (3,)
        Place: latitude, longitude [rad], height [m].
    section, spec
        Floor of the tilt, noise and biases.

    Returns
    -------
    Alignment
        Its yaw is the turn since the rest, with an unknown heading. Tilt errors by the gyro bias over the time carried
        are correlated with it.
    """
    if not len(rests):
        return None
    ago = t - rests.stop
    spread = np.hypot(rests.sigma_force / units.G0, np.hypot(spec.gyro.random_walk * np.sqrt(ago), bias[1] * ago))
    best = len(rests) - 1 - int(np.argmin(spread[::-1]))
    if ago[best] > CARRIED_S:
        return None
    noise = float(np.hypot(rests.sigma_force[best], section.tilt_floor_deg * units.DEG * units.G0))
    end = float(rests.stop[best])
    level = levelling(rests.force[best], t=end, sigma_bias=spec.accel.turn_on_bias, sigma_noise=noise)
    part = rates.between(end, t)
    if len(part) < 2:
        return level
    path = replace(part, gyro=part.gyro - bias[0]).increments()
    turned = mechanize(path, NavState.from_geodetic(path.start, llh, np.zeros(3), level.rpy_nb))
    C_nb = frames.C_en(llh).T @ rotation.dcm_from_quat(turned.q_eb)
    span = float(path.t[-1] - path.start)
    return replace(
        level, t=t, rpy_nb=rotation.rpy_from_dcm(C_nb[-1]), psi_gyro=-C_nb.mean(axis=0) * span, sigma_b_g=bias[1],
        cov_noise_n=level.cov_noise_n + spec.gyro.random_walk**2 * span * np.eye(3),
    )  # fmt: skip


def level_in_motion(
    rates: ImuSeries,
    gnss: GnssSeries,
    k: int,
    heading: float,
    sigma: float,
    bias: tuple[FloatArray, float],
    section: AlignmentSection,
    spec: ImuSpec,
) -> Alignment:
    """Roll and pitch while moving: the specific force less the acceleration GNSS sees, and the heading given.

    Parameters
    ----------
    rates : ImuSeries
    gnss : GnssSeries
        With velocities.
    k : int
        Fix of the start.
    heading, sigma : float
        Heading and its 1-sigma; of the x axis, or where that is near the vertical, of the z axis or its opposite. [rad]
    bias : (ndarray of shape (3,), float)
        Gyro bias of the start and its 1-sigma. [rad/s]
    section, spec
        Floor of the tilt, noise and biases.

    Raises
    ------
    InputError
        If the velocities around the fix are more than 15 s apart.

    Notes
    -----
    The force of each sample is turned into the axes of the fix by the gyroscopes. Where velocities are far apart, what
    their bias leaves in the mean is the turn from the middle of both to the fix, as if levelled there and carried.
    """
    v_n, cov_v_n = gnss.need_velocity()
    t = float(gnss.t[k])
    sigma_v = float(np.sqrt(max(cov_v_n[k, 0, 0], cov_v_n[k, 1, 1])))
    # velocities further apart than the next one only if these are too poor for the floor of the tilt
    wanted = np.sqrt(2.0) * sigma_v / (max(2.0 * section.tilt_floor_deg * units.DEG, 1e-4) * units.G0)
    reach = 0.5 * min(wanted, _LONGEST_S)
    j = min(max(k + 1, int(np.searchsorted(gnss.t, t + reach, side="right")) - 1), len(gnss) - 1)
    i = min(max(j - 1, 0), k, int(np.searchsorted(gnss.t, t - reach)))
    if gnss.t[j] - gnss.t[i] > _LONGEST_S:
        i = max(j - 1, 0)
    if gnss.t[j] - gnss.t[i] > _LONGEST_S and i < k < j:
        # fixes are rare: the next or the one before, whichever is closer
        i, j = (i, k) if gnss.t[k] - gnss.t[i] < gnss.t[j] - gnss.t[k] else (k, j)
    span = float(gnss.t[j] - gnss.t[i])
    if not 0.0 < span <= _SPARSE_S:
        raise InputError(
            f"levelling in motion needs two GNSS velocities at most {_SPARSE_S:g} s apart where the course is taken, "
            f"and around {t:.1f} s there are none: begin elsewhere, or give the attitude (alignment.rpy_deg)"
        )
    a_n = (v_n[j] - v_n[i]) / span
    f_n = a_n - earth.gravity_ned(float(gnss.llh[k, 0]), float(gnss.llh[k, 2]))
    part = rates.between(float(gnss.t[i]), float(gnss.t[j]))
    far = span > _LONGEST_S  # over less, the gyro bias turns the mean by nothing that counts
    f_b = _mean_force(replace(part, gyro=part.gyro - bias[0]) if far else part, t, gnss.llh[k])
    s = rotation.dcm_from_rpy(np.array([0.0, 0.0, heading])).T @ f_n  # axes turned to the heading, still level
    # roll and pitch of axes whose x is not near the vertical, where the two cannot be told from the heading
    C_vb = _about_y(f_b)
    f_v = C_vb @ f_b * (np.linalg.norm(s) / np.linalg.norm(f_b))  # a bias along the force tilts nothing
    # f_v = R_x(roll)' R_y(pitch)' s: pitch from the forward, roll from the cross components
    pitch = np.arctan2(s[0], s[2]) - np.arctan2(f_v[0], -np.sqrt(max(s[0] ** 2 + s[2] ** 2 - f_v[0] ** 2, 0.0)))
    pitch = float(frames.wrap_angle(pitch))
    down = np.sin(pitch) * s[0] + np.cos(pitch) * s[2]
    roll = float(frames.wrap_angle(np.arctan2(f_v[1], f_v[2]) - np.arctan2(s[1], down)))
    noise = np.sqrt(2.0) * sigma_v / span
    turned = float(np.hypot(a_n[0], a_n[1])) * min(sigma, 1.0)  # acceleration in the wrong direction
    tilt = float(max(np.hypot(noise, turned) / units.G0, 2.0 * section.tilt_floor_deg * units.DEG))
    C_nb = rotation.dcm_from_rpy(np.array([roll, pitch, heading])) @ C_vb
    # as at rest: the force is that of the attitude but for its horizontal error
    psi_accel = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 0.0]]) / units.G0 @ C_nb
    carried = t - 0.5 * float(gnss.t[i] + gnss.t[j]) if far else 0.0
    psi_gyro = -carried * C_nb
    psi_gyro[2] = 0.0  # the heading is not carried
    return Alignment(
        t, rotation.rpy_from_dcm(C_nb), np.diag([tilt**2, tilt**2, sigma**2]), "levelled in motion",
        psi_accel=psi_accel, psi_gyro=psi_gyro, sigma_b_a=spec.accel.turn_on_bias, sigma_b_g=bias[1] if far else 0.0,
    )  # fmt: skip


def is_upright(f_b: FloatArray) -> bool:
    """Whether the x axis is within 30 degrees of a specific force, the vertical, so that it has no heading."""
    return bool(abs(f_b[0]) > _UPRIGHT * np.linalg.norm(f_b))


def _about_y(f_b: FloatArray) -> FloatArray:
    """Turn about y by a right angle that takes an upright x axis to down or up; nothing for others. Shape (3, 3)."""
    if not is_upright(f_b):
        return np.eye(3)
    side = -1.0 if f_b[0] < 0.0 else 1.0  # specific force of a body at rest points up
    return np.array([[0.0, 0.0, side], [0.0, 1.0, 0.0], [-side, 0.0, 0.0]])


def _mean_force(part: ImuSeries, t: float, llh: FloatArray) -> FloatArray:
    """Mean specific force over a part of the log in the body axes of time t. Shape (3,). [m/s^2]"""
    if len(part) < 3 or part.t[-1] - part.t[0] <= _SHORT_S:
        return np.asarray(part.accel.mean(axis=0))
    path = part.increments()
    q_eb = mechanize(path, NavState.from_geodetic(path.start, llh, np.zeros(3), np.zeros(3))).q_eb
    now = rotation.dcm_from_quat(q_eb[min(int(np.searchsorted(path.t, t)), len(path) - 1)])
    return np.asarray(rotation.rotate(q_eb, part.accel[1:]).mean(axis=0) @ now)


def tilt(alignment: Alignment) -> float:
    """1-sigma of the tilt about both horizontal axes together, without that by accelerometer biases. [rad]"""
    cov = alignment.cov_noise_n + alignment.sigma_b_g**2 * alignment.psi_gyro @ alignment.psi_gyro.T
    return float(np.sqrt(cov[0, 0] + cov[1, 1]))
