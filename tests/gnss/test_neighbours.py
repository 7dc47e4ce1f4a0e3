"""Epochs solved with their neighbours: a street of detours, what stays as it was, honest levels, the linear algebra."""

from dataclasses import replace

import numpy as np
import pytest

from schuler import frames
from schuler.gnss.constellation import nominal_orbits
from schuler.gnss.detours import RangeNoise
from schuler.gnss.epoch_fits import Padded
from schuler.gnss.integrity import Integrity
from schuler.gnss.linked import _diagonal_blocks, _solved, lasting_factor, link_epochs
from schuler.gnss.point import solve_points
from schuler.gnss.preparation import prepare_ranges
from schuler.gnss.protection_errors import stanford
from schuler.gnss.synthetic import RangeErrors, synthetic_ranges
from schuler.timebase import WEEK_S
from schuler.units import DEG

SIGMA = 1.5
NOISY = RangeErrors(noise=SIGMA, rate_noise=0.05, multipath=0.0, atmosphere=0.0, offsets=(20.0,))
ALONE = Integrity(neighbours=False)


def street(seed, n=120, share=0.35, mean=40.0, errors=NOISY):
    """A drive at 10 m/s round a block; satellites are behind houses for 15 s at a time, then late and weak."""
    rng = np.random.default_rng(seed)
    t = np.arange(float(n))
    angle = 2.0 * np.pi * t / 60.0
    around = 10.0 * 60.0 / (2.0 * np.pi)
    north_east_down = np.stack((around * np.sin(angle), around * (1.0 - np.cos(angle)), 0.0 * t), axis=-1)
    speed = 10.0 * np.stack((np.cos(angle), np.sin(angle), 0.0 * t), axis=-1)
    llh = np.array([0.39, 1.99, 10.0])
    C = frames.C_en(llh)
    r, v = frames.ecef_from_llh(llh) + north_east_down @ C.T, speed @ C.T
    s = synthetic_ranges(t, r, v, nominal_orbits("GE"), rng, errors)
    block = (s.epoch + 7 * s.ranges.sat) // 15
    key = s.ranges.sat * 1000 + block
    names, at = np.unique(key, return_inverse=True)
    behind = (rng.random(len(names)) < share)[at]
    late = np.where(behind, rng.exponential(mean, len(names))[at], 0.0)
    cn0 = np.where(behind, 30.0, 45.0) + rng.normal(0.0, 3.0, len(behind))
    ranges = replace(s.ranges, pseudorange=s.ranges.pseudorange + late, cn0=cn0)
    return ranges, r, late


def local(r_e, true):
    return np.einsum("kji,kj->ki", frames.C_en(frames.llh_from_ecef(true)), r_e - true)


# ------------------------------------------------------------------------------------------ street of detours


@pytest.mark.campaign
def test_neighbours_solve_the_epochs_that_one_alone_gives_up():
    """Seeds chosen in advance; the unlinked fault search gives up a third of the epochs, and errs in others."""
    horizontal, kept, given_up, plain = [], [], [], []
    for seed in range(3):
        ranges, r, _ = street(seed)
        points, alone, blind = (solve_points(ranges, integrity=i) for i in (Integrity(), ALONE, None))
        horizontal.append(np.hypot(*local(points.r_e, r)[points.ok, :2].T))
        plain.append(np.hypot(*local(blind.r_e, r)[blind.ok, :2].T))
        kept.append(points.ok.mean())
        given_up.append(1.0 - alone.ok.mean())
    assert np.mean(given_up) > 0.2
    assert np.mean(kept) > 0.98
    error, worse = np.concatenate(horizontal), np.concatenate(plain)
    assert np.median(error) < 2.0  # noise of 1.5 m through the geometry of some tens of ranges
    assert np.percentile(error, 95) < 6.0
    assert np.percentile(error, 95) < 0.3 * np.percentile(worse, 95)  # looking for faults is never the worse choice


def test_detours_are_told_by_satellite():
    ranges, _, late = street(1)
    points = solve_points(ranges)
    linked = (points.status == 8)[points.epoch]
    assert linked.sum() > 300
    clear = linked & (late > 15.0)  # ten sigmas: below, noise hides a detour
    assert np.mean(points.excluded[clear]) > 0.98
    assert np.mean(points.excluded[linked & (late == 0.0)]) < 0.03
    k = int(points.epoch[clear][0])
    assert any("late; suspected not to be in line of sight" in s for s in points.left_out(k))
    assert len(points.left_out(k)) >= len(points.excluded_at(k))
    assert "suspected not to be in line of sight" in points.summary()
    screened = points.screened(ranges)
    assert np.all(screened.reason[clear & points.excluded] == 6)
    assert np.all(screened.sigma_range >= ranges.sigma_range)


