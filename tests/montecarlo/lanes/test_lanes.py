"""Runs in lanes are the engine's runs, depend on nothing but their number, and err as much as the filter says."""

import os
import pickle
import subprocess
import sys
from dataclasses import replace
from math import erfc, sqrt

import filter_cases as cases
import lane_cases
import numpy as np
import pytest

from schuler import frames
from schuler.exceptions import InputError
from schuler.filtering.filter_arrays import aligned
from schuler.filtering.measurements import ACCEPTED, FORCED, POSITION, REJECTED, VELOCITY, MeasurementSchedule
from schuler.filtering.states import StateLayout, StateModel, layout_for
from schuler.montecarlo.lanes.aiding import LaneAiding, together, true_gnss, true_rests
from schuler.montecarlo.lanes.errors import LaneErrors, true_parameters
from schuler.montecarlo.lanes.records import LaneRecords
from schuler.montecarlo.lanes.replay import normals_of
from schuler.montecarlo.lanes.run import lane_statistics, replay, run_lanes
from schuler.montecarlo.lanes.scenario import draw_run
from schuler.navigation.evaluation.consistency import chi_square_band
from schuler.sensors import catalogue
from schuler.sensors.errors import ImuErrors
from schuler.sensors.noise import GaussMarkov, GaussMarkov2, NoiseModel, Ramp, RandomConstant, RandomWalk, White
from schuler.simulation.gnss import GnssFault, GnssModel
from schuler.simulation.motion import LocalMotion, StaticMotion, euler_attitude

SEED = 11

# ------------------------------------------------------------------------------------- the engine's numbers


def assert_same(scene, number=2, runs=8, states=1e-8, sigmas=1e-10):
    """Errors in sigmas and sigmas of one run against the engine on the same data; returns both."""
    lanes = run_lanes(scene, runs, seed=SEED)
    forward, error, sigma = lane_cases.engine_run(scene, number, SEED)
    np.testing.assert_allclose(lanes.t, forward.rec_t, rtol=0, atol=1e-9)
    # rounding: sums in another order, carried on by the closed loop; 1e-11 and 1e-12 are seen
    assert np.abs((lanes.error[number] - error) / sigma).max() < states
    assert np.abs(lanes.sigma[number] / sigma - 1.0).max() < sigmas
    return lanes, forward


@pytest.mark.parametrize("states", [9, 15, 21, 33, 42])
def test_a_lane_is_the_engine(states):
    """Lever arm, velocity, fixes between samples, an outage, all state layouts."""
    gnss = replace(lane_cases.GNSS, outages=((20.0, 35.0),))
    lanes, forward = assert_same(lane_cases.scenario(states, gnss=gnss))
    assert lanes.accepted[2].tolist() == [44, 44]
    assert np.sum(forward.status == ACCEPTED) == 88


@pytest.mark.parametrize("states", [9, 15, 42])
def test_free_inertial_runs_are_the_engine_too(states):
    assert_same(lane_cases.scenario(states, gnss=None))


@pytest.mark.parametrize("rate", [None, 1.0, 33.0])
def test_any_covariance_rate(rate):
    assert_same(lane_cases.scenario(33, 20.0, covariance_rate_hz=rate, record_s=1.0))


def test_upper_triangular_cross_coupling_and_blocks_in_any_order():
    lay = StateLayout(
        {
            "S_g": StateModel.constant(1e-3),
            "b_g": StateModel.random_walk(2e-3, 1e-6),
            "M_a": StateModel.constant(1e-3),
            "G_g": StateModel.constant(2e-5),
            "b_a": StateModel.gauss_markov(0.02, 300.0),
            "S_a": StateModel.constant(1e-3),
        }
    )
    assert_same(lane_cases.scenario(lay, 30.0))


def test_gauss_markov_states_decay_as_in_the_engine():
    lay = StateLayout(
        {
            "b_a": StateModel.constant(0.05),
            "b_g": StateModel.constant(2e-3),
            "b_a_run": StateModel.gauss_markov(0.01, 8.0),
            "b_g_run": StateModel.gauss_markov(1e-4, 20.0, initial_sigma=3e-4),
        }
    )
    assert_same(lane_cases.scenario(lay, 40.0))


def test_noise_that_differs_by_axis():
    scene = lane_cases.scenario(15, 30.0)
    gyro, accel = np.array([1.0, 2.0, 4.0]) * 1e-4, np.array([3.0, 1.0, 2.0]) * 1e-3
    errors = LaneErrors.of_layout(scene.layout, gyro, accel, 100.0)
    assert_same(replace(scene, gyro_psd=gyro**2, accel_psd=accel**2, errors=errors))


