"""Noise put in is found again; a bad log is named with its place, on its axis alone."""

from dataclasses import replace

import numpy as np
import pytest

from schuler.characterisation.identification import identify_noise
from schuler.characterisation.result import AXES
from schuler.exceptions import InputError
from schuler.recording.recording import Metadata, Recording
from schuler.recording.series import ImuSeries
from schuler.sensors.noise import Flicker, RandomWalk, White
from schuler.units import G0

RATE, N = 100.0, 60_000
NOISE = White(1e-3) + Flicker(1e-4)  # 10 mrad/s or mm/s^2 a sample, floor at 225 s
MODELS = ("N", "N+B", "N+K", "N+GM")
DOWN = np.array([0.0, 0.0, -9.80665])


def imu_of(x, t=None, **options):
    """Six columns as an IMU that lies still."""
    t = np.arange(len(x)) / RATE if t is None else t
    return ImuSeries(t, x[:, :3], x[:, 3:] + DOWN, **options)


def gyroscopes_of(x, t=None, **options):
    """The first three columns as an IMU without accelerometers, half the work where three axes say as much as six."""
    t = np.arange(len(x)) / RATE if t is None else t
    return ImuSeries(t, x[:, :3], np.zeros((len(x), 3)), **options)


def noise_of(seed, n=N, model=NOISE):
    return model.sample((n, 6), 1.0 / RATE, np.random.default_rng(seed))


def warned(axis, code):
    return [f for f in axis.findings if f.code == code and f.severity == "warning"]


@pytest.fixture(scope="module")
def clean():
    x = noise_of(1)
    return x, identify_noise(imu_of(x), models=MODELS)


def test_a_clean_log(clean):
    _, identified = clean
    assert set(identified.axes) == set(AXES)
    assert identified.refused == {}
    assert identified.findings == ()
    for axis in identified.axes.values():
        assert axis.terms["N"].low < axis.terms["N"].value < axis.terms["N"].high
        assert axis.terms["N"].value == pytest.approx(1e-3, rel=0.02)  # statistical: 0.4 % for 60 000 samples
        assert [f for f in axis.findings if f.severity != "note"] == []
        np.testing.assert_allclose(axis.fitted(axis.curve.tau), np.sqrt(axis.model.allan_variance(axis.curve.tau)))
        assert np.all(axis.curve.low < axis.curve.deviation)
        assert np.all(axis.curve.deviation < axis.curve.high)
        assert axis.covariance.shape == (len(axis.names),) * 2
    assert identified.axes["gyro_x"].unit == "rad/s"
    assert identified.axes["accel_x"].terms["N"].unit == "(m/s^2)/sqrt(Hz)"
    assert identified.axes["accel_z"].mean.value == pytest.approx(-9.80665, abs=2e-3)


@pytest.mark.campaign
def test_budget_and_provenance(clean):
    _, identified = clean
    for triad in (identified.spec.gyro, identified.spec.accel):
        assert triad.random_walk == pytest.approx(1e-3, rel=0.01)  # statistical: three axes
    assert identified.spec.rate_hz == pytest.approx(RATE)
    assert set(identified.spec_sigma) == {"gyro", "accel"}
    assert identified.spec_sigma["gyro"]["random_walk"] < 0.01
    assert identified.provenance["method"] == "gmwm"
    assert identified.provenance["models"] == list(MODELS)
    assert identified.provenance["robust"] is False
    recording = Recording(imu=imu_of(noise_of(1, 2000)), metadata=Metadata(name="short", options={"axes": "FLU"}))
    of_recording = identify_noise(recording, models=("N",), robust=True)
    assert of_recording.name == "short"
    assert of_recording.provenance["recordings"] == ["short"]
    assert of_recording.provenance["recording_options"] == [{"axes": "FLU"}]
    assert of_recording.provenance["robust"] is True


@pytest.mark.campaign
def test_the_diagonal_method_agrees():
    """White noise and random walk by both weights, within their own errors."""
    x = noise_of(2, model=White(1e-3) + RandomWalk(3e-4))
    full, diagonal = (identify_noise(imu_of(x), method=m, models=("N+K",)) for m in ("gmwm", "allan"))
    assert diagonal.provenance["method"] == "allan"
    for axis in AXES:
        assert set(full.axes[axis].terms) == {"N", "K"}  # exactly the model asked for
        for term, true in (("N", 1e-3), ("K", 3e-4)):
            a, b = full.axes[axis].terms[term], diagonal.axes[axis].terms[term]
            assert abs(a.value - b.value) < 3.0 * b.sigma  # statistical
            assert abs(np.log(a.value / true)) < 4.0 * a.sigma / a.value  # statistical


