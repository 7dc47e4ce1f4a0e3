"""Hayal's simulation study: attitudes, Tables 4.2 to 4.5, sweeps, scenarios, and the plain iteration's failures."""

import re
from dataclasses import replace

import numpy as np
import pytest
from places import ROOT
from scipy.stats import chi2

from schuler.calibration.bench.sensor_geometry import PARAMETERS
from schuler.calibration.design.plans import ATTITUDES, design_matrix
from schuler.earth import WGS84
from schuler.exceptions import InputError
from schuler.reproduce.hayal.study.attitudes import (
    attitude_rotation,
    ordered_attitudes,
    scenario,
    study_attitudes,
)
from schuler.reproduce.hayal.study.multiposition import (
    GRAVITY,
    LATITUDE,
    NOISE,
    TRUTH,
    StudyCase,
    run_case,
    scenario_grid,
    simulated_readings,
    sweep,
)
from schuler.reproduce.hayal.study.tables import FACTOR, table_rows
from schuler.units import DEG

W = WGS84.omega_ie


def test_rotation_is_the_product_of_the_source():
    def r(i, t):
        c, s = np.cos(t), np.sin(t)
        return (
            [[1, 0, 0], [0, c, s], [0, -s, c]], [[c, 0, -s], [0, 1, 0], [s, 0, c]], [[c, s, 0], [-s, c, 0], [0, 0, 1]]
        )[i]  # fmt: skip

    e, x, a = 0.3, -0.4, 0.5
    expected = np.array(r(2, a)) @ r(1, x) @ r(0, e)
    np.testing.assert_allclose(attitude_rotation((e, x, a)), expected, atol=1e-15)
    np.testing.assert_array_equal(attitude_rotation(np.full((2, 3), 0.1))[1], attitude_rotation((0.1, 0.1, 0.1)))


def test_attitudes_put_each_direction_down():
    C = study_attitudes(ATTITUDES, 20.0 * DEG, 0.0)
    np.testing.assert_allclose(C @ (0.0, 0.0, 1.0), ATTITUDES, atol=1e-15)
    np.testing.assert_allclose(C @ np.swapaxes(C, 1, 2), np.tile(np.eye(3), (26, 1, 1)), atol=1e-14)
    np.testing.assert_allclose(np.linalg.det(C), 1.0)
    level = int(np.flatnonzero(ATTITUDES[:, 2] > 0.99)[0])
    np.testing.assert_allclose(C[level] @ (1.0, 0.0, 0.0), (np.cos(20 * DEG), -np.sin(20 * DEG), 0.0), atol=1e-15)


def test_disturbance_has_the_stated_size(rng):
    C = study_attitudes(np.tile((0.0, 0.0, 1.0), (2000, 1)), 0.0, 2.0 * DEG, rng)
    tilt = (C @ (0.0, 0.0, 1.0))[:, :2]
    # statistical: standard deviation known to 1.6 % from 2000 draws
    np.testing.assert_allclose(tilt.std(axis=0), 2.0 * DEG, rtol=0.06)
    with pytest.raises(InputError, match="generator"):
        study_attitudes(ATTITUDES, 0.0, 0.1)


def test_noise_of_the_source():
    """T3.1: 3.636e-5 rad/s and 3.667e-3 m/s^2 at 1 Hz; printed digits."""
    assert NOISE["gyro"] == pytest.approx(3.636e-5, rel=2e-4)
    assert NOISE["accel"] == pytest.approx(3.667e-3, rel=2e-4)
    assert StudyCase().sigma == pytest.approx(2.710e-6, rel=2e-4)
    assert StudyCase(sensor="accel").sigma == pytest.approx(2.733e-4, rel=2e-4)


def test_readings_have_noise_of_averaged_samples(rng):
    case = StudyCase(sensor="accel", disturbance=0.0, truth=np.zeros(9), duration_s=30.0)
    clean = study_attitudes(case.directions, case.heading, 0.0) @ (0.0, 0.0, -GRAVITY)
    noise = np.array([simulated_readings(case, child) for child in rng.spawn(50)]) - clean
    assert noise.std() == pytest.approx(case.sigma, rel=0.06)  # statistical: 3900 draws
    assert np.linalg.norm(StudyCase().reference_n) == pytest.approx(W)
    assert StudyCase().reference_n[2] == pytest.approx(-W * np.sin(LATITUDE))


def test_scenarios_of_ten_attitudes_have_rank_eight():
    assert len(ordered_attitudes()) == 26
    assert [len(scenario(k)) for k in (1, 2, 3, 4)] == [26, 18, 10, 10]
    assert [np.linalg.matrix_rank(design_matrix(scenario(k))) for k in (1, 2, 3, 4)] == [9, 9, 8, 8]
    np.testing.assert_array_equal(np.unique(ordered_attitudes(), axis=0), np.unique(ATTITUDES, axis=0))
    with pytest.raises(InputError, match="scenario"):
        scenario(5)


@pytest.fixture(scope="module")
def rows():
    return table_rows(60, np.random.default_rng(42))