def test_fixes_on_samples_and_at_the_very_start():
    gnss = replace(lane_cases.GNSS, first_s=0.0, rate_hz=5.0)
    assert_same(lane_cases.scenario(21, 20.0, gnss=gnss))


def test_position_alone_without_a_lever_arm():
    motion = lane_cases.Cut(cases.drive(1.0), 40.0)
    aiding = true_gnss(motion, GnssModel(first_s=1.0), use_velocity=False, gate=None)
    lanes, _ = assert_same(lane_cases.scenario(15, 40.0, aiding=aiding))
    assert np.isnan(lanes.nis[:, 1]).all()


def test_zero_velocity_at_rest():
    motion = StaticMotion(cases.ORIGIN, np.array([0.02, -0.01, 1.0]), 60.0)
    rests = true_rests(np.arange(1.0, 60.0, 0.5), 0.01)
    fixes = true_gnss(motion, lane_cases.GNSS, gate=None)
    assert_same(lane_cases.scenario(15, 60.0, motion=motion, aiding=together(fixes, rests)))


def test_runs_whose_filter_finds_itself_wrong_are_those_of_the_engine():
    """A receiver that claims less noise than it has: rejected here, accepted there, forced in the end, run by run."""
    gnss = replace(lane_cases.GNSS, reported_position=np.array([0.15, 0.15, 0.3]), reported_velocity=np.full(3, 0.02))
    scene = lane_cases.scenario(15, 120.0, gnss=gnss, gate=0.99)
    lanes = run_lanes(scene, 8, seed=SEED)
    for number in (0, 5):
        forward, error, sigma = lane_cases.engine_run(scene, number, SEED)
        for i, kind in enumerate((POSITION, VELOCITY)):
            status = forward.status[scene.aiding.schedule.kind == kind]
            assert lanes.rejected[number, i] == np.sum(status == REJECTED)
            assert lanes.accepted[number, i] == np.sum((status == ACCEPTED) | (status == FORCED))
        assert np.any(forward.status == FORCED)
        assert np.any(forward.status == REJECTED)
        assert np.abs((lanes.error[number] - error) / sigma).max() < 1e-7  # rounding
    assert len(set(lanes.rejected[:, 0])) > 2  # every lane its own


def test_large_turns_propagate_as_in_the_engine():
    """3 rad/s: the flush angle counts the true motion here, the measured one there, by at most a sample."""

    def path(t):
        zero = np.zeros((len(t), 3))
        return zero, zero, zero

    def angles(t):
        rpy = np.stack((0.4 * np.sin(0.5 * t), 0.3 * np.cos(0.4 * t), 3.0 * t), -1)
        return rpy, np.stack((0.2 * np.cos(0.5 * t), -0.12 * np.sin(0.4 * t), 3.0 + 0.0 * t), -1)

    motion = LocalMotion(cases.ORIGIN, path, euler_attitude(angles), 40.0)
    scene = lane_cases.scenario(33, 30.0, motion=motion, covariance_rate_hz=2.0, flush_angle=0.25)
    # discretisation: propagations a sample apart
    assert_same(scene, states=0.02, sigmas=2e-3)
    assert_same(replace(scene, options=replace(scene.options, flush_angle=10.0)))


def test_nis_and_nees_are_those_of_the_engine():
    scene = lane_cases.scenario(21, 40.0, nees=("all", "navigation", "dr", "b_g"))
    lanes = run_lanes(scene, 8, seed=SEED)
    forward, error, sigma = lane_cases.engine_run(scene, 4, SEED)
    kind = scene.aiding.schedule.kind
    expected = [forward.nis[kind == k].mean() / 3.0 for k in (POSITION, VELOCITY)]
    np.testing.assert_allclose(lanes.nis[4], expected, rtol=1e-9)  # rounding
    from schuler.filtering.engine import unpack_symmetric
    from schuler.filtering.error_model import ecef_from_ned_states

    P = unpack_symmetric(forward.rec_P, scene.layout.size)
    at = np.searchsorted(scene.ideal.t, forward.rec_t - 1e-6)
    T = ecef_from_ned_states(frames.llh_from_ecef(scene.ideal.truth.r_eb_e[at]), scene.layout.size)
    dx = np.einsum("kij,kj->ki", T, error)
    for name in scene.nees:
        a, b = scene.states(name)
        value = [d[a:b] @ np.linalg.solve(p[a:b, a:b], d[a:b]) / (b - a) for d, p in zip(dx, P, strict=True)]
        np.testing.assert_allclose(lanes.nees[name][4], value, rtol=1e-6)  # rounding times the condition of P
    del sigma


