"""One realisation of IMU errors: the model, its inverse, its statistics, clipping and rounding."""

import numpy as np
import pytest

from schuler.exceptions import InputError
from schuler.sensors import GaussMarkov, ImuErrors, ImuSpec, NoiseModel, RandomWalk, TriadSpec, White

SIGMAS = 4.0  # statistical tolerances: standard errors, seeds fixed
DT = 0.01


def some_errors(seed: int = 1, **extra) -> ImuErrors:
    r = np.random.default_rng(seed)
    return ImuErrors(
        b_g=1e-3 * r.standard_normal(3),
        b_a=0.5 * r.standard_normal(3),
        M_g=0.02 * r.standard_normal((3, 3)),
        M_a=0.02 * r.standard_normal((3, 3)),
        G_g=2e-4 * r.standard_normal((3, 3)),
        gyro_bias_temperature=1e-4 * r.standard_normal(3),
        accel_bias_temperature=1e-2 * r.standard_normal(3),
        gyro_scale_temperature=1e-4 * r.standard_normal(3),
        accel_scale_temperature=2e-4 * r.standard_normal(3),
        **extra,
    )


def some_motion(n: int = 50, seed: int = 2) -> tuple[np.ndarray, np.ndarray]:
    r = np.random.default_rng(seed)
    return r.standard_normal((n, 3)), 10.0 * r.standard_normal((n, 3))


def rng() -> np.random.Generator:
    return np.random.default_rng(3)


def test_no_errors_change_nothing():
    omega, f = some_motion()
    for apply in (ImuErrors.none().apply_rates, ImuErrors.none().apply_increments):
        out_g, out_a, report = apply(omega, f, DT, rng(), temperature=-40.0)
        np.testing.assert_array_equal(out_g, omega)
        np.testing.assert_array_equal(out_a, f)
        assert not report.b_g.any()
        assert report.summary() == "samples beyond the range: none"


def test_the_model_sample_by_sample():
    """Written out for every sample, with temperature."""
    e = some_errors(temperature_0=20.0)
    omega, f = some_motion()
    T = np.linspace(-10.0, 60.0, len(f))
    out_g, out_a, report = e.apply_rates(omega, f, DT, rng(), T)
    for k in range(len(f)):
        S_g = np.diag(e.gyro_scale_temperature) * (T[k] - 20.0)
        S_a = np.diag(e.accel_scale_temperature) * (T[k] - 20.0)
        b_g = e.b_g + e.gyro_bias_temperature * (T[k] - 20.0)
        b_a = e.b_a + e.accel_bias_temperature * (T[k] - 20.0)
        expected_g = b_g + (np.eye(3) + S_g + e.M_g) @ omega[k] + e.G_g @ f[k]
        np.testing.assert_allclose(out_g[k], expected_g, rtol=1e-13, atol=1e-15)  # rounding
        np.testing.assert_allclose(out_a[k], b_a + (np.eye(3) + S_a + e.M_a) @ f[k], rtol=1e-13, atol=1e-13)  # rounding
        np.testing.assert_allclose(report.b_g[k], b_g, rtol=1e-13)  # rounding
        np.testing.assert_allclose(report.b_a[k], b_a, rtol=1e-13)  # rounding


def test_signs_of_single_terms():
    """A z gyroscope with +1 % scale, one that sees x, one that feels force; input and output by hand."""
    M = np.zeros((3, 3))
    M[2, 2], M[2, 0] = 0.01, 0.002
    G = np.zeros((3, 3))
    G[0, 2] = 1e-3
    e = ImuErrors(M_g=M, G_g=G, b_g=[0.0, 0.5, 0.0])
    out, _, _ = e.apply_rates([[1.0, 0.0, 2.0]], [[0.0, 0.0, -9.8]], DT, rng())
    np.testing.assert_allclose(out, [[1.0 - 9.8e-3, 0.5, 2.02 + 0.002]], rtol=1e-14)  # rounding


@pytest.mark.parametrize("temperature", [None, 31.0, np.linspace(-40.0, 85.0, 50)])
@pytest.mark.parametrize("seed", range(5))
def test_compensation_is_the_exact_inverse(seed, temperature):
    e = some_errors(seed)
    omega, f = some_motion(seed=100 + seed)
    back = e.compensate_rates(*e.apply_rates(omega, f, DT, rng(), temperature)[:2], temperature)
    np.testing.assert_allclose(back[0], omega, rtol=0, atol=1e-14 * 10)  # rounding of values of size 10
    np.testing.assert_allclose(back[1], f, rtol=0, atol=1e-14 * 100)  # rounding of values of size 40
    back = e.compensate_increments(*e.apply_increments(omega * DT, f * DT, DT, rng(), temperature)[:2], DT, temperature)
    np.testing.assert_allclose(back[0], omega * DT, rtol=0, atol=1e-15)  # rounding
    np.testing.assert_allclose(back[1], f * DT, rtol=0, atol=1e-14)  # rounding


