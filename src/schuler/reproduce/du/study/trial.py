"""One free-inertial trial of an emulated IMU: rest, turn, calibrate, then navigate; run many times with other noise."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Literal, NamedTuple

import numpy as np

from schuler import rotation
from schuler.arrays import FloatArray, IntArray
from schuler.exceptions import InputError
from schuler.mechanization.strapdown import NavState, mechanize
from schuler.montecarlo import traits
from schuler.recording.series import Increments
from schuler.recording.trajectory import Trajectory
from schuler.reproduce.du.study.drives import DRIVE_S, drive
from schuler.reproduce.du.study.imus import Emulation
from schuler.reproduce.du.study.metrics import rms_values
from schuler.rotary.calibration import calibrate_rotation, estimate
from schuler.rotary.calibration_result import RotationCalibration, Stretch
from schuler.rotary.du_axes import du_axis
from schuler.rotary.mechanization import body_trajectory
from schuler.rotary.rotating_imu import RotatingMotion, ideal_rotating_imu, vehicle_truth
from schuler.rotary.schedule import Schedule
from schuler.rotary.schemes import continuous, fixed
from schuler.sensors.noise import Flicker
from schuler.simulation.motion import Motion, StaticMotion

_NO_NOISE = np.random.default_rng(0)
_STEP = 0.25  # of the errors that are looked at: a sixteenth of the fastest revolution of a sweep, nearly [s]


@dataclass(frozen=True, kw_only=True)
class Trial:
    """Procedure of one trial with an IMU.

    Attributes
    ----------
    imu : Emulation
    rate : float
        Rate of rotation about Du's Z (up), positive counter-clockwise seen from above; zero is the conventional IMU.
        [rad/s]
    vehicle : {"static", "drive"}
    rest_s : float
        At rest, not turning: mean of the gyroscopes. [s]
    turning_s : float
        Turning at rest, for the responses; the next whole number of revolutions is taken. [s]
    start_s : float
        Navigation begins, the same for every rate so that runs share their noise. [s]
    duration_s : float
        Length of the navigation. [s]
    lat : float
        [rad]
    initial_attitude : float
        1-sigma of the error of the initial attitude about each axis, constant. [rad]
    """

    imu: Emulation
    rate: float = 0.0
    vehicle: Literal["static", "drive"] = "static"
    rest_s: float = 60.0
    turning_s: float = 60.0
    start_s: float = 132.0
    duration_s: float = 300.0
    lat: float = 0.25 * np.pi
    initial_attitude: float = 0.0

    def __post_init__(self) -> None:
        needed = self.rest_s + (whole_turns(self.rate, self.turning_s) if self.rate else 0.0)
        if needed > self.start_s + 1e-9:
            raise InputError(
                f"{needed:.1f} s are needed for rest and whole revolutions, but navigation begins at {self.start_s} s; "
                "begin later (start_s) or turn for a shorter time (turning_s)"
            )
        if self.vehicle not in ("static", "drive"):
            raise InputError(f"vehicle: expected 'static' or 'drive', got {self.vehicle!r}")
        if self.vehicle == "drive" and self.duration_s > DRIVE_S:
            raise InputError(f"duration_s: the drive lasts {DRIVE_S} s, got {self.duration_s}")

    @property
    def strategies(self) -> tuple[str, ...]:
        """Names of what a run gives."""
        return ("I", "II") if self.rate else ("conventional",)


class _Ideal(NamedTuple):
    """All of a trial that runs share."""

    schedule: Schedule
    log: Increments  # with all errors but noise
    C_bs: FloatArray  # in the middle of each interval
    first: int  # interval with which navigation begins
    start: NavState  # of the IMU, its own axes
    every: IntArray  # intervals of navigation at whose ends errors are looked at
    vehicle: Trajectory  # there
    stretches: tuple[Stretch, ...]
    edges: IntArray  # shape (stretches, 2): first interval and that behind the last


@traits(threads=True)
def trial_run(trial: Trial, seed: Any) -> dict[str, FloatArray]:
    """One run: root mean squares over the navigation by strategy.

    Parameters
    ----------
    trial : Trial
    seed : int or numpy.random.SeedSequence

    Returns
    -------
    dict of str to ndarray, shape (7,)
        ``conventional``, or ``I`` and ``II`` of the same recording, in the order of
        :data:`~schuler.reproduce.du.study.metrics.QUANTITIES`.
    """
    shared = ideal(trial)
    return {
        name: rms_values(solved, shared.vehicle) for name, solved in solutions(trial, seed).items()
    }  # fmt: skip


def solutions(trial: Trial, seed: Any) -> dict[str, Trajectory]:
    """Trajectories of the vehicle by strategy, every quarter of a second.

    Notes
    -----
    The Earth's rate is taken out of all means at rest; the thesis leaves it in.

    White noise is drawn in the axes of the vehicle and turned into those of the IMU: it knows no direction, so nothing
    changes for one run, but runs with the same seed have the same noise in space at every rate of rotation, and their
    differences show what rotation does with much fewer runs. 1/f noise belongs to the sensors and turns with them.
    """
    shared = ideal(trial)
    rng = np.random.default_rng(seed)
    wrong = trial.initial_attitude * rng.standard_normal(3)
    log = shared.log
    dtheta, dv = _noisy(shared, trial.imu, rng)
    calibration = _calibration(shared, trial, dtheta)
    k = slice(shared.first, None)
    measured = Increments(log.t[k], log.dt[k], dtheta[k], dv[k])
    start = _turned(shared.start, wrong)
    by_strategy: dict[str, Trajectory] = {}
    for name in trial.strategies:
        if isinstance(calibration, RotationCalibration):
            clean = calibration.compensated(measured, "I" if name == "I" else "II")
        else:
            clean = Increments(measured.t, measured.dt, dtheta[k] - calibration * measured.dt[:, None], dv[k])
        own = mechanize(clean, start)
        at = shared.every
        thinned = own.samples(at)
        by_strategy[name] = body_trajectory(thinned, shared.schedule)
    return by_strategy


@traits(threads=True)
def calibration_run(trial: Trial, seed: Any) -> dict[str, FloatArray]:
    """The calibration of one run of a rotating IMU, estimate minus truth.

    Returns
    -------
    dict of str to ndarray, shape (3,)
        ``bias`` [rad/s], ``response`` [-], and ``at_rate``: what is left of both at the rate of rotation [rad/s].
    """
    if not trial.rate:
        raise InputError("rate: a calibration by rotation needs one other than zero")
    shared = ideal(trial)
    dtheta, _ = _noisy(shared, trial.imu, np.random.default_rng(seed))
    calibration = _calibration(shared, trial, dtheta)
    assert isinstance(calibration, RotationCalibration)
    bias = calibration.bias - np.array(trial.imu.gyro_bias)
    response = calibration.M[:, 2] - np.array(trial.imu.response)
    omega_z = trial.rate * du_axis("Z")[2]
    return {"bias": bias, "response": response, "at_rate": bias + response * omega_z}


@lru_cache(maxsize=16)
def ideal(trial: Trial) -> _Ideal:
    """Ideal recording of a trial, made once for all its runs."""
    total, rate_hz = trial.start_s + trial.duration_s, trial.imu.rate_hz
    llh = np.array([trial.lat, 0.0, 0.0])
    schedule = continuous(du_axis("Z"), trial.rate, start=trial.rest_s) if trial.rate else fixed()
    vehicle: Motion = StaticMotion(llh, np.zeros(3), total)
    if trial.vehicle == "drive":
        vehicle = drive(llh, rest_s=trial.start_s)
    motion = RotatingMotion(vehicle, schedule)
    # the drive's manoeuvres end with it
    made = ideal_rotating_imu(motion, rate_hz)
    n = round(total * rate_hz)
    dt = 1.0 / rate_hz
    gyro, accel, _ = trial.imu.fixed_errors().apply_increments(made.gyro[:n], made.accel[:n], dt, _NO_NOISE)
    log = Increments(made.t[1 : n + 1], np.full(n, dt), gyro, accel)
    first = round(trial.start_s * rate_hz)
    true = made.truth
    start = NavState(float(true.t[first]), true.r_eb_e[first], true.v_eb_e[first], true.q_eb[first])
    stride = max(round(_STEP * rate_hz), 1)
    every = np.arange(stride - 1, n - first, stride)
    at_rest = vehicle.state(np.zeros(1))
    body = NavState(0.0, at_rest.r_eb_e[0], at_rest.v_eb_e[0], rotation.quat_from_dcm(at_rest.C_eb[0]))
    clean = Increments(log.t, log.dt, made.gyro[:n], made.accel[:n])
    stretches = _stretches(trial, clean, schedule, body)
    edges = np.array([[round(s.start * rate_hz), round(s.stop * rate_hz)] for s in stretches])
    C_bs = schedule.C_bs(log.t - 0.5 * dt)
    return _Ideal(
        schedule, log, C_bs, first, start, every, vehicle_truth(motion, log.t[first:][every]), stretches, edges
    )


def _noisy(shared: _Ideal, imu: Emulation, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Increments of one run: the shared ones with noise of its own."""
    increments, (n, dt) = [], (len(shared.log), 1.0 / imu.rate_hz)
    children = rng.spawn(3)
    for fixed_part, walk, child in (
        (shared.log.dtheta_ib_b, imu.gyro_random_walk, children[0]),
        (shared.log.dv_ib_b, imu.accel_random_walk, children[1]),
    ):
        noise = child.standard_normal((n, 3))
        turned = np.matmul(noise[:, None, :], shared.C_bs)[:, 0, :]
        increments.append(fixed_part + walk * np.sqrt(dt) * turned)
    if imu.gyro_instability:
        increments[0] += Flicker(imu.gyro_instability).sample((n, 3), dt, children[2]) * dt
    return increments[0], increments[1]