def test_options_are_checked(clean):
    x, _ = clean
    imu = imu_of(x[:2000])
    with pytest.raises(InputError, match="method: expected 'gmwm' or 'allan', got 'eye'"):
        identify_noise(imu, method="eye")
    with pytest.raises(InputError, match="models: expected terms out of"):
        identify_noise(imu, models=("N+Z",))
    with pytest.raises(InputError, match="recordings: expected at least one"):
        identify_noise([])


@pytest.mark.campaign
def test_one_fault_an_axis_is_named_with_its_place_and_leaves_the_others_alone(clean):
    x, before = clean
    y = x.copy()
    y[18_000:, 0] += 3e-3  # a third of a sample's deviation: a random walk of the same size would be found instead
    y[30_000:48_000, 1] = y[30_000, 1]  # 30 % stuck
    y[:, 2] = np.minimum(y[:, 2], np.quantile(y[:, 2], 0.9))  # one side of the range
    y[:, 3] = y[0, 3]  # all stuck
    y[:, 4] += 0.02 * np.exp(-np.arange(N) / 6000.0)  # warm-up of a minute
    identified = identify_noise(imu_of(y), models=MODELS)
    assert set(identified.refused) == {"accel_x"}

    (step,) = warned(identified.axes["gyro_x"], "step")
    assert step.start_s <= 180.0 <= step.stop_s
    assert step.stop_s - step.start_s < 11.0  # two blocks of a hundred and twenty
    assert "K" in identified.axes["gyro_x"].terms  # what is warned of
    (stuck,) = warned(identified.axes["gyro_y"], "stuck")
    assert (stuck.start_s, stuck.stop_s) == pytest.approx((300.0, 479.99))
    (saturated,) = warned(identified.axes["gyro_z"], "saturated")
    assert "6000 samples (10 %)" in saturated.text
    clipped = np.flatnonzero(y[:, 2] == y[:, 2].max()) / RATE
    assert (saturated.start_s, saturated.stop_s) == pytest.approx((clipped[0], clipped[-1]))
    all_stuck = identified.refused["accel_x"][0]
    assert (all_stuck.code, all_stuck.severity) == ("stuck", "refused")
    assert (all_stuck.start_s, all_stuck.stop_s) == pytest.approx((0.0, 599.99))
    (trend,) = warned(identified.axes["accel_y"], "trend")
    assert trend.start_s == 0.0
    assert 100.0 < trend.stop_s < 450.0  # some time constants of 60 s
    assert identified.axes["accel_z"].terms == before.axes["accel_z"].terms
    assert identified.axes["accel_z"].findings == before.axes["accel_z"].findings


def several_steps(y):
    for k, place in enumerate((0.1, 0.25, 0.4, 0.6, 0.85)):
        y[int(place * N) :] += (-1) ** k * 6e-3


def early_step(y):
    y[1000:] += 0.05


def stuck_now_and_then(y):
    for k in range(100):
        y[600 * k : 600 * k + 300] = y[600 * k]


def thinly_saturated(y):
    y[:] = np.minimum(y, np.quantile(y, 0.99))


def shaken(y):
    y[30_000:33_000] += 0.05 * np.random.default_rng(9).standard_normal(3000)


def rounded(y):
    y[:] = np.round(y / 0.05) * 0.05


@pytest.mark.campaign
def test_faults_that_hide(clean):
    """Each on its axis: never a number without a warning of severity warning."""
    x, _ = clean
    y = x.copy()
    faults = {
        "gyro_x": (several_steps, "step"), "gyro_y": (early_step, "step"), "gyro_z": (stuck_now_and_then, "stuck"),
        "accel_x": (thinly_saturated, "saturated"), "accel_y": (shaken, "motion"), "accel_z": (rounded, "coarse"),
    }  # fmt: skip
    for axis, (spoil, _) in faults.items():
        spoil(y[:, AXES.index(axis)])
    identified = identify_noise(imu_of(y), models=MODELS)
    for axis, (_, code) in faults.items():
        notices = identified.axes[axis].findings if axis in identified.axes else identified.refused[axis]
        assert [f for f in notices if f.code == code and f.severity != "note"], (axis, [f.code for f in notices])
    early = warned(identified.axes["gyro_y"], "step")
    assert early[0].start_s == pytest.approx(10.0, abs=1.1)
    shaking = warned(identified.axes["accel_y"], "motion")
    assert (shaking[0].start_s, shaking[0].stop_s) == pytest.approx((300.0, 330.0), abs=1.1)