# --------------------------------------------------------------------------------------- run k is run k


def same(a: LaneRecords, i: int, b: LaneRecords, j: int) -> None:
    for name in ("error", "sigma", "nis", "accepted"):
        np.testing.assert_array_equal(getattr(a, name)[i], getattr(b, name)[j])
    for name in a.nees:
        np.testing.assert_array_equal(a.nees[name][i], b.nees[name][j])


def test_a_run_does_not_depend_on_its_company():
    """Bit for bit: alone, in any place of any batch, whatever the threads."""
    scene = lane_cases.scenario(21, 20.0)
    everything = run_lanes(scene, 20, seed=SEED, threads=2)
    alone = run_lanes(scene, [13], seed=SEED)
    same(everything, 13, alone, 0)
    mixed = run_lanes(scene, [900, 7, 13, 2, 0, 1, 10**12, 19, 18, 3], seed=SEED, threads=1)
    for place, number in enumerate(mixed.runs):
        if number < 20:
            same(everything, int(number), mixed, place)
    assert np.unique(everything.error[:, -1, 0]).size == 20
    other = run_lanes(scene, 20, seed=SEED + 1)
    assert not np.any(other.error[:, -1, 0] == everything.error[:, -1, 0])


def test_a_run_that_breaks_down_leaves_the_others_alone():
    """One lane with a hopeless IMU: it is marked, its neighbours do not change by a bit, statistics leave it out."""
    from schuler.montecarlo.lanes import run as module

    scene = lane_cases.scenario(15, 20.0)
    good = run_lanes(scene, 8, seed=SEED)
    original = module.draw_run

    def one_bad(scenario, number, seed):
        drawn = original(scenario, number, seed)
        return drawn._replace(constants=drawn.constants + (300.0 if number == 3 else 0.0))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "draw_run", one_bad)
        bad = run_lanes(scene, 8, seed=SEED)
        sums = lane_statistics(scene, 8, seed=SEED)
    assert bad.diverged.tolist() == [number == 3 for number in range(8)]
    for number in (0, 1, 2, 4, 5, 6, 7):
        same(good, number, bad, number)
    assert (sums.count, sums.diverged) == (7, 1)
    assert np.isfinite(sums.scatter).all()
    assert "1 runs diverged and are left out" in bad.summary()


@pytest.mark.campaign
def test_another_process_makes_the_same_run(tmp_path):
    """A worker that unpickles the scenario and runs three numbers of it: the same bytes."""
    scene = lane_cases.scenario(15, 10.0)
    (tmp_path / "scene").write_bytes(pickle.dumps(scene))
    script = (
        "import pickle, sys; from schuler.montecarlo.lanes.run import run_lanes\n"
        "records = run_lanes(pickle.load(open(sys.argv[1], 'rb')), [4, 1, 9], seed=11)\n"
        "sys.stdout.buffer.write(records.error.tobytes() + records.sigma.tobytes())"
    )
    out = subprocess.run(
        [sys.executable, "-c", script, str(tmp_path / "scene")], capture_output=True, check=True, timeout=600
    ).stdout
    here = run_lanes(scene, 10, seed=11)
    assert out == here.error[[4, 1, 9]].tobytes() + here.sigma[[4, 1, 9]].tobytes()


def test_a_longer_campaign_begins_like_a_shorter_one():
    scene = lane_cases.scenario(15, 10.0)
    few, many = run_lanes(scene, 5, seed=SEED), run_lanes(scene, 11, seed=SEED)
    np.testing.assert_array_equal(few.error, many.error[:5])


def test_an_outage_leaves_the_other_noise_as_it_was():
    """The same luck with and without: until the outage begins nothing differs, and the fixes after it are the same."""
    scene = lane_cases.scenario(15, 40.0, record_s=1.0)
    cut = replace(scene, aiding=scene.aiding.without([(15.0, 25.0)]))
    a, b = run_lanes(scene, 8, seed=SEED), run_lanes(cut, 8, seed=SEED)
    np.testing.assert_array_equal(a.error[:, :15], b.error[:, :15])
    assert np.all(b.sigma[:, 23, 6:9] > a.sigma[:, 23, 6:9])
    z = replay(scene, 1, seed=SEED).schedule.z, replay(cut, 1, seed=SEED).schedule.z
    np.testing.assert_array_equal(*z)


