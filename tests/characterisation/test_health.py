"""Faults put into clean logs are found where they are; clean logs of every colour are left alone; real logs."""

import numpy as np
import pytest
from scipy.stats import binom

from schuler.characterisation.health import check_static_imu, check_static_log, gaps, length_needed
from schuler.characterisation.readings import resolution
from schuler.characterisation.result import FALSE_ALARM, MOST_PLACES
from schuler.exceptions import InputError
from schuler.recording.series import ImuSeries
from schuler.sensors.noise import GaussMarkov, NoiseModel, Ramp, RandomWalk, White, flicker

RATE = 100.0
CLEAN = White(1e-3) + flicker(2e-4) + RandomWalk(2e-5)  # 10 mrad/s a sample, floor at 30 s


def clean(rng, n=120_000, lsb=None, model: NoiseModel = CLEAN, rate_hz=RATE):
    x = 0.02 + model.sample(n, 1.0 / rate_hz, rng)
    return x if lsb is None else np.round(x / lsb) * lsb


def only(findings, code):
    """The findings of one kind, and none of another kind beside notes."""
    others = {f.code for f in findings if f.severity != "note"} - {code}
    assert not others, [f.text for f in findings]
    matching = [f for f in findings if f.code == code]
    assert matching, f"no {code}"
    return matching


@pytest.fixture(params=[None, 0.002], ids=["floats", "counts"])
def log(request):
    return clean(np.random.default_rng(42), lsb=request.param)


def test_a_clean_log_has_nothing_to_warn_of(log):
    assert [f for f in check_static_log(log, RATE) if f.severity != "note"] == []


# ------------------------------------------------------------------------------------------ injected faults


def test_a_constant_axis_is_refused():
    (matching,) = check_static_log(np.full(5000, 0.25), RATE, "gyro_y")
    assert (matching.code, matching.severity) == ("stuck", "refused")
    assert "gyro_y: every sample reads 0.25" in matching.text


def test_a_stuck_value_is_found_with_its_place(log):
    log[50_000:50_100] = log[50_000]
    (matching,) = only(check_static_log(log, RATE), "stuck")
    assert matching.start_s == pytest.approx(500.0, abs=0.05)
    assert matching.stop_s == pytest.approx(501.0, abs=0.05)
    assert matching.severity == "warning"


def test_an_axis_that_is_mostly_stuck_is_refused(log):
    log[30_000:] = log[30_000]
    matching = [f for f in check_static_log(log, RATE) if f.code == "stuck"]
    assert matching[0].severity == "refused"


def test_repeated_samples_are_found():
    x = np.repeat(clean(np.random.default_rng(1), n=60_000), 2)
    (matching,) = [f for f in check_static_log(x, RATE) if f.code == "repeated"]
    assert "about 2.0 samples each" in matching.text


@pytest.mark.parametrize("given", [True, False])
def test_saturation_is_found_with_and_without_the_range(log, given):
    log[70_000:70_300] += 0.2 * np.sin(np.arange(300) / 300.0 * np.pi)
    clipped = np.minimum(log, 0.1)
    matching = [f for f in check_static_log(clipped, RATE, full_scale=0.1 if given else None) if f.code == "saturated"]
    assert len(matching) == 1
    assert 700.0 < matching[0].start_s < 701.0
    assert 702.0 < matching[0].stop_s < 703.0
    assert matching[0].severity == "warning"


def test_a_saturated_axis_is_refused(rng):
    matching = check_static_log(np.minimum(clean(rng), 0.015), RATE, full_scale=0.015)
    assert matching[-1].code == "saturated"
    assert matching[-1].severity == "refused"


def test_motion_is_found_with_its_place(log):
    rng = np.random.default_rng(3)
    log[30_000:30_500] += 0.02 * rng.standard_normal(500)
    (matching,) = only(check_static_log(log, RATE), "motion")
    assert matching.start_s == pytest.approx(300.0, abs=1.5)
    assert matching.stop_s == pytest.approx(305.0, abs=1.5)


def test_slow_shaking_is_motion_too(log):
    log[30_000:30_600] += 0.02 * np.sin(2.0 * np.pi * 2.0 * np.arange(600) / RATE)
    (matching,) = [f for f in check_static_log(log, RATE) if f.code == "motion"]
    assert matching.start_s == pytest.approx(300.0, abs=1.5)


def test_outliers_are_counted_and_placed(log):
    where = np.random.default_rng(4).choice(len(log), 60, replace=False)
    log[where] += 0.3 * np.sign(np.arange(60) - 29.5)
    (matching,) = only(check_static_log(log, RATE), "outliers")
    assert "60 outliers" in matching.text
    assert matching.start_s == pytest.approx(where.min() / RATE)
    assert matching.stop_s == pytest.approx(where.max() / RATE)