def test_tables_agree_within_the_bands(rows):
    """Uncertainties within a factor 1.7, errors of the source's single draw within 3 sigma, noise-free to rounding.

    Printed digits: the factor is stated with two, and an independent prototype has 7.09/4.08 = 1.74 for theta_zx in
    Table 4.4, case 2, so the ratio is rounded to two. Ours is 1.71 to 1.74 in 400 runs and the only one that needs the
    rounding: the attitudes, which the source does not list, matter most to it. Statistical: in 60 runs it scatters by
    some per cent more.
    """
    outside = {(r.table, r.case, r.parameter): r for r in rows if not r.inside}
    assert set(outside) <= {("4.4", 2, "theta_zx")}
    assert all(r.ratio < 1.1 * FACTOR for r in outside.values())
    assert {(r.table, r.case, r.parameter) for r in rows if r.kind != "rounding" and r.ratio > FACTOR} <= {
        ("4.4", 2, "theta_zx")
    }
    assert len(rows) == 9 + 18 + 27 + 18


def test_the_band_is_that_of_the_printed_digits(rows):
    """1.74 is 1.7 in two digits, 1.76 is 1.8; the same for uncertainties smaller than ours."""
    row = next(r for r in rows if r.kind == "noise")
    for ratio, inside in ((1.0, True), (1.74, True), (1.76, False), (1.0 / 1.74, True), (1.0 / 1.76, False)):
        assert replace(row, source_sigma=ratio * row.sigma, source_error=0.0).inside is inside
    assert not replace(row, source_sigma=row.sigma, source_error=3.1 * max(row.sigma, row.rms_error)).inside


def test_our_error_is_what_we_predict_where_the_model_is_right(rows):
    for r in rows:
        if r.kind == "noise":
            # statistical: rms of 60 draws is known to 9 %; Earth rate with 9 parameters is nonlinear by a few per cent
            assert 0.68 < r.rms_error / r.sigma < 1.35, r


def test_uncertainties_are_those_of_an_independent_program(rows):
    """An independent program: 10 % for its 400 and our 60 draws."""
    ours = {(r.table, r.case, r.parameter): r.sigma for r in rows}
    prototype = {
        ("4.2", 1): (3.35e-9, 4.23e-9, 3.72e-9), ("4.2", 2): (0.85e-6, 1.06e-6, 0.94e-6),
        ("4.3", 2): (1.18e-6, 1.11e-6, 0.97e-6, 1.99e-2, 2.17e-2, 1.74e-2),
        ("4.4", 2): (1.30e-6, 1.41e-6, 1.34e-6, 2.17e-2, 2.22e-2, 1.89e-2, 3.61e-2, 4.08e-2, 3.61e-2),
        ("4.4", 3): (1.29e-6, 1.40e-6, 1.33e-6, 2.15e-6, 2.20e-6, 1.87e-6, 3.60e-6, 4.09e-6, 3.60e-6),
        ("4.5", 2): (0.92e-4, 0.92e-4, 0.92e-4, 14.1e-6, 14.1e-6, 14.1e-6, 20.1e-6, 20.1e-6, 20.1e-6),
    }  # fmt: skip
    for (table, case), sigma in prototype.items():
        got = [ours[table, case, name] for name in PARAMETERS[: len(sigma)]]
        np.testing.assert_allclose(got, sigma, rtol=0.1, err_msg=f"{table} {case}")


def test_models_that_lack_parameters_show_in_the_unit_weight(rng):
    """An independent program: 1.5e3 for 3 and 1.5e2 for 6 parameters at 10^4 Earth rates, 135 and 4.6 for the
    accelerometers.
    """
    for case, expected in (
        (StudyCase(order=3, rate_factor=1e4), 1.5e3), (StudyCase(order=6, rate_factor=1e4), 1.5e2),
        (StudyCase(sensor="accel", order=3), 135.0), (StudyCase(sensor="accel", order=6), 4.6), (StudyCase(), 1.0),
    ):  # fmt: skip
        weight = run_case(case, 30, rng).unit_weight.mean()
        assert weight == pytest.approx(expected, rel=0.2)  # statistical, and two printed digits


def test_sweep_of_the_reference_rate(rng):
    """Fig. 4.2: biases stay, scale factors and angles improve in proportion; computed 2.1e4 ppm and 3.9e4 urad over
    k.
    """
    for result in sweep(StudyCase(), "rate_factor", (1, 100, 1e4), 30, rng):
        b, s, theta = result.groups()
        k = result.case.rate_factor
        assert result.success == 1.0
        assert b == pytest.approx(1.4e-6, rel=0.25)  # statistical: 90 draws, heavier tails at k = 1
        assert s * k == pytest.approx(2.1e-2, rel=0.25)
        assert theta * k == pytest.approx(3.9e-2, rel=0.25)


