"""The filter is as good as it says: NEES and NIS with injected biases, scale factors and lever arm of both signs."""

from __future__ import annotations

import filter_cases as cases
import numpy as np
import pytest

from schuler.filtering.engine import FilterOptions, run
from schuler.filtering.measurements import gnss_measurements
from schuler.navigation.evaluation.consistency import chi_square_band, nees, state_errors
from schuler.navigation.result import NavigationResult


def campaign(case, lay, seeds, **options):
    """NEES (runs, records), NIS (runs,) and final errors in sigmas (runs, n)."""
    nees_all, nis_all, final = [], [], []
    for seed in seeds:
        result, parameters = cases.filtered(case, lay, seed, **options)
        nees_all.append(nees(result, case.truth, parameters))
        nis_all.append(result.innovations.mean_nis())
        _, dx, P = state_errors(result, case.truth, parameters)
        final.append(dx[-1] / np.sqrt(np.diag(P[-1])))
    return np.array(nees_all), np.array(nis_all), np.array(final)


@pytest.mark.thinned(2)
@pytest.mark.parametrize("states", [15, 21])
def test_nees_over_a_hundred_seeds(drive_case, states):
    """Each run draws biases, scale factors, initial errors and noise; the mean stays in its chi-square band."""
    lay = cases.layout(states)
    values, nis, final = campaign(drive_case, lay, range(100))
    low, high = chi_square_band(lay.size, 100, 0.9999)
    at = values[:, [5, 20, 40, 60, 80, 100, 119]].mean(axis=0)
    # statistical: seven looks at a mean of 100 chi-squares, 99.99 percent band each
    assert np.all((at > low) & (at < high)), (low, at, high)
    by_run = values.mean(axis=1)
    assert abs(by_run.mean() - 1.0) < 4.5 * by_run.std() / np.sqrt(100)  # 4.5 standard errors
    low, high = chi_square_band(3 * 238, 100, 0.9999)
    assert low < nis.mean() < high
    # every single state: the mean error over runs is zero and its spread is the claimed one
    assert np.all(np.abs(final.mean(axis=0)) < 4.5 / np.sqrt(100)), final.mean(axis=0)  # 4.5 standard errors
    spread = np.sqrt((final**2).mean(axis=0))
    assert np.all(np.abs(spread - 1.0) < 4.5 / np.sqrt(200)), spread


def test_nees_with_all_states(drive_case):
    """45 states: biases, scale factors, cross-coupling, g-sensitivity and a lever arm that is 0.2 m off."""
    lay = cases.layout(45)
    values, nis, _ = campaign(drive_case, lay, range(40))
    low, high = chi_square_band(lay.size, 40, 0.9999)
    at = values[:, [20, 60, 119]].mean(axis=0)
    assert np.all((at > low) & (at < high)), (low, at, high)
    assert 0.95 < nis.mean() < 1.05


def test_nees_at_full_covariance_rate(drive_case):
    lay = cases.layout(21)
    values, _, _ = campaign(drive_case, lay, range(20), covariance_rate_hz=None)
    low, high = chi_square_band(lay.size, 20, 0.9999)
    assert low < values[:, -1].mean() < high


@pytest.mark.campaign
@pytest.mark.parametrize(
    "runs", [4, pytest.param(12, marks=pytest.mark.campaign), pytest.param(60, marks=pytest.mark.slow)]
)
def test_nees_over_an_hour(runs):
    """Truth from the filter's own model for an hour: a defect too small for two minutes has time to show."""
    case = cases.Case.of(cases.drive(60.0), 3600.0, rate_hz=25.0)
    lay = cases.StateLayout(
        {
            "b_a": cases.StateModel.gauss_markov(0.02, 3600.0),
            "b_g": cases.StateModel.gauss_markov(5e-4, 3600.0),
            "S_a": cases.StateModel.constant(1e-3),
            "S_g": cases.StateModel.constant(1e-3),
        }
    )
    values, nis, _ = campaign(case, lay, range(runs))
    low, high = chi_square_band(lay.size, runs, 0.9999)
    at = values[:, [60, 600, 1200, 1800, 2400, 3000, 3598]].mean(axis=0)
    assert np.all((at > low) & (at < high)), (low, at, high)
    # means over an hour of correlated values: an effective sample every five minutes is assumed
    low, high = chi_square_band(lay.size, runs * 12, 0.9999)
    assert low < values[:, 60:].mean() < high
    assert 0.99 < nis.mean() < 1.01