def test_one_outlier_is_too_little_to_warn_of(log):
    log[777] += 0.2
    (matching,) = [f for f in check_static_log(log, RATE) if f.code == "outliers"]
    assert matching.severity == "note"
    assert "too little to matter" in matching.text


@pytest.mark.parametrize(("height", "place"), [(0.005, 0.3), (-0.005, 0.77), (0.02, 0.05), (0.006, 0.5)])
def test_a_step_is_found_with_its_place_and_size(height, place, log):
    """Half the deviation of a sample: seen by nobody in a plot, but twenty times the floor of the Allan curve."""
    at = int(place * len(log))
    log[at:] += height
    (matching,) = only(check_static_log(log, RATE), "step")
    assert matching.start_s == pytest.approx(at / RATE, abs=2.0)
    assert float(matching.text.split("shifts by ")[1].split(" ")[0]) == pytest.approx(height, abs=0.0015)


def test_two_steps_are_two_findings(log):
    log[40_000:] += 0.01
    log[90_000:] -= 0.006
    first, second = only(check_static_log(log, RATE), "step")
    assert first.start_s == pytest.approx(400.0, abs=1.0)  # the larger first
    assert second.start_s == pytest.approx(900.0, abs=1.0)


def test_a_step_behind_a_disturbance_is_seen(log):
    """Somebody bumps the table and the unit has moved a little."""
    log[60_000:60_200] += 0.1 * np.random.default_rng(5).standard_normal(200)
    log[60_200:] += 0.01
    codes = {f.code for f in check_static_log(log, RATE) if f.severity == "warning"}
    assert codes == {"motion", "step"}


def test_a_bump_that_comes_back_is_no_step(log):
    log[60_000:60_200] += 0.008
    assert not [f for f in check_static_log(log, RATE) if f.code == "step"]


@pytest.mark.parametrize("trend", ["ramp", "warm-up"])
def test_smooth_trends_are_no_steps(trend, log):
    """They are reported by the trends, with their own test."""
    s = np.arange(len(log)) / len(log)
    log += 0.2 * s if trend == "ramp" else 0.1 * np.exp(-10.0 * s)  # ten deviations of a sample in 2 min
    assert not [f for f in check_static_log(log, RATE) if f.code == "step"]


def test_coarse_rounding_is_said():
    x = clean(np.random.default_rng(6), lsb=0.05)
    (matching,) = only(check_static_log(x, RATE), "coarse")
    assert "the resolution 0.05 is coarse" in matching.text
    assert not [f for f in check_static_log(clean(np.random.default_rng(6), lsb=0.015), RATE) if f.code == "coarse"]


def test_missing_samples_and_gaps_have_places(log):
    log[5000:5010] = np.nan
    keep = np.ones(len(log), dtype=bool)
    keep[80_000:80_400] = False
    matching = check_static_log(log[keep], RATE, t=1000.0 + np.arange(len(log))[keep] / RATE)
    assert {f.code for f in matching if f.severity != "note"} == {"gap", "missing"}
    gap = next(f for f in matching if f.code == "gap")
    assert gap.start_s == pytest.approx(799.99)
    assert gap.stop_s == pytest.approx(804.0)
    missing = next(f for f in matching if f.code == "missing")
    assert (missing.start_s, missing.stop_s) == pytest.approx((50.0, 50.09))


