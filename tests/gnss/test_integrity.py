"""Fault detection and exclusion: the test's level and power, identification, protection, liars."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from scipy.stats import chi2, ncx2, norm

from schuler import frames
from schuler.exceptions import InputError
from schuler.gnss.constellation import nominal_orbits
from schuler.gnss.integrity import (
    Integrity,
    identify,
    power,
    protection_levels,
    residual_projector,
    smallest_noncentrality,
    threshold,
    thresholds,
)
from schuler.gnss.point import solve_points
from schuler.gnss.signals import satellite_name
from schuler.gnss.synthetic import RangeErrors, synthetic_ranges

SIGMA = 3.0
NOISY = RangeErrors(noise=SIGMA, rate_noise=0.1, multipath=0.0, atmosphere=0.0)


def campaign(n, seed, systems="G", most=8, errors=NOISY):
    """Independent noise, a receiver at rest, a minute between epochs."""
    t = 60.0 * np.arange(n)
    r = np.broadcast_to(frames.ecef_from_llh(np.array([0.85, 0.16, 400.0])), (n, 3))
    offsets = tuple(10.0 * (i + 1) for i in range(len(systems) - 1))
    s = synthetic_ranges(
        t, r, np.zeros_like(r), nominal_orbits(systems), np.random.default_rng(seed), replace(errors, offsets=offsets),
        max_satellites=most,
    )  # fmt: skip
    return s, r


def with_fault(s, row_of_epoch, bias):
    """Add a bias to one row of each epoch."""
    rho = s.ranges.pseudorange.copy()
    rho[row_of_epoch] += bias
    return replace(s.ranges, pseudorange=rho)


def pick(s, rng, count=1):
    """Rows of ``count`` different satellites of each epoch, shape (k, count)."""
    return np.array([rng.choice(np.flatnonzero(s.epoch == k), count, replace=False) for k in range(s.epoch.max() + 1)])


def binomial_se(p, n):
    return np.sqrt(p * (1.0 - p) / n)


# ----------------------------------------------------------------------------------------- closed forms


def test_thresholds_are_quantiles():
    assert threshold(1e-3, 4) == pytest.approx(chi2.isf(1e-3, 4), rel=1e-14)
    assert np.isinf(threshold(1e-3, 0))
    assert thresholds(0.01, [[1, 0], [3, 1]]).tolist() == [
        [threshold(0.01, 1), np.inf],
        [threshold(0.01, 3), threshold(0.01, 1)],
    ]


def test_power_and_its_inverse():
    assert power(1e-3, 4, 0.0) == pytest.approx(1e-3, rel=1e-9)
    assert power(1e-3, 4, 30.0) == pytest.approx(ncx2.sf(threshold(1e-3, 4), 4, 30.0), rel=1e-12)
    assert power(1e-3, 0, 100.0) == 0.0
    for r in (1, 2, 6):
        value = smallest_noncentrality(1e-3, 1e-2, r)
        assert power(1e-3, r, value) == pytest.approx(0.99, abs=1e-9)
    assert np.isinf(smallest_noncentrality(1e-3, 1e-2, 0))


def test_baardas_reference_value():
    """One redundant observation, 0.1 % false alarms, 20 % missed: Baarda's 17.07 (printed digits)."""
    assert smallest_noncentrality(1e-3, 0.2, 1) == pytest.approx(17.07, abs=0.01)


def test_leaving_rows_out_by_formula_is_leaving_them_out():
    """The statistic after exclusion without solving again, against solving again, for every set up to three rows."""
    rng = np.random.default_rng(2)
    A = np.concatenate((rng.normal(size=(9, 3)), np.ones((9, 1))), axis=1) / rng.uniform(0.5, 3.0, size=(9, 1))
    y = rng.normal(size=9) * 5.0
    M = residual_projector(A)
    v = M @ y
    for size in (1, 2, 3):
        for rows in combinations(range(9), size):
            rest = np.setdiff1d(np.arange(9), rows)
            _, squares, _, _ = np.linalg.lstsq(A[rest], y[rest], rcond=None)
            block = M[np.ix_(rows, rows)]
            drop = v[list(rows)] @ np.linalg.solve(block, v[list(rows)])
            assert v @ v - drop == pytest.approx(squares[0], rel=1e-9)