@pytest.mark.campaign
@pytest.mark.parametrize("seeds", [range(10, 14), pytest.param(range(20, 60), marks=pytest.mark.campaign)])
def test_levels_of_the_street_hold(seeds):
    """At most one epoch in a hundred beyond the levels; neighbours err together, so that runs are what is counted.

    Half of the variance is multipath that lasts for 20 s.
    """
    lasting = replace(NOISY, noise=1.0, multipath=1.0, multipath_tau=20.0)
    beyond = []
    for seed in seeds:
        ranges, r, _ = street(seed, errors=lasting)
        points = solve_points(ranges)
        e, linked = local(points.r_e, r), points.status == 8
        out = (np.hypot(e[:, 0], e[:, 1]) > points.hpl) | (np.abs(e[:, 2]) > points.vpl)
        beyond.append(np.mean(out[linked]))
    assert np.mean(beyond) < 0.01 + 2.0 * np.std(beyond) / np.sqrt(len(beyond))


def test_a_smaller_risk_has_larger_levels():
    ranges, _, _ = street(2, n=60)
    a, b = (solve_points(ranges, integrity=Integrity(missed_detection=risk)) for risk in (1e-2, 1e-5))
    linked = (a.status == 8) & (b.status == 8)
    assert linked.sum() > 10
    assert np.all(b.hpl[linked] > a.hpl[linked])
    assert np.all(b.vpl[linked] > a.vpl[linked])


# ------------------------------------------------------------------------------------------- what stays as it was


def test_without_faults_nothing_changes():
    ranges, _, _ = street(3, share=0.0)
    a, b = solve_points(ranges, integrity=Integrity(false_alarm=1e-6)), None
    b = solve_points(ranges, integrity=Integrity(false_alarm=1e-6, neighbours=False))
    assert not np.any(a.status == 8)
    assert np.array_equal(a.r_e, b.r_e)
    assert np.array_equal(a.hpl, b.hpl)


def test_without_range_rates_nothing_changes():
    ranges, _, _ = street(3, n=40)
    still = replace(ranges, range_rate=np.full(len(ranges), np.nan))
    a, b = solve_points(still), solve_points(still, integrity=ALONE)
    assert np.array_equal(a.status, b.status)
    assert np.any(a.status >= 5)


def test_epochs_far_apart_are_not_tied():
    ranges, _, _ = street(3, n=40)
    a = solve_points(replace(ranges, t=6.0 * ranges.t))
    assert not np.any(a.status == 8)


def test_a_pause_is_not_bridged():
    ranges, r, _ = street(4)
    keep = (ranges.t < 50.0) | (ranges.t > 70.0)
    points = solve_points(ranges.where(keep))
    true = r[points.t.astype(int)]
    assert np.percentile(np.hypot(*local(points.r_e, true)[points.ok, :2].T), 95) < 8.0
    assert points.ok.mean() > 0.95


def test_stamps_that_hardly_differ_do_no_harm():
    """A receiver that splits an epoch: two microseconds between its halves."""
    ranges, r, _ = street(1, n=60)
    second = np.arange(len(ranges)) % 2 == 1
    t = ranges.t + np.where(second & (ranges.t > 30.0), 2e-6, 0.0)
    order = np.argsort(t, kind="stable")
    points = solve_points(replace(ranges.where(order), t=t[order]))
    true = r[np.round(points.t).astype(int)]
    error = np.hypot(*local(points.r_e, true)[points.ok, :2].T)
    assert points.ok.mean() > 0.9
    assert np.percentile(error, 90) < 6.0


def test_velocity_not_asked_for_stays_so():
    ranges, _, _ = street(1, n=60)
    points = solve_points(ranges, velocity=False)
    assert np.any(points.status == 8)
    assert set(points.velocity_status) == {7}
    assert np.isnan(points.v_e).all()


# --------------------------------------------------------------------------------------------------- the track


def padded(ranges):
    t, epoch = np.unique(ranges.t, return_inverse=True)
    p = Padded.of(ranges, slice(0, len(ranges)), epoch, len(t), ranges.sigma_range, ranges.sigma_rate)
    row = np.maximum(p.row, 0)
    return p, t, np.where(p.row >= 0, ranges.sat[row], -1), np.where(p.row >= 0, ranges.cn0[row], np.nan)