def test_temperature_terms_need_a_temperature():
    e = some_errors()
    omega, f = some_motion()
    without = e.apply_rates(omega, f, DT, rng())
    at_reference = e.apply_rates(omega, f, DT, rng(), e.temperature_0)
    np.testing.assert_allclose(without[0], at_reference[0], rtol=1e-15)  # rounding
    assert np.abs(e.apply_rates(omega, f, DT, rng(), 60.0)[0] - without[0]).max() > 1e-3


def noisy(**extra) -> ImuErrors:
    return some_errors(
        gyro_noise=White(1e-4) + GaussMarkov(2e-4, 5.0) + RandomWalk(1e-5),
        accel_noise=NoiseModel((White(1e-3), GaussMarkov(5e-3, 20.0))),
        **extra,
    )


@pytest.mark.parametrize("dt", [0.005, 0.04])
def test_rates_and_increments_agree(dt):
    """Corrupting increments is integrating corrupted rates, noise and all, for the same generator state."""
    omega, f = np.tile([0.1, -0.2, 0.3], (500, 1)), np.tile([0.2, 0.1, -9.8], (500, 1))
    e = noisy(gyro_range=0.25, accel_range=9.0)
    rate_g, rate_a, rates = e.apply_rates(omega, f, dt, rng())
    dtheta, dv, increments = e.apply_increments(omega * dt, f * dt, dt, rng())
    np.testing.assert_allclose(dtheta, rate_g * dt, rtol=1e-12)  # rounding
    np.testing.assert_allclose(dv, rate_a * dt, rtol=1e-12)  # rounding
    np.testing.assert_array_equal(rates.b_g, increments.b_g)
    np.testing.assert_array_equal(rates.gyro_clipped, increments.gyro_clipped)


@pytest.mark.parametrize("rate_hz", [50.0, 200.0])
def test_white_noise_of_rates_and_increments(rate_hz):
    N_g, N_a, n, dt = 1e-4, 2e-3, 60_000, 1.0 / rate_hz
    e = ImuErrors(gyro_noise=NoiseModel((White(N_g),)), accel_noise=NoiseModel((White(N_a),)))
    zero = np.zeros((n, 3))
    gyro, accel, _ = e.apply_rates(zero, zero, dt, rng())
    dtheta, dv, _ = e.apply_increments(zero, zero, dt, rng())
    relative = 1.0 / np.sqrt(2.0 * n)  # standard error of a sample deviation
    np.testing.assert_allclose(gyro.std(axis=0), N_g * np.sqrt(rate_hz), rtol=SIGMAS * relative)
    np.testing.assert_allclose(accel.std(axis=0), N_a * np.sqrt(rate_hz), rtol=SIGMAS * relative)
    np.testing.assert_allclose(dtheta.std(axis=0), N_g * np.sqrt(dt), rtol=SIGMAS * relative)
    np.testing.assert_allclose(dv.std(axis=0), N_a * np.sqrt(dt), rtol=SIGMAS * relative)
    correlation = np.corrcoef(np.hstack((gyro, accel)).T) - np.eye(6)
    assert np.abs(correlation).max() < SIGMAS / np.sqrt(n)  # six independent channels


def test_reported_bias_is_the_one_that_was_added():
    e = ImuErrors(
        b_g=[1.0, 2.0, 3.0], gyro_noise=NoiseModel((GaussMarkov(0.3, 2.0),)), accel_noise=NoiseModel((RandomWalk(0.2),))
    )
    omega, f = some_motion()
    gyro, accel, report = e.apply_rates(omega, f, DT, rng())
    np.testing.assert_allclose(gyro - report.b_g, omega, atol=1e-14)  # rounding
    np.testing.assert_allclose(accel - report.b_a, f, atol=1e-13)  # rounding
    assert report.b_g.std() > 0.1
    dtheta, _, report = e.apply_increments(omega * DT, f * DT, DT, rng())
    np.testing.assert_allclose(dtheta - report.b_g * DT, omega * DT, atol=1e-15)  # rounding; the report is in rad/s


