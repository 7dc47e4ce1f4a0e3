"""Runners that a tuning is judged by: simulated figure-eights, and a recording in two parts."""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from schuler.exceptions import InputError
from schuler.navigation.config import ModelSection, NavigationConfig
from schuler.navigation.evaluation.consistency import nees, state_errors
from schuler.navigation.result import NavigationResult
from schuler.navigation.run import navigate
from schuler.navigation.states import imu_spec, state_layout
from schuler.recording.recording import Recording
from schuler.reproduce.stefanisko.study.experiment import FigureEight, Track, figure_eight_run
from schuler.reproduce.stefanisko.study.tuning import Factors, Runner, Score, likelihood
from schuler.sensors.spec_file import write_spec


def figure_eight_runner(case: FigureEight, runs: int, seed: int = 1) -> Runner:
    """Runner over simulated figure-eights; factors multiply those of the case. Other seeds are out-of-sample."""
    track = Track.of(case)

    def score(factors: Factors) -> Score:
        changed = replace(
            case, p0_factor=case.p0_factor * factors.p0, q_factor=case.q_factor * factors.q,
            r_factor=case.r_factor * factors.r,
        )  # fmt: skip
        moved = replace(track, case=changed)
        scores = []
        for child in np.random.SeedSequence(seed).spawn(runs):
            result, biases = figure_eight_run(moved, np.random.default_rng(child))
            if not result.complete:
                raise KeyboardInterrupt
            value = float(np.mean(nees(result, track.reference, biases)))
            scores.append(replace(likelihood(result.innovations), nees=value))
        return Score.mean(scores)

    return score


def recording_runners(
    recording: Recording, config: NavigationConfig | dict[str, Any] | Path | str, *, split: float = 0.5
) -> tuple[Runner, Runner]:
    """Runners over the first and the last part of one recording: in-sample and out-of-sample.

    Parameters
    ----------
    recording : Recording
    config : NavigationConfig, dict, or path of a TOML file
        Its outages stay: without some, Q hardly shows in the innovations of frequent fixes.
    split : float
        Share of the time that is in-sample.

    Returns
    -------
    in_sample, out_of_sample : callable
        The filter runs over all of the recording in both; a causal filter knows nothing of what comes later.

    Notes
    -----
    P0 multiplies the initial variances of the parameter blocks and of levelling and course; the rest of the initial
    state comes with the covariance of its fix. Q multiplies the white noise of the IMU and of the blocks. R multiplies
    the receiver's variances and their floors. Receiver clocks and the noise of other aids keep theirs.
    """
    config = NavigationConfig.checked(config)
    if not 0.0 < split < 1.0:
        raise InputError(f"split: expected a share between 0 and 1, got {split}")
    base = config.model_copy(update={"filter": config.filter.model_copy(update={"smooth": False, "tune": False})})
    limit = recording.start + split * (recording.stop - recording.start)
    runs: dict[Factors, NavigationResult] = {}

    def run(factors: Factors) -> NavigationResult:
        if factors not in runs:
            with tempfile.TemporaryDirectory() as folder:
                result = navigate(recording, with_factors(base, factors, Path(folder) / "imu.toml"))
            if not result.complete:
                raise KeyboardInterrupt
            runs[factors] = result
        return runs[factors]

    def scored(factors: Factors, first: bool) -> Score:
        result = run(factors)
        part = result.innovations
        score = likelihood(part.where((part.t < limit) == first))
        reference = recording.reference
        if reference is None or reference.v_eb_e is None or reference.q_eb is None:
            return score
        t = state_errors(result, reference)[0]
        inside = (t < limit) == first
        return replace(score, nees=float(np.mean(nees(result, reference)[inside])) if inside.any() else None)

    return (lambda f: scored(f, True)), (lambda f: scored(f, False))


def with_factors(config: NavigationConfig, factors: Factors, spec_file: Path) -> NavigationConfig:
    """The configuration with its variances multiplied; writes the IMU's budget to a file that it then names."""
    root_p, root_q, root_r = (float(np.sqrt(x)) for x in (factors.p0, factors.q, factors.r))
    spec = imu_spec(config)
    scaled = replace(
        spec,
        gyro=replace(spec.gyro, random_walk=root_q * spec.gyro.random_walk),
        accel=replace(spec.accel, random_walk=root_q * spec.accel.random_walk),
    )
    write_spec(spec_file, scaled)
    states = state_layout(config, spec).models
    models = {n: ModelSection(sigma=root_p * m.sigma, noise=root_q * m.noise, tau_s=m.tau) for n, m in states.items()}
    g, a = config.gnss, config.alignment
    return config.model_copy(
        update={
            "imu": config.imu.model_copy(update={"catalogue": None, "spec": str(spec_file), "gyro": {}, "accel": {}}),
            "filter": config.filter.model_copy(update={"models": models}),
            "gnss": g.model_copy(
                update={
                    "sigma_scale": root_r * g.sigma_scale,
                    "position_sigma_floor_m": tuple(root_r * x for x in g.position_sigma_floor_m),
                    "velocity_sigma_floor_m_s": tuple(root_r * x for x in g.velocity_sigma_floor_m_s),
                }
            ),
            "alignment": a.model_copy(
                update={
                    "tilt_floor_deg": root_p * a.tilt_floor_deg,
                    "sideslip_deg": root_p * a.sideslip_deg,
                    "sigma_deg": tuple(root_p * x for x in a.sigma_deg),
                }
            ),
        }
    )
