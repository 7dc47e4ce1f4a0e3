"""Identifications made by hand: no fit is needed to see whether a report says what is in one."""

import math

import numpy as np

from schuler.characterisation.allan import AllanCurve
from schuler.characterisation.result import AxisNoise, Candidate, Estimate, Finding, NoiseIdentification
from schuler.recording.series import ImuSeries
from schuler.sensors.noise import GaussMarkov, NoiseModel, Quantisation, Ramp, RandomWalk, White, flicker
from schuler.sensors.spec import ImuSpec, TriadSpec, allan_minimum
from schuler.units import DEG_PER_HR, DEG_PER_RTHR, G0, MPS_PER_RTHR, UG

RATE, LENGTH = 100.0, 10800.0
SI = {
    "gyro": {"N": "(rad/s)/sqrt(Hz)", "B": "rad/s", "K": "(rad/s)*sqrt(Hz)", "R": "rad/s^2", "Q": "rad"},
    "accel": {"N": "(m/s^2)/sqrt(Hz)", "B": "m/s^2", "K": "(m/s^2)*sqrt(Hz)", "R": "m/s^3", "Q": "m/s"},
}
GYRO = {"N": 0.3 * DEG_PER_RTHR, "B": 6.0 * DEG_PER_HR, "K": 20.0 * DEG_PER_HR / 60.0}
ACCEL = {"N": 0.06 * MPS_PER_RTHR}
STEP = Finding("step", "A step of 3 ug at 4000 s <b>raises</b> K; cut the log there.", 4000.0, None, "note")
STUCK = Finding("stuck", "gyro_z repeats one value for 60 % of the log; check the sensor.", 100.0, 6500.0, "refused")
WARM = Finding("temperature", "The IMU warmed up by 8 K; let it run for an hour first.", 0.0, 1800.0)


def estimate(value: float, relative: float = 0.02, unit: str = "") -> Estimate:
    return Estimate(
        value, relative * value, value * math.exp(-1.96 * relative), value * math.exp(1.96 * relative), unit
    )


def curve_of(model: NoiseModel, rng: np.random.Generator, rate: float = RATE, length: float = LENGTH) -> AllanCurve:
    """The model's own curve with chi-square scatter, one factor for each averaging time."""
    m = np.round(np.geomspace(1.0, rate * length / 5.0, 40)).astype(np.int64)
    m = np.maximum(m, np.arange(1, 41))
    tau = m / rate
    edf = np.maximum(length / tau, 2.0)
    variance = model.discrete_allan_variance(m, 1.0 / rate)
    spread = 1.96 * np.sqrt(2.0 / edf)
    measured = variance * np.exp(np.sqrt(2.0 / edf) * 0.5 * rng.standard_normal(len(tau)))
    low, high = measured * np.exp(-spread), measured * np.exp(spread)
    return AllanCurve(
        tau, np.sqrt(measured), np.sqrt(low), np.sqrt(high), edf, np.ceil(edf).astype(np.int64),
        np.zeros(len(tau)), "overlapping", 0.95, rate, int(rate * length),
    )  # fmt: skip


def axis_noise(axis, terms, gauss_markov=(), findings=(), seed=1, read_off=True) -> AxisNoise:
    """An axis whose fit is the truth."""
    triad = axis.partition("_")[0]
    made = {"Q": Quantisation, "N": White, "K": RandomWalk, "R": Ramp, "B": flicker}
    model = NoiseModel(
        tuple(made[k](v) for k, v in terms.items() if k in made) + tuple(GaussMarkov(s, t) for s, t in gauss_markov)
    )
    curve = curve_of(model, np.random.default_rng(seed))
    k = int(np.argmin(curve.deviation))
    read = {"minimum": float(curve.deviation[k]), "minimum_tau_s": float(curve.tau[k])}
    if "N" in terms:
        read["N_at_1s"] = 1.03 * terms["N"]
    if "K" in terms:
        read["K_at_3s"] = 1.2 * terms["K"]
    unit = "rad/s" if triad == "gyro" else "m/s^2"
    names = (*terms, *(f"{n}_{i + 1}" for i in range(len(gauss_markov)) for n in ("sigma", "tau")))
    return AxisNoise(
        axis=axis, unit=unit, rate_hz=RATE, duration_s=LENGTH, mean=estimate(1e-3, 0.01, unit), curve=curve,
        terms={k: estimate(v, 0.02, SI[triad][k]) for k, v in terms.items()},
        gauss_markov=tuple((estimate(s, 0.1, unit), estimate(t, 0.2, "s")) for s, t in gauss_markov),
        model=model, names=names, covariance=np.diag(np.full(len(names), 4e-4)),
        candidates=(Candidate("N + GM", 31.0, 36, 35.0), Candidate("N + B + K", 41.5, 37, 44.5)),
        read_off=read if read_off else {}, method="gmwm", findings=tuple(findings),
    )  # fmt: skip


def identification(*, spec: bool = True, name: str = "an <IMU> & more") -> NoiseIdentification:
    """Two gyroscope axes and one accelerometer axis; gyro_z was refused."""
    axes = {
        "gyro_x": axis_noise("gyro_x", GYRO, findings=(STEP,)),
        "gyro_y": axis_noise("gyro_y", {"N": 1.1 * GYRO["N"], "R": 1e-9, "Q": 1e-7}, seed=2),
        "accel_x": axis_noise("accel_x", ACCEL, ((30.0 * UG, 5.0), (90.0 * UG, 600.0)), seed=3),
    }
    budget = ImuSpec(
        name,
        TriadSpec(random_walk=GYRO["N"], bias_instability=GYRO["B"], rate_random_walk=GYRO["K"]),
        TriadSpec(random_walk=ACCEL["N"], in_run_bias=90.0 * UG, in_run_time=600.0),
        rate_hz=RATE,
    )
    return NoiseIdentification(
        name=name, axes=axes, refused={"gyro_z": (STUCK,)}, spec=budget if spec else None,
        spec_sigma={"gyro": {"random_walk": 0.012}, "accel": {"in_run_bias": 0.11}} if spec else {},
        findings=(WARM,), notes=("The first 60 s were left out: <i>warm-up</i>.",),
        provenance={"schuler": "0.0.test", "method": "gmwm", "sources": {"log.csv": "ab" * 32}, "elapsed_s": 12.345678},
    )  # fmt: skip


def recording(seconds: float = 300.0) -> ImuSeries:
    rng = np.random.default_rng(4)
    n = int(seconds * RATE)
    t = 50.0 + np.arange(n) / RATE
    gyro = GYRO["N"] * math.sqrt(RATE) * rng.standard_normal((n, 3))
    accel = np.array([0.0, 0.0, -G0]) + ACCEL["N"] * math.sqrt(RATE) * rng.standard_normal((n, 3))
    return ImuSeries(t, gyro, accel)


__all__ = ["ACCEL", "GYRO", "LENGTH", "RATE", "allan_minimum", "axis_noise", "estimate", "identification", "recording"]
