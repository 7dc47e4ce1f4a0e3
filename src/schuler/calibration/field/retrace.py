"""A log as the turns and rests it consists of: rough attitudes, enough to tell what it says of the parameters."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from schuler import rotation
from schuler.arrays import FloatArray
from schuler.calibration.field.blocks import Blocks
from schuler.calibration.field.foresight import LOST_S, Standing, foresee
from schuler.calibration.field.steps import Rest, Step, Turn
from schuler.filtering.error_model import sensor_matrices
from schuler.recording.series import ImuSeries
from schuler.standstill.stationarity import StaticIntervals

_STEP_S = 0.1  # of turns


def standing_after(
    before: Standing, imu: ImuSeries, rests: StaticIntervals, blocks: Blocks, values: FloatArray, heading: float = 0.0
) -> Standing:
    """What is known after a log.

    Parameters
    ----------
    before : Standing
        Its noise is that of the log.
    imu : ImuSeries
        Raw readings, SI.
    rests : StaticIntervals
        At least one.
    blocks : Blocks
        Of the rests.
    values : ndarray, shape (p,)
        What is believed of the parameters; biases of the gyroscopes are taken from the rests.
    heading : float
        Of the first rest. [rad]

    Returns
    -------
    Standing
        Attitude and covariance in the last rest.

    Notes
    -----
    Inclinations are those of the accelerometers in each rest, turns between them those of the gyroscopes, made to end
    at the next inclination. Both are wrong by what is to be calibrated, 50 mrad of a bias or 1 % of a turn, and so are
    the columns of H: a share of 10 % may be one of 9.5 %.
    """
    _, b_a, M_g, M_a, G_g = sensor_matrices(before.layout, values)
    rates = imu.rates()
    f = np.linalg.solve(np.eye(3) + M_a, (rates.accel - b_a).T).T
    numbers = np.arange(len(rests))
    down = np.array([-f[a:b].mean(axis=0) for a, b in rests.index])
    down /= np.linalg.norm(down, axis=1, keepdims=True)
    raw = np.array([blocks.omega[blocks.rest == k].mean(axis=0) for k in numbers])
    bias = np.median(raw + np.linalg.norm(f[0]) * down @ G_g.T, axis=0)
    omega = np.linalg.solve(np.eye(3) + M_g, (rates.gyro - bias - f @ G_g.T).T).T
    angle = np.cumsum(omega * np.diff(rates.t, prepend=rates.t[0])[:, None], axis=0)
    roll, pitch = np.arctan2(down[0, 1], down[0, 2]), np.arctan2(-down[0, 0], np.hypot(down[0, 1], down[0, 2]))
    C = start = rotation.dcm_from_rpy((roll, pitch, heading))
    steps: list[Step] = []
    for k in numbers:
        b = int(rests.index[k, 1])
        # readings of the rest are used to its ends; what foresee leaves out at them is taken from the turns
        steps.append(Rest(float(rests.stop[k] - rests.start[k]) + LOST_S))
        if k + 1 == len(rests):
            break
        c = int(rests.index[k + 1, 0])
        turn_s = max(float(rests.start[k + 1] - rests.stop[k]) - LOST_S, 0.5 * _STEP_S)
        m = max(1, round(turn_s / _STEP_S))
        parts = np.diff(angle[np.linspace(b - 1, c, m + 1).round().astype(np.int64)], axis=0)
        parts, C = _ending_at(C, parts, down[k + 1])
        steps += [_turn(part, turn_s / m) for part in parts]
    return foresee(replace(before, C_nb=start), steps).standing


def _ending_at(C: FloatArray, parts: FloatArray, down: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Parts of a turn from an attitude, bent a little so that the vertical is where it is in the end; the end."""
    after = np.empty((len(parts), 3, 3))
    for k, Q in enumerate(rotation.dcm_from_rotvec(parts)):
        after[k] = after[k - 1] @ Q if k else Q
    turned = after[-1]
    axis = np.cross(down, (C @ turned)[2])
    size = np.linalg.norm(axis)
    if size < 1e-12:
        return parts, C @ turned
    bend = np.arctan2(size, down @ (C @ turned)[2]) * axis / size
    return parts + (turned @ bend) @ after / len(parts), C @ turned @ rotation.dcm_from_rotvec(bend)


def _turn(part: FloatArray, duration_s: float) -> Turn:
    angle = float(np.linalg.norm(part))
    return Turn(tuple(part.tolist()), angle, duration_s) if angle > 0.0 else Turn("x", 0.0, duration_s)
