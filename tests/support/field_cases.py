"""Simulated routines with known errors, shared by the tests of field calibration."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from scipy.stats import chi2

from schuler.calibration.field.calibration import FieldCalibration, calibrate_field, field_layout, parameter_names
from schuler.calibration.field.options import FieldOptions
from schuler.calibration.result.parameters import vector
from schuler.filtering.states import StateLayout
from schuler.recording.series import ImuSeries
from schuler.sensors import catalogue
from schuler.sensors.errors import ImuErrors
from schuler.sensors.noise import NoiseModel
from schuler.sensors.spec import ImuSpec
from schuler.simulation.imu import ideal_imu, simulate_imu
from schuler.simulation.motion import Motion
from schuler.simulation.routine import RoutineMotion, six_face_routine, thesis_routine
from schuler.simulation.steps import Routine
from schuler.standstill.rests import given_rests
from schuler.standstill.stationarity import StaticIntervals
from schuler.units import DEG

#: Ankara, where the thesis was written.
LLH = np.array([39.92 * DEG, 33.2 * DEG, 1000.0])
AUTOMOTIVE, TACTICAL = catalogue.spec("yaman-automotive"), catalogue.spec("yaman-tactical")


@dataclass(frozen=True)
class Scene:
    """A routine that was carried out without errors, and when it rests."""

    routine: Routine
    motion: Motion
    ideal: object
    spans: np.ndarray

    @classmethod
    def of(cls, routine: Routine, rate_hz: float = 100.0, lever_m=(0.0, 0.0, 0.0)) -> Scene:
        motion = RoutineMotion(routine, LLH, lever_m)
        return cls(routine, motion, ideal_imu(motion, rate_hz), routine.rests)

    def rests(self, imu: ImuSeries, trim: float = 0.1) -> StaticIntervals:
        """The true rests, less a little at both ends."""
        return given_rests(imu, [(a + trim, b - trim) for a, b in self.spans])


@cache
def thesis(repeats: int = 2, rate_hz: float = 100.0, lever_m=(0.0, 0.0, 0.0)) -> Scene:
    """The routine of the thesis."""
    return Scene.of(thesis_routine(repeats=repeats), rate_hz, lever_m)


@cache
def faces(rate_hz: float = 50.0) -> Scene:
    return Scene.of(six_face_routine(), rate_hz)


def signed(spec: ImuSpec, sign: float, share: float = 1.0) -> ImuErrors:
    """Every error of one sigma and one sign (alternating would hide errors of sign), in the upper gauge."""
    a, g = spec.accel, spec.gyro
    ones = np.ones((3, 3))
    return replace(
        ImuErrors.draw(spec, np.random.default_rng(0), gauge="upper"),
        b_a=share * sign * a.turn_on_bias * np.array([1.0, 0.8, 0.9]),
        M_a=share * sign * (a.scale_factor * np.eye(3) + a.misalignment * np.triu(ones, 1)),
        b_g=share * sign * g.turn_on_bias * np.array([0.9, 1.0, 0.8]),
        M_g=share * sign * (g.scale_factor * np.eye(3) + g.misalignment * (ones - np.eye(3))),
        G_g=share * sign * g.g_sensitivity * ones,
    )


def only(errors: ImuErrors, blocks: tuple[str, ...]) -> ImuErrors:
    """The errors of some blocks of the 39 states."""
    eye, upper = np.eye(3), np.triu(np.ones((3, 3)), 1)
    return replace(
        errors,
        b_a=errors.b_a * ("b_a" in blocks),
        b_g=errors.b_g * ("b_g" in blocks),
        M_a=errors.M_a * (eye * ("S_a" in blocks) + upper * ("M_a" in blocks)),
        M_g=errors.M_g * (eye * ("S_g" in blocks) + (1.0 - eye) * ("M_g" in blocks)),
        G_g=errors.G_g * ("G_g" in blocks),
    )


def quiet(spec: ImuSpec, share: float) -> ImuSpec:
    """The same uncertainties with a part of the noise."""
    return replace(
        spec,
        gyro=replace(spec.gyro, random_walk=share * spec.gyro.random_walk),
        accel=replace(spec.accel, random_walk=share * spec.accel.random_walk),
    )


def silent(errors: ImuErrors) -> ImuErrors:
    """Without noise and without steps of a converter, whose errors are the same all through a rest."""
    quiet_noise = {"gyro_noise": NoiseModel(), "accel_noise": NoiseModel()}
    return replace(errors, **quiet_noise, gyro_resolution=None, accel_resolution=None)


def names_of(spec: ImuSpec, options: FieldOptions | None = None) -> tuple[str, ...]:
    return parameter_names(field_layout(spec, options or FieldOptions()))


def log_of(scene: Scene, errors: ImuErrors, rng: np.random.Generator | None = None) -> ImuSeries:
    """What such a unit writes; without noise if there is no generator."""
    errors = errors if rng is not None else silent(errors)
    return simulate_imu(scene.ideal, errors, np.random.default_rng(0) if rng is None else rng).imu


def calibrated(
    scene: Scene, imu: ImuSeries, spec: ImuSpec, options: FieldOptions | None = None, **more
) -> FieldCalibration:
    more = {"heading": (0.0, 1.0 * DEG), "rests": scene.rests(imu), "halves": False} | more
    return calibrate_field(imu, spec, latitude=LLH[0], height=LLH[2], options=options, **more)


def in_sigmas(result: FieldCalibration, errors: ImuErrors) -> np.ndarray:
    c = result.calibration
    return (c.values - vector(errors, c.names)) / c.sigma


def wandering(
    scene: Scene, layout: StateLayout, spec: ImuSpec, rng: np.random.Generator
) -> tuple[ImuSeries, np.ndarray]:
    """A log whose parameters are drawn from the models of a layout and move as these say; and they, at its last rest.

    White noise is that of the specification.
    """
    from scipy.signal import lfilter

    dtheta, dv, h = scene.ideal.gyro, scene.ideal.accel, 1.0 / scene.ideal.rate_hz
    n, (beta, q) = len(dv), layout.dynamics().T
    p = np.sqrt(layout.initial_variances()) * rng.standard_normal(layout.size - 9)
    keep = np.exp(-beta * h)
    step = np.sqrt(np.where(beta > 0, q * -np.expm1(-2 * beta * h) / np.where(beta > 0, 2 * beta, 1), q * h))
    history = np.tile(p, (n, 1))
    for k in np.flatnonzero((q > 0) | (beta > 0)):
        history[:, k] = lfilter([1.0], [1.0, -keep[k]], step[k] * rng.standard_normal(n), zi=[keep[k] * p[k]])[0]
    regressors = np.column_stack((np.full(n, h), dv, dtheta))
    out = [dtheta.copy(), dv.copy()]
    for k, (sensor, axis, source) in enumerate(layout.table()):
        out[sensor][:, axis] += history[:, k] * regressors[:, source]
    for x, triad in zip(out, (spec.gyro, spec.accel), strict=True):
        x += triad.random_walk * np.sqrt(h) * rng.standard_normal((n, 3))
    imu = ImuSeries(scene.ideal.t[1:], out[0], out[1], "increment")
    return imu, history[scene.rests(imu).index[-1, 1] - 1]


def drawn(spec, seed):
    """A unit, its generator, and a heading known to a degree."""
    rng = np.random.default_rng(seed)
    errors = ImuErrors.draw(spec, rng, gauge="upper")
    return errors, rng, (DEG * float(rng.standard_normal()), DEG)


def nees_of(result, truth):
    e = result.calibration.values - truth
    return float(e @ np.linalg.solve(result.calibration.covariance, e))


def campaign(scene, spec, runs, spoil=None, options=None, seeds=0, **more):
    """NEES per degree of freedom, errors (runs, p), mean sigmas, results."""
    nees, errors_all, solutions = [], [], []
    for seed in range(seeds, seeds + runs):
        errors, rng, heading = drawn(spec, seed)
        imu = log_of(scene, errors, rng)
        if spoil is not None:
            imu = spoil(imu, scene, rng)
        result = calibrated(scene, imu, spec, options, heading=heading, **more)
        truth = vector(errors, result.calibration.names)
        nees.append(nees_of(result, truth) / len(truth))
        errors_all.append(result.calibration.values - truth)
        solutions.append(result)
    return float(np.mean(nees)), np.array(errors_all), solutions


def band(runs, size, probability=0.9998):
    """Chi-square band of a mean NEES per degree of freedom."""
    tail = 0.5 * (1.0 - probability)
    return chi2.ppf(tail, runs * size) / runs / size, chi2.isf(tail, runs * size) / runs / size