def test_the_track_says_how_good_it_is():
    """White noise, no detours: normalised squared errors are at most the expected ones, at least half of them.

    The random walk of velocity is wider than the turning of this drive, so the track is rather too modest. Errors of
    neighbours are alike: 40 independent ones of each drive, statistical.
    """
    values = []
    for seed in range(4):
        ranges, r, _ = street(seed, share=0.0)
        p, t, sat, cn0 = padded(ranges)
        linked = link_epochs(p, t, sat, cn0, np.where(np.arange(len(t))[:, None] % 3 == 0, r + 300.0, np.nan))
        e = linked.r_e - r
        values.append(np.einsum("ki,kij,kj->k", e, np.linalg.inv(linked.cov_r_e), e) / 3.0)
        assert np.median(linked.direct[p.usable]) > 0.9
    mean, se = np.mean(values), np.sqrt(2.0 / (3.0 * 4 * 40))
    assert 0.5 - 4.0 * se < mean < 1.0 + 4.0 * se


def test_a_satellite_late_by_what_passes_moves_the_track_as_stated():
    """A twentieth of it added to all ranges of a satellite: linear, but for the weights, which hardly change."""
    ranges, r, _ = street(6, share=0.0)
    p, t, sat, cn0 = padded(ranges)
    before = link_epochs(p, t, sat, cn0, r)
    largest = RangeNoise.stated(p, cn0).largest_direct()
    sats = np.unique(sat[sat >= 0])
    worst = int(np.argmax(np.linalg.norm(before.hidden, axis=2).mean(axis=0)))
    after = link_epochs(replace(p, rho=p.rho + 0.05 * largest * (sat == sats[worst])), t, sat, cn0, r)
    moved, stated = np.linalg.norm(after.r_e - before.r_e, axis=1), np.linalg.norm(before.hidden[:, worst], axis=1)
    assert np.median(moved / (0.05 * stated)) == pytest.approx(1.0, abs=0.2)


def test_the_start_does_not_matter():
    """Half a street of detours, begun 5 km away: the same track, to the step that ends the rounds."""
    ranges, r, _ = street(5)
    p, t, sat, cn0 = padded(ranges)
    a = link_epochs(p, t, sat, cn0, r)
    b = link_epochs(p, t, sat, cn0, r + np.array([3000.0, -4000.0, 500.0]))
    assert np.abs(a.r_e - b.r_e).max() < 1.0
    assert np.median(np.abs(a.r_e - b.r_e)) < 0.1


def test_block_tridiagonal_algebra_is_that_of_the_dense_matrix():
    rng = np.random.default_rng(1)
    k, n = 5, 4
    beside = rng.normal(size=(k - 1, n, n))
    N = np.einsum("kij,klj->kil", *(2 * (rng.normal(size=(k, n, n)),))) + 12.0 * np.eye(n)
    dense = np.zeros((k * n, k * n))
    for i in range(k):
        dense[i * n : (i + 1) * n, i * n : (i + 1) * n] = N[i]
        if i < k - 1:
            dense[i * n : (i + 1) * n, (i + 1) * n : (i + 2) * n] = beside[i]
            dense[(i + 1) * n : (i + 2) * n, i * n : (i + 1) * n] = beside[i].T
    assert np.linalg.eigvalsh(dense)[0] > 0.0
    b = rng.normal(size=(k, n, 2))
    assert _solved(N, beside, b).reshape(k * n, 2) == pytest.approx(np.linalg.solve(dense, b.reshape(k * n, 2)))
    inverse = np.linalg.inv(dense).reshape(k, n, k, n)
    assert _diagonal_blocks(N, beside) == pytest.approx(np.stack([inverse[i, :, i] for i in range(k)]))


def test_lasting_errors_count_as_fewer():
    """An autoregression of rho: 1 + 2 sum rho^j = (1 + rho) / (1 - rho); statistical, and cut off at 5 %."""
    rng = np.random.default_rng(2)
    n, m, rho = 4000, 6, 0.8
    v = rng.normal(size=(n, m))
    for k in range(1, n):
        v[k] = rho * v[k - 1] + np.sqrt(1.0 - rho**2) * v[k]
    sat = np.broadcast_to(np.arange(m), (n, m))
    assert lasting_factor(sat, v, np.ones((n, m))) == pytest.approx((1.0 + rho) / (1.0 - rho), rel=0.15)
    assert lasting_factor(sat, rng.normal(size=(n, m)), np.ones((n, m))) == 1.0


# -------------------------------------------------------------------------------------------------- detours


