"""IMU epochs per second of every navigation configuration, batch and live, beside the peer's loosely coupled filter.

One drive of 1000 s at 100 Hz with stops; every aid measures its truth, so that nothing is gated and all updates count.
"""

from __future__ import annotations

import numpy as np
import pytest

from schuler import frames
from schuler.filtering.engine import FilterOptions, run
from schuler.filtering.initial_state import InitialState
from schuler.filtering.measurements import (
    HEADING,
    HEIGHT,
    SPEED,
    ZERO_RATE,
    MeasurementSchedule,
    gnss_measurements,
    merged,
    zero_velocity,
)
from schuler.filtering.states import StateLayout, StateModel
from schuler.gnss.constellation import nominal_orbits
from schuler.gnss.synthetic import EXACT, synthetic_ranges
from schuler.mechanization.strapdown import NavState
from schuler.navigation.aids.satellite import range_measurements
from schuler.navigation.aids.vehicle import VehicleConditions, non_holonomic
from schuler.navigation.navigator import Navigator
from schuler.navigation.result import NavigationResult
from schuler.recording.series import GnssSeries, ImuSeries, Increments
from schuler.simulation.motion import ideal_increments
from schuler.simulation.profiles import Manoeuvre, ManoeuvreMotion

ORIGIN = np.array([np.radians(47.0), np.radians(8.0), 450.0])
GYRO_N, ACCEL_N, SECONDS, LIVE_S = 1e-4, 2e-3, 1000.0, 100.0
STOP = (34.0, 46.0)  # of every lap of 46 s: slowing down, then at rest
GROUP = "navigation configurations, 100 Hz, GNSS 1 Hz unless said"

IMU = {
    "b_a": StateModel.random_walk(0.02, 1e-5),
    "b_g": StateModel.random_walk(1e-3, 1e-7),
    "S_a": StateModel.constant(1e-3),
    "S_g": StateModel.constant(1e-3),
    "M_a6": StateModel.constant(1e-3),
    "M_g": StateModel.constant(1e-3),
}
WHEELS = {
    "mount": StateModel.constant(0.03),
    "lever_v": StateModel.constant(0.3),
    "odometer": StateModel.constant(0.02),
}
SCALARS = {"b_heading": StateModel.constant(0.05), "baro": StateModel.random_walk(20.0, 0.05)}
CLOCKS = {"clock": StateModel.random_walk(100.0, 0.3), "clock_drift": StateModel.random_walk(10.0, 0.1)}


def first(number: int) -> dict[str, StateModel]:
    return dict(list(IMU.items())[: {15: 2, 21: 4, 33: 6}[number]])


#: Name to state blocks besides attitude, velocity, position, and measurements.
CONFIGURATIONS = {
    "loose, 15 states": (first(15), ("loose",)),
    "loose, 21 states": (first(21), ("loose",)),
    "loose, 33 states": (first(33), ("loose",)),
    "loose + zero velocity + zero rate, 15": (first(15), ("loose", "rest")),
    "loose + wheels + odometer, 21": (first(15) | WHEELS, ("loose", "wheels")),
    "loose + heading + barometer, 17": (first(15) | SCALARS, ("loose", "scalars")),
    "loose + all of these, 29": (first(21) | WHEELS | SCALARS, ("loose", "rest", "wheels", "scalars")),
    "tight, 8 x (range + rate), 17": (first(15) | CLOCKS, ("tight 1 Hz",)),
    "tight, 8 x (range + rate) at 4 Hz, 17": (first(15) | CLOCKS, ("tight 4 Hz",)),
    "tight + wheels, 23": (first(15) | CLOCKS | WHEELS, ("tight 1 Hz", "wheels")),
}


@pytest.fixture(scope="module")
def town():
    lap = [
        Manoeuvre(duration=8.0, speed=12.0),
        Manoeuvre(duration=7.0, turn=1.5),
        Manoeuvre(duration=6.0, speed=16.0),
        Manoeuvre(duration=13.0, turn=-2.0),
        Manoeuvre(duration=4.0, speed=0.0),
        Manoeuvre(duration=8.0),
    ]
    motion = ManoeuvreMotion.of([*lap * (int(SECONDS / 46.0) + 2)], ORIGIN, bank=0.2)
    t = np.arange(round(SECONDS * 100.0) + 1) / 100.0
    dtheta, dv = ideal_increments(motion, t)
    rng = np.random.default_rng(0)
    dtheta, dv = (
        dtheta + 0.1 * GYRO_N * rng.standard_normal(dtheta.shape),
        dv + 0.1 * ACCEL_N * rng.standard_normal(dv.shape),
    )
    return motion, Increments(t[1:], np.full(len(t) - 1, 0.01), dtheta, dv)


