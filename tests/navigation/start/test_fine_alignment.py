"""Fine alignment at rest: it reaches the limit that physics sets, and says so."""

from __future__ import annotations

import filter_cases as cases
import numpy as np
import pytest

from schuler import earth, rotation, units
from schuler.exceptions import InputError
from schuler.filtering.states import layout_for
from schuler.mechanization.alignment import gyrocompass
from schuler.navigation.evaluation.consistency import chi_square_band, state_errors
from schuler.navigation.start.fine_alignment import fine_alignment
from schuler.recording.series import Increments
from schuler.sensors.spec import ImuSpec, TriadSpec
from schuler.simulation.imu import truth
from schuler.simulation.motion import StaticMotion, ideal_increments

SPEC = ImuSpec(
    "navigation grade",
    TriadSpec.gyro(arw_deg_rthr=0.003, bias_deg_hr=0.02),
    TriadSpec.accelerometer(vrw_m_s_rthr=0.003, bias_ug=50.0),
)


@pytest.fixture(scope="module")
def rest():
    motion = StaticMotion(cases.ORIGIN, np.array([0.05, -0.03, 0.8]), 600.0)
    t = np.linspace(0.0, 600.0, 30_001)
    return Increments(t[1:], np.diff(t), *ideal_increments(motion, t)), truth(motion, np.arange(0.0, 601.0))


def test_fine_alignment_reaches_the_gyro_limit(rest):
    ideal, true = rest
    lay = layout_for(SPEC, 15)
    z, final = [], []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        b_g, b_a = SPEC.gyro.turn_on_bias * rng.standard_normal(3), SPEC.accel.turn_on_bias * rng.standard_normal(3)
        h, n = ideal.dt[:, None], len(ideal)
        log = Increments(
            ideal.t,
            ideal.dt,
            ideal.dtheta_ib_b + b_g * h + SPEC.gyro.random_walk * np.sqrt(h) * rng.standard_normal((n, 3)),
            ideal.dv_ib_b + b_a * h + SPEC.accel.random_walk * np.sqrt(h) * rng.standard_normal((n, 3)),
        )
        first = log.between(0.0, 60.0)
        noise = SPEC.gyro.random_walk / np.sqrt(60.0)
        coarse = gyrocompass(
            first.dtheta_ib_b.sum(0) / 60.0, first.dv_ib_b.sum(0) / 60.0, float(cases.ORIGIN[0]),
            sigma_gyro_bias=SPEC.gyro.turn_on_bias, sigma_gyro_noise=noise, sigma_accel_bias=SPEC.accel.turn_on_bias,
        )  # fmt: skip
        # the coarse attitude comes from the first minute, the filter runs over the rest: no data used twice
        initial, result = fine_alignment(log.between(60.0, 600.0), cases.ORIGIN, coarse, SPEC, lay)
        _, dx, P = state_errors(result, true)
        z.append(dx[-1, :3] @ np.linalg.solve(P[-1, :3, :3], dx[-1, :3]) / 3.0)
        C = rotation.dcm_from_quat(true.q_nb[0])
        final.append(rotation.rotvec_from_dcm(rotation.dcm_from_quat(initial.nav.q_nb) @ C.T))
    low, high = chi_square_band(3, 40, 0.9999)
    assert low < np.mean(z) < high  # statistical
    spread = np.sqrt(np.mean(np.square(final), axis=0))
    limit = SPEC.gyro.turn_on_bias / (earth.WGS84.omega_ie * np.cos(cases.ORIGIN[0]))
    assert spread[2] == pytest.approx(limit, rel=0.45)  # 4 standard errors of a spread from 40 runs
    assert spread[0] == pytest.approx(SPEC.accel.turn_on_bias / 9.81, rel=0.45)
    assert np.sqrt(initial.P[2, 2]) == pytest.approx(limit, rel=0.15)
    assert units.DEG * 0.05 < limit < units.DEG * 0.2


def test_a_moment_at_rest_is_too_short(rest):
    ideal, _ = rest
    coarse = gyrocompass(ideal.dtheta_ib_b[0] / ideal.dt[0], ideal.dv_ib_b[0] / ideal.dt[0], float(cases.ORIGIN[0]))
    with pytest.raises(InputError, match=r"needs at least 5 s at rest, got 3\.00 s"):
        fine_alignment(ideal.between(0.0, 3.0), cases.ORIGIN, coarse, SPEC, layout_for(SPEC, 15))
