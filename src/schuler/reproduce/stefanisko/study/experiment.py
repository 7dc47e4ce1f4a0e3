"""Stefanisko's experiment, simulated: a low-cost IMU with GNSS at rest or in a figure-eight, without GNSS for a while.

The source (2015, sections 4.7 and 4.8) shows curves without numbers; the numbers to compare with are those of a
simulation of his filter with the signs put right, 40 runs. This is that simulation on the engine of this package:
Earth that turns, correct signs, biases as states.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from schuler import frames, rotation
from schuler.arrays import FloatArray
from schuler.exceptions import InputError
from schuler.filtering.engine import FilterOptions, run
from schuler.filtering.initial_state import InitialState
from schuler.filtering.measurements import gnss_measurements
from schuler.filtering.states import StateLayout, StateModel
from schuler.mechanization.strapdown import NavState
from schuler.navigation.result import NavigationResult
from schuler.recording.series import GnssSeries, Increments
from schuler.recording.trajectory import FullTrajectory, Trajectory
from schuler.simulation.imu import truth
from schuler.simulation.motion import LocalMotion, Motion, StaticMotion, euler_attitude, ideal_increments
from schuler.units import DEG, UG

#: ESIEE Paris: latitude, longitude [rad], height [m].
ESIEE = np.array([48.84 * DEG, 2.59 * DEG, 100.0])
IMU_INTERVAL_S = 0.006
GNSS_INTERVAL_S = 0.1
#: 1-sigma of ten minutes at rest, N E D. [m], [m/s]
SIGMA_POSITION = np.array([3.6852, 3.9626, 4.3475])
SIGMA_VELOCITY = np.array([0.0068, 0.0047, 0.0093])
#: Data sheet of the sensor. [rad/s/sqrt(Hz)], [m/s^2/sqrt(Hz)]
GYRO_NOISE, ACCEL_NOISE = 0.005 * DEG, 400.0 * UG


@dataclass(frozen=True)
class FigureEight:
    """One case of the experiment; the defaults follow section 4.6.

    Attributes
    ----------
    moving : bool
        False: at rest all the time.
    duration_s : float
    amplitude_m, period_s : float
        North ``a sin(w t)``, east ``a/2 sin(2 w t)``: up to 13.3 m/s.
    outage_s : tuple of (start, stop), optional
    update_s : float
        Fixes used: 0.3, the least common multiple of the two rates (coincidence), or 0.1, all of them, between IMU
        samples (asynchronous).
    gnss : bool
        False: INS alone from the same initial errors.
    sigma_tilt, sigma_heading : float
        Initial. [rad]
    sigma_b_a, sigma_b_g : float
        [m/s^2], [rad/s]
    sigma_v : float
        Initial. [m/s]
    walk_b_a, walk_b_g : float
        Random walks of the biases, in truth and filter. [m/s^2/sqrt(s)], [rad/s/sqrt(s)]
    p0_factor, q_factor, r_factor : float
        The filter's initial covariance, white IMU noise and GNSS covariance (variances) are so many times the true
        ones; 1 is honest.
    """

    moving: bool = True
    duration_s: float = 120.0
    amplitude_m: float = 60.0
    period_s: float = 40.0
    outage_s: tuple[float, float] | None = (50.0, 90.0)
    update_s: float = 0.3
    gnss: bool = True
    sigma_tilt: float = 0.5 * DEG
    sigma_heading: float = 2.0 * DEG
    sigma_b_a: float = 0.05
    sigma_b_g: float = 0.1 * DEG
    sigma_v: float = 0.05
    walk_b_a: float = 0.0
    walk_b_g: float = 0.0
    p0_factor: float = 1.0
    q_factor: float = 1.0
    r_factor: float = 1.0

    def __post_init__(self) -> None:
        for name in ("duration_s", "amplitude_m", "period_s", "update_s", "p0_factor", "q_factor", "r_factor"):
            if not getattr(self, name) > 0.0:
                raise InputError(f"FigureEight.{name}: expected a positive number, got {getattr(self, name)!r}")
        ratio = self.update_s / GNSS_INTERVAL_S
        if abs(ratio - round(ratio)) > 1e-6:
            raise InputError(f"update_s: expected a multiple of {GNSS_INTERVAL_S} s, got {self.update_s}")

    def motion(self) -> Motion:
        """True motion: level, nose along the path."""
        length = self.duration_s + 1.0
        if not self.moving:
            return StaticMotion(ESIEE, np.zeros(3), length)
        a, w = self.amplitude_m, 2.0 * np.pi / self.period_s

        def path(t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
            zero = np.zeros_like(t)
            return (
                np.stack((a * np.sin(w * t), 0.5 * a * np.sin(2.0 * w * t), zero), -1),
                np.stack((a * w * np.cos(w * t), a * w * np.cos(2.0 * w * t), zero), -1),
                np.stack((-a * w**2 * np.sin(w * t), -2.0 * a * w**2 * np.sin(2.0 * w * t), zero), -1),
            )

        def angles(t: FloatArray) -> tuple[FloatArray, FloatArray]:
            _, v, acc = path(t)
            zero = np.zeros_like(t)
            rate = (v[:, 0] * acc[:, 1] - v[:, 1] * acc[:, 0]) / (v[:, 0] ** 2 + v[:, 1] ** 2)
            heading = np.unwrap(np.arctan2(v[:, 1], v[:, 0]))
            return np.stack((zero, zero, heading), -1), np.stack((zero, zero, rate), -1)

        return LocalMotion(ESIEE, path, euler_attitude(angles), length)

    def layout(self) -> StateLayout:
        """Fifteen states with the models of the filter."""
        root = np.sqrt(self.p0_factor)
        return StateLayout(
            {
                "b_a": StateModel(root * self.sigma_b_a, self.walk_b_a),
                "b_g": StateModel(root * self.sigma_b_g, self.walk_b_g),
            }
        )


@dataclass(frozen=True)
class Track:
    """A case with everything that does not depend on chance."""

    case: FigureEight
    increments: Increments
    start: NavState
    fixes_t: FloatArray
    fixes: Trajectory
    reference: FullTrajectory = field(repr=False)

    @classmethod
    def of(cls, case: FigureEight) -> Track:
        """Ideal increments at 6 ms, true antenna at the fixes (no lever arm), truth every second."""
        motion = case.motion()
        n = round(case.duration_s / IMU_INTERVAL_S)
        t = IMU_INTERVAL_S * np.arange(n + 1.0)
        dtheta, dv = ideal_increments(motion, t)
        k = np.arange(1.0, round(case.duration_s / case.update_s) + 1)
        fixes_t = case.update_s * k
        if case.outage_s is not None:
            fixes_t = fixes_t[(fixes_t <= case.outage_s[0] + 1e-9) | (fixes_t > case.outage_s[1] + 1e-9)]
        first = truth(motion, np.zeros(1))
        return cls(
            case,
            Increments(t[1:], np.diff(t), dtheta, dv),
            NavState(0.0, first.r_eb_e[0], first.v_eb_e[0], first.q_eb[0]),
            fixes_t,
            truth(motion, fixes_t),
            truth(motion, np.arange(0.0, case.duration_s + 0.5)),
        )


@dataclass(frozen=True)
class Draw:
    """Data of one run of the filter, and the true biases.

    Attributes
    ----------
    log : Increments
        With biases and noise.
    nav : NavState
        Start with its errors.
    sigma_psi : ndarray, shape (3,)
        1-sigma of the initial attitude, north, east, down. [rad]
    gnss : GnssSeries
    bias : ndarray, shape (n + 1, 6)
        Accelerometers, gyroscopes, at the ends of the increments. [m/s^2], [rad/s]
    """

    log: Increments
    nav: NavState
    sigma_psi: FloatArray
    gnss: GnssSeries
    bias: FloatArray


def figure_eight_draw(track: Track, rng: np.random.Generator) -> Draw:
    """Errors of one run.

    Parameters
    ----------
    track : Track
    rng : numpy.random.Generator
        Biases, IMU noise, GNSS noise and initial errors draw from children of their own: cases of one seed share them.
    """
    case, inc = track.case, track.increments
    bias_rng, imu_rng, gnss_rng, start_rng = rng.spawn(4)
    n, h = len(inc), IMU_INTERVAL_S
    sigma = np.repeat((case.sigma_b_a, case.sigma_b_g), 3)
    walk = np.repeat((case.walk_b_a, case.walk_b_g), 3)
    bias = sigma * bias_rng.standard_normal(6) + np.concatenate(
        (np.zeros((1, 6)), np.cumsum(walk * np.sqrt(h) * bias_rng.standard_normal((n, 6)), axis=0))
    )
    mean = 0.5 * (bias[1:] + bias[:-1])
    white = np.sqrt(h) * imu_rng.standard_normal((n, 6))
    log = Increments(
        inc.t, inc.dt, inc.dtheta_ib_b + mean[:, 3:] * h + GYRO_NOISE * white[:, :3],
        inc.dv_ib_b + mean[:, :3] * h + ACCEL_NOISE * white[:, 3:],
    )  # fmt: skip
    z = start_rng.standard_normal(9)
    sigma_psi = np.array([case.sigma_tilt, case.sigma_tilt, case.sigma_heading])
    s, C = track.start, frames.C_en(track.start.llh)
    tilted = rotation.quat_multiply(rotation.quat_from_rotvec(C @ (sigma_psi * z[:3])), s.q_eb)
    nav = NavState(0.0, s.r_eb_e + C @ (SIGMA_POSITION * z[6:]), s.v_eb_e + C @ (case.sigma_v * z[3:6]), tilted)
    k = len(track.fixes_t)
    # the noise of a fix depends on its number among all that there could be, so both schedules see the same fixes
    every = gnss_rng.standard_normal((round(case.duration_s / GNSS_INTERVAL_S) + 2, 6))
    noise = every[np.round(track.fixes_t / GNSS_INTERVAL_S).astype(int)]
    fixes, C_f = track.fixes, frames.C_en(track.fixes.llh)
    r = fixes.r_eb_e + np.einsum("nij,nj->ni", C_f, SIGMA_POSITION * noise[:, :3])
    gnss = GnssSeries(
        track.fixes_t, frames.llh_from_ecef(r), np.tile(np.diag(case.r_factor * SIGMA_POSITION**2), (k, 1, 1)),
        fixes.v_eb_n + SIGMA_VELOCITY * noise[:, 3:], np.tile(np.diag(case.r_factor * SIGMA_VELOCITY**2), (k, 1, 1)),
    )  # fmt: skip
    return Draw(log, nav, sigma_psi, gnss, bias)


def figure_eight_run(track: Track, rng: np.random.Generator) -> tuple[NavigationResult, FloatArray]:
    """One draw of all errors, filtered.

    Parameters
    ----------
    track : Track
    rng : numpy.random.Generator
        See :func:`figure_eight_draw`.

    Returns
    -------
    result : NavigationResult
        Records every second.
    parameters : ndarray, shape (k, 6)
        True biases at the records. [m/s^2], [rad/s]
    """
    case, drawn = track.case, figure_eight_draw(track, rng)
    layout = case.layout()
    root = np.sqrt(case.p0_factor)
    initial = InitialState.from_sigmas(
        drawn.nav, layout, attitude=root * drawn.sigma_psi, velocity=np.full(3, root * case.sigma_v),
        position=root * SIGMA_POSITION,
    )  # fmt: skip
    schedule = gnss_measurements(drawn.gnss, np.zeros(3), gate=None)
    if not case.gnss:
        schedule = schedule.where(np.zeros(len(schedule), dtype=bool))
    q = case.q_factor
    forward = run(
        drawn.log, schedule, initial, layout, np.full(3, q * GYRO_NOISE**2), np.full(3, q * ACCEL_NOISE**2),
        FilterOptions(covariance_rate_hz=20.0, output_rate_hz=1.0),
    )  # fmt: skip
    result = NavigationResult.from_run(
        forward, schedule.t, schedule.kind, layout, outages=() if case.outage_s is None else (case.outage_s,)
    )
    at = np.clip(np.round(result.t / IMU_INTERVAL_S).astype(int), 0, len(drawn.log))
    return result, drawn.bias[at]
