"""Runs of a navigation campaign: simulate, navigate, compare with the truth."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from schuler import frames, rotation
from schuler.arrays import FloatArray, IntArray
from schuler.exceptions import InputError
from schuler.filtering.initial_state import InitialState
from schuler.mechanization.strapdown import NavState
from schuler.montecarlo.functions import RunFunction, traits
from schuler.montecarlo.job import Engine, NavigationJob, Plan
from schuler.navigation.evaluation.consistency import attitude_difference
from schuler.navigation.result import NavigationResult
from schuler.navigation.run import navigate
from schuler.simulation.scenario import simulate_mission

#: Of the drawn start among the children of a run's seed, far from those that the simulation takes.
_START = 1 << 20
_SAME = 1e-5  # records and looks are at the same time: a thousandth of a sample, or what a car drives in 0.3 mm [s]


def navigation_run(job: NavigationJob, seed: np.random.SeedSequence) -> dict[str, Any]:
    """One run: IMU errors, noise and aids are drawn, navigated by the filter, compared with the truth.

    Parameters
    ----------
    job : NavigationJob
    seed : SeedSequence

    Returns
    -------
    dict
        At the times of ``job.plan.t``: ``attitude`` (rotation vector) [rad], ``velocity`` [m/s] and ``position`` [m],
        errors north, east, down, shape (k, 3); ``sigma_attitude``, ``sigma_velocity``, ``sigma_position``, what the
        filter says of them; ``horizontal``, distance to the truth [m], and ``nees``, normalised square of the nine
        errors per degree of freedom, shape (k,). Over the run: ``rms_horizontal`` [m], ``nis``, mean normalised
        innovation squared per degree of freedom where there were measurements, and ``rejected``, how many of them were.

    Raises
    ------
    InputError
        If this run cannot be navigated, or is aligned so late that times are missing.
    """
    plan = job.plan
    # a copy: a sequence remembers how many children it gave, and the same seed must give the same run again
    fresh = np.random.SeedSequence(seed.entropy, spawn_key=seed.spawn_key)
    simulation = simulate_mission(plan.mission, np.random.default_rng(fresh))
    result = navigate(simulation.recording, plan.config.untuned(), initial=_drawn(plan, seed))
    if not result.complete:
        raise KeyboardInterrupt
    at = np.minimum(np.searchsorted(result.t, plan.t - _SAME), len(result.t) - 1)
    if np.any(np.abs(result.t[at] - plan.t) > _SAME):
        raise InputError(
            f"this run is known from {result.t[0]:.2f} to {result.t[-1]:.2f} s and is looked at from {plan.t[0]:.2f} "
            f"to {plan.t[-1]:.2f} s: was it aligned late? Raise evaluation.settle_s"
        )
    error, P = _errors(result, at, plan)
    seen = np.isfinite(result.innovations.nis)
    return {
        **error_columns(error, np.sqrt(np.einsum("nii->ni", P)), _nees(error, P)),
        **({"nis": result.innovations.mean_nis()} if seen.any() else {}),
        "rejected": sum(result.innovations.rejected().values()),
    }


def _errors(result: NavigationResult, at: IntArray, plan: Plan) -> tuple[FloatArray, FloatArray]:
    """Navigation errors north, east, down at records, and what is claimed of them. Shapes (k, 9), (k, 9, 9)."""
    s, truth = result.states, plan.truth
    dx = np.concatenate(
        (attitude_difference(s.q_eb[at], truth.q_eb), s.v_eb_e[at] - truth.v_eb_e, s.r_eb_e[at] - truth.r_eb_e), axis=1
    )
    C = np.swapaxes(frames.C_en(truth.llh), 1, 2)
    T = np.zeros((len(at), 9, 9))
    for k in (0, 3, 6):
        T[:, k : k + 3, k : k + 3] = C
    P: FloatArray = T @ result.filter_covariance_e(at)[:, :9, :9] @ np.swapaxes(T, 1, 2)
    return np.einsum("nij,nj->ni", T, dx), P


@traits(batched=True, threads=True, preferred=8)
def lane_runs(job: NavigationJob, seeds: Sequence[np.random.SeedSequence]) -> dict[str, Any]:
    """Many runs in lock-step, see :mod:`schuler.montecarlo.lanes.run`: the same columns as :func:`navigation_run`.

    Raises
    ------
    InputError
        If lanes cannot do this job.
    """
    from schuler.montecarlo.lanes.run import run_lanes

    scenario = job.lanes
    if isinstance(scenario, str):
        raise InputError(scenario)
    numbers = [int(s.spawn_key[-1]) for s in seeds]
    entropy = seeds[0].entropy
    assert isinstance(entropy, int)
    records = run_lanes(scenario, numbers, seed=entropy, threads=1)
    at = np.searchsorted(records.t, job.plan.t - 1e-6)
    error = np.where(records.diverged[:, None, None], np.nan, records.error[:, at, :9])
    columns = error_columns(error, records.sigma[:, at, :9], records.nees["navigation"][:, at])
    weight = np.where(np.isfinite(records.nis), records.accepted + records.rejected, 0)
    measured = weight.sum(axis=1)
    if np.all(measured > 0):
        columns["nis"] = np.sum(np.where(weight > 0, records.nis, 0.0) * weight, axis=1) / measured
    columns["rejected"] = records.rejected.sum(axis=1)
    return columns


def runner(job: NavigationJob, engine: Engine = "auto") -> tuple[RunFunction, str]:
    """The function that does a job's runs, and a sentence on why it is that one.

    Raises
    ------
    InputError
        If lanes are asked for and cannot do it.
    """
    if engine == "filter":
        return navigation_run, "every run goes through the whole of simulation and navigation, as asked for"
    scenario = job.lanes
    if not isinstance(scenario, str):
        return lane_runs, "runs go through the filter in lock-step (lanes)"
    if engine == "lanes":
        raise InputError(f"engine: {scenario}")
    return navigation_run, f"every run goes through the whole of simulation and navigation: {scenario}"


def error_columns(error: FloatArray, sigma: FloatArray, nees: FloatArray) -> dict[str, FloatArray]:
    """Columns of errors and claimed sigmas, of one run (k, 9) or of many (n, k, 9)."""
    horizontal = np.hypot(error[..., 6], error[..., 7])
    return {
        "attitude": error[..., 0:3], "velocity": error[..., 3:6], "position": error[..., 6:9],
        "sigma_attitude": sigma[..., 0:3], "sigma_velocity": sigma[..., 3:6], "sigma_position": sigma[..., 6:9],
        "horizontal": horizontal, "nees": nees, "rms_horizontal": np.sqrt(np.mean(horizontal**2, axis=-1)),
    }  # fmt: skip


def _nees(error: FloatArray, P: FloatArray) -> FloatArray:
    scale = np.sqrt(np.einsum("kii->ki", P))  # in units of sigma: positions and angles differ by 1e6
    z = error / scale
    correlation = P / (scale[:, :, None] * scale[:, None, :])
    squared = np.einsum("ki,ki->k", z, np.linalg.solve(correlation, z[:, :, None])[:, :, 0])
    return np.asarray(squared / error.shape[1])


def _drawn(plan: Plan, seed: np.random.SeedSequence) -> InitialState | None:
    """The true start with errors drawn from its covariance."""
    if plan.initial is None:
        return None
    rng = np.random.default_rng(np.random.SeedSequence(seed.entropy, spawn_key=(*seed.spawn_key, _START)))
    nav, P = plan.initial.nav, plan.initial.P
    dx = np.sqrt(np.diag(P)[:9]) * rng.standard_normal(9)
    C = frames.C_en(nav.llh)
    start = NavState(
        nav.t,
        nav.r_eb_e + C @ dx[6:9],
        nav.v_eb_e + C @ dx[3:6],
        rotation.quat_multiply(rotation.quat_from_rotvec(C @ dx[0:3]), nav.q_eb),
    )
    return InitialState(start, P, plan.initial.parameters)