def test_statistics_are_the_sums_of_the_records():
    scene = lane_cases.scenario(15, 20.0, nees=("all", "dr"))
    records = run_lanes(scene, 21, seed=SEED)
    one, two = (lane_statistics(scene, 21, seed=SEED, threads=n) for n in (1, 2))
    for a, b in ((one, two), (records.statistics(), one)):
        np.testing.assert_allclose(a.mean, b.mean, rtol=1e-12, atol=1e-15)  # rounding
        np.testing.assert_allclose(a.scatter, b.scatter, rtol=1e-12)
        np.testing.assert_allclose(a.nees["dr"], b.nees["dr"], rtol=1e-12)
    np.testing.assert_array_equal(one.sum_error, two.sum_error)  # in order, whatever the threads
    np.testing.assert_allclose(one.scatter, np.sqrt((records.error**2).mean(axis=0)), rtol=1e-12)
    np.testing.assert_allclose(one.claimed, np.sqrt((records.sigma**2).mean(axis=0)), rtol=1e-12)
    parts = (
        run_lanes(scene, range(16), seed=SEED).statistics() + run_lanes(scene, range(16, 21), seed=SEED).statistics()
    )
    np.testing.assert_allclose(parts.sum_square, one.sum_square, rtol=1e-12)
    assert parts.count == 21
    assert one.at("dr", one.scatter).shape == (2, 3)
    assert one.to_dict()["count"] == 21
    assert records.to_dict()["nees_dr"].shape == (21, 2)
    with pytest.raises(InputError, match="statistics of different scenarios"):
        one + lane_statistics(lane_cases.scenario(15, 10.0), 8)


def test_progress_is_told():
    seen = []
    run_lanes(lane_cases.scenario(9, 5.0), 20, progress=seen.append)
    assert seen == pytest.approx([1 / 3, 2 / 3, 1.0])


# ------------------------------------------------------------------------------------------- random numbers


def xoshiro(state: list[int], count: int) -> list[int]:
    """xoshiro256++ in Python's whole numbers."""
    mask, s, out = (1 << 64) - 1, list(state), []

    def rotl(x, k):
        return ((x << k) | (x >> (64 - k))) & mask

    for _ in range(count):
        out.append((rotl((s[0] + s[3]) & mask, 23) + s[0]) & mask)
        t = (s[1] << 17) & mask
        s[2] ^= s[0]
        s[3] ^= s[1]
        s[1] ^= s[2]
        s[0] ^= s[3]
        s[2] ^= t
        s[3] = rotl(s[3], 45)
    return out


def test_the_generator_is_xoshiro256_plus_plus():
    """First numbers from the state 1, 2, 3, 4, as published with the generator's other implementations."""
    assert xoshiro([1, 2, 3, 4], 4) == [41943041, 58720359, 3588806011781223, 3591011842654386]


def test_normals_are_box_and_mullers():
    """The kernel's numbers against the transformation in NumPy with libm's functions."""
    state = np.random.SeedSequence(5).generate_state(4, np.uint64)
    z = normals_of(state, 20_000)
    raw = np.array(xoshiro([int(x) for x in state], 20_000), dtype=np.uint64).reshape(-1, 2)
    u = 1.0 - (raw[:, 0] >> np.uint64(12)) * 2.0**-52
    angle = ((raw[:, 1] >> np.uint64(12)) * 2.0**-52 - 0.5) * np.pi / 2
    r = np.sqrt(-2.0 * np.log(u))
    c, s = r * np.cos(angle), r * np.sin(angle)
    c = np.where(raw[:, 1] & np.uint64(2), -c, c)
    swap = (raw[:, 1] & np.uint64(1)).astype(bool)
    expected = np.stack((np.where(swap, s, c), np.where(swap, c, s)), axis=1).ravel()
    # rounding: a few units in the last place of the radius
    assert np.abs(z - expected).max() < 3e-15 * r.max()


@pytest.fixture(scope="module")
def many_normals():
    """(500 000, 8): eight lanes, each from a seed of its own."""
    from schuler.montecarlo.lanes._random_kernels import draw

    seeds = [np.random.SeedSequence(SEED, spawn_key=(k, 2)).generate_state(4, np.uint64) for k in range(8)]
    out = aligned(500_000, 8)
    draw(np.ascontiguousarray(np.stack(seeds, axis=1)), out)
    return out