@pytest.mark.parametrize(("n", "needed"), [(100, "at least 200"), (900, "1000 are needed")])
def test_too_short_logs_are_refused(n, needed):
    identified = identify_noise(imu_of(noise_of(3, n)))
    assert identified.axes == {}
    assert identified.spec is None
    for reasons in identified.refused.values():
        assert (reasons[0].code, reasons[0].severity) == ("too_short", "refused")
        assert needed in reasons[0].text


@pytest.mark.campaign
def test_a_short_log_says_what_it_cannot_see():
    identified = identify_noise(imu_of(noise_of(3, 6000)), models=MODELS)
    (note,) = [f for f in identified.axes["gyro_x"].findings if f.code == "too_short"]
    assert "60 s are too short to see a bias instability" in note.text
    assert "B" not in identified.axes["gyro_x"].terms


@pytest.mark.campaign
def test_a_large_gap_is_told_and_widens_the_intervals(clean):
    x, before = clean
    y = x.copy()
    y[50_000:, 0] += 0.02
    keep = np.ones(N, dtype=bool)
    keep[10_000:28_000] = False
    identified = identify_noise(gyroscopes_of(y[keep], np.arange(N)[keep] / RATE), models=MODELS)
    (gap,) = identified.findings
    assert (gap.code, gap.severity) == ("gap", "warning")
    assert (gap.start_s, gap.stop_s) == pytest.approx((99.99, 280.0))
    # the place of a step behind the gap counts from the start of the recording
    assert warned(identified.axes["gyro_x"], "step")[0].start_s == pytest.approx(500.0, abs=2.0)
    for name in AXES[1:3]:
        axis = identified.axes[name]
        assert axis.curve.missing == 18_000
        assert axis.terms["N"].value == pytest.approx(1e-3, rel=0.02)  # statistical
        fewer = axis.curve.edf[0] / before.axes[name].curve.edf[0]
        if axis.names == before.axes[name].names == ("N",):
            assert fewer == pytest.approx(0.7, rel=0.05)  # what is there is 70 %


@pytest.mark.campaign
def test_many_gaps_and_jitter_leave_the_noise_alone(clean):
    x, _ = clean
    rng = np.random.default_rng(4)
    t = np.arange(N) / RATE + rng.uniform(-1e-3, 1e-3, N)
    keep = rng.random(N) > 0.05
    identified = identify_noise(gyroscopes_of(x[keep], t[keep]), models=MODELS)
    assert identified.findings[0].code == "gap"
    assert "more gaps" in identified.findings[-1].text
    for axis in identified.axes.values():
        assert axis.terms["N"].value == pytest.approx(1e-3, rel=0.02)  # statistical


@pytest.mark.campaign
def test_next_to_nothing_is_left_or_stamps_make_no_grid(clean):
    x, _ = clean
    keep = np.ones(N, dtype=bool)
    keep[700:59_000] = False  # 7 and 10 s at either end
    t = np.arange(N) / RATE
    identified = identify_noise(imu_of(x[keep], t[keep]), models=("N",))
    for axis in identified.axes.values():
        assert axis.terms["N"].value == pytest.approx(1e-3, rel=0.1)  # statistical: 2 %
        assert axis.terms["N"].sigma > 1e-5  # as for 1700 samples, not 60 000
    wild = t + np.random.default_rng(5).uniform(-4e-3, 4e-3, N)
    with pytest.raises(InputError, match="t: expected stamps about"):
        identify_noise(imu_of(x, wild))
    apart = np.where(t < 300.0, t, t + 1e6)
    with pytest.raises(InputError, match="recordings of their own"):
        identify_noise(imu_of(x, apart))


@pytest.mark.campaign
def test_an_axis_that_follows_the_temperature(clean):
    x, _ = clean
    T = 25.0 + 5.0 * np.sin(2.0 * np.pi * np.arange(N) / N * 2.0)
    y = x.copy()
    y[:, 1] += 1e-3 * (T - 25.0)
    identified = identify_noise(imu_of(y, temperature=T), models=MODELS)
    (notices,) = [f for f in identified.axes["gyro_y"].findings if f.code == "temperature"]
    assert notices.severity == "warning"
    assert not [f for f in identified.axes["gyro_x"].findings if f.code == "temperature"]


