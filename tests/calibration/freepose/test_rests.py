"""The published search for rests: thresholds in closed form, simulated logs with known rests, what is refused."""

from dataclasses import replace

import numpy as np
import pytest

from schuler.calibration.freepose.calibrate import calibrate_freepose
from schuler.calibration.freepose.fleet import calibrate_fleet
from schuler.calibration.freepose.rests import ENOUGH, MULTIPLES, tedaldi_rests, without_held
from schuler.calibration.freepose.simulation import hand_log, spread_turns
from schuler.calibration.result.parameters import in_gauge, vector
from schuler.exceptions import InputError
from schuler.recording.series import ImuSeries
from schuler.rotation import dcm_from_rotvec
from schuler.sensors.errors import ImuErrors
from schuler.sensors.noise import White
from schuler.standstill.variance_ratio import accel_variance_ratio
from schuler.units import DEG, G0

N_G, N_A = 3e-4, 2e-3  # a consumer IMU [rad/s/sqrt(Hz)], [m/s^2/sqrt(Hz)]
DT, W = 0.01, 101
HALF = W // 2
AMPLITUDE = np.array([0.02, 0.01, 0.03])  # of the initial rest [m/s^2]
#: Variance (over count - 1) of +-1 in turn, of an odd window and of an even number of samples.
IN_WINDOW, AT_START = (W - 1.0 / W) / (W - 1.0), 1000.0 / 999.0
SIXTEEN = np.concatenate([np.eye(3), -np.eye(3), [[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)],
                          [[1, 1, 0], [1, 0, -1]]])  # fmt: skip


def pulses(segments, R=None, b=(0.1, -0.2, 0.05)) -> ImuSeries:
    """Specific force that reads plus and minus ``AMPLITUDE sqrt(multiple)`` in turn, one direction after another.

    ``segments`` are (direction, multiple of the initial variance, samples).
    """
    parts = []
    for direction, multiple, n in segments:
        f = G0 * np.asarray(direction, dtype=float) / np.linalg.norm(direction)
        sign = (-1.0) ** np.arange(n)
        parts.append((np.eye(3) if R is None else R) @ f + b + np.sqrt(multiple) * sign[:, None] * AMPLITUDE)
    accel = np.concatenate(parts)
    return ImuSeries(DT * np.arange(len(accel)), np.zeros_like(accel), accel)


def starts_of(segments):
    return np.cumsum([0, *(n for _, _, n in segments)])


def some_errors(noise=True) -> ImuErrors:
    rng = np.random.default_rng(0)
    errors = in_gauge(
        ImuErrors(
            b_g=0.02 * rng.standard_normal(3), b_a=0.2 * rng.standard_normal(3),
            M_g=0.02 * rng.standard_normal((3, 3)), M_a=0.02 * rng.standard_normal((3, 3)),
        ), "upper",
    )  # fmt: skip
    return replace(errors, gyro_noise=White(N_G) + White(0.0), accel_noise=White(N_A) + White(0.0)) if noise else errors


def log_of(errors, n=24, seed=1, **options) -> ImuSeries:
    rng = np.random.default_rng(seed)
    return hand_log(errors, rng, rotvecs=spread_turns(n, rng), **options)


def test_magnitude_of_variances_in_closed_form():
    """Length of the vector of variances, not of deviations, over count - 1. Rounding of sums over a window."""
    imu = pulses([((0, 0, 1), 1.0, 1000), ((0, 0, 1), 9.0, 500)])
    ratio, at_rest = accel_variance_ratio(imu, DT, 10.0)
    np.testing.assert_allclose(at_rest, AMPLITUDE**2 * AT_START, rtol=1e-10)
    np.testing.assert_allclose(ratio[HALF : 1000 - HALF], IN_WINDOW / AT_START, rtol=1e-9)
    np.testing.assert_allclose(ratio[1000 + HALF : -HALF], 9.0 * IN_WINDOW / AT_START, rtol=1e-9)
    assert np.isinf(ratio[:HALF]).all()
    assert np.isinf(ratio[-HALF:]).all()
    # one axis that moves alone is seen against the magnitude of all three
    alone = replace(imu, accel=imu.accel + np.where(np.arange(1500) < 1000, 0.0, (-1.0) ** np.arange(1500))[:, None]
                    * [0.0, 0.0, -AMPLITUDE[2] * 3.0])  # fmt: skip
    still = 9.0 * np.linalg.norm(AMPLITUDE[:2] ** 2) / np.linalg.norm(AMPLITUDE**2)
    np.testing.assert_allclose(
        accel_variance_ratio(alone, DT, 10.0)[0][1000 + HALF : -HALF], still * IN_WINDOW / AT_START, rtol=1e-9
    )


