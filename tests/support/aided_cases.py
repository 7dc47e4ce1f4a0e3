"""Simulated runs with every aid there is: measurements of a truth, one run, campaigns with their chi-square bands."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from aided_truth import CLOCKS_BETWEEN, LEVER_V, MODELS, Drive, Truth, layout, town
from filter_cases import ACCEL_N, GYRO_N, LEVER, ORIGIN, SIGMA_R, SIGMA_V, START_R, START_V

from schuler import frames, rotation
from schuler.filtering.engine import FilterOptions, run
from schuler.filtering.initial_state import InitialState
from schuler.filtering.measurements import EARTH_RATE_MAGNITUDE, MeasurementSchedule, gnss_measurements, merged
from schuler.filtering.states import StateLayout
from schuler.gnss.constellation import nominal_orbits
from schuler.gnss.ranges import Ranges, predicted_ranges, predicted_rates
from schuler.gnss.synthetic import EXACT, synthetic_ranges
from schuler.mechanization.strapdown import NavState
from schuler.navigation.aids.rest import earth_rates, gravities, zero_rates
from schuler.navigation.aids.vehicle import VehicleConditions, non_holonomic
from schuler.navigation.evaluation.consistency import chi_square_band, nees, state_errors
from schuler.navigation.result import NavigationResult
from schuler.recording.series import GnssSeries
from schuler.standstill.stationarity import StaticIntervals

__all__ = ["ACCEL_N", "CLOCKS_BETWEEN", "GYRO_N", "LEVER", "LEVER_V", "MODELS", "ORIGIN"]
__all__ += ["SIGMA_R", "SIGMA_V", "Drive", "Truth", "layout", "town"]  # handed on to the tests

LEVER_H = np.array([0.2, 0.1, -0.4])  # IMU to the barometer
NOISE = (np.full(3, GYRO_N**2), np.full(3, ACCEL_N**2))
# Small enough that tilt times heading error, which an error-state filter leaves out, stays below a percent of NEES;
# 0.01, 0.01, 0.05 rad raise it to 1.2 for the first seconds of zero-velocity updates.
START_ATT = np.array([0.005, 0.005, 0.01])
SIGMA_NHC, SIGMA_ODO, SIGMA_REST = 0.05, 0.03, 0.01
SIGMA_HEADING, SIGMA_HEIGHT, SIGMA_FIX = 0.01, 0.5, np.array([0.3, 0.2, 0.4])
SIGMA_RANGE, SIGMA_RATE = 1.5, 0.08

# Measurements: functions of a truth, with noise from its generator.
Aid = Callable[[Truth], MeasurementSchedule]


def gnss(truth: Truth, *, keep: Callable | None = None, velocity: bool = True, lever=LEVER, nominal_lever=LEVER):
    """Positions and velocities of the antenna: wrong stamps, correlated errors, lever arm as the layout has them."""
    t = truth.drive.fixes_t
    s = truth.drive.at_fixes
    if "delay" in truth.layout:
        s = truth.drive.motion.state(t + truth.constant("delay", 1)[0])
    r, v = truth.body(s).point(truth.lever - LEVER + lever)
    C = frames.C_en(frames.llh_from_ecef(r))
    r = r + np.einsum("nij,nj->ni", C, SIGMA_R * truth.draws(len(t), 3) + truth.at("b_r", t))
    v_n = np.einsum("nji,nj->ni", C, v) + SIGMA_V * truth.draws(len(t), 3) + truth.at("b_v", t)
    n = len(t)
    series = GnssSeries(
        t, frames.llh_from_ecef(r), np.tile(np.diag(SIGMA_R**2), (n, 1, 1)), v_n,
        np.tile(np.diag(SIGMA_V**2), (n, 1, 1)),
    )  # fmt: skip
    if keep is not None:
        series = series.where(keep(t))
    return gnss_measurements(series, nominal_lever, use_velocity=velocity, gate=None)


def at_rest(truth: Truth, t: np.ndarray) -> np.ndarray:
    """Whether the axle has not moved for a second before."""
    speed = np.linalg.norm(truth.drive.motion.state(np.maximum(t - 1.0, 0.0)).v_eb_e, axis=1)
    return (speed < 1e-9) & (np.linalg.norm(truth.drive.motion.state(t).v_eb_e, axis=1) < 1e-9)


def zero_velocity(truth: Truth) -> MeasurementSchedule:
    """What little the vehicle still moves at rest is in the measurement."""
    from schuler.filtering.measurements import ZERO_VELOCITY

    t = truth.drive.aids_t[at_rest(truth, truth.drive.aids_t)]
    return MeasurementSchedule.of(ZERO_VELOCITY, t, SIGMA_REST * truth.draws(len(t), 3), SIGMA_REST**2)


def rests(truth: Truth) -> StaticIntervals:
    """Where the log really rests."""
    mask = at_rest(truth, truth.log.t)
    edge = np.diff(np.concatenate(([False], mask, [False])).astype(int))
    index = np.stack((np.flatnonzero(edge == 1), np.flatnonzero(edge == -1)), axis=1)
    none, zero = np.empty(0), np.zeros(3)
    return StaticIntervals(
        truth.log.t[index[:, 0]], truth.log.t[index[:, 1] - 1], index, mask, none, 0.0, "truth", 0.5, zero, zero, zero
    )


def zero_rate(truth: Truth, block_s: float = 1.0) -> MeasurementSchedule:
    """Means of the log itself over blocks at rest, as ``rest_aids.zero_rates`` makes them."""
    return zero_rates(truth.series(), rests(truth), sigma_noise=GYRO_N, block_s=block_s, gate=None)


def gravity(truth: Truth) -> MeasurementSchedule:
    """Magnitude of the means of the log itself, as ``rest_aids.gravities`` makes them."""
    return gravities(truth.series(), rests(truth), sigma_noise=ACCEL_N, gate=None)


def gravity_vector(truth: Truth) -> MeasurementSchedule:
    """The means with their direction."""
    return gravities(truth.series(), rests(truth), sigma_noise=ACCEL_N, vector=True, gate=None)


def earth_rate(truth: Truth) -> MeasurementSchedule:
    """Means of the log itself along the vertical, as ``rest_aids.earth_rates`` makes them."""
    return earth_rates(truth.series(), rests(truth), sigma_noise=GYRO_N, gate=None)


def earth_rate_magnitude(truth: Truth) -> MeasurementSchedule:
    """As printed in the thesis; for comparison only."""
    s = earth_rate(truth)
    return replace(s, kind=np.full(len(s), EARTH_RATE_MAGNITUDE))


def wheels(truth: Truth, rate_hz: float = 5.0) -> MeasurementSchedule:
    """No slip but white noise, where the conditions hold."""
    s = non_holonomic(
        truth.series(), rate_hz=rate_hz, sigma_lateral=SIGMA_NHC, sigma_vertical=SIGMA_NHC, lever_b=LEVER_V,
        conditions=VehicleConditions(max_turn_rate=0.5), gate=None, start=0.0037,
    )  # fmt: skip
    z = s.z.copy()
    z[:, 0] = SIGMA_NHC * truth.draws(len(s))
    return replace(s, t=np.round(s.t, 9), z=z)


def odometer(truth: Truth) -> MeasurementSchedule:
    """Speed of the axle along the vehicle, wrong by the scale error."""
    from schuler.filtering.measurements import SPEED

    s = truth.drive.at_aids
    forward = np.einsum("ni,ni->n", s.C_eb[:, :, 0], s.v_eb_e)
    z = (1.0 + truth.constant("odometer", 1)[0]) * forward + SIGMA_ODO * truth.draws(len(forward))
    return MeasurementSchedule.of(SPEED, s.t, z, SIGMA_ODO**2, LEVER_V)


def heading(truth: Truth) -> MeasurementSchedule:
    from schuler.filtering.measurements import HEADING

    b, t = truth.body(truth.drive.at_fixes), truth.drive.fixes_t
    C = np.einsum("nji,njk->nik", frames.C_en(frames.llh_from_ecef(b.r)), b.C)
    z = np.arctan2(C[:, 1, 0], C[:, 0, 0]) + truth.at("b_heading", t)[:, 0] + SIGMA_HEADING * truth.draws(len(t))
    return MeasurementSchedule.of(HEADING, t, np.mod(z, 2 * np.pi), SIGMA_HEADING**2)


def height(truth: Truth) -> MeasurementSchedule:
    from schuler.filtering.measurements import HEIGHT

    t = truth.drive.fixes_t
    h = frames.llh_from_ecef(truth.body(truth.drive.at_fixes).point(LEVER_H)[0])[:, 2]
    z = h + truth.at("baro", t)[:, 0] + SIGMA_HEIGHT * truth.draws(len(t))
    return MeasurementSchedule.of(HEIGHT, t, z, SIGMA_HEIGHT**2, LEVER_H)


def known_places(truth: Truth, every: int = 15) -> MeasurementSchedule:
    from schuler.navigation.aids.scalar import known_positions

    t = truth.drive.aids_t[::every]
    r = truth.body(truth.drive.at_aids).point(LEVER_H)[0][::every]
    C = frames.C_en(frames.llh_from_ecef(r))
    r = r + np.einsum("nij,nj->ni", C, SIGMA_FIX * truth.draws(len(t), 3))
    return known_positions(t, frames.llh_from_ecef(r), SIGMA_FIX, lever_b=LEVER_H)


def sky(drive: Drive, systems: str = "GE", most: int | np.ndarray | None = 8, mask_deg: float = 10.0) -> Ranges:
    """Visible satellites at every fix, where they were at transmission; ranges are filled in by truth."""
    s = drive.at_fixes
    synthetic = synthetic_ranges(
        drive.fixes_t, s.r_eb_e, s.v_eb_e, nominal_orbits(systems), np.random.default_rng(0),
        EXACT, elevation_mask=np.radians(mask_deg), max_satellites=most,
    )  # fmt: skip
    n = len(synthetic.ranges)
    return replace(synthetic.ranges, sigma_range=np.full(n, SIGMA_RANGE), sigma_rate=np.full(n, SIGMA_RATE))


def measured(truth: Truth, over: Ranges) -> Ranges:
    """Ranges of the true antenna with the true clocks and white noise."""
    epoch = np.searchsorted(truth.drive.fixes_t, over.t)
    r, v = (x[epoch] for x in truth.body(truth.drive.at_fixes).point(truth.lever))
    clock, drift = truth.at("clock", over.t)[:, 0], truth.at("clock_drift", over.t)[:, 0]
    for i in range(1, len(over.groups)):
        clock = clock + np.where(over.group == i, truth.at(f"clock_{i + 1}", over.t)[:, 0], 0.0)
    n = len(over)
    return replace(
        over,
        pseudorange=predicted_ranges(over.r_sat_e, r)[0] + clock + over.sigma_range * truth.draws(n),
        range_rate=predicted_rates(over.r_sat_e, over.v_sat_e, r, v)[0] + drift + over.sigma_rate * truth.draws(n),
    )


def satellites(over: Ranges, *, gate: float | None = None, spoil: Callable[[Ranges], Ranges] | None = None) -> Aid:
    from schuler.navigation.aids.satellite import range_measurements

    def aid(truth: Truth) -> MeasurementSchedule:
        ranges = measured(truth, over)
        return range_measurements(ranges if spoil is None else spoil(ranges), LEVER, gate=gate)

    return aid


def initial(truth: Truth, filter_layout: StateLayout | None = None) -> InitialState:
    """Truth at the start, wrong by draws of the stated uncertainty (times the truth's ``noise``)."""
    T = truth.reference
    C = frames.C_en(T.llh[0])
    turned = rotation.quat_from_rotvec(C @ (START_ATT * truth.draws(3)))
    nav = NavState(
        0.0,
        T.r_eb_e[0] + C @ (START_R * truth.draws(3)),
        T.v_eb_e[0] + C @ (START_V * truth.draws(3)),
        rotation.quat_multiply(turned, T.q_eb[0]),
    )
    return InitialState.from_sigmas(
        nav, filter_layout or truth.layout, attitude=START_ATT, velocity=START_V, position=START_R
    )


@dataclass(frozen=True)
class Outcome:
    """One run: result, truth of the parameters at its records."""

    result: NavigationResult
    truth: Truth
    parameters: np.ndarray


def filtered(
    drive: Drive,
    lay: StateLayout,
    aids: Sequence[Aid],
    seed: int,
    *,
    given: dict | None = None,
    noise: float = 1.0,
    filter_layout: StateLayout | None = None,
    **options,
) -> Outcome:
    """One run; the filter may have another layout than the truth."""
    truth = Truth(drive, lay, np.random.default_rng([11, seed]), given, noise=noise)
    schedule = merged(*(aid(truth) for aid in aids))
    used = filter_layout or lay
    forward = run(truth.log, schedule, initial(truth, used), used, *NOISE, FilterOptions(**options))
    result = NavigationResult.from_run(forward, schedule.t, schedule.kind, used, lever_arm_b=LEVER)
    at = np.searchsorted(truth.log.t, result.t - 1e-9) + 1
    return Outcome(result, truth, truth.history[at])


@dataclass(frozen=True)
class Campaign:
    """NEES per degree of freedom (runs, records), mean NIS (runs,), its degrees, final errors in sigmas (runs, n)."""

    nees: np.ndarray
    nis: np.ndarray
    freedom: int
    final: np.ndarray
    size: int

    @classmethod
    def of(cls, drive: Drive, lay: StateLayout, aids: Sequence[Aid], seeds: Sequence[int], **more) -> Campaign:
        values, nis, final, freedom = [], [], [], 0
        for seed in seeds:
            one = filtered(drive, lay, aids, seed, **more)
            same = more.get("filter_layout") in (None, lay)
            parameters = one.parameters if same else None
            values.append(nees(one.result, one.truth.reference, parameters))
            _, dx, P = state_errors(one.result, one.truth.reference, parameters)
            final.append(dx[-1] / np.sqrt(np.diag(P[-1])))
            nis.append(one.result.innovations.mean_nis())
            tested = np.isfinite(one.result.innovations.nis)
            freedom = int(one.result.innovations.freedom[tested].sum())
        return cls(np.array(values), np.array(nis), freedom, np.array(final), len(P[-1]))

    def check(self, looks: Sequence[int] = (10, 30, 60, 90, 115), probability: float = 0.9999) -> None:
        """NEES at some records, NIS, and the spread of each state, all in their bands. Tolerances are statistical."""
        runs = len(self.nees)
        low, high = chi_square_band(self.size, runs, probability)
        at = self.nees[:, list(looks)].mean(axis=0)
        assert np.all((at > low) & (at < high)), (low, at.round(3), high)
        low, high = chi_square_band(self.freedom, runs, probability)
        assert low < self.nis.mean() < high, (low, self.nis.mean(), high)
        spread = np.sqrt((self.final**2).mean(axis=0))
        # each state for itself, at the end: 4.5 standard errors of a mean and of a spread
        assert np.all(np.abs(self.final.mean(axis=0)) < 4.5 / np.sqrt(runs)), self.final.mean(axis=0).round(2)
        squares = chi_square_band(1, runs, 1.0 - 1e-5)
        assert np.all((spread**2 > squares[0]) & (spread**2 < squares[1])), spread.round(2)