def test_many_gaps_are_summed_up():
    t = np.arange(2000) * 0.01
    t += 0.05 * (np.arange(2000) // 200)
    matching = gaps(t)
    assert len(matching) == MOST_PLACES + 1
    assert "6 more gaps" in matching[-1].text


@pytest.mark.parametrize("n", [0, 1, 50, 199])
def test_too_few_samples_are_refused(n, rng):
    matching = check_static_log(rng.standard_normal(n), RATE)
    assert [(f.code, f.severity) for f in matching] == [("too_short", "refused")]
    assert [f.severity for f in check_static_log(np.full(500, np.nan), RATE)][-1] == "refused"


def test_a_short_log_says_how_long_one_must_be():
    """Floor 0.664 * 1e-5 at (1e-3 / 6.6e-6)^2 = 6 h: 20 min see white noise only."""
    x = (White(1e-3) + flicker(1e-5)).sample(120_000, 0.01, np.random.default_rng(8))
    (matching,) = check_static_log(x, RATE)
    assert (matching.code, matching.severity) == ("too_short", "note")
    assert "takes 10800 s" in matching.text
    # with the floor in sight there is nothing to say
    assert check_static_log(clean(np.random.default_rng(8)), RATE) == []


def test_length_needed_solves_the_degrees_of_freedom():
    for relative in (0.1, 0.25, 0.5):
        r = length_needed(7.0, relative) / 7.0
        edf = 5.0 * r**2 / (4.0 * (r + 3.0))
        assert 1.0 / (2.0 * edf) == pytest.approx(relative**2, rel=1e-12)  # rounding
    assert length_needed(100.0) == pytest.approx(862.6, abs=0.1)  # printed digits


@pytest.mark.parametrize("lsb", [0.05, 3.33e-3, 1.0, 2.0**-15])
def test_resolution_is_found(lsb, rng):
    x = np.round(rng.standard_normal(20_000) * 4.0) * lsb
    assert resolution(x) == pytest.approx(lsb, rel=1e-9)
    assert resolution(0.3 + x) == pytest.approx(lsb, rel=1e-9)
    assert resolution(rng.standard_normal(20_000)) is None
    assert resolution(np.zeros(100)) is None


# -------------------------------------------------------------------------------------------- clean logs


COLOURS = {
    "white": White(1.0),
    "flicker": White(1.0) + flicker(0.5),
    "random walk": White(1.0) + RandomWalk(0.05),
    "Gauss-Markov": White(1.0) + GaussMarkov(0.5, 60.0),
    "ramp": White(1.0) + Ramp(1e-3),
    "all": White(1.0) + flicker(0.3) + RandomWalk(0.02) + GaussMarkov(0.5, 200.0) + Ramp(3e-4),
}


@pytest.mark.parametrize("runs", [72, pytest.param(200, marks=pytest.mark.campaign)])
def test_clean_logs_draw_no_more_findings_than_stated(runs):
    """Logs of six colours, half of them rounded; four kinds of test at 1 % each."""
    rng = np.random.default_rng(100)
    counts = dict.fromkeys(("motion", "outliers", "step", "stuck"), 0)
    others = 0
    for k in range(runs):
        model = list(COLOURS.values())[k % len(COLOURS)]
        x = model.sample(10_000, 0.1, rng)
        if k % 2:
            x = np.round(x / 2.0) * 2.0  # 0.6 of the deviation of a sample
        for code in {f.code for f in check_static_log(x, 10.0)}:
            if code in counts:
                counts[code] += 1
            else:
                others += code not in ("too_short",)
    # statistical: a count beyond this happens once in a thousand with the stated probability
    allowed = binom.isf(1e-3, runs, FALSE_ALARM)
    assert max(counts.values()) <= allowed, counts
    assert others == 0


@pytest.mark.slow
def test_clean_logs_draw_no_more_findings_than_stated_at_full_size():
    rng = np.random.default_rng(101)
    counts = dict.fromkeys(("motion", "outliers", "step", "stuck"), 0)
    for k in range(1200):
        x = list(COLOURS.values())[k % len(COLOURS)].sample(50_000, 0.02, rng)
        for code in {f.code for f in check_static_log(x, 50.0)} & counts.keys():
            counts[code] += 1
    assert max(counts.values()) <= binom.isf(1e-3, 1200, FALSE_ALARM), counts  # statistical


# ------------------------------------------------------------------------------------------ whole IMU


def still_imu(rng, n=60_000, f=(0.0, 0.0, -9.80)):
    gyro = (White(1e-3) + flicker(2e-4)).sample((n, 3), 0.01, rng)
    accel = np.asarray(f) + (White(2e-3) + flicker(4e-4)).sample((n, 3), 0.01, rng)
    return ImuSeries(500.0 + np.arange(n) / RATE, gyro, accel)


def test_an_imu_at_rest_is_clean(rng):
    matching = check_static_imu(still_imu(rng))
    assert set(matching) == {"gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z", "recording"}
    assert [f for fs in matching.values() for f in fs if f.severity != "note"] == []


def test_checking_takes_the_memory_of_a_few_columns(rng):
    """A day at 200 Hz: 140 MB a column, seven in the log. A copy of all axes took seven more, checks eleven."""
    import tracemalloc

    imu = ImuSeries(np.arange(100_000) / 200.0, *rng.standard_normal((2, 100_000, 3)))
    check_static_imu(imu)
    tracemalloc.start()
    check_static_imu(imu)
    peak = tracemalloc.get_traced_memory()[1] / imu.t.nbytes
    tracemalloc.stop()
    assert peak < 7.0


def test_increments_are_judged_as_rates(rng):
    imu = still_imu(rng)
    pulses = np.round(imu.accel * 0.01 / 1e-4) * 1e-4
    matching = check_static_imu(ImuSeries(imu.t, imu.gyro * 0.01, pulses, kind="increment"))
    assert [f for fs in matching.values() for f in fs if f.severity != "note"] == []


def test_units_and_tilt_are_noticed(rng):
    imu = still_imu(rng)
    (matching,) = check_static_imu(ImuSeries(imu.t, imu.gyro, imu.accel / 9.8))["recording"]
    assert matching.code == "not_at_rest"
    assert "is 1.000 m/s^2, not 9.807" in matching.text
    tilt = 0.05 * np.arange(len(imu)) / len(imu)
    f = imu.accel + 9.8 * np.stack((np.sin(tilt), 0.0 * tilt, 1.0 - np.cos(tilt)), axis=1)
    (matching,) = check_static_imu(ImuSeries(imu.t, imu.gyro, f))["recording"]
    assert "turned by 0.04" in matching.text


def test_gaps_are_told_once_and_not_for_every_axis(rng):
    imu = still_imu(rng)
    keep = (imu.t < 700.0) | (imu.t > 702.0)
    matching = check_static_imu(ImuSeries(imu.t[keep], imu.gyro[keep], imu.accel[keep]))
    assert [(name, f.code) for name, fs in matching.items() for f in fs if f.severity != "note"] == [
        ("recording", "gap")
    ]


@pytest.mark.parametrize(
    ("x", "options", "match"),
    [
        (np.zeros((10, 3)), {}, r"x: expected one axis, shape \(n,\), got \(10, 3\)"),
        (np.zeros(10), {"lsb": -1.0}, "lsb: expected a positive number, got -1.0"),
        (np.zeros(10), {"t": np.arange(9.0)}, "t: expected 10 times, one for each sample, got 9"),
        (np.zeros(3), {"t": [0.0, 1.0, 1.0]}, "expected increasing times"),
    ],
)
def test_wrong_arguments_are_named(x, options, match):
    with pytest.raises(InputError, match=match):
        check_static_log(x, RATE, **options)


# ------------------------------------------------------------------------------------------ real recordings


@pytest.mark.campaign
@pytest.mark.realdata
@pytest.mark.parametrize("unit", [pytest.param(1, marks=pytest.mark.campaign), 2])
def test_adis16405_at_rest(shared_data, unit):
    """The gyros are clean for 2.8 h; the accelerometers show bumps, outliers of 8 to 17 sigma, shifts of 2 mg."""
    archive = np.load(shared_data / "adis16405_static" / f"adis16405_imu{unit}.npz")
    x = archive["counts"] * archive["lsb"]
    imu = ImuSeries(np.arange(len(x)) / 100.0, x[:, :3] * np.pi / 180.0, x[:, 3:] * 9.80665)
    matching = check_static_imu(imu)
    for axis in ("gyro_x", "gyro_y", "gyro_z", "recording"):
        assert matching[axis] == []
    for axis in ("accel_x", "accel_y", "accel_z"):
        assert {f.code for f in matching[axis]} <= {"motion", "outliers", "step"}
        assert not [f for f in matching[axis] if f.severity == "refused"]
        assert sum(f.code == "step" for f in matching[axis]) <= 3
    if unit == 2:  # on all three axes at once: the table was touched
        assert all(
            any(f.code == "motion" and f.start_s == pytest.approx(99.0, abs=1.0) for f in matching[axis])
            for axis in ("accel_x", "accel_y", "accel_z")
        )


@pytest.mark.campaign
@pytest.mark.realdata
def test_laser_gyros_in_a_parked_car(shared_data):
    """Pulses of 125 ug s and 0.1 arcsec: coarse where the noise is below them; people get out in the first 20 s."""
    rows = [line.split() for line in (shared_data / "psins_lasergyro" / "lasergyro.imu").read_text().splitlines()]
    counts = np.array([r for r in rows if len(r) == 6 and all(c.lstrip("-").isdigit() for c in r)], dtype=float)
    dtheta, dv = counts[:, :3] * 0.1 / 3600.0 * np.pi / 180.0, counts[:, 3:] * 125e-6 * 9.80665
    imu = ImuSeries(np.arange(1, len(counts) + 1) / 100.0, dtheta, dv, kind="increment")
    matching = check_static_imu(imu)
    codes = {axis: {f.code for f in fs} for axis, fs in matching.items()}
    assert "coarse" in codes["accel_x"]
    assert "coarse" in codes["accel_z"]
    for axis in ("gyro_x", "gyro_y", "gyro_z"):
        assert "motion" in codes[axis]
        assert any(f.code == "motion" and f.start_s < 21.0 for f in matching[axis])
    assert all("stuck" not in c and "saturated" not in c and "repeated" not in c for c in codes.values())
    assert codes["recording"] == set()