@pytest.fixture(scope="module")
def solutions(town):
    t = np.arange(1.0, SECONDS)
    s = town[0].state(t)
    rng = np.random.default_rng(1)
    n = len(t)
    return GnssSeries(
        t,
        frames.llh_from_ecef(s.r_eb_e + rng.standard_normal((n, 3))),
        np.tile(np.eye(3), (n, 1, 1)),
        s.v_eb_n + 0.05 * rng.standard_normal((n, 3)),
        np.tile(0.05**2 * np.eye(3), (n, 1, 1)),
    )


@pytest.fixture(scope="module")
def start(town):
    s = town[0].state(np.zeros(1))
    return NavState(0.0, s.r_eb_e[0], s.v_eb_e[0], s.q_eb[0])


@pytest.fixture(scope="module")
def aids(town, solutions):
    """Measurements by name."""
    motion, inc = town
    of = MeasurementSchedule.of
    half = np.arange(0.5, SECONDS, 0.5)
    still = half[half % 46.0 > STOP[0] + 5.0]
    block = np.searchsorted(inc.t, still)
    rate = inc.dtheta_ib_b[block] / 0.01
    tenth = np.arange(0.1, SECONDS, 0.1)
    s = motion.state(tenth)
    forward = np.einsum("ni,ni->n", s.C_eb[:, :, 0], s.v_eb_e)
    one = motion.state(solutions.t)
    yaw = np.arctan2(one.C_nb[:, 1, 0], one.C_nb[:, 0, 0])

    def ranges(rate_hz: float) -> MeasurementSchedule:
        t = np.arange(1.0, SECONDS, 1.0 / rate_hz)
        s = motion.state(t)
        made = synthetic_ranges(
            t, s.r_eb_e, s.v_eb_e, nominal_orbits("G"), np.random.default_rng(0), EXACT, max_satellites=8
        )
        return range_measurements(made.ranges, [0.0, 0.0, 0.0], gate=None)

    wheels = non_holonomic(
        ImuSeries(inc.t, inc.dtheta_ib_b, inc.dv_ib_b, "increment"), rate_hz=5.0,
        conditions=VehicleConditions(max_turn_rate=np.inf, max_forward_acceleration=np.inf), gate=None, start=0.0,
    )  # fmt: skip
    return {
        "loose": gnss_measurements(solutions, [0.0, 0.0, 0.0]),
        "rest": merged(zero_velocity(still, 0.02), of(ZERO_RATE, still, rate, (10.0 * GYRO_N) ** 2)),
        "wheels": merged(wheels, of(SPEED, tenth, forward, 0.05**2)),
        "scalars": merged(
            of(HEADING, solutions.t, np.mod(yaw, 2.0 * np.pi), 0.02**2),
            of(HEIGHT, solutions.t, frames.llh_from_ecef(one.r_eb_e)[:, 2], 1.0),
        ),
        "tight 1 Hz": ranges(1.0),
        "tight 4 Hz": ranges(4.0),
    }


@pytest.fixture(scope="module")
def job(town, aids, start):
    """Arguments of a run by name of the configuration."""

    def of(name: str) -> tuple:
        models, parts = CONFIGURATIONS[name]
        lay = StateLayout(models)
        initial = InitialState.from_sigmas(
            start, lay, attitude=[0.005, 0.005, 0.02], velocity=[0.1] * 3, position=[1.0] * 3
        )
        schedule = merged(*(aids[part] for part in parts))
        return town[1], schedule, initial, lay, np.full(3, GYRO_N**2), np.full(3, ACCEL_N**2)

    return of


@pytest.mark.benchmark(group=GROUP)
@pytest.mark.parametrize("name", CONFIGURATIONS)
def test_batch(benchmark, job, name):
    args = job(name)
    forward = run(*args)
    assert np.isfinite(forward.r).all()
    assert (forward.status == 1).mean() > 0.8  # the table is of updates that were made
    benchmark.extra_info["epochs"] = len(args[0])
    benchmark.extra_info["updates"] = len(args[1])
    benchmark.pedantic(run, args=args, rounds=3)