@pytest.mark.campaign
def test_moments_of_the_normals(many_normals):
    z, n = many_normals, many_normals.size
    # statistical: 4.5 standard errors; moments of a normal, and those of twice the order, whence the errors
    exact = [0.0, 1.0, 0.0, 3.0, 0.0, 15.0]
    double = [1.0, 3.0, 15.0, 105.0, 945.0, 10395.0]
    for k, (value, second) in enumerate(zip(exact, double, strict=True), start=1):
        assert abs((z**k).mean() - value) < 4.5 * sqrt((second - value**2) / n), k


def test_distribution_and_tails_of_the_normals(many_normals):
    from scipy.special import ndtr

    z = np.sort(many_normals.ravel())
    n = len(z)
    p = ndtr(z)
    distance = max(np.max(np.arange(1, n + 1) / n - p), np.max(p - np.arange(n) / n))
    assert distance * sqrt(n) < 2.1  # Kolmogorov and Smirnov: exceeded once in 3400
    for k in (1.0, 2.0, 3.0, 4.0, 5.0):
        for tail in (np.sum(z > k), np.sum(z < -k)):
            expected = n * 0.5 * erfc(k / sqrt(2.0))
            assert abs(tail - expected) < 4.5 * sqrt(expected) + 3.0, k  # statistical, and Poisson's skewness
    assert 4.9 < np.abs(z).max() < 6.3  # of four million: 5.0 to 6.2 but for one in a thousand


def test_normals_are_independent(many_normals):
    """Of neighbours in the stream, of lanes, and of their squares (Box and Muller's two share a radius)."""
    z, n = many_normals, len(many_normals)
    squares = (z**2 - 1.0) / sqrt(2.0)
    for x in (z, squares):
        lanes = x.T @ x / n
        assert np.abs(lanes - np.diag(np.diag(lanes))).max() < 4.5 / sqrt(n)  # statistical, of 28
        for lag in range(1, 13):
            product = (x[lag:] * x[:-lag]).mean(axis=0)
            assert np.abs(product).max() < 4.5 / sqrt(n - lag), lag  # statistical, of 8
    for a, b in ((0, 1), (2, 3)):  # pairs of one transformation
        pair = (np.sign(z[a::4]) == np.sign(z[b::4])).mean()
        assert abs(pair - 0.5) < 4.5 * 0.5 / sqrt(z[a::4].size)


# ------------------------------------------------------------------------------------------ sensor errors


def quiet(spec_noise=None, **errors) -> LaneErrors:
    noise = NoiseModel() if spec_noise is None else spec_noise
    return LaneErrors.of_imu(ImuErrors(gyro_noise=noise, accel_noise=noise, **errors), 100.0, 6000)


def test_constant_errors_are_those_of_the_simulator(rng):
    """Without noise a run's increments are ImuErrors.apply_increments' own."""
    fixed = {
        "b_g": 1e-3 * rng.standard_normal(3), "b_a": 0.1 * rng.standard_normal(3),
        "M_g": 1e-2 * rng.standard_normal((3, 3)), "M_a": 1e-2 * rng.standard_normal((3, 3)),
        "G_g": 1e-4 * rng.standard_normal((3, 3)),
    }  # fmt: skip
    scene = lane_cases.scenario(42, 30.0, errors=quiet(**fixed))
    data = replay(scene, 3)
    dtheta, dv, _ = ImuErrors(**fixed).apply_increments(scene.ideal.gyro, scene.ideal.accel, 0.01, rng)
    np.testing.assert_allclose(data.increments.dtheta_ib_b, dtheta, rtol=0, atol=1e-16)  # rounding
    np.testing.assert_allclose(data.increments.dv_ib_b, dv, rtol=0, atol=1e-14)
    true = data.parameters[-1]
    np.testing.assert_array_equal(true, true_parameters(scene.layout, draw_run(scene, 3, 0).constants))
    np.testing.assert_array_equal(true[0:3], fixed["b_a"])
    np.testing.assert_array_equal(true[6:9], np.diag(fixed["M_a"]))
    np.testing.assert_array_equal(true[24:33], fixed["G_g"].ravel())
    assert_same(scene)