def test_same_generator_state_same_result_and_noise_of_one_triad_leaves_the_other():
    omega, f = some_motion()
    e = noisy()
    first, second = e.apply_rates(omega, f, DT, rng()), e.apply_rates(omega, f, DT, rng())
    np.testing.assert_array_equal(first[0], second[0])
    quiet = some_errors(accel_noise=e.accel_noise)
    np.testing.assert_array_equal(quiet.apply_rates(omega, f, DT, rng())[1], first[1])
    r = rng()
    assert np.abs(e.apply_rates(omega, f, DT, r)[0] - e.apply_rates(omega, f, DT, r)[0]).max() > 0.0


SPEC = ImuSpec(
    "test",
    TriadSpec(
        random_walk=1e-4, turn_on_bias=1e-3, scale_factor=2e-3, misalignment=3e-3, g_sensitivity=4e-5,
        bias_temperature=5e-6, scale_temperature=6e-6, range=7.0, resolution=8e-4, quantisation=9e-6,
        in_run_bias=1e-4, in_run_time=50.0,
    ),
    TriadSpec(
        random_walk=1e-3, turn_on_bias=1e-2, scale_factor=2e-2, misalignment=3e-2,
        bias_temperature=5e-5, scale_temperature=6e-5, range=70.0,
    ),
)  # fmt: skip


def test_draws_have_the_statistics_of_the_budget():
    n = 2000
    generator = np.random.default_rng(5)
    drawn = [ImuErrors.draw(SPEC, generator) for _ in range(n)]
    off = ~np.eye(3, dtype=bool)
    for triad, s in ((SPEC.gyro, "g"), (SPEC.accel, "a")):
        word = {"g": "gyro", "a": "accel"}[s]
        M = np.array([getattr(e, f"M_{s}") for e in drawn])
        samples = [
            (np.array([getattr(e, f"b_{s}") for e in drawn]), triad.turn_on_bias),
            (M[:, ~off], triad.scale_factor),
            (M[:, off], triad.misalignment),
            (np.array([getattr(e, f"{word}_bias_temperature") for e in drawn]), triad.bias_temperature),
            (np.array([getattr(e, f"{word}_scale_temperature") for e in drawn]), triad.scale_temperature),
        ]
        if s == "g":
            samples.append((np.array([e.G_g.ravel() for e in drawn]), triad.g_sensitivity))
        for x, sigma in samples:
            assert np.abs(x.mean(axis=0)).max() < SIGMAS * sigma / np.sqrt(n)
            assert np.abs(x.std(axis=0) / sigma - 1.0).max() < SIGMAS / np.sqrt(2.0 * n)
            if x.shape[1] > 1:
                assert np.abs(np.corrcoef(x.T) - np.eye(x.shape[1])).max() < SIGMAS / np.sqrt(n)


def test_draw_carries_noise_ranges_and_pulses():
    e = ImuErrors.draw(SPEC, rng(), start="zero", temperature_0=30.0)
    assert e.gyro_noise == White(1e-4) + GaussMarkov(1e-4, 50.0, "zero")
    assert e.accel_noise == NoiseModel((White(1e-3),))
    assert (e.gyro_range, e.accel_range, e.gyro_resolution, e.accel_resolution) == (7.0, 70.0, 8e-4, None)
    assert e.gyro_quantum == pytest.approx(np.sqrt(12.0) * 9e-6)
    assert e.accel_quantum is None
    assert e.temperature_0 == 30.0


def test_same_seed_gives_the_same_normalised_errors_for_every_imu():
    other = ImuSpec(
        "other", TriadSpec(random_walk=0.0, turn_on_bias=2.0), TriadSpec(random_walk=1.0, scale_factor=4e-2)
    )
    a, b = ImuErrors.draw(SPEC, rng()), ImuErrors.draw(other, rng())
    np.testing.assert_allclose(b.b_g / 2.0, a.b_g / 1e-3, rtol=1e-14)  # rounding
    np.testing.assert_allclose(np.diag(b.M_a) / 4e-2, np.diag(a.M_a) / 2e-2, rtol=1e-14)  # rounding


def test_gauges():
    full, lower, upper = (ImuErrors.draw(SPEC, rng(), gauge=g) for g in ("full", "lower", "upper"))
    np.testing.assert_array_equal(lower.M_a, np.tril(full.M_a))
    np.testing.assert_array_equal(upper.M_a, np.triu(full.M_a))
    assert np.count_nonzero(full.M_a) == np.count_nonzero(full.M_g) == 9
    np.testing.assert_array_equal(lower.M_g, full.M_g)