@pytest.mark.benchmark(group=GROUP)
@pytest.mark.parametrize("name", ["loose, 15 states", "loose + all of these, 29"])
def test_smoothed(benchmark, job, name):
    """Forward run that keeps what the smoother needs, and the backward pass."""
    args = job(name)
    options = FilterOptions(smoother=True)

    def both() -> None:
        forward = run(*args, options)
        NavigationResult.from_run(forward, args[1].t, args[1].kind, args[3]).smooth()

    both()
    benchmark.extra_info["epochs"] = len(args[0])
    benchmark.pedantic(both, rounds=3)


@pytest.mark.benchmark(group=GROUP)
@pytest.mark.parametrize("name", CONFIGURATIONS)
def test_live(benchmark, job, name):
    """Sample by sample from Python, each measurement announced before the sample it falls into."""
    inc, schedule, initial, lay, gyro, accel = job(name)
    n = round(LIVE_S * 100.0)
    rows = list(zip(inc.t[:n], inc.dtheta_ib_b[:n], inc.dv_ib_b[:n], strict=True))
    used = schedule.where(schedule.t <= LIVE_S)
    epoch = np.flatnonzero(np.diff(used.t, prepend=-1.0) > 0.0)
    parts = [used.where(np.arange(a, b)) for a, b in zip(epoch, [*epoch[1:], len(used)], strict=True)]

    def live() -> None:
        navigator = Navigator(initial, lay, gyro, accel, interval_s=0.01)
        k = 0
        for t, dtheta, dv in rows:
            while k < len(parts) and parts[k].t[0] <= t + 1e-9:
                navigator.aid(parts[k])
                k += 1
            navigator.imu(t, dtheta, dv)

    benchmark.extra_info["epochs"] = n
    benchmark.pedantic(live, rounds=3, warmup_rounds=1)


@pytest.mark.benchmark(group=GROUP)
def test_peer_python_ins(benchmark, town, solutions, peer_start_of):
    """The peer's feedback filter, loosely coupled, 15 states, over a tenth of the drive."""
    import pandas as pd
    from pyins import filters, inertial_sensor, measurements

    inc = town[1].between(0.0, 100.0)
    table = pd.DataFrame(
        np.column_stack((inc.dt, inc.dtheta_ib_b, inc.dv_ib_b)),
        columns=["dt", "theta_x", "theta_y", "theta_z", "dv_x", "dv_y", "dv_z"],
        index=pd.Index(inc.t, name="time"),
    )
    g = solutions.between(0.0, 99.0)
    position = pd.DataFrame(
        np.column_stack((np.degrees(g.llh[:, :2]), g.llh[:, 2])), index=g.t, columns=["lat", "lon", "alt"]
    )
    velocity = pd.DataFrame(g.v_n, index=g.t, columns=["VN", "VE", "VD"])
    gyro = inertial_sensor.EstimationModel(bias_sd=1e-3, noise=GYRO_N, bias_walk=1e-7)
    accel = inertial_sensor.EstimationModel(bias_sd=0.02, noise=ACCEL_N, bias_walk=1e-5)

    def run_peer() -> object:
        return filters.run_feedback_filter(
            peer_start_of, 1.0, 0.1, 0.3, 1.2, table, gyro_model=gyro, accel_model=accel,
            measurements=[measurements.Position(position, 1.0), measurements.NedVelocity(velocity, 0.05)],
        )  # fmt: skip

    benchmark.extra_info["epochs"] = len(inc)
    benchmark.pedantic(run_peer, rounds=2, warmup_rounds=1)


@pytest.fixture(scope="module")
def peer_start_of(start):
    """Initial state in the peer's form."""
    pytest.importorskip("pyins", reason="the peer is in the bench extra: pip install 'schuler[bench]'")
    import pandas as pd

    return pd.Series(
        [*np.degrees(start.llh[:2]), start.llh[2], *start.v_eb_n, *np.degrees(start.rpy_nb)],
        index=["lat", "lon", "alt", "VN", "VE", "VD", "roll", "pitch", "heading"],
        name=start.t,
    )
