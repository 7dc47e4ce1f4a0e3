"""Gyro biases of a start from the mean rate at rest."""

from __future__ import annotations

import numpy as np

from schuler import earth, frames, rotation, units
from schuler.arrays import FloatArray
from schuler.filtering.initial_state import InitialState
from schuler.filtering.states import StateLayout
from schuler.mechanization.alignment import levelling
from schuler.mechanization.strapdown import NavState
from schuler.navigation.start.calibration import rest_columns
from schuler.navigation.start.rests import StartRests
from schuler.recording.series import ImuSeries
from schuler.sensors.spec import ImuSpec


def rest_rate(rests: StartRests, lat: float, spec: ImuSpec) -> tuple[FloatArray, float] | None:
    """Mean rate at rest less Earth's, shape (3,), and its 1-sigma as a gyro bias at the start; None without rest.

    Earth rate is taken off as far as it is known without a heading: its vertical part. Its horizontal part and the
    wander of the bias in the run are in the 1-sigma. [rad/s]
    """
    if not len(rests):
        return None
    mean, sigma = rests.mean_rate()
    omega_ie_n = earth.earth_rate_ned(lat)
    down = levelling(rests.force[-1], sigma_bias=units.G0).C_nb[2]
    wander = spec.gyro.in_run_bias if spec.gyro.in_run_time else 0.0
    return mean - down * omega_ie_n[2], float(np.linalg.norm([sigma, omega_ie_n[0], wander]))


def unmodelled_rate(rates: ImuSeries, bias: FloatArray, spec: ImuSpec, layout: StateLayout) -> float:
    """1-sigma of rates in motion that a filter takes for a change of bias, because no state is theirs. [rad/s]

    Scale factor and misalignment times the RMS rate of the log over ten seconds, g-sensitivity times that of the force
    off its mean.
    """
    W = max(1, round(10.0 * rates.rate_hz))
    n = len(rates) // W
    if not n:
        return 0.0
    turn, force = (x[: n * W].reshape(n, W, 3).mean(axis=1) for x in (rates.gyro - bias, rates.accel))
    turning = float(np.sqrt(np.mean(turn**2)))
    shaking = float(np.sqrt(np.mean((force - force.mean(axis=0)) ** 2)))
    gyro = spec.gyro
    return float(np.linalg.norm([
        0.0 if "S_g" in layout else gyro.scale_factor * turning,
        0.0 if "M_g" in layout else gyro.misalignment * turning * np.sqrt(2.0),
        0.0 if "G_g" in layout else gyro.g_sensitivity * shaking * np.sqrt(3.0),
    ]))  # fmt: skip


def weighted_bias(rate: FloatArray, sigma: float, prior: float) -> tuple[FloatArray, float]:
    """Gyro bias from the mean rate at rest and from the budget, each by its weight, and its 1-sigma. [rad/s]

    Parameters
    ----------
    rate : ndarray, shape (3,)
    sigma : float
        1-sigma of the rate as a bias.
    prior : float
        1-sigma of a bias by the budget. A rate that contradicts it, by three 1-sigma of both together, counts alone.
    """
    if rate @ rate > 9.0 * (prior**2 + sigma**2):
        return rate, sigma
    gain = prior**2 / (prior**2 + sigma**2)
    return gain * rate, float(np.sqrt(gain)) * sigma


def bias_of_rests(
    rests: StartRests, lat: float, rates: ImuSeries, spec: ImuSpec, layout: StateLayout
) -> tuple[FloatArray, float] | None:
    """Gyro bias of a start, shape (3,), and its 1-sigma: of rests and budget, each by its weight; None without rest.

    What no state of the filter is for, in motion, is in the 1-sigma. [rad/s]
    """
    rest = rest_rate(rests, lat, spec)
    if rest is None:
        return None
    sigma = float(np.hypot(rest[1], unmodelled_rate(rates, rest[0], spec, layout)))
    return weighted_bias(rest[0], sigma, layout.models["b_g"].sigma)


def with_bias(initial: InitialState, layout: StateLayout, bias: FloatArray, sigma: float) -> InitialState:
    """Initial state with gyro biases and their 1-sigma, uncorrelated with anything yet."""
    estimates, P = initial.parameters.copy(), initial.P.copy()
    part = layout["b_g"]
    estimates[part.start - 9 : part.stop - 9] = bias
    P[part, part] = sigma**2 * np.eye(3)
    return InitialState(initial.nav, P, estimates)


def updated_with_rest_rate(
    initial: InitialState, layout: StateLayout, C_nb: FloatArray, rate: FloatArray, sigma: float
) -> InitialState:
    """Kalman update of a calibrated initial state with the compensated rate at rest, which should be zero.

    It acts on biases, g-sensitivity times gravity, and all that correlates with them.
    """
    H = np.hstack((np.zeros((3, 9)), rest_columns(initial, C_nb, layout)[0]))
    P, R = initial.P, sigma**2 * np.eye(3)
    K = np.linalg.solve(H @ P @ H.T + R, H @ P).T
    dx, I_KH = K @ rate, np.eye(len(P)) - K @ H
    nav, C = initial.nav, frames.C_en(initial.nav.llh)
    nav = NavState(
        nav.t, nav.r_eb_e - C @ dx[6:9], nav.v_eb_e - C @ dx[3:6],
        rotation.quat_multiply(rotation.quat_from_rotvec(-C @ dx[:3]), nav.q_eb),
    )  # fmt: skip
    return InitialState(nav, I_KH @ P @ I_KH.T + K @ R @ K.T, initial.parameters - dx[9:])


def rest_sentences(
    initial: InitialState, layout: StateLayout, rests: StartRests, rate: FloatArray, sigma: float, calibrated: bool
) -> list[str]:
    """Sentences on gyro biases that were taken from rests."""
    part = layout["b_g"]
    b, s = initial.parameters[part.start - 9 : part.stop - 9] / units.DEG, np.sqrt(np.diag(initial.P)[part]).max()
    values = ", ".join(f"{x:+.4f}" if calibrated else f"{x:+.3f}" for x in b) + f" deg/s, 1-sigma {s / units.DEG:.4f}"
    seen = int(rests.confirmed.sum())
    where = f"{len(rests)} rest{'s' if len(rests) > 1 else ''}, {rests.duration:.1f} s" + (
        "" if seen == len(rests) else f"; {len(rests) - seen} shown by the IMU only"
    )
    if calibrated:
        first = (
            f"the mean rate at rest ({where}) is {np.abs(rate).max() / units.DEG:.4f} deg/s off what was known before "
            f"(1-sigma of the mean {sigma / units.DEG:.4f}); gyro biases start from both: {values}"
        )
    else:
        first = f"gyro biases start from the mean at rest ({where}): {values}"
    if not rests.outside:
        return [first]
    return [
        first,
        f"while GNSS stands still the gyroscopes read {rests.outside / units.DEG:.2f} deg/s, more than the turn-on "
        "bias of the IMU's budget has room for: taken as the bias all the same; correct the budget (imu.gyro)",
    ]