def test_sweep_of_noise(rng):
    """Fig. 4.3: everything in proportion, until noise is a third of Earth rate and the adjustment breaks down."""
    small, one, three, ten = sweep(StudyCase(), "noise_factor", (0.01, 1.0, 3.0, 10.0), 30, rng)
    for group, expected in zip(small.groups(), (1.4e-8, 206e-6, 387e-6), strict=True):
        assert group == pytest.approx(expected, rel=0.25)
    assert small.success == one.success == 1.0
    assert three.success > 0.8
    assert ten.success < 0.3
    with pytest.raises(InputError, match="noise_factor"):
        sweep(StudyCase(), "order", (1,), 1, rng)


@pytest.mark.parametrize("size", [0.5, 1.0, 1.13, 3.0])
def test_continuation_converges_where_the_plain_iteration_does_not(rng, size):
    """Bias in Earth rates; an independent program has 100 % at 0.5, 2 % at 1 and 0 % beyond for the plain iteration
    from zeros.
    """
    truth = TRUTH["gyro"].copy()
    truth[:3] = size * W / np.sqrt(3.0)
    plain = run_case(StudyCase(truth=truth, start="zeros", plain=True), 30, rng)
    ours = run_case(StudyCase(truth=truth), 30, rng)
    assert ours.success == 1.0
    assert plain.success == 1.0 if size == 0.5 else plain.success < 0.25
    # right ones, not just any
    nees = np.sum((ours.error[:, :3] / ours.sigma[:, :3]) ** 2, axis=1)
    assert np.median(nees) < chi2.ppf(0.9, 3)


def test_data_sheet_as_prior(rng):
    """An independent program: b to 0.86, 1.08, 0.95e-6 instead of 1.30, 1.41, 1.34e-6; converges from zeros at twice
    Earth rate.
    """
    prior = {name: (0.0, size) for name, size in zip(PARAMETERS, [1e-4] * 3 + [150e-6] * 3 + [100e-6] * 3, strict=True)}
    result = run_case(StudyCase(prior=prior), 40, rng)
    np.testing.assert_allclose(result.sigma[:, :3].mean(axis=0), (0.86e-6, 1.08e-6, 0.95e-6), rtol=0.03)
    truth = TRUTH["gyro"].copy()
    truth[:3] = 2.0 * W / np.sqrt(3.0)
    assert run_case(StudyCase(prior=prior, truth=truth, start="zeros", plain=True), 20, rng).success == 1.0


def test_known_angles_and_six_attitudes(rng):
    """F28. An independent program: accelerometer b to 1.9e-4 m/s^2 and s to 20 ppm with six faces."""
    given = dict(zip(PARAMETERS[6:], TRUTH["accel"][6:], strict=True))
    result = run_case(StudyCase(sensor="accel", order=6, fixed=given, directions=ATTITUDES[:6]), 60, rng)
    assert result.success == 1.0
    b, s, theta = result.groups()
    assert b == pytest.approx(1.9e-4, rel=0.2)
    assert s == pytest.approx(20e-6, rel=0.2)
    assert theta == 0.0


def test_scenario_grid(rng):
    grid = scenario_grid(StudyCase(sensor="accel"), 12, rng, minutes=(1.0, 3.0), orders=(9,))
    assert set(grid) == {(k, t, 9) for k in (1, 2, 3, 4) for t in (1.0, 3.0)}
    for k in (1, 2):
        ratio = grid[k, 1.0, 9].mean_sigma / grid[k, 3.0, 9].mean_sigma
        np.testing.assert_allclose(ratio, np.sqrt(3.0), rtol=0.2)  # white noise; the field data do not do so
    third = np.median(grid[3, 3.0, 9].sigma[:, 6:], axis=0) / 1e-6
    assert third[1] > 8 * third[[0, 2]].max()  # theta_zx: computed 808 against 49 and 43 microradian
    fourth = np.median(grid[4, 3.0, 9].sigma[:, 3:6], axis=0) / 1e-6
    assert fourth[1:].min() > 3 * fourth[0]  # s_y, s_z: computed 270 against 48 ppm


def test_ten_attitudes_and_earth_rate_are_too_few(rng):
    """The source's failure at one minute (s_x = 2.2e6 ppm): we say undetermined instead."""
    result = run_case(StudyCase(directions=scenario(4), duration_s=60.0), 20, rng)
    assert result.success < 0.5
    assert run_case(StudyCase(order=3, directions=scenario(4), duration_s=60.0), 20, rng).success == 1.0


def test_the_page_runs():
    """docs/calibration-multiposition.md."""
    page = ROOT / "docs" / "calibration-multiposition.md"
    blocks = re.findall(r"```python\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)
    assert blocks
    for block in blocks:
        exec(compile(block, str(page), "exec"), {})


@pytest.mark.slow
def test_tables_full_size():
    rows = table_rows(400, np.random.default_rng(7))
    assert [r for r in rows if not r.inside] == []
    largest = max((r for r in rows if r.kind != "rounding"), key=lambda r: r.ratio)
    assert (largest.table, largest.case, largest.parameter) == ("4.4", 2, "theta_zx")
    assert largest.ratio == pytest.approx(1.71, abs=5e-3)  # printed digits of the documentation; this seed
    for r in rows:
        if r.kind == "noise":
            assert 0.88 < r.rms_error / r.sigma < 1.15, r  # 10 %: 400 draws know it to 3.5 %