@pytest.mark.campaign
def test_processes_have_the_variances_of_the_simulator():
    """Gauss-Markov from zero and stationary, random walk, constant, ramp: variance at chosen ages over many runs."""
    terms = {
        "stationary": GaussMarkov(2e-3, 3.0), "zero": GaussMarkov(2e-3, 3.0, "zero"), "walk": RandomWalk(5e-4),
        "constant": RandomConstant(1.5e-3), "ramp": Ramp(3e-4),
    }  # fmt: skip
    expected = {
        "stationary": lambda t: 4.0 + 0.0 * t, "zero": lambda t: 4.0 * (1 - np.exp(-2.0 * t / 3.0)),
        "walk": lambda t: 0.25 * t, "constant": lambda t: 2.25 + 0.0 * t, "ramp": lambda t: (0.3 * t) ** 2,
    }  # fmt: skip
    for name, term in terms.items():
        scene = lane_cases.scenario(15, 8.0, errors=quiet(NoiseModel((term,))))
        history = np.array([replay(scene, k, seed=3).parameters for k in range(200)])  # (runs, n, 6)
        at = np.array([0, 100, 300, 799])
        variance = 1e6 * (history[:, at] ** 2).mean(axis=(0, 2))
        exact = expected[name](at * 0.01)
        # statistical: 4.5 standard errors of a variance from 1200 values
        assert np.all(np.abs(variance - exact) <= 4.5 * exact * sqrt(2.0 / 1200)), name
        lag = 1e6 * (history[:, 500] * history[:, 200]).mean()
        if name == "stationary":
            assert abs(lag - 4.0 * np.exp(-1.0)) < 4.5 * 4.0 * sqrt(1.2 / 1200)
        assert_same(scene)


def test_white_noise_has_the_density_asked_for():
    scene = lane_cases.scenario(9, 60.0)
    data = replay(scene, 0)
    gyro, accel = (data.increments.dtheta_ib_b - scene.ideal.gyro, data.increments.dv_ib_b - scene.ideal.accel)
    for noise, N in ((gyro, cases.GYRO_N), (accel, cases.ACCEL_N)):
        assert abs(noise.var() / (N**2 * 0.01) - 1.0) < 4.5 * sqrt(2.0 / noise.size)  # statistical
        assert np.abs(np.corrcoef(noise.T) - np.eye(3)).max() < 4.5 / sqrt(len(noise))
    assert abs(np.corrcoef(gyro[:, 0], accel[:, 0])[0, 1]) < 4.5 / sqrt(len(gyro))


def test_gnss_noise_is_north_east_down():
    scene = lane_cases.scenario(9, 120.0)
    true = scene.aiding.schedule
    C = frames.C_en(frames.llh_from_ecef(true.z[true.kind == POSITION, :3]))
    errors = []
    for k in range(20):
        z = replay(scene, k).schedule.z - true.z
        errors.append((np.einsum("nji,nj->ni", C, z[true.kind == POSITION, :3]), z[true.kind == VELOCITY, :3]))
    for which, sigma in ((0, cases.SIGMA_R), (1, cases.SIGMA_V)):
        e = np.concatenate([x[which] for x in errors]) / sigma
        assert np.all(np.abs(e.var(axis=0) - 1.0) < 4.5 * sqrt(2.0 / len(e)))  # statistical
        assert np.abs(np.corrcoef(e.T) - np.eye(3)).max() < 4.5 / sqrt(len(e))


def test_an_imu_of_the_catalogue():
    """Bias instability and all; what lanes do not have is refused unless it is left out knowingly."""
    spec = catalogue.spec("flenniken-tactical")
    errors = LaneErrors.of_spec(spec, 100.0, 3000)
    lay = layout_for(spec, 15)
    scene = lane_cases.scenario(lay, 30.0, errors=errors)
    noise = (np.full(3, spec.gyro.random_walk**2), np.full(3, spec.accel.random_walk**2))
    assert_same(replace(scene, gyro_psd=noise[0], accel_psd=noise[1]))
    assert errors.to_dict()["source"]["name"] == spec.name


def test_drawn_constants_are_the_simulators():
    spec = catalogue.spec("flenniken-tactical")
    errors = LaneErrors.of_spec(spec, 100.0, 3000, gauge="upper")
    drawn = errors.draw(np.random.default_rng(3))
    same_imu = ImuErrors.draw(spec, np.random.default_rng(3), gauge="upper")
    np.testing.assert_array_equal(drawn.constants[:3], same_imu.b_g)
    np.testing.assert_array_equal(drawn.constants[15:24], same_imu.M_a.ravel())


# -------------------------------------------------------------------------------------------- consistency