def test_clipping_is_counted():
    omega = np.array([[0.0, 3.0, 0.0], [2.0, -3.0, 0.0], [1.0, 0.0, 0.0]])
    e = ImuErrors(gyro_range=1.5, accel_range=100.0)
    out, _, report = e.apply_rates(omega, np.zeros((3, 3)), DT, rng())
    np.testing.assert_array_equal(out, np.clip(omega, -1.5, 1.5))
    np.testing.assert_array_equal(report.gyro_clipped, [1, 2, 0])
    np.testing.assert_array_equal(report.accel_clipped, 0)
    assert report.summary() == "samples beyond the range: gyro x: 1 of 3, gyro y: 2 of 3"
    dtheta, _, report = e.apply_increments(omega * DT, np.zeros((3, 3)), DT, rng())
    np.testing.assert_allclose(dtheta, out * DT, rtol=1e-14)  # rounding
    np.testing.assert_array_equal(report.gyro_clipped, [1, 2, 0])


def test_rounding_of_increments_does_not_drift_and_rounding_of_rates_loses_the_remainder():
    """0.3 of a bit: a rate sensor shows nothing, a pulse counter loses nothing. Half a pulse of tolerance."""
    n, lsb = 10_000, 1e-3
    omega = np.full((n, 3), 0.3 * lsb)
    e = ImuErrors(gyro_resolution=lsb, accel_resolution=lsb)
    gyro, _, _ = e.apply_rates(omega, omega, DT, rng())
    assert not gyro.any()
    dtheta, dv, _ = e.apply_increments(omega * DT, omega * DT, DT, rng())
    for x in (dtheta, dv):
        np.testing.assert_allclose(x / (lsb * DT), np.round(x / (lsb * DT)), atol=1e-9)  # whole pulses, rounding
        assert np.abs(np.cumsum(x, axis=0) - np.cumsum(omega, axis=0) * DT).max() <= 0.5001 * lsb * DT


def test_a_pulse_size_counts_for_both_kinds_of_output():
    e = ImuErrors(gyro_quantum=1e-4)
    omega = np.full((100, 3), 0.0131)
    dtheta, dv, _ = e.apply_increments(omega * DT, omega * DT, DT, rng())
    gyro, _, _ = e.apply_rates(omega, omega, DT, rng())
    np.testing.assert_allclose(gyro * DT, dtheta, atol=1e-16)  # rounding
    assert dtheta[:, 0].sum() == pytest.approx(100 * 0.0131 * DT, abs=0.5e-4)
    np.testing.assert_array_equal(dv, omega * DT)


def test_fields_are_copies_and_cannot_be_changed():
    b = np.ones(3)
    e = ImuErrors(b_g=b)
    b[0] = 2.0
    assert e.b_g[0] == 1.0
    with pytest.raises(ValueError, match="read-only"):
        e.b_g[0] = 2.0


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: ImuErrors(b_g=[1.0, 2.0]), r"b_g: expected shape \(3,\), got \(2,\)"),
        (lambda: ImuErrors(M_a=np.zeros(3)), r"M_a: expected shape \(3, 3\)"),
        (lambda: ImuErrors(gyro_range=0.0), "gyro_range: expected a positive number or None, got 0.0"),
        (lambda: ImuErrors(accel_quantum=-1.0), "accel_quantum: expected a positive number"),
        (lambda: ImuErrors.draw(SPEC, rng(), gauge="diag"), "gauge: expected 'full', 'lower' or 'upper', got 'diag'"),
        (lambda: ImuErrors.draw(SPEC, rng(), start="cold"), "start: expected 'stationary' or 'zero'"),
        (
            lambda: ImuErrors().apply_rates(np.zeros((4, 3)), np.zeros((5, 3)), DT, rng()),
            r"accel: expected shape \(4, 3\)",
        ),
        (lambda: ImuErrors().apply_rates(np.zeros((4, 2)), np.zeros((4, 2)), DT, rng()), "gyro: expected shape"),
        (lambda: ImuErrors().apply_rates(*some_motion(), np.full(50, DT), rng()), "dt: expected one sampling interval"),
        (lambda: ImuErrors().compensate_increments(*some_motion(), -1.0), "dt: expected a positive number of seconds"),
        (
            lambda: ImuErrors().apply_rates(*some_motion(), DT, rng(), np.zeros(7)),
            r"temperature: expected one value or shape \(50,\), got \(7,\)",
        ),
        (lambda: ImuErrors(M_a=-np.eye(3)).compensate_rates(*some_motion()), r"I \+ M has no inverse"),
    ],
)
def test_refusals(call, message):
    with pytest.raises(InputError, match=message):
        call()