@pytest.mark.parametrize("faults", [(3,), (0, 5), (1, 2, 7)])
def test_faults_without_noise_are_found(faults):
    rng = np.random.default_rng(4)
    A = np.concatenate((rng.normal(size=(10, 3)), np.ones((10, 1))), axis=1)
    y = A @ [1.0, -2.0, 3.0, 40.0]
    y[list(faults)] += [30.0, -25.0, 40.0][: len(faults)]
    identified = identify(A, y, Integrity())
    assert identified.rows == faults
    assert identified.statistic == pytest.approx(0.0, abs=1e-9)
    assert identified.rivals == 0


def test_one_redundant_row_isolates_nothing():
    rng = np.random.default_rng(4)
    A = np.concatenate((rng.normal(size=(5, 3)), np.ones((5, 1))), axis=1)
    y = np.array([0.0, 0.0, 500.0, 0.0, 0.0])
    assert identify(A, y, Integrity()).rows == ()


def test_what_remains_is_tested_with_its_own_redundancy():
    """A fault on row 0 and a rest of a chosen size that no single row explains."""
    rng = np.random.default_rng(4)
    A = np.concatenate((rng.normal(size=(10, 3)), np.ones((10, 1))), axis=1)
    one = np.eye(10)[:, :1]
    null = np.linalg.svd(np.concatenate((A, one), axis=1))[0][:, 5:]
    rest = null @ np.ones(5) / np.sqrt(5.0)
    low, high = threshold(0.01, 5), threshold(0.01, 6)
    for square, alone in ((0.99 * low, True), (0.5 * (low + high), False)):
        identified = identify(A, 300.0 * one[:, 0] + np.sqrt(square) * rest, Integrity(false_alarm=0.01))
        assert (identified.rows == (0,)) is alone
        if alone:
            assert identified.statistic == pytest.approx(square, rel=1e-9)


def test_max_faults_is_a_limit():
    rng = np.random.default_rng(4)
    A = np.concatenate((rng.normal(size=(10, 3)), np.ones((10, 1))), axis=1)
    y = np.zeros(10)
    y[[1, 5]] = 100.0, 77.0
    assert identify(A, y, Integrity(max_faults=1)).rows == ()
    assert identify(A, y, Integrity(max_faults=2)).rows == (1, 5)


# ------------------------------------------------------------------------------------------ Monte Carlo


@pytest.mark.parametrize("false_alarm", [0.05, pytest.param(0.01, marks=pytest.mark.campaign)])
def test_false_alarms_are_as_many_as_asked(false_alarm):
    n = 6000
    s, _ = campaign(n, 11)
    points = solve_points(s.ranges, integrity=Integrity(false_alarm=false_alarm, max_faults=0))
    for status in (points.status, points.velocity_status[points.status == 0]):
        rate = np.mean(status == 5)
        assert abs(rate - false_alarm) < 4.0 * binomial_se(false_alarm, len(status))


@pytest.mark.parametrize("runs", [1000, pytest.param(3000, marks=pytest.mark.campaign)])
@pytest.mark.thinned(3)
@pytest.mark.parametrize("bias", [8.0, 15.0, 25.0])
def test_the_power_is_that_of_the_noncentral_chi_square(bias, runs):
    """Each epoch has its own geometry, so the detections are a sum of unequal Bernoulli draws."""
    n, false_alarm = runs, 1e-2
    s, r = campaign(n, 12)
    rows = pick(s, np.random.default_rng(1))[:, 0]
    points = solve_points(with_fault(s, rows, bias), integrity=Integrity(false_alarm=false_alarm, max_faults=0))
    expected = np.empty(n)
    for k in range(n):
        mine = np.flatnonzero(s.epoch == k)
        u = s.ranges.r_sat_e[mine] - r[k]
        sigma = s.ranges.sigma_range[mine]
        A = np.concatenate((u / np.linalg.norm(u, axis=1)[:, None], np.ones((len(mine), 1))), axis=1) / sigma[:, None]
        i = int(np.flatnonzero(mine == rows[k])[0])
        noncentrality = (bias / sigma[i]) ** 2 * residual_projector(A)[i, i]
        expected[k] = power(false_alarm, len(mine) - 4, noncentrality)
    se = np.sqrt(np.sum(expected * (1.0 - expected))) / n
    assert abs(np.mean(points.status == 5) - expected.mean()) < 4.0 * se