@pytest.mark.thinned(2)
@pytest.mark.parametrize("states", [15, 33])
def test_scatter_is_what_the_filter_says(states):
    """Biases, scale factors, cross-coupling, start and noise drawn from the filter's own model: 800 runs of 2 min.

    The start is known to 0.6 deg: with 3 deg of heading the filter's linearisation shows, NEES 1.10 after 10 s.
    """
    runs = 800
    scene = lane_cases.scenario(
        states, 120.0, nees=("all", "navigation", "b_a", "b_g"), attitude=np.array([0.002, 0.002, 0.01])
    )
    records = run_lanes(scene, runs, seed=SEED)
    assert not records.diverged.any()
    # statistical: 99.99 percent bands of a mean of 800 chi-squares, 12 looks
    for name, values in records.nees.items():
        a, b = scene.states(name)
        low, high = chi_square_band(b - a, runs, 0.9999)
        mean = values.mean(axis=0)
        assert np.all((mean > low) & (mean < high)), (name, low, mean, high)
    sums = records.statistics()
    ratio = sums.scatter / sums.claimed
    assert np.abs(ratio - 1.0).max() < 5.0 / sqrt(2.0 * runs)  # statistical: 5 standard errors, of 180 or 396
    assert np.abs(sums.mean / sums.claimed).max() < 5.0 / sqrt(runs)
    nis = records.nis.mean(axis=0)
    low, high = chi_square_band(3 * 119, runs, 0.9999)
    assert np.all((nis > low) & (nis < high)), nis
    # injected biases were of both signs and large against what is left of them
    true = np.array([draw_run(scene, k, SEED) for k in range(20)], dtype=object)
    starts = np.array([d[3].ravel() for d in true])
    assert np.all((starts > 0.0).any(axis=0) & (starts < 0.0).any(axis=0))


@pytest.mark.campaign
@pytest.mark.parametrize("runs", [24, pytest.param(400, marks=pytest.mark.slow)])
def test_consistent_over_an_hour_with_outages(runs):
    """What a few minutes do not show; five outages of a minute."""
    lay = StateLayout(
        {
            "b_a": StateModel.gauss_markov(0.02, 3600.0),
            "b_g": StateModel.gauss_markov(5e-4, 3600.0),
            "S_a": StateModel.constant(1e-3),
            "S_g": StateModel.constant(1e-3),
        }
    )
    outages = tuple((600.0 * k, 600.0 * k + 60.0) for k in range(1, 6))
    motion = LocalMotion(cases.ORIGIN, weaving, euler_attitude(heading), 3600.0)
    scene = lane_cases.scenario(
        lay, 3600.0, motion=motion, rate_hz=20.0, gnss=replace(lane_cases.GNSS, outages=outages)
    )
    records = run_lanes(scene, runs, seed=SEED)
    low, high = chi_square_band(lay.size, runs, 0.9999)
    mean = records.nees["all"].mean(axis=0)
    at = [5, 59, 65, 185, 239, 305, 359]
    assert np.all((mean[at] > low) & (mean[at] < high)), (low, mean[at], high)
    # a mean over an hour of correlated values: an effective one every five minutes is assumed
    low, high = chi_square_band(lay.size, 12 * runs, 0.9999)
    assert low < mean.mean() < high
    end = records.sigma[:, 65, 6:8].mean() / records.sigma[:, 59, 6:8].mean()
    assert end > 3.0  # the outage is one


def weaving(t):
    w = 2.0 * np.pi / 60.0
    zero = np.zeros_like(t)
    r = np.stack((200.0 * np.sin(w * t), 100.0 * np.sin(2 * w * t), zero), -1)
    v = np.stack((200.0 * w * np.cos(w * t), 200.0 * w * np.cos(2 * w * t), zero), -1)
    return r, v, np.stack((-200.0 * w**2 * np.sin(w * t), -400.0 * w**2 * np.sin(2 * w * t), zero), -1)


def heading(t):
    zero = np.zeros_like(t)
    return np.stack((zero, zero, np.sin(0.05 * t)), -1), np.stack((zero, zero, 0.05 * np.cos(0.05 * t)), -1)


# ------------------------------------------------------------------------------------------------ refusals