def _stretches(trial: Trial, log: Increments, schedule: Schedule, body: NavState) -> tuple[Stretch, ...]:
    walk = np.full(3, max(trial.imu.gyro_random_walk, 1e-12))
    if not trial.rate:
        expected = log.between(0.0, trial.rest_s)
        mean = expected.dtheta_ib_b.sum(axis=0) / trial.rest_s
        return (Stretch(0.0, trial.rest_s, mean, mean, np.zeros(3)),)
    spans = [(0.0, trial.rest_s), (trial.rest_s, trial.rest_s + whole_turns(trial.rate, trial.turning_s))]
    return calibrate_rotation(log, schedule, body, spans=spans, random_walk=walk).stretches


def _calibration(shared: _Ideal, trial: Trial, dtheta: FloatArray) -> RotationCalibration | FloatArray:
    """Calibration of one run; of a conventional IMU the bias only, shape (3,)."""
    stretches = [
        s._replace(reading=dtheta[a:b].sum(axis=0) / s.duration)
        for s, (a, b) in zip(shared.stretches, shared.edges, strict=True)
    ]
    if not trial.rate:
        return np.asarray(stretches[0].reading - stretches[0].expected)
    return estimate(stretches, np.full(3, max(trial.imu.gyro_random_walk, 1e-12)))


def _turned(start: NavState, wrong: FloatArray) -> NavState:
    """A start with an error of attitude about Earth-fixed axes; sizes are the same about all axes."""
    if not wrong.any():
        return start
    q = rotation.quat_multiply(rotation.quat_from_rotvec(wrong), start.q_eb)
    return NavState(start.t, start.r_eb_e, start.v_eb_e, q)


def whole_turns(rate: float, at_least: float) -> float:
    """Shortest time of whole revolutions at ``rate`` [rad/s] that is at least so long. [s]"""
    if not (np.isfinite(rate) and rate != 0.0 and at_least > 0.0):
        raise InputError(f"expected a rate other than zero and a positive time, got {rate!r} rad/s, {at_least!r} s")
    turn = 2.0 * np.pi / abs(rate)
    return float(np.ceil(at_least / turn - 1e-9)) * turn