def test_rests_begin_and_end_half_a_window_inside():
    """Known rests to the sample; a segment of 4.5 times the variance is a rest from k = 5 on, one of 30 never.

    k multiplies the variance: were it its square root or square, 4.5 would be a rest from k = 21 or 3 on.
    """
    quiet = [(d, 1.0, 400) for d in SIXTEEN]
    segments = [((0, 0, 1), 1.0, 1000), *quiet[:8], ((1, 2, 3), 4.5, 400), *quiet[8:], ((3, 2, 1), 30.0, 400)]
    rests = tedaldi_rests(pulses(segments), DT, G0, 10.0)
    counts = {k: n for k, n, _ in rests.tried}
    assert list(counts) == list(MULTIPLES)
    assert [counts[float(k)] for k in range(2, 5)] == [17] * 3
    assert [counts[float(k)] for k in range(5, 11)] == [18] * 6
    at = starts_of(segments)
    kept = [k for k, (_, multiple, _) in enumerate(segments) if multiple == 1.0]
    assert rests.margin in (2.0, 3.0, 4.0)
    np.testing.assert_array_equal(rests.index, [(at[k] + HALF, at[k + 1] - HALF) for k in kept])
    np.testing.assert_allclose(rests.duration, 1.0)  # of the samples used
    np.testing.assert_allclose(rests.accel[0], [0.1, -0.2, 0.05 + G0], atol=1e-12)  # an even number of pulses


def test_the_threshold_of_least_cost_is_kept():
    """A direction whose size is wrong costs: where it is a rest only from k = 5 on, less is kept. Costs by hand."""
    segments = [((0, 0, 1), 1.0, 1000), *((d, 1.0, 400) for d in SIXTEEN)]
    good = pulses(segments)
    wrong = pulses([((1, 2, 3), 4.5, 400)])
    accel = np.concatenate((good.accel, 1.01 * wrong.accel))
    imu = ImuSeries(DT * np.arange(len(accel)), np.zeros_like(accel), accel)
    rests = tedaldi_rests(imu, DT, G0, 10.0)
    assert rests.margin == 2.0
    cost = {k: c for k, _, c in rests.tried}
    assert cost[5.0] > 2.0 * cost[2.0]
    # half the sum of squares of +-(amplitude along f) of all used samples; cross terms of second order, 1e-3
    u = np.array([(0, 0, 1), *SIXTEEN]) / np.linalg.norm(np.array([(0, 0, 1), *SIXTEEN]), axis=1, keepdims=True)
    assert cost[2.0] == pytest.approx(50.0 * ((u @ AMPLITUDE) ** 2).sum(), rel=1e-2)


def test_few_rests_do_not_win_by_their_small_cost():
    """Nine parameters fit ten rests at k = 2 better than sixteen at k = 5; with ten alone they are all there is."""
    quiet, loud = [(d, 1.0, 400) for d in SIXTEEN[:9]], [(d, 4.5, 400) for d in SIXTEEN[9:]]
    start = [((1, 2, 3), 1.0, 1000)]
    rests = tedaldi_rests(pulses([*start, *quiet, *loud]), DT, G0, 10.0)
    counts, cost = [n for _, n, _ in rests.tried], [c for _, _, c in rests.tried]
    assert counts[0] == 10 < ENOUGH < counts[3] == 17
    assert cost[0] < cost[3]
    assert rests.margin >= 5.0
    alone = tedaldi_rests(pulses([*start, *quiet, *((d, 30.0, 400) for d in SIXTEEN[9:])]), DT, G0, 10.0)
    assert len(alone) == 10