def noise_of(k, m, sigma, cn0):
    one, zero = np.ones((k, m)), np.zeros((k, m))
    p = Padded(
        zero.astype(int), one.astype(bool), zero.astype(int), 1, np.ones((k, m, 3)), np.zeros((k, m, 3)), zero, zero,
        one.astype(bool), one / sigma, one / 0.1,
    )  # fmt: skip
    return RangeNoise.stated(p, cn0)


def test_probability_of_a_direct_range():
    """Bayes' rule written out; the largest residual that passes is where it crosses a half."""
    noise = noise_of(1, 3, 2.0, np.array([[45.0, 20.0, np.nan]]))
    y = np.array([[4.0, -4.0, 30.0]])
    normal = np.exp(-0.5 * (y / 2.0) ** 2) / (2.0 * np.sqrt(2.0 * np.pi))
    late = np.where(y > 0.0, 0.9, 0.1) * np.exp(-np.abs(y) / 30.0) / 30.0
    assert noise.probability_direct(y) == pytest.approx(0.9 * normal / (0.9 * normal + 0.1 * late), abs=1e-6)
    assert noise.probability_direct(noise.largest_direct()) == pytest.approx(0.5, abs=1e-6)


def test_shares_and_lengths_are_learned():
    """Weak ranges half late, strong ones hardly; 20 000 of each: shares to a few standard errors and the prior."""
    rng = np.random.default_rng(3)
    k, m, sigma = 20_000, 2, 2.0
    cn0 = np.broadcast_to([27.0, 47.0], (k, m))
    late = rng.random((k, m)) < np.array([0.5, 0.03])
    y = 1.5 * sigma * rng.normal(size=(k, m)) + np.where(late, rng.exponential(50.0, (k, m)), 0.0)
    noise, none = noise_of(k, m, sigma, cn0), np.zeros((k, m))
    for _ in range(60):
        noise = noise.learned(y, noise.probability_direct(y), none, none)
    assert noise.share[[5, 9]] == pytest.approx([0.5, 0.03], abs=0.03)
    assert noise.detour == pytest.approx(50.0, rel=0.06)
    assert noise.factor == pytest.approx(1.5, rel=0.05)


# ----------------------------------------------------------------------------------------------- recording


@pytest.fixture(scope="module")
def canyon(shared_data):
    from schuler.recording.formats.rinex_navigation import read_rinex_navigation
    from schuler.recording.formats.rinex_observation import read_rinex_observation

    folder = shared_data / "urbannav_tst"
    observations = read_rinex_observation(folder / "COM3_190428_124409.obs")
    messages = read_rinex_navigation(folder / "hksc1180.19n").merged_with(
        read_rinex_navigation(folder / "hksc1180.19b")
    )
    truth = np.genfromtxt(folder / "groundTruth_TST.csv", delimiter=",")
    t = truth[:, 0] * WEEK_S + truth[:, 1] - observations.epoch_gps_s
    points = solve_points(prepare_ranges(observations, messages))
    points = points.where((points.t > t[0] - 0.1) & (points.t < t[-1] + 0.1))
    r = frames.ecef_from_llh(truth[:, 2:5] * np.array([DEG, DEG, 1.0]))
    return points, np.stack([np.interp(points.t, t, r[:, i]) for i in range(3)], axis=-1)


@pytest.mark.campaign
@pytest.mark.realdata
def test_single_points_in_a_canyon(canyon):
    """The issue asks for 460 of 485 epochs, p50 4 m, p95 15 m. Nothing was chosen by these numbers; half by half."""
    points, r = canyon
    error = np.hypot(*local(points.r_e, r)[:, :2].T)
    assert len(points) == 485
    assert points.ok.sum() >= 480  # seen 482: three show fewer than five satellites
    assert np.median(error[points.ok]) < 3.5  # seen 2.8 m
    assert np.percentile(error[points.ok], 95) < 12.0  # seen 10.0 m
    for half in (points.t < points.t[242], points.t >= points.t[242]):
        assert np.median(error[half & points.ok]) < 4.0  # seen 2.5 and 3.1 m
        assert np.percentile(error[half & points.ok], 95) < 15.0  # seen 11.8 and 8.2 m


@pytest.mark.realdata
def test_protection_levels_hold_in_a_canyon(canyon):
    """Risk 1e-3: of 482 epochs none is expected beyond, and none is seen."""
    for direction, most in (("horizontal", 15.0), ("vertical", 45.0)):
        diagram = stanford(*canyon, alert_limit=40.0, direction=direction)
        assert not diagram.misleading.any()
        assert np.median(diagram.level) < most  # they say something
