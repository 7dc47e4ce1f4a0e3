"""One run of a scenario: a rotating IMU simulated with its errors, and navigated alone or through the filter."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from schuler import frames, rotation
from schuler.arrays import FloatArray
from schuler.budget.scenario import rotation_of_start
from schuler.budget.sources import filter_layout
from schuler.filtering.initial_state import InitialState
from schuler.mechanization.strapdown import NavState
from schuler.recording.recording import Recording
from schuler.recording.series import GnssSeries
from schuler.recording.trajectory import FullTrajectory
from schuler.rotary.du_axes import enu_errors
from schuler.rotary.encoder import Platform, read_encoder
from schuler.rotary.free_navigation import ErrorHistory, error_history
from schuler.rotary.mechanization import mechanize_rotating
from schuler.rotary.navigation import navigate_rotary
from schuler.rotary.rotating_imu import RotatingMotion, vehicle_truth
from schuler.rotary.search.scenario import RotaryScenario
from schuler.sensors.errors import ImuErrors
from schuler.simulation.gnss import GnssModel, draw_gnss
from schuler.simulation.imu import IdealImu, simulate_imu
from schuler.simulation.scalar_aids import HeightModel, simulate_height
from schuler.units import DEG

_STEP = 0.25  # of the errors that are kept [s]


def one_run(scenario: RotaryScenario, motion: RotatingMotion, ideal: IdealImu, k: int) -> ErrorHistory:
    """One realisation, simulated and navigated.

    Parameters
    ----------
    scenario : RotaryScenario
    motion : RotatingMotion
        Its schedule counts, not that of the scenario.
    ideal : IdealImu
        Ideal IMU on that motion.
    k : int
        Number of the run: errors and noise are the same for every schedule.

    Returns
    -------
    ErrorHistory
        Errors of the vehicle, every quarter of a second; attitude against Earth-fixed axes.
    """
    seeds = np.random.SeedSequence([scenario.seed, k]).spawn(5)
    errors_rng, noise_rng, start_rng, gnss_rng, encoder_rng = (np.random.default_rng(s) for s in seeds)
    spec = scenario.imu.spec()
    imu = simulate_imu(ideal, ImuErrors.draw(spec, errors_rng), noise_rng).imu
    platform: Platform = motion.schedule
    if motion.schedule.breakpoints(0.0, motion.duration).size or np.any(motion.schedule.rates(np.zeros(1))):
        section = scenario.rotary.encoder
        platform = read_encoder(
            motion.schedule, section.build(), motion.duration, encoder_rng, between=section.between
        )  # fmt: skip
    start, sigma = _start(scenario, motion, start_rng)
    offset = motion.offset_m
    earth = scenario.motion.earth_rotation
    if scenario.alone:
        solved = mechanize_rotating(imu.increments(), start, platform, offset_m=offset, earth_rotation=earth)
    else:
        layout = filter_layout(spec, scenario.states)
        initial = InitialState.from_sigmas(
            start, layout, attitude=sigma, velocity=scenario.start.velocity_m_s, position=scenario.start.position_m
        )
        height = None
        if (h := scenario.height) is not None:
            model = HeightModel(rate_hz=h.rate_hz, sigma=h.sigma_m)
            height = simulate_height(motion.vehicle, model, gnss_rng.spawn(1)[0])[0]
        recording = Recording(imu, _gnss(scenario, motion, gnss_rng), height=height)
        solved = navigate_rotary(
            recording, platform, _configuration(scenario), offset_m=offset, initial=initial
        ).trajectory  # fmt: skip
    return _thinned(solved, motion)


def _start(scenario: RotaryScenario, motion: RotatingMotion, rng: np.random.Generator) -> tuple[NavState, FloatArray]:
    """A start of the vehicle that is wrong by what the scenario says, and covariance of its attitude (3, 3)."""
    s, given = motion.vehicle.state(np.zeros(1)), scenario.start
    z = rng.standard_normal(9)
    T = rotation_of_start(motion.vehicle)
    C_en = frames.C_en(frames.llh_from_ecef(s.r_eb_e))[0]
    sigma = np.array(given.attitude_deg) * DEG
    wrong = C_en @ (T @ (sigma * z[:3]))
    q = rotation.quat_multiply(rotation.quat_from_rotvec(wrong), rotation.quat_from_dcm(s.C_eb[0]))
    v = s.v_eb_e[0] + C_en @ (np.array(given.velocity_m_s) * z[3:6])
    r = s.r_eb_e[0] + C_en @ (np.array(given.position_m) * z[6:9])
    return NavState(0.0, r, v, q), T @ np.diag(sigma**2) @ T.T


def _gnss(scenario: RotaryScenario, motion: RotatingMotion, rng: np.random.Generator) -> GnssSeries | None:
    g = scenario.gnss
    if g is None:
        return None
    model = GnssModel(
        rate_hz=g.rate_hz, sigma_position=g.sigma_position_m,
        sigma_velocity=g.sigma_velocity_m_s or (0.05, 0.05, 0.1), lever_arm_b=g.lever_arm_m, first_s=1.0 / g.rate_hz,
    )  # fmt: skip
    return draw_gnss(motion.vehicle, model, rng).gnss


def _configuration(scenario: RotaryScenario) -> dict[str, Any]:
    """What ``schuler navigate`` would be told: the same filter as that of the covariance."""
    layout = filter_layout(scenario.imu.spec(), scenario.states)
    models = {
        block: {"sigma": m.sigma, "noise": m.noise, **({} if m.tau is None else {"tau_s": m.tau})}
        for block, m in layout.models.items()
    }
    config: dict[str, Any] = {
        "imu": scenario.imu.source(),
        "filter": {
            "states": tuple(layout.models), "models": models, "smooth": False,
            "earth_rotation": scenario.motion.earth_rotation,
        },
        "outages": {"windows_s": scenario.outages},
    }  # fmt: skip
    if (g := scenario.gnss) is not None:
        config["gnss"] = {"lever_arm_m": g.lever_arm_m, "velocity": g.sigma_velocity_m_s is not None}
    aiding: dict[str, Any] = {}
    if (z := scenario.zero_velocity) is not None:
        aiding["zero_velocity"] = {"sigma_m_s": z.sigma_m_s, "rate_hz": z.rate_hz}
    if scenario.height is not None:
        aiding["barometer"] = {"bias_sigma_m": 0.0}
    return {**config, "aiding": aiding} if aiding else config


def _thinned(solved: FullTrajectory, motion: RotatingMotion) -> ErrorHistory:
    stride = max(round(_STEP / float(np.median(np.diff(solved.t)))), 1)
    at = np.arange(stride - 1, len(solved.t), stride)
    kept = solved.samples(at)
    true = vehicle_truth(motion, kept.t)
    # against Earth-fixed axes, as covariances have it: a place that is wrong by kilometres has another horizon
    in_true_n = np.swapaxes(frames.C_en(true.llh), 1, 2) @ rotation.dcm_from_quat(kept.q_eb)
    return replace(error_history(kept, true), attitude=enu_errors(in_true_n, true.C_nb))