@pytest.mark.parametrize("sign", [-1.0, 1.0])
@pytest.mark.parametrize("block", ["b_a", "b_g", "S_a", "S_g", "M_a6", "M_g", "G_g", "lever"])
def test_each_parameter_is_estimated_with_either_sign(drive_case, block, sign):
    """One parameter block off, all else exact and almost noise-free: its estimate goes to the truth, not away."""
    lay = cases.layout(45)
    rng = np.random.default_rng(3)
    size = lay[block].stop - lay[block].start
    true = lay.values(**{block: sign * lay.models[block].sigma * np.ones(size)})
    log, _ = cases.corrupted(drive_case, lay, true, rng, walk=False)
    lever = cases.LEVER + (true[lay["lever"].start - 9 : lay["lever"].stop - 9])
    schedule = gnss_measurements(cases.fixes(drive_case, rng, lever), cases.LEVER, gate=None)
    initial = cases.start(drive_case, lay, rng)
    forward = run(
        log, schedule, initial, lay, np.full(3, cases.GYRO_N**2), np.full(3, cases.ACCEL_N**2), FilterOptions()
    )
    result = NavigationResult.from_run(forward, schedule.t, schedule.kind, lay)
    _, dx, P = state_errors(result, drive_case.truth, true)
    part = lay[block]
    sigma = np.sqrt(np.diag(P[-1]))[part]
    assert np.all(np.abs(dx[-1, part]) < 4.5 * sigma), dx[-1, part] / sigma  # statistical: 4.5 sigma
    # where the drive tells anything at all, the estimate has moved towards the truth
    observable = sigma < 0.5 * lay.models[block].sigma
    estimate = result.parameters[-1, part.start - 9 : part.stop - 9]
    assert np.all(sign * estimate[observable] > 0.0)
    least = {"b_a": 2, "b_g": 3, "S_g": 1, "lever": 2}  # a car hardly turns about any but its vertical axis
    assert observable.sum() >= least.get(block, 0)


def test_zero_error_data_stays_at_zero(drive_case):
    """Exact increments, exact fixes, exact start: the filter adds nothing of its own."""
    lay = cases.layout(21)
    rng = np.random.default_rng(0)
    quiet = np.full(3, 1e-9)
    s = drive_case.truth_fixes
    import schuler.frames as frames
    from schuler.recording.series import GnssSeries

    n = len(drive_case.fixes_t)
    r = s.r_eb_e + s.C_eb @ cases.LEVER
    v = s.v_eb_e + np.einsum("nij,nj->ni", s.C_eb, np.cross(s.omega_eb_b, cases.LEVER))
    llh = frames.llh_from_ecef(r)
    gnss = GnssSeries(
        drive_case.fixes_t, llh, np.tile(np.diag(cases.SIGMA_R**2), (n, 1, 1)),
        np.einsum("nji,nj->ni", frames.C_en(llh), v), np.tile(np.diag(cases.SIGMA_V**2), (n, 1, 1)),
    )  # fmt: skip
    T = drive_case.truth
    nav = cases.NavState(0.0, T.r_eb_e[0], T.v_eb_e[0], T.q_eb[0])
    initial = cases.InitialState.from_sigmas(nav, lay, attitude=[0.01] * 3, velocity=[0.1] * 3, position=[1.0] * 3)
    schedule = gnss_measurements(gnss, cases.LEVER)
    forward = run(drive_case.increments, schedule, initial, lay, quiet**2, quiet**2)
    result = NavigationResult.from_run(forward, schedule.t, schedule.kind, lay)
    errors = result.errors(drive_case.truth)
    # discretisation: the lever arm's velocity takes the mean rate of an interval, half a sample old
    assert errors.max_horizontal < 5e-3
    assert np.abs(errors.attitude_n).max() < 1e-4
    assert np.abs(result.parameter("b_a")).max() < 3e-4
    del rng