@pytest.mark.parametrize(("bias", "least"), [(20.0, 0.97), pytest.param(50.0, 0.99, marks=pytest.mark.campaign)])
def test_faults_of_20_to_50_m_are_detected_and_the_right_satellite_goes(bias, least):
    """1 m ranges of 10 satellites; what remains is as accurate as it says."""
    n = 1500
    s, r = campaign(n, 13, systems="GE", most=12, errors=replace(NOISY, noise=1.0))
    rows = pick(s, np.random.default_rng(2))[:, 0]
    points = solve_points(with_fault(s, rows, bias))
    alone = np.array([np.sum(s.ranges.group[s.epoch == k] == s.ranges.group[rows[k]]) < 2 for k in range(n)])
    right = points.ok & points.excluded[rows] & (np.bincount(s.epoch, points.excluded) == 1)
    assert np.mean(right[~alone]) > least
    error = points.r_e - r
    nees = np.einsum("ki,kij,kj->k", error[right], np.linalg.inv(points.cov_r_e[right]), error[right])
    assert abs(nees.mean() - 3.0) < 4.0 * np.sqrt(6.0 / right.sum())
    assert np.linalg.norm(error[points.ok], axis=1).max() < bias


def test_wrong_exclusions_are_as_rare_as_asked():
    """Seven satellites and a fault just above the noise, where one often cannot tell: believed exclusions are right."""
    n = 3000
    s, _ = campaign(n, 14, most=7, errors=replace(NOISY, noise=1.0))
    rows = pick(s, np.random.default_rng(3))[:, 0]
    ranges = with_fault(s, rows, 8.0)
    strict = solve_points(ranges, integrity=Integrity(wrong_exclusion=0.1))
    eager = solve_points(ranges, integrity=Integrity(wrong_exclusion=1.0))

    def wrong(points):
        tried = points.ok & (np.bincount(s.epoch, points.excluded, minlength=n) > 0)
        return np.mean(~points.excluded[rows][tried]), tried.sum()

    share, tried = wrong(strict)
    assert tried > 300
    assert share < 0.1
    assert share < wrong(eager)[0]
    assert np.any(strict.status == 6)
    assert not np.any(eager.status == 6)


@pytest.mark.parametrize("count", [2, 3])
def test_several_faults_are_found_together(count):
    n = 300
    s, r = campaign(n, 15, systems="GE", most=None, errors=replace(NOISY, noise=1.0))
    rng = np.random.default_rng(4)
    rows = pick(s, rng, count)
    ranges = with_fault(s, rows, rng.uniform(40.0, 200.0, rows.shape) * rng.choice([-1.0, 1.0], rows.shape))
    points = solve_points(ranges)
    right = points.ok & points.excluded[rows].all(axis=1)
    assert np.mean(right) > 0.97
    assert np.linalg.norm(points.r_e - r, axis=1)[points.ok].max() < 25.0


def sky(m, seed):
    """Design of m satellites above 5 degrees, all of one weight, north-east-down."""
    rng = np.random.default_rng(seed)
    down, azimuth = -rng.uniform(0.09, 1.0, m), rng.uniform(0.0, 2.0 * np.pi, m)
    flat = np.sqrt(1.0 - down**2)
    return np.stack((-flat * np.cos(azimuth), -flat * np.sin(azimuth), -down, np.ones(m)), axis=-1)


def levels(A, integrity):
    cofactor = np.linalg.inv(A.T @ A)
    used, identity = np.ones((1, len(A)), dtype=bool), np.eye(3)[None]
    hpl, vpl = protection_levels(A[None], cofactor[None], identity, used, [len(A) - 4], integrity)
    return float(hpl[0]), float(vpl[0])


@pytest.mark.parametrize("m", [6, 8, 60])
def test_protection_levels_protect(m):
    """The worst satellite, faults of all sizes: missed and beyond the level at most as often as stated.

    5 % instead of 0.1 %, so that there is something to count. Without the margin for noise the 60 satellites fail:
    their slopes are so flat that noise alone is beyond the level.
    """
    n, missed = 20_000, 0.05
    integrity = Integrity(false_alarm=0.01, missed_detection=missed)
    A = sky(m, 3)
    hpl, vpl = levels(A, integrity)
    M, gain = residual_projector(A), np.linalg.pinv(A)
    checked = np.sqrt(np.diag(M))
    root = np.sqrt(smallest_noncentrality(0.01, missed, m - 4))
    noise = np.random.default_rng(7).standard_normal((n, m))
    for moved in (np.hypot(gain[0], gain[1]), np.abs(gain[2])):
        i = int(np.argmax(moved / checked))
        for factor in (0.0, 0.4, 0.6, 0.8, 1.0, 1.3):
            y = noise.copy()
            y[:, i] += factor * root / checked[i]
            unseen = np.sum((y @ M) ** 2, axis=1) < threshold(0.01, m - 4)
            x = y @ gain.T
            for beyond in (np.hypot(x[:, 0], x[:, 1]) > hpl, np.abs(x[:, 2]) > vpl):
                share = np.mean(unseen & beyond)
                assert share < missed + 4.0 * binomial_se(missed, n)