def test_what_lanes_do_not_have_is_refused():
    scene = lane_cases.scenario(15, 5.0)
    motion = lane_cases.Cut(cases.drive(1.0), 5.0)
    with pytest.raises(InputError, match="runs: expected a positive count"):
        run_lanes(scene, 0)
    with pytest.raises(InputError, match="runs: expected a positive count"):
        run_lanes(scene, [3, -1])
    with pytest.raises(InputError, match="sensor errors only"):
        replace(scene, layout=StateLayout({"lever": StateModel.constant(0.1)}))
    with pytest.raises(InputError, match="the initial covariance has 15 states, the layout 21"):
        replace(scene, layout=cases.layout(21))
    with pytest.raises(InputError, match="neither smooth nor bridge pauses"):
        replace(scene, options=replace(scene.options, smoother=True))
    with pytest.raises(InputError, match=r"a sample every 0\.02 s, the IMU reports 100"):
        replace(scene, errors=LaneErrors.of_layout(scene.layout, np.zeros(3), np.zeros(3), 50.0))
    with pytest.raises(InputError, match=r"turns by 0\.50 rad in a sample"):
        replace(scene, ideal=scene.ideal._replace(gyro=scene.ideal.gyro + np.array([0.5, 0.0, 0.0])))
    with pytest.raises(InputError, match="no state block 'S_g' in this layout"):
        replace(scene, nees=("S_g",))
    with pytest.raises(InputError, match="gyro_psd: expected non-negative"):
        replace(scene, gyro_psd=-np.ones(3))
    odd = GnssModel(drift_position=np.ones(3), faults=(GnssFault(1.0, 2.0),))
    with pytest.raises(InputError, match="this receiver has drift_position, faults"):
        true_gnss(motion, odd)
    turning = scene.aiding.schedule
    z = turning.z.copy()
    z[np.flatnonzero(turning.kind == VELOCITY)[0], 4] = 0.01
    with pytest.raises(InputError, match="lever arms fixed to the IMU"):
        LaneAiding(replace(turning, z=z), scene.aiding.sigma)
    with pytest.raises(InputError, match="positions, velocities and zero velocities only"):
        LaneAiding(MeasurementSchedule.of(10, [1.0], [0.1], 1.0), np.zeros((1, 3)))
    spec = catalogue.spec("flenniken-tactical")
    clipping = replace(spec, gyro=replace(spec.gyro, range=1.0))
    with pytest.raises(InputError, match="neither clip nor round, but it has a range"):
        LaneErrors.of_spec(clipping, 100.0, 100)
    assert LaneErrors.of_spec(clipping, 100.0, 100, left_out=("range",)).white[0] == spec.gyro.random_walk
    with pytest.raises(InputError, match="gyro_range: runs in lanes neither clip nor round"):
        LaneErrors.of_imu(ImuErrors(gyro_range=1.0), 100.0, 100)
    with pytest.raises(InputError, match="not GaussMarkov2"):
        quiet(NoiseModel((White(1e-4), GaussMarkov2(1e-3, 2.0))))
    with pytest.raises(InputError, match="S_a: in lanes only biases wander"):
        LaneErrors.of_layout(StateLayout({"S_a": StateModel.random_walk(1e-3, 1e-5)}), np.zeros(3), np.zeros(3), 100.0)


# ---------------------------------------------------------------------------------------------- the lane type


@pytest.mark.parametrize("name", ["lt", "le", "gt", "ge", "eq", "ne"])
@pytest.mark.parametrize("right", [0.5, 1])
def test_lanes_cannot_be_compared_with_numbers(name, right):
    """Eight runs have eight answers; a branch on one of them would send all runs its way."""
    import operator

    import numba

    from schuler.filtering.kernels.vector import as_lanes

    compare = getattr(operator, name)
    with pytest.raises(numba.TypingError):
        numba.njit(lambda x: compare(as_lanes(x)[0], right))(np.zeros((1, 8)))
    with pytest.raises(numba.TypingError):
        numba.njit(lambda x: 1 if as_lanes(x)[0] else 2)(np.zeros((1, 8)))


LANES_ALONE = """
import sys
import lane_cases
from numba.extending import is_jitted
from schuler.montecarlo.lanes.run import run_lanes
run_lanes(lane_cases.scenario(15, 2.0), 8)
modules = [m for name, m in sys.modules.items() if "kernels" in name and ".lanes." not in name]
kernels = {v for m in modules for v in vars(m).values() if is_jitted(v)}
print(len(kernels), *{k.py_func.__name__ for k in kernels if any("lane" in str(t) for s in k.signatures for t in s)})
"""


@pytest.mark.campaign
def test_runs_in_lanes_use_no_kernel_of_the_engine():
    """One dispatcher for both would mix their machine code on disk (tests/test_jit.py says what came of it)."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    done = subprocess.run(
        [sys.executable, "-c", LANES_ALONE], capture_output=True, text=True, env=environment, check=True
    )
    count, *mixed = done.stdout.split()
    assert int(count) > 50
    assert set(mixed) <= {"draw"}
