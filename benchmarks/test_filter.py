"""Error-state filter with 1 Hz position and velocity over 100 000 IMU epochs; smoother; live use."""

from __future__ import annotations

import numpy as np
import pytest

from schuler.filtering.engine import FilterOptions, run
from schuler.navigation.navigator import Navigator
from schuler.navigation.result import NavigationResult


@pytest.mark.parametrize("states", [15, 21, 33])
@pytest.mark.parametrize("rate", ["10 Hz", "every sample"])
def test_filter(benchmark, filter_job, states, rate):
    benchmark.group = f"filter, {states} states" if states != 33 else "filter, 33 states (no peer)"
    job = filter_job(states)
    options = FilterOptions(covariance_rate_hz=None if rate == "every sample" else 10.0)
    run(*job, options)
    benchmark.extra_info["epochs"] = len(job[0])
    benchmark.pedantic(run, args=(*job, options), rounds=7)


@pytest.mark.parametrize("states", [15, 21])
def test_peer_python_ins(benchmark, log_1000s, fixes, peer_start, noise, states):
    """The peer's feedback filter at its default covariance step of 0.1 s, with the same noise and measurements."""
    benchmark.group = f"filter, {states} states"
    import pandas as pd
    from pyins import filters, inertial_sensor, measurements

    gyro_n, accel_n = noise
    inc = log_1000s[1]
    inc = inc.between(0.0, 200.0)  # a fifth of the job: the peer takes a minute for all of it
    table = pd.DataFrame(
        np.column_stack((inc.dt, inc.dtheta_ib_b, inc.dv_ib_b)),
        columns=["dt", "theta_x", "theta_y", "theta_z", "dv_x", "dv_y", "dv_z"],
        index=pd.Index(inc.t, name="time"),
    )
    g = fixes.between(0.0, 199.0)
    position = pd.DataFrame(
        np.column_stack((np.degrees(g.llh[:, :2]), g.llh[:, 2])), index=g.t, columns=["lat", "lon", "alt"]
    )
    velocity = pd.DataFrame(g.v_n, index=g.t, columns=["VN", "VE", "VD"])
    scale = np.diag([1e-3] * 3) if states == 21 else None
    gyro = inertial_sensor.EstimationModel(bias_sd=1e-3, noise=gyro_n, bias_walk=1e-7, scale_misal_sd=scale)
    accel = inertial_sensor.EstimationModel(bias_sd=0.02, noise=accel_n, bias_walk=1e-5, scale_misal_sd=scale)

    def run_peer() -> object:
        return filters.run_feedback_filter(
            peer_start, 1.0, 0.1, 0.3, 1.2, table, gyro_model=gyro, accel_model=accel,
            measurements=[measurements.Position(position, 1.0), measurements.NedVelocity(velocity, 0.05)],
        )  # fmt: skip

    benchmark.extra_info["epochs"] = len(inc)
    benchmark.pedantic(run_peer, rounds=2, warmup_rounds=1)


@pytest.mark.benchmark(group="smoothing against filtering, 15 states")
@pytest.mark.parametrize("what", ["forward pass that keeps for the smoother", "backward pass"])
def test_smoother(benchmark, filter_job, what):
    job = filter_job(15)
    options = FilterOptions(smoother=True)
    forward = run(*job, options)
    result = NavigationResult.from_run(forward, job[1].t, job[1].kind, job[3])
    result.smooth()
    benchmark.extra_info["epochs"] = len(job[0])
    if what == "backward pass":
        benchmark.pedantic(result.smooth, rounds=7)
    else:
        benchmark.pedantic(run, args=(*job, options), rounds=7)


@pytest.mark.benchmark(group="live, 15 states")
def test_live_navigator_from_python(benchmark, filter_job):
    inc, schedule, initial, lay, gyro, accel = filter_job(15)
    rows = list(zip(inc.t[:20_000], inc.dtheta_ib_b[:20_000], inc.dv_ib_b[:20_000], strict=True))
    aids = [(t, schedule.where(schedule.t == t)) for t in np.unique(schedule.t[schedule.t < 200.0])]

    def live() -> None:
        navigator = Navigator(initial, lay, gyro, accel, interval_s=0.01)
        k = 0
        for t, dtheta, dv in rows:
            if k < len(aids) and aids[k][0] <= t:
                navigator.aid(aids[k][1])
                k += 1
            navigator.imu(t, dtheta, dv)

    benchmark.extra_info["epochs"] = len(rows)
    benchmark.pedantic(live, rounds=5, warmup_rounds=1)


@pytest.mark.benchmark(group="live, 15 states")
def test_live_step_without_python(benchmark, filter_job):
    """The compiled step alone: one kernel call an epoch, made from a compiled loop over one-sample slices."""
    import numba

    from schuler.filtering.engine import FilterState
    from schuler.filtering.filter_arrays import ImuStream
    from schuler.filtering.kernels import run as k

    inc, _, initial, lay, gyro, accel = filter_job(15)
    state = FilterState(initial, lay, gyro, accel, FilterOptions(), 0.01)
    navigator = Navigator(initial, lay, gyro, accel, interval_s=0.01)
    none, out = navigator._no_measurement, navigator._out

    @numba.njit(nogil=True)
    def loop(dtheta, dv, dt, t, none, arrays, model, settings, work, out):
        for i in range(len(t)):
            part = slice(i, i + 1)
            stream = ImuStream(dtheta[part], dv[part], dt[part], t[part], False)
            k.run_filter(stream, none, arrays, model, settings, work, out[0], out[1], out[2])

    log = (inc.dtheta_ib_b[:20_000], inc.dv_ib_b[:20_000], inc.dt[:20_000], inc.t[:20_000])
    args = (*log, none, state.arrays, state.model, state.settings, state.work, out)
    loop(*args)
    benchmark.extra_info["epochs"] = 20_000
    benchmark.pedantic(loop, args=args, rounds=5)