def test_protection_levels_of_a_solution():
    """As of its design in local axes, by the formula written out."""
    s, r = campaign(3, 16)
    integrity = Integrity()
    points = solve_points(s.ranges, integrity=integrity)
    C_en = frames.C_en(frames.llh_from_ecef(r[0]))
    for k in range(3):
        mine = np.flatnonzero(s.epoch == k)
        u = s.ranges.r_sat_e[mine] - r[k]
        A = np.concatenate((-u / np.linalg.norm(u, axis=1)[:, None] @ C_en, np.ones((len(mine), 1))), axis=1)
        A /= s.ranges.sigma_range[mine][:, None]
        gain, checked = np.linalg.pinv(A), np.sqrt(np.diag(residual_projector(A)))
        root = np.sqrt(smallest_noncentrality(1e-3, 1e-3, len(mine) - 4))
        sigma = np.sqrt(np.linalg.inv(A.T @ A)[2, 2])
        vpl = np.max(np.abs(gain[2]) / checked) * root + norm.isf(0.5e-3) * sigma
        assert points.vpl[k] == pytest.approx(vpl, rel=1e-4)  # Sagnac's part of the gradient is left out here
        larger = np.sqrt(np.linalg.eigvalsh(np.linalg.inv(A.T @ A)[:2, :2])[1])
        hpl = np.max(np.hypot(gain[0], gain[1]) / checked) * root + np.sqrt(chi2.isf(1e-3, 2)) * larger
        assert points.hpl[k] == pytest.approx(hpl, rel=1e-4)


# ------------------------------------------------------------------------------------------------- liars


@pytest.mark.parametrize("outlier", [1e3, -1e3, 3e5, -3e6])
def test_an_outlier_of_kilometres_does_not_spoil_the_rest(outlier):
    s, _r = campaign(50, 17, systems="GE", most=None)
    rows = pick(s, np.random.default_rng(5))[:, 0]
    points = solve_points(with_fault(s, rows, outlier))
    clean = solve_points(s.ranges.where(~np.isin(np.arange(len(s.ranges)), rows)), integrity=None)
    assert points.ok.mean() > 0.97  # a false alarm of what remains may cost one
    assert points.excluded[rows][points.ok].all()
    alone = points.ok & (np.bincount(s.epoch, points.excluded) == 1)
    assert np.abs(points.r_e - clean.r_e)[alone].max() < 1e-5


@pytest.mark.parametrize("claimed", [0.01, 1e-3])
def test_a_range_that_reports_1_cm_and_is_wrong_by_20_m_does_not_survive(claimed):
    s, r = campaign(200, 18, systems="GE", most=None, errors=replace(NOISY, noise=1.0))
    rows = pick(s, np.random.default_rng(6))[:, 0]
    sigma = s.ranges.sigma_range.copy()
    sigma[rows] = claimed
    points = solve_points(replace(with_fault(s, rows, 20.0), sigma_range=sigma))
    assert points.ok.mean() > 0.9
    assert np.mean(points.excluded[rows][points.ok]) > 0.99
    # one near the horizon may hide among its neighbours, as far as the protection levels admit
    ned = np.einsum("kji,kj->ki", frames.C_en(frames.llh_from_ecef(r)), points.r_e - r)[points.ok]
    assert np.all(np.hypot(ned[:, 0], ned[:, 1]) < points.hpl[points.ok])
    assert np.all(np.abs(ned[:, 2]) < points.vpl[points.ok])
    assert np.median(np.linalg.norm(ned, axis=1)) < 3.0  # as without the liar; 20 m / PDOP with it


def test_a_receiver_whose_every_range_claims_1_cm_does_not_survive():
    s, _ = campaign(200, 19, systems="GE", most=None, errors=replace(NOISY, noise=10.0))
    points = solve_points(replace(s.ranges, sigma_range=np.full(len(s.ranges), 0.01)))
    assert not points.ok.any()
    assert set(points.status) == {5}
    assert "not to be isolated" in points.why(0)
    assert np.all(points.screened(s.ranges).reason == 6)


