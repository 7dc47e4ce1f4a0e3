"""Zero-velocity filters on the turntable: an independent check's anchors, a twelve-state filter of our own in Du's
axes, runs.
"""

from functools import cache

import numpy as np
import pytest

from schuler import earth
from schuler.exceptions import InputError
from schuler.montecarlo.lanes.run import run_lanes
from schuler.navigation.evaluation.consistency import chi_square_band
from schuler.reproduce.du.study.imus import FILTER_IMUS, MTI_G, NAV440, TAU_S
from schuler.reproduce.du.study.tables import ANCHORS, MEASURED
from schuler.reproduce.du.study.zupt import CASES, PLACE, TABLE_RATE, TableCase, zupt_sigmas, zupt_study
from schuler.reproduce.du.study.zupt_runs import table_unit, zupt_emulation, zupt_runs, zupt_scenario
from schuler.rotary.du_axes import swap_vector
from schuler.units import DEG, DEG_PER_HR


@cache
def study():
    return zupt_study()


def test_every_anchor_is_met():
    """Printed digits, and the 20 % the issue allows; 2.5 % is seen wherever two digits are printed."""
    for row in study().comparison().rows:
        quantity, ratio, agrees = row[2], row[5], row[6]
        assert agrees, row
        if ratio is not None and not quantity.startswith("b_"):
            assert ratio == pytest.approx(1.0, abs=0.045), row  # one printed digit of 7 deg/h


def test_anchors_are_all_there():
    rows = study().comparison().rows
    assert len(rows) == 8 * len(ANCHORS) == 72
    assert len({row[:2] for row in rows}) == 9


def twelve_states(imu, case, step=0.1):
    """Du's filter in ENU and RFU from chapter 5's equations, corrected; no code of the package but the Earth's radii.

    States: velocity, attitude, gyroscope bias, accelerometer bias.
    """
    lat = float(PLACE[0])
    M, N = (float(r) for r in earth.radii_of_curvature(lat))
    W, g = earth.WGS84.omega_ie, float(np.linalg.norm(earth.gravity_ned(lat, 0.0)))
    s, c = np.sin(lat), np.cos(lat)
    F = np.zeros((12, 12))
    F[0, [1, 2, 4]] = 2.0 * W * s, -2.0 * W * c, g
    F[1, [0, 3]] = -2.0 * W * s, -g
    F[2, 0] = 2.0 * W * c
    F[3, [1, 4, 5]] = 1.0 / M, W * s, -W * c
    F[4, [0, 3]] = -1.0 / N, -W * s
    F[5, [0, 3]] = -np.tan(lat) / N, W * c
    gyro, accel = imu.spec.gyro, imu.spec.accel
    P = np.diag(np.repeat([0.01, DEG, gyro.turn_on_bias, accel.turn_on_bias], 3) ** 2)
    walk = [2.0 * t.in_run_bias**2 / TAU_S for t in (gyro, accel)]
    q = np.repeat([accel.random_walk**2, gyro.random_walk**2, *walk], 3)
    H, R = np.eye(3, 12), 1e-4 * np.eye(3)
    pitch = case.tilt_deg * DEG
    # forward points north and up by the pitch: rotation about east, nose up
    C_nb = np.array([[1, 0, 0], [0, np.cos(pitch), -np.sin(pitch)], [0, np.sin(pitch), np.cos(pitch)]])
    for k in range(round(case.duration_s / step)):
        beta = 0.0 if case.axis is None else TABLE_RATE * step * (k + 0.5)
        cb, sb = np.cos(beta), np.sin(beta)
        C_bs = np.eye(3)
        if case.axis == "Z":
            C_bs = np.array([[cb, -sb, 0], [sb, cb, 0], [0, 0, 1]])
        elif case.axis == "Y":
            C_bs = np.array([[cb, 0, sb], [0, 1, 0], [-sb, 0, cb]])
        C = C_nb @ C_bs
        Fk = F.copy()
        Fk[0:3, 9:12] = Fk[3:6, 6:9] = C
        A = step * Fk
        Phi = np.eye(12) + A + 0.5 * A @ A
        Q = np.diag(q * step)
        P = Phi @ (P + 0.5 * Q) @ Phi.T + 0.5 * Q
        if (k + 1) % round(1.0 / step) == 0:
            K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
            I_KH = np.eye(12) - K @ H
            P = I_KH @ P @ I_KH.T + K @ R @ K.T
    return np.sqrt(np.diag(P))


@pytest.mark.parametrize("imu", [NAV440, MTI_G], ids=lambda i: i.name)
@pytest.mark.parametrize("case", CASES, ids=lambda c: c.name)
def test_the_engine_is_the_twelve_state_filter(imu, case):
    sigma = twelve_states(imu, case)
    ours = study().of(imu.name, case.axis, case.tilt_deg)
    seen = np.concatenate((ours.tilt[-1], ours.azimuth[-1:], ours.b_g[-1], ours.b_a[-1]))
    # discretisation: 0.1 s steps of a rotation by 1 deg; position states, gravity's gradient
    np.testing.assert_allclose(seen, sigma[3:], rtol=0.01)