def test_rests_shorter_than_what_is_used_are_none():
    """Segments lose half a window at either end: 160 samples leave 60, which are not the 100 of a second."""
    segments = [((0, 0, 1), 1.0, 1000), *((d, 1.0, 400) for d in SIXTEEN), ((1, 2, 3), 1.0, 160)]
    segments += [((3, 2, 1), 1.0, 202)]
    rests = tedaldi_rests(pulses(segments), DT, G0, 10.0)
    assert len(rests) == 18
    at = starts_of(segments)
    assert rests.index[-1].tolist() == [at[-2] + HALF, at[-1] - HALF]
    assert len(tedaldi_rests(pulses(segments), DT, G0, 10.0, min_s=0.5)) == 19
    np.testing.assert_allclose(tedaldi_rests(pulses(segments), DT, G0, 10.0, min_s=2.0).duration, 2.0)


def test_gaps_end_rests():
    imu = pulses([((0, 0, 1), 1.0, 1000), *((d, 1.0, 400) for d in SIXTEEN)])
    t = imu.t + np.where(np.arange(len(imu)) >= 1200, 5.0, 0.0)
    rests = tedaldi_rests(replace(imu, t=t), DT, G0, 10.0)
    assert len(rests) == 18
    assert [1050, 1200] in rests.index.tolist()
    assert [1200, 1350] in rests.index.tolist()


def test_known_rests_of_a_simulated_log_are_found():
    """24 poses, to the half window that a rest loses at either end, or less where the turn begins too slowly."""
    imu = log_of(some_errors())
    rests = tedaldi_rests(imu.rates(), imu.interval, G0, 15.0)
    assert len(rests) == 24
    start = np.array([0.0, *(22.0 + 5.0 * np.arange(23))])
    stop = np.array([20.0, *(start[1:] + 3.0)])
    begin, end = imu.t[rests.index[:, 0]], imu.t[rests.index[:, 1] - 1]
    assert (np.abs(begin - start) < 0.6).all()
    assert (np.abs(end - stop) < 0.6).all()
    assert (begin[1:] > start[1:] - 0.1).all()


def test_perfect_data_return_what_was_inserted():
    """Rounding: 1e-11 of numbers of order 0.1; means over parts of rests and turns from rest to rest are as exact."""
    errors = some_errors(noise=False)
    result = calibrate_freepose(log_of(errors), initial_rest_s=15.0, rests="tedaldi")
    assert result.status == "ok", result.verdicts
    assert result.extra["poses"] == 24
    np.testing.assert_allclose(result.values - vector(errors, result.names), 0.0, atol=1e-11)


def test_result_says_how_rests_were_found():
    imu = log_of(some_errors())
    result = calibrate_freepose(imu, initial_rest_s=15.0, rests="tedaldi")
    assert result.provenance["options"]["rests"] == "tedaldi"
    assert result.extra["margin"] in MULTIPLES
    assert [k for k, _, _ in result.extra["tried"]] == list(MULTIPLES)
    assert dict(zip(MULTIPLES, result.extra["tried"], strict=True))[result.extra["margin"]][1] == result.extra["poses"]
    usual = calibrate_freepose(imu, initial_rest_s=15.0)
    assert usual.provenance["options"]["rests"] == "auto"
    assert "tried" not in usual.extra
    # a second of each pose instead of three: 1 sigma of what poses determine is larger by about the root of three
    ratio = result.sigma[:9] / usual.sigma[:9]
    assert (ratio > 1.2).all()
    assert (ratio < 2.4).all()
    table = calibrate_fleet([imu], initial_rest_s=15.0, rests="tedaldi")
    np.testing.assert_array_equal(table.values[0], result.values)


def test_counts_give_the_same_rests():
    """Nothing in the search has a unit but gravity."""
    imu = log_of(some_errors()).rates()
    raw = ImuSeries(imu.t, 4778.0 * imu.gyro + 32768.0, 415.0 * imu.accel + 32768.0)
    one, two = (tedaldi_rests(x, imu.interval, G0, 15.0) for x in (imu, raw))
    np.testing.assert_array_equal(one.index, two.index)
    for (_, n, cost), (_, m, other) in zip(one.tried, two.tried, strict=True):
        assert n == m
        assert cost == pytest.approx(other, rel=1e-3)  # the factor has four digits


def slowly_turning(rate):
    """A simulated log whose fifth pose turns about a level axis instead of resting; its samples."""
    imu = log_of(some_errors()).rates()
    first = 2200 + 500 * 3
    accel = imu.accel.copy()
    f = accel[first : first + 300].mean(axis=0)
    level = np.cross(f, [1.0, 0.0, 0.0])
    turn = dcm_from_rotvec(rate * DT * np.arange(-150, 150)[:, None] * level / np.linalg.norm(level))
    accel[first : first + 300] += np.einsum("kij,j->ki", turn, f) - f
    return replace(imu, accel=accel), first