def test_scattering_ranges_without_rates_are_refused_like_those_with():
    s, _ = campaign(50, 19, systems="GE", most=None, errors=replace(NOISY, noise=10.0))
    without = replace(s.ranges, range_rate=np.full(len(s.ranges), np.nan))
    claimed = replace(without, sigma_range=np.full(len(s.ranges), 0.01))
    points = solve_points(claimed)
    assert set(points.status) == {5}
    assert not points.velocity_ok.any()
    assert np.array_equal(points.r_e, solve_points(replace(s.ranges, sigma_range=claimed.sigma_range)).r_e)


def test_five_satellites_detect_and_do_not_exclude():
    s, _ = campaign(100, 20, most=5)
    rows = pick(s, np.random.default_rng(7))[:, 0]
    points = solve_points(with_fault(s, rows, 3e4))
    assert np.mean(points.status == 5) > 0.95
    assert not points.excluded.any()


def test_four_satellites_cannot_tell():
    s, _ = campaign(20, 20, most=4)
    points = solve_points(with_fault(s, pick(s, np.random.default_rng(7))[:, 0], 500.0))
    assert set(points.status) == {1}
    assert np.isinf(points.hpl).all()
    assert np.isinf(points.vpl).all()


def test_a_satellite_alone_in_its_system_cannot_be_wrong():
    """Its error goes into its own clock, and the position does not notice."""
    s, _r = campaign(50, 21, systems="GE", most=None)
    first_e = np.array([np.flatnonzero((s.epoch == k) & (s.ranges.group == 1))[0] for k in range(50)])
    keep = (s.ranges.group == 0) | np.isin(np.arange(len(s.ranges)), first_e)
    a = solve_points(s.ranges.where(keep), integrity=None)
    b = solve_points(with_fault(s, first_e, 1e4).where(keep))
    same = b.status == 0
    assert same.mean() > 0.95
    assert np.isfinite(b.hpl[same]).all()
    unaltered = same & (np.bincount(b.epoch, b.excluded) == 0)
    assert np.abs(a.r_e - b.r_e)[unaltered].max() < 1e-6


def test_wrong_range_rates_are_left_out_alone():
    s, _ = campaign(200, 22, systems="GE", most=None)
    rows = pick(s, np.random.default_rng(8))[:, 0]
    rate = s.ranges.range_rate.copy()
    rate[rows] += 5.0
    ranges = replace(s.ranges, range_rate=rate)
    points = solve_points(ranges)
    ok = points.velocity_ok
    assert ok.mean() > 0.97
    assert points.rate_excluded[rows][ok].all()
    assert np.linalg.norm(points.v_e[ok], axis=1).max() < 1.5
    screened = points.screened(ranges)
    assert np.isnan(screened.range_rate[points.rate_excluded]).all()
    assert np.array_equal(
        screened.reason == 6, points.excluded | np.isin(points.epoch, np.flatnonzero(points.status >= 5))
    )


def test_screened_ranges_say_why():
    s, _ = campaign(50, 23, systems="GE", most=None, errors=replace(NOISY, noise=1.0))
    rows = pick(s, np.random.default_rng(9))[:, 0]
    ranges = with_fault(s, rows, 100.0)
    points = solve_points(ranges)
    screened = points.screened(ranges)
    assert np.all(screened.reason[rows] == 6)
    assert "fault detection left out" in screened.notes[-1]
    assert satellite_name(int(ranges.sat[rows[0]])) in points.excluded_at(0)
    # solving what is left finds nothing more to exclude where the first pass was content
    again = solve_points(screened)
    assert np.abs(again.r_e - points.r_e)[points.ok].max() < 1e-6
    with pytest.raises(InputError, match="that were solved"):
        points.screened(ranges.where(ranges.t < 100.0))


def test_switched_off():
    s, _ = campaign(20, 24)
    points = solve_points(with_fault(s, pick(s, np.random.default_rng(1))[:, 0], 1e3), integrity=None)
    assert points.ok.all()
    assert not points.excluded.any()
    assert np.isinf(points.threshold).all()


@pytest.mark.parametrize(
    "options", [{"false_alarm": 0.0}, {"missed_detection": 1.0}, {"max_faults": -1}, {"wrong_exclusion": 0.0}]
)
def test_options_are_checked(options):
    with pytest.raises(InputError, match=next(iter(options))):
        Integrity(**options)