def test_what_the_thesis_concludes():
    for imu in ("MTi-G", "NAV440"):
        still, level, tilted = (study().of(imu, *c) for c in ((None, 0.0), ("Z", 0.0), ("Z", 30.0)))
        y_level, y_tilted = study().of(imu, "Y", 0.0), study().of(imu, "Y", 30.0)
        # rotation with a tilt shows all but the azimuth
        for good in (tilted, y_tilted):
            assert good.tilt[-1].max() < 0.06 * DEG
            assert good.b_a[-1].max() < 0.002
            assert good.azimuth[-1] > 0.9 * DEG
        # level Z is no better than none in tilt and b, worse in d_x, d_y
        assert np.all(level.tilt[-1] > 5.0 * tilted.tilt[-1])
        assert np.all(level.b_g[-1, :2] > 10.0 * still.b_g[-1, :2])
        # Y at pitch zero: b_y and pitch (about east) stay
        assert y_level.b_a[-1, 1] > 50.0 * y_level.b_a[-1, 0]
        assert y_level.tilt[-1, 0] > 5.0 * y_level.tilt[-1, 1]


@pytest.mark.parametrize(("axis", "tilt"), [("Y", 0.0), ("Y", 30.0), ("Z", 30.0)])
def test_nees_is_in_band_in_the_rotating_frame(axis, tilt):
    """Biases of both signs, drawn; NAV440, whose angles stay small (of level Z the heading does not)."""
    runs = 32
    records = run_lanes(zupt_scenario(NAV440, TableCase(axis, tilt), noisy=True), runs, seed=3)
    assert not records.diverged.any()
    low, high = chi_square_band(15, runs, 0.9999)
    for at in (60, 150, 299):
        assert low < records.nees["all"][:, at].mean() < high  # statistical
    # three components each second, of every run
    low, high = chi_square_band(3 * 300 * runs, 1, 0.9999)
    assert low < records.nis[:, 1].mean() < high
    z = records.error[:, -1, 9:] / records.sigma[:, -1, 9:]
    assert np.all(np.abs(z) < 4.5)  # statistical, 192 values
    assert 0.3 < np.mean(records.error[:, 0, 9:] > 0.0) < 0.7


def test_emulated_unit_is_read_from_the_tables():
    unit = table_unit(NAV440, "Z")
    turning = swap_vector(unit.M_g @ swap_vector([0.0, 0.0, TABLE_RATE]))
    seen = swap_vector(unit.b_g) + turning
    np.testing.assert_allclose(seen / DEG_PER_HR, MEASURED["NAV440", "Z", 30.0].d_deg_hr, rtol=1e-12)
    # an independent reading of the same difference: 2.6e-3 and 1.0e-3
    np.testing.assert_allclose(turning[:2] / TABLE_RATE, (2.65e-3, 1.01e-3), rtol=0.01)


@pytest.mark.parametrize(
    ("imu", "test"), [("NAV440", "Y"), ("MTi-G", "Z"), pytest.param("NAV440", "Z", marks=pytest.mark.slow)]
)
def test_the_measured_pattern_comes_out(imu, test):
    """Mean biases of tilted runs; what stays unknown in the others scatters as much as the thesis's differ."""
    done = zupt_emulation([(imu, test, None), (imu, test, 0.0), (imu, test, 30.0)], runs=16)
    still, level, tilted = done.runs
    for run in (tilted,):
        ours, theirs, spread = run.emulated(), run.measured, run.spread()
        limit = 4.0 * np.array(spread.b_m_s2) / 4.0 + 5e-4  # statistical, and printed digits
        assert np.all(np.abs(np.subtract(ours.b_m_s2, theirs.b_m_s2)) < limit)
        assert np.all(np.abs(np.subtract(ours.d_deg_hr, theirs.d_deg_hr)) < 4.0 * np.array(spread.d_deg_hr) / 4.0 + 1.0)
        # roll and pitch: 0.03 and 0.04 or 0.08 deg printed
        assert 0.4 < ours.attitude_deg[0] / theirs.attitude_deg[0] < 1.5
        assert 0.4 < ours.attitude_deg[1] / theirs.attitude_deg[1] < 1.5
    assert min(still.emulated().attitude_deg[:2]) > 5.0 * max(tilted.emulated().attitude_deg[:2])
    assert still.emulated().attitude_deg[2] > 3.0 * tilted.emulated().attitude_deg[2]
    unseen = level.spread().b_m_s2[1]
    assert unseen > 20.0 * tilted.spread().b_m_s2[1]
    # run by run: of biases the mean is the same, of RMS the mean is a little less than the RMS of all
    b, rms, d = tilted.by_run()
    np.testing.assert_allclose(b.mean(axis=0), tilted.emulated().b_m_s2, rtol=1e-9)
    np.testing.assert_allclose(d.mean(axis=0), tilted.emulated().d_deg_hr, rtol=1e-9)
    np.testing.assert_allclose(np.sqrt(np.mean(rms**2, axis=0)), tilted.emulated().attitude_deg, rtol=1e-9)
    table = done.table()
    assert len(table) == 9
    assert "by construction" in done.summary()


@pytest.mark.slow
def test_all_rows_of_the_tables():
    done = zupt_emulation(runs=96)
    assert len(done.runs) == 12
    for run in done.runs:
        if run.case.tilt_deg == 30.0:
            np.testing.assert_allclose(run.emulated().b_m_s2, run.measured.b_m_s2, atol=1.5e-3)


def test_names_that_are_none():
    with pytest.raises(InputError, match="NAV440"):
        zupt_study(["NAV441"])
    with pytest.raises(InputError, match="no row"):
        zupt_runs("NAV440", "Y", 10.0)
    with pytest.raises(InputError, match="no case"):
        study().of("NAV440", "X", 5.0)


def test_summaries():
    s = zupt_sigmas(FILTER_IMUS["NAV440"], TableCase("X", 10.0, 20.0))
    assert s.case.name == "X, tilt 10"
    assert study().to_dict()["rows"][0]["imu"] == "MTi-G"
    assert "azimuth_deg" in study().summary()