def test_a_slow_turn_is_refused():
    """Closed form: a ramp of g omega over T seconds has the variance (g omega T)^2 / 12 along one axis.

    With this noise, 4e-4 m^2/s^4 an axis, ten times the variance at rest are 1.7 deg/s.
    """
    at_rest = np.sqrt(3.0) * N_A**2 / DT
    limit = np.sqrt(12.0 * 10.0 * at_rest) / G0
    assert limit / DEG == pytest.approx(1.7, abs=0.05)
    imu, first = slowly_turning(2.0 * limit)
    rests = tedaldi_rests(imu, DT, G0, 15.0)
    assert all(n == 23 for k, n, _ in rests.tried if k > 2.0)
    assert not ((rests.index[:, 0] < first + 300) & (rests.index[:, 1] > first)).any()
    # one a tenth as fast cannot be told from rest
    imu, _ = slowly_turning(0.1 * limit)
    assert len(tedaldi_rests(imu, DT, G0, 15.0)) == 24


def test_a_log_that_never_rests_again_is_refused():
    """Turned slowly all the time after the initial rest."""
    imu = log_of(some_errors()).rates()
    angle = 5.0 * DEG * np.maximum(imu.t - 20.0, 0.0)
    noise = imu.accel[np.arange(len(imu)) % 1900] - imu.accel[:1900].mean(axis=0)
    accel = noise - G0 * np.column_stack((np.sin(angle), np.zeros_like(angle), np.cos(angle)))
    result = calibrate_freepose(replace(imu, accel=accel), initial_rest_s=15.0, rests="tedaldi")
    assert result.status == "refused"
    assert result.verdicts[0].startswith("Refused: 1 pose at rest found")
    assert np.isinf(result.extra["tried"][-1][2])
    assert "put up next" in result.next_pose


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({}, "initial_rest_s: expected the seconds at rest that the log begins with"),
        ({"initial_rest_s": 2.0, "window_s": 3.0}, "initial_rest_s: expected a window of 3 s or more, got 2 s"),
        ({"initial_rest_s": 10.0, "intervals": [(0.0, 10.0)]}, "rests: expected 'auto' with intervals"),
        ({"initial_rest_s": 10.0, "rests": "imu_tk"}, "rests: expected 'auto' or 'tedaldi', got 'imu_tk'"),
        ({"initial_rest_s": 10.0, "window_s": 20.0}, "expected ten windows of 20 s or more"),
    ],
)
def test_what_makes_no_sense_is_said(options, message):
    with pytest.raises(InputError, match=message):
        calibrate_freepose(log_of(some_errors()), **{"rests": "tedaldi", **options})


# ---------------------------------------------------------------------------------------------- held readings


def test_held_readings_are_a_gap_and_no_pose():
    """A link that stops in a turn holds the last reading: two seconds that vary less than any rest, tilted anyhow."""
    errors = some_errors()
    imu = log_of(errors).rates()
    clean = calibrate_freepose(imu, halves=False)
    a, b = (
        int(np.searchsorted(imu.t, s)) for s in (clean.extra["intervals"][7][1] + 0.3, clean.extra["intervals"][8][0])
    )
    gyro, accel = imu.gyro.copy(), imu.accel.copy()
    gyro[a : b + 200], accel[a : b + 200] = gyro[a], accel[a]
    kept, sentences = without_held(ImuSeries(imu.t, gyro, accel))
    assert len(kept) == len(imu) - (b + 199 - a)
    assert f"{imu.t[a]:.1f}..{imu.t[b + 199]:.1f} s" in sentences[0]
    result = calibrate_freepose(ImuSeries(imu.t, gyro, accel), halves=False)
    assert sentences[0] in result.verdicts
    assert not any(start < imu.t[a] < stop for start, stop in result.extra["intervals"])
    z = (result.values - vector(errors, result.names)) / result.sigma
    assert np.sqrt(np.mean(z**2)) < 1.7  # statistical: 21 values


def test_a_log_without_noise_repeats_in_its_rests_and_is_kept():
    imu = log_of(some_errors(noise=False)).rates()
    kept, sentences = without_held(imu)
    assert kept is imu
    assert sentences == ()
