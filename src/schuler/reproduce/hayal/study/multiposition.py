"""Simulation of the multi-position method: attitudes, readings, and Monte Carlo over them.

What Hayal's chapter 4 does once is done here many times, so that predicted uncertainty and true error can be compared.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from schuler.arrays import BoolArray, FloatArray, IntArray, as_floats
from schuler.calibration.bench.gauss_helmert import Order, Start, adjust
from schuler.calibration.bench.sensor_geometry import triad_reading
from schuler.earth import earth_rate_ned
from schuler.exceptions import InputError
from schuler.reproduce.hayal.study.attitudes import ordered_attitudes, scenario, study_attitudes
from schuler.units import DEG, DEG_PER_RTHR, MIN, MPS_PER_RTHR, PPM

#: Gravity of the study, m/s^2, at 40 degrees; normal gravity has 9.8017 on the ellipsoid.
GRAVITY = 9.801
LATITUDE = 40.0 * DEG
#: Noise of HG1700 (Honeywell): 0.125 deg/sqrt(h), 0.22 (m/s)/sqrt(h). [x/sqrt(Hz)]
NOISE = {"gyro": 0.125 * DEG_PER_RTHR, "accel": 0.22 * MPS_PER_RTHR}
#: Errors put in, in the order of PARAMETERS (Table 4.1).
TRUTH = {
    "gyro": np.array([4.848e-6] * 3 + [150.0 * PPM] * 3 + [100e-6] * 3),
    "accel": np.array([0.010] * 3 + [300.0 * PPM] * 3 + [100e-6] * 3),
}


@dataclass(frozen=True, eq=False)
class StudyCase:
    """Case of the simulation, and the adjustment applied to it.

    Attributes
    ----------
    sensor : {"gyro", "accel"}
    order : {3, 6, 9}
    rate_factor : float
        The reference is so many times Earth rate or gravity.
    noise_factor : float
        Noise is so many times :data:`NOISE`; with zero the nominal noise gives the weights.
    duration_s : float
        In each attitude; one sample a second. [s]
    directions : ndarray, shape (n, 3)
        Down in body axes.
    disturbance : float
        1 sigma of each angle by which an attitude misses its face, edge or corner. [rad]
    heading : float
        [rad]
    truth : ndarray, shape (9,), or None
        None: :data:`TRUTH`.
    prior, fixed, start
        See :func:`schuler.calibration.bench.gauss_helmert.adjust`.
    plain : bool
        The iteration as in the source: no step limit, every direction however uncertain.
    """

    sensor: Literal["gyro", "accel"] = "gyro"
    order: Order = 9
    rate_factor: float = 1.0
    noise_factor: float = 1.0
    duration_s: float = 180.0
    directions: FloatArray = field(default_factory=ordered_attitudes)
    disturbance: float = 2.0 * DEG
    heading: float = 20.0 * DEG
    truth: FloatArray | None = None
    prior: Mapping[str, tuple[float, float]] | None = None
    fixed: Mapping[str, float] | None = None
    start: Start = "continuation"
    plain: bool = False

    @property
    def reference_n(self) -> FloatArray:
        """Specific force or rate in north-east-down. Shape (3,)."""
        if self.sensor == "accel":
            return self.rate_factor * np.array((0.0, 0.0, -GRAVITY))
        return self.rate_factor * earth_rate_ned(LATITUDE)

    @property
    def sigma(self) -> float:
        """Noise of the mean that gives the weights. [x]"""
        return NOISE[self.sensor] * (self.noise_factor or 1.0) / float(np.sqrt(self.duration_s))

    @property
    def errors(self) -> FloatArray:
        """Parameters put in. Shape (9,)."""
        return TRUTH[self.sensor] if self.truth is None else as_floats(self.truth, "truth", (9,))


@dataclass(frozen=True, eq=False)
class StudyResult:
    """Many runs of one case; runs that did not converge are NaN in ``values`` and ``sigma``.

    Attributes
    ----------
    case : StudyCase
    values : ndarray, shape (runs, 9)
    sigma : ndarray, shape (runs, 9)
        With the weights as given; times the root of ``unit_weight`` it is what Hayal prints.
    unit_weight : ndarray, shape (runs,)
        Variance of unit weight.
    converged : ndarray of bool, shape (runs,)
        And every parameter determined.
    iterations : ndarray of int, shape (runs,)
    """

    case: StudyCase
    values: FloatArray
    sigma: FloatArray
    unit_weight: FloatArray
    converged: BoolArray
    iterations: IntArray

    @property
    def success(self) -> float:
        """Share of runs that converged."""
        return float(self.converged.mean())

    @property
    def error(self) -> FloatArray:
        """Estimate minus truth of the runs that converged. Shape (k, 9)."""
        return np.asarray((self.values - self.case.errors)[self.converged])

    @property
    def mean_sigma(self) -> FloatArray:
        """Mean predicted 1 sigma, scaled as in the source. Shape (9,)."""
        return np.asarray(np.mean((self.sigma * np.sqrt(self.unit_weight)[:, None])[self.converged], axis=0))

    @property
    def rms_error(self) -> FloatArray:
        """Root mean square of :attr:`error`. Shape (9,)."""
        return np.asarray(np.sqrt(np.mean(self.error**2, axis=0)))

    def groups(self) -> tuple[float, float, float]:
        """Root mean square error of bias [x], scale factors [-] and angles [rad], each over its three axes."""
        e = self.rms_error
        return tuple(float(np.sqrt(np.mean(e[i : i + 3] ** 2))) for i in (0, 3, 6))  # type: ignore[return-value]


def simulated_readings(case: StudyCase, rng: np.random.Generator) -> FloatArray:
    """Mean reading in each attitude: the reference turned, replicated, with errors and noise, averaged. Shape (n, 3).

    References
    ----------
    Hayal (2010), sections 4.1 to 4.3.
    """
    C = study_attitudes(case.directions, case.heading, case.disturbance, rng)
    b, s, theta = np.split(case.errors, 3)
    Y = triad_reading(C @ case.reference_n, b, s, theta)
    if case.noise_factor:
        samples = max(round(case.duration_s), 1)
        noise = NOISE[case.sensor] * case.noise_factor * np.sqrt(samples / case.duration_s)
        Y = Y + noise * rng.standard_normal((len(Y), samples, 3)).mean(axis=1)
    return Y


def run_case(case: StudyCase, runs: int, rng: np.random.Generator) -> StudyResult:
    """Simulate and adjust, again and again.

    Parameters
    ----------
    case : StudyCase
    runs : int
    rng : numpy.random.Generator
        Each run gets a child of its own.

    Returns
    -------
    StudyResult
    """
    values, sigma = np.full((runs, 9), np.nan), np.full((runs, 9), np.nan)
    weight, converged, iterations = np.full(runs, np.nan), np.zeros(runs, dtype=bool), np.zeros(runs, dtype=np.int64)
    rho = float(np.linalg.norm(case.reference_n))
    options = {"step_limit": None, "largest_sigma": np.inf} if case.plain else {}
    for i, child in enumerate(rng.spawn(runs)):
        Y = simulated_readings(case, child)
        fit = adjust(Y, case.sigma, rho, case.order, prior=case.prior, fixed=case.fixed, start=case.start, **options)  # type: ignore[arg-type]
        iterations[i], weight[i] = fit.iterations, fit.variance_of_unit_weight
        converged[i] = fit.converged and not fit.undetermined.any()
        if converged[i]:
            values[i], sigma[i] = fit.values, fit.sigma
    return StudyResult(case, values, sigma, weight, converged, iterations)


def sweep(
    case: StudyCase, name: Literal["rate_factor", "noise_factor"], factors: Sequence[float], runs: int,
    rng: np.random.Generator,
) -> list[StudyResult]:  # fmt: skip
    """One case over a range of reference rates (Hayal's Fig. 4.2) or of noise (Fig. 4.3)."""
    if name not in ("rate_factor", "noise_factor"):
        raise InputError(f"name: expected 'rate_factor' or 'noise_factor', got {name!r}")
    if name == "rate_factor":
        return [run_case(replace(case, rate_factor=float(k)), runs, rng) for k in factors]
    return [run_case(replace(case, noise_factor=float(k)), runs, rng) for k in factors]


def scenario_grid(
    case: StudyCase,
    runs: int,
    rng: np.random.Generator,
    *,
    scenarios: Sequence[int] = (1, 2, 3, 4),
    minutes: Sequence[float] = (1.0, 3.0, 5.0),
    orders: Sequence[Order] = (3, 9),
) -> dict[tuple[int, float, int], StudyResult]:
    """Attitude subsets x durations x parameters, the study of Hayal's section 5.3 with white noise only.

    Parameters
    ----------
    case : StudyCase
        Everything else.
    runs : int
    rng : numpy.random.Generator
    scenarios : sequence of int
        See :func:`schuler.reproduce.hayal.study.attitudes.scenario`.
    minutes : sequence of float
        In each attitude. [min]
    orders : sequence of {3, 6, 9}

    Returns
    -------
    dict of (scenario, minutes, order) to StudyResult
    """
    return {
        (k, t, m): run_case(replace(case, directions=scenario(k), duration_s=t * MIN, order=m), runs, rng)
        for k in scenarios
        for t in minutes
        for m in orders
    }