@pytest.mark.campaign
def test_recordings_are_pooled():
    """Four quarters of a log: the same N as the log, and intervals of half the width of one of them or less."""
    x = noise_of(6, model=White(1e-3) + RandomWalk(3e-4))
    quarters = [imu_of(x[k : k + N // 4]) for k in range(0, N, N // 4)]
    one, whole, pooled = (identify_noise(r, models=("N+K",)) for r in (quarters[0], imu_of(x), quarters))
    for axis in AXES:
        N_1, N_all, N_4 = (r.axes[axis].terms["N"] for r in (one, whole, pooled))
        # half by the model of the weights; less where the halves of the one quarter differ by chance, which widens it
        assert N_4.sigma / N_4.value < 1.1 * 0.5 * N_1.sigma / N_1.value
        assert N_4.value == pytest.approx(N_all.value, abs=N_all.sigma)  # the same samples
        K_1, K_all, K_4 = (r.axes[axis].terms["K"] for r in (one, whole, pooled))
        assert K_4.sigma / K_4.value < 0.8 * K_1.sigma / K_1.value
        assert abs(np.log(K_4.value / K_all.value)) < 3.0 * K_4.sigma / K_4.value  # statistical
        assert pooled.axes[axis].duration_s == pytest.approx(600.0)


@pytest.mark.campaign
def test_lengths_may_differ_and_rates_may_not(clean):
    x, before = clean
    stuck = x[40_000:].copy()
    stuck[5000:5100, 0] = stuck[5000, 0]
    identified = identify_noise([imu_of(x[:40_000]), imu_of(stuck)], models=MODELS)
    assert identified.axes["gyro_y"].terms["N"].value == pytest.approx(before.axes["gyro_y"].terms["N"].value, rel=2e-3)
    (notices,) = warned(identified.axes["gyro_x"], "stuck")
    assert notices.text.endswith("(recording 2)")
    assert notices.start_s == pytest.approx(50.0)
    imu = imu_of(x)
    with pytest.raises(InputError, match="recordings: expected one sampling rate, got 100, 50 Hz"):
        identify_noise([imu, replace(imu, t=2.0 * imu.t)])


@pytest.mark.campaign
def test_increments_give_the_result_of_rates(clean):
    x, before = clean
    rates = imu_of(x)
    still = np.zeros_like(rates.accel)  # accelerometers that are not there: three axes say as much as six
    identified = identify_noise(ImuSeries(rates.t + 0.01, rates.gyro * 0.01, still, kind="increment"), models=MODELS)
    for axis in AXES[:3]:
        assert identified.axes[axis].names == before.axes[axis].names
        for term, estimate in identified.axes[axis].terms.items():
            assert estimate.value == pytest.approx(before.axes[axis].terms[term].value, rel=1e-6)  # rounding of stamps


@pytest.mark.campaign
def test_a_temperature_that_rises_is_a_warm_up_whatever_the_axes_show(clean):
    x, _ = clean
    T = 43.7 - 7.9 * np.exp(-np.arange(N) / RATE / 60.0)
    identified = identify_noise(gyroscopes_of(x, temperature=T), models=("N",))
    (finding,) = [f for f in identified.findings if f.code == "warm_up"]
    assert "goes from 3" in finding.text
    assert "to 43.7 degC" in finding.text
    assert 100.0 < finding.stop_s < 200.0  # a tenth of 7.9 K is left after 138 s
    steady = identify_noise(gyroscopes_of(x, temperature=40.0 + np.sin(np.arange(N) / 5000.0)), models=("N",))
    assert [f for f in steady.findings if f.code == "warm_up"] == []


@pytest.mark.campaign
def test_gyroscopes_alone_are_identified_without_a_word_on_accelerometers(clean):
    x, before = clean
    identified = identify_noise(ImuSeries(np.arange(N) / RATE, x[:, :3], np.zeros((N, 3))), models=MODELS)
    assert list(identified.axes) == list(AXES[:3])
    assert identified.refused == {}
    assert identified.findings == ()
    assert identified.axes["gyro_z"].terms == before.axes["gyro_z"].terms


@pytest.mark.campaign
def test_a_triad_without_white_noise_has_a_budget_without_it():
    """Accelerometers of steps and a slow wander, as those of a laser gyro system; it was a TypeError."""
    rng = np.random.default_rng(1)
    n, rate = 1000, 100.0
    gyro = 1e-3 * rng.standard_normal((n, 3))
    steps = np.diff(rng.standard_normal((n + 1, 3)), axis=0)  # of velocity, differenced: quantisation noise
    accel = 0.1 * steps + np.cumsum(1e-3 * rng.standard_normal((n, 3)), axis=0) - [0.0, 0.0, G0]
    identified = identify_noise(ImuSeries(np.arange(n) / rate, gyro, accel))
    assert identified.spec.accel.random_walk == 0.0
    assert identified.spec.gyro.random_walk == pytest.approx(1e-4, rel=0.1)  # statistical
    assert sum("no white noise of the accel" in note for note in identified.notes) == 1
