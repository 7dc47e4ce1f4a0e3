"""A live run has the numbers of a batch run, whenever its measurements come; what comes wrong is said, not raised."""

import gc
import tomllib
from dataclasses import replace

import live_cases as cases
import numpy as np
import pytest
from places import ROOT
from result_cases import calibration

from schuler.exceptions import ConfigError
from schuler.filtering.engine import run
from schuler.filtering.measurements import MeasurementSchedule
from schuler.live import Event, LiveNavigator
from schuler.navigation.config import NavigationConfig
from schuler.navigation.inputs.antenna import ANTENNA_POINT, antenna_note
from schuler.navigation.inputs.imu_axes import AXES_UNCERTAIN
from schuler.navigation.run import navigate, prepared_run
from schuler.recording.io import read

ROUNDING = 1e-8  # geodetic coordinates and sums over blocks of other lengths [m]
AIDS_OF_WHEELS = {"non_holonomic": {}}
AIDS = {"zero_velocity": {}, "zero_rate": {}, "non_holonomic": {}}


@pytest.fixture(scope="module")
def recording():
    return cases.drive()


@pytest.fixture(scope="module")
def batch(recording):
    return navigate(recording, cases.CONFIG)


def live_run(recording, config=cases.CONFIG, **options):
    return LiveNavigator.from_config(config, kind=recording.imu.kind, **options)


def distances(rows, result):
    """Distance of live positions from those of a run at the same times. [m]"""
    tr = result.trajectory
    return np.linalg.norm(tr.r_eb_e[np.searchsorted(tr.t, rows[:, 0] - 1e-6)] - rows[:, 1:], axis=1)


def texts(live, kind):
    return [e.text for e in live.events if e.kind == kind]


def test_from_alignment_on_it_is_the_batch_run(recording, batch):
    """The start is that of the log so far; once the log's own start is settled both are one run."""
    live = live_run(recording)
    rows = cases.fed(live, recording)
    same = navigate(recording, cases.CONFIG, initial=live.initial)
    settled = rows[:, 0] > live.initial.nav.t + 61.0
    assert settled.sum() > 20
    assert distances(rows, same)[settled].max() < ROUNDING  # seen 0
    # the batch run learns what is quiet from the whole log: a start that differs by a thousandth of its sigma
    start = prepared_run(recording, NavigationConfig.checked(cases.CONFIG)).initial
    apart = np.linalg.norm(live.initial.nav.rpy_nb - start.nav.rpy_nb) / np.sqrt(start.P[0, 0])
    assert live.initial.nav.t == start.nav.t
    assert apart < 1e-2
    assert distances(rows, batch)[settled].max() < 1e-3  # seen 1.4e-5


def test_samples_by_one_and_in_blocks_are_one_run(recording):
    part = recording.between(0.0, 25.0)
    ends = [cases.fed(live_run(part), part, block=block)[-1] for block in (1, 7, 400)]
    np.testing.assert_allclose(ends[1:], ends[:1] * 2, rtol=0.0, atol=ROUNDING)


@pytest.mark.parametrize(
    "late", [1.0, pytest.param(0.2, marks=pytest.mark.campaign), pytest.param(5.0, marks=pytest.mark.campaign)]
)
def test_late_fixes_are_put_where_they_belong(recording, late):
    """After the replay the numbers are those of fixes in time; before, the solution waits for them."""
    live = live_run(recording)
    rows = cases.fed(live, recording, late)
    same = navigate(recording, cases.CONFIG, initial=live.initial)
    assert distances(rows[-1:], same)[0] < ROUNDING
    assert late < 1.0 or distances(rows[:-1], same).max() > 1e-3
    assert not texts(live, "late")


def test_an_attitude_claimed_as_its_axes_are_known_is_said_once(recording):
    """As the note of the batch run; without misalignment in the budget there is nothing to say."""
    part = recording.between(0.0, 40.0)
    imu = {name: {**triad, "misalignment_mrad": 20.0} for name, triad in cases.CONFIG["imu"].items()}
    uncertain, exact = (live_run(part, {**cases.CONFIG, "imu": given}) for given in (imu, cases.CONFIG["imu"]))
    for live in (uncertain, exact):
        cases.fed(live, part, block=50)
    (text,) = [text for text in texts(uncertain, "imu") if text.startswith(AXES_UNCERTAIN)]
    assert "budget states to 1.1 deg" in text
    assert uncertain.solution().sigma_psi_n.min() > 0.999 * 0.02
    assert not texts(exact, "imu")


@pytest.mark.parametrize("sigma_scale", [0.7, 5.0])
def test_positions_of_the_antenna_are_noted_once(recording, sigma_scale):
    """In the words of the batch run, where they are claimed well enough to tell it from the IMU."""
    part = recording.between(0.0, 70.0)
    arm = cases.CONFIG["gnss"]["lever_arm_m"]
    for gnss, noted in (({}, sigma_scale < 1.0), ({"lever_arm_m": arm}, False), ({"lever_sigma_m": 0.5}, False)):
        live = live_run(part, {**cases.CONFIG, "gnss": {"sigma_scale": sigma_scale, "gate": "off", **gnss}})
        cases.fed(live, part, block=50)
        antenna_events = [e for e in live.events if e.text.startswith(ANTENNA_POINT)]
        assert [e.kind for e in antenna_events] == ["measurement"] * noted
        if noted:
            P = live.covariance
            assert antenna_note(np.array([[0.3, 0.4]]))[0].split(":")[1] == antenna_events[0].text.split(":")[1]
            assert np.hypot(*np.sqrt(P.diagonal()[6:8])) < 1.0


def test_a_fix_later_than_the_lag_is_said_and_left_out(recording):
    live = live_run(recording, lag_s=2.0)
    first = recording.between(0.0, 60.0)
    cases.fed(live, first)
    before = live.covariance
    old, new = (next(f for f in cases.fixes(recording) if f.t > t) for t in (50.0, 59.0))
    live.take(old)
    live.take(new)  # a second time
    np.testing.assert_array_equal(live.covariance, before)
    assert "more than lag_s = 2 s late" in texts(live, "late")[-1]
    assert "came again" in texts(live, "measurement")[-1]


def test_aids_measure_as_in_the_batch_run(recording):
    """Rests and constraints from what came so far: the same solution within a fraction of its sigma."""
    config = {**cases.CONFIG, "aiding": AIDS}
    live = live_run(recording, config)
    rows = cases.fed(live, recording)
    same = navigate(recording, config, initial=live.initial)
    sigma = np.sqrt(np.trace(same.covariance[-1][6:9, 6:9]))
    settled = rows[:, 0] > live.initial.nav.t + 61.0
    # right after a rest has begun, before the live run knows of it, they may differ
    assert np.median(distances(rows, same)[settled]) < 0.02 * sigma  # statistical; seen 0.003
    assert distances(rows, same)[settled].max() < 0.5 * sigma  # seen 0.3
    assert live.solution().health == "ok"


def test_wheels_are_less_sure_long_after_a_fix_as_in_the_batch_run(recording):
    gnss = recording.need_gnss()
    ended = replace(recording, gnss=gnss.where(gnss.t < 70.0))
    config = {**cases.CONFIG, "aiding": {"non_holonomic": {"unaided_factor": 20.0}}}
    live = live_run(ended, config)
    rows = cases.fed(live, ended)
    same, sure = (navigate(ended, c, initial=live.initial) for c in (config, {**config, "aiding": AIDS_OF_WHEELS}))
    sigma = np.sqrt(np.trace(same.covariance[-1][6:9, 6:9]))
    assert sigma > 1.2 * np.sqrt(np.trace(sure.covariance[-1][6:9, 6:9]))
    assert distances(rows, same)[-20:].max() < 0.02 * sigma
    assert np.sqrt(np.trace(live.covariance[6:9, 6:9])) == pytest.approx(sigma, rel=0.01)


def test_the_filter_of_live_aids_is_the_engine(recording):
    """Law: the engine, given the measurements that the live aids made, goes where the live run goes."""
    config = {**cases.CONFIG, "aiding": AIDS}
    checked = NavigationConfig.checked(config)
    live = live_run(recording, config, lag_s=600.0)  # nothing is forgotten
    rows = cases.fed(live, recording)
    made = live._stream.run.filter.aiding
    prepared = prepared_run(recording, checked, initial=live.initial)
    schedule = MeasurementSchedule(made.t, made.kind, made.z, made.R.reshape(-1, 3, 3), made.lever, made.gate)
    forward = run(prepared.increments, schedule, prepared.initial, prepared.layout, *prepared.psd, prepared.options)
    at_end = np.linalg.norm(forward.r[-1] - rows[-1, 1:])
    assert at_end < ROUNDING
    np.testing.assert_array_equal(made.status[made.t < forward.t[-1]], forward.status[made.t < forward.t[-1]])


@pytest.mark.parametrize("kind", [pytest.param("increment", marks=pytest.mark.campaign), "rate"])
def test_calibration_mount_and_clock_are_those_of_the_batch_run(recording, kind):
    """The same increments in the end, so that the engine over the log's goes where the live run goes."""
    part = recording.between(0.0, 90.0)
    imu = part.imu if kind == "increment" else part.imu.rates()
    part = replace(part, imu=imu)
    changes = {"mount_rpy_deg": [1.0, -2.0, 0.5], "clock_shift_s": 0.012, "rate_order": 3}
    config = {**cases.CONFIG, "imu": {**cases.CONFIG["imu"], **changes}}
    given = calibration(sigma=1e-3)
    given = replace(given, values=0.02 * given.values)
    live = live_run(part, config, calibration=given)
    rows = cases.fed(live, part)
    p = prepared_run(part, NavigationConfig.checked(config), calibration=given)
    forward = run(p.increments, p.schedule, live.initial, p.layout, *p.psd, p.options)
    assert live.initial.nav.t == p.initial.nav.t
    assert np.linalg.norm(forward.r[-1] - rows[-1, 1:]) < ROUNDING


def test_what_comes_wrong_is_said_and_changes_nothing(recording, batch):
    """Repeated, misplaced and impossible samples, fixes without numbers or of another clock, among a good stream."""
    live, imu = live_run(recording), recording.imu
    waiting = cases.fixes(recording)
    for i in range(0, 5000, 10):
        part = slice(i, i + 10)
        live.imu_many(imu.t[part], imu.gyro[part], imu.accel[part])
        if i % 500 == 0:
            live.imu(imu.t[i + 9], imu.gyro[i], imu.accel[i])
            live.imu(imu.t[i + 5], imu.gyro[i], imu.accel[i])
            live.imu(imu.t[i] + 500.0, imu.gyro[i], imu.accel[i])
            live.imu(imu.t[i] + 0.1, imu.gyro[i] * np.nan, imu.accel[i])
            live.fix(imu.t[i] + 62.0, waiting[0].llh, waiting[0].cov_r_n)
            live.fix(imu.t[i], waiting[0].llh * np.nan, waiting[0].cov_r_n)
            live.fix(np.nan, waiting[0].llh, waiting[0].cov_r_n)
            live.fix(imu.t[i], waiting[0].llh, -waiting[0].cov_r_n)
            live.fix(imu.t[i], np.degrees(waiting[0].llh), waiting[0].cov_r_n)
            live.fix(imu.t[i], waiting[0].llh + np.array((0.0, 0.0, 1e9)), waiting[0].cov_r_n)
            live.fix(imu.t[i], waiting[0].llh, 1e18 * waiting[0].cov_r_n)
            live.fix(imu.t[i], waiting[0].llh, waiting[0].cov_r_n, (1e300, 0.0, 0.0), waiting[0].cov_v_n)
            live.fix(-1e300, waiting[0].llh, waiting[0].cov_r_n)
            live.speed(imu.t[i], 1e30)
            live.height(imu.t[i], 1e30, 1.0)
        while waiting and waiting[0].t <= imu.t[part][-1]:
            live.take(waiting.pop(0))
    plain = live_run(recording)
    end = cases.fed(plain, recording.between(0.0, float(imu.t[4999])))[-1]
    np.testing.assert_allclose(cases.position(live.solution()), end[1:], rtol=0.0, atol=ROUNDING)
    message = " ".join(e.text for e in live.events)
    for sentence in (
        "repeated",
        "out of order",
        "far ahead",
        "no sensor reads",
        "another zero",
        "has no time",
        "the height is 1e+09 m",
        "1-sigma of position is 1e+09 m",
        "velocity is 1e+300 m/s",
        "its time is -1e+300 s",
        "a speed is left out: expected a number up to 1000",
        "a height is left out: expected a number up to 1e+08",
    ):
        assert sentence in message
    assert "positive variances" in message
    assert "beyond +-90 deg" in message


def halved(imu):
    """Increments at twice the rate."""
    t = np.repeat(imu.t, 2)
    t[::2] -= 0.5 * imu.interval
    return t, np.repeat(0.5 * imu.gyro, 2, axis=0), np.repeat(0.5 * imu.accel, 2, axis=0)


@pytest.mark.parametrize(
    ("rate", "at", "mount_deg"),
    [(0.7, 300, (0.0, 0.0, 0.0)), (0.499, 3200, (45.0, 30.0, 45.0))],
    ids=["before the start, where the sample interval is not known", "in the run, large about an axis of the vehicle"],
)
def test_a_reading_of_no_sensor_holds_up_no_run(recording, rate, at, mount_deg):
    """It kept a run from starting for ten minutes, or ended it in an error."""
    t, gyro, accel = halved(recording.imu)
    gyro[at] = rate
    config = {**cases.CONFIG, "imu": {**cases.CONFIG["imu"], "mount_rpy_deg": list(mount_deg)}}
    live, waiting = live_run(recording, config), cases.fixes(recording)
    for i in range(0, 3600, 20):
        live.imu_many(t[i : i + 20], gyro[i : i + 20], accel[i : i + 20])
        while waiting and waiting[0].t <= t[i + 19]:
            live.take(waiting.pop(0))
    assert live.initial is not None
    assert any("is no motion" in text for text in texts(live, "imu"))
    assert live.solution() is not None


@pytest.mark.parametrize(
    "step", [-30.0, pytest.param(40.0, marks=pytest.mark.campaign), pytest.param(700.0, marks=pytest.mark.campaign)]
)
def test_a_step_of_the_clock_begins_anew(recording, step):
    """Of all sensors, as after a restart: the run aligns again, and ends where one of the second part alone ends."""
    received = []
    live = live_run(recording, on_event=received.append)
    cases.fed(live, recording.between(0.0, 45.0))
    assert live.health == "ok"
    cases.fed(live, recording.shifted(step), every_s=10.0)
    assert live.health == "ok"
    assert all(isinstance(e, Event) for e in received)
    assert sum("begins anew" in e.text for e in received) == 1
    alone = live_run(recording)
    end = cases.fed(alone, recording.shifted(step))[-1]
    # twenty samples go by until the new clock is believed
    assert np.linalg.norm(cases.position(live.solution()) - end[1:]) < 0.05


def test_without_fixes_it_coasts_and_says_so(recording):
    live = live_run(recording)
    cases.fed(live, recording.between(0.0, 60.0))
    sigma = live.solution().sigma_r_n[:2].max()
    imu = recording.imu.between(60.001, 80.0)
    live.imu_many(imu.t, imu.gyro, imu.accel)
    solution = live.solution()
    assert solution.health == "coasting"
    assert solution.sigma_r_n[:2].max() > 2.0 * sigma
    assert texts(live, "health")[-1] == "ok becomes coasting"


def test_memory_does_not_grow_with_time(recording):
    """Columns, snapshots and measurements of the replay window are all that is kept after the start."""
    live = live_run(recording, lag_s=2.0)
    cases.fed(live, recording)
    gc.collect()
    assert len(live._stream.run.filter.samples) < 300
    assert len(live._stream.run.filter.snapshots) < 8
    assert len(live._stream.run.filter.aiding.t) < 20
    assert live._stream._collection is None


@pytest.mark.parametrize(
    ("change", "entry"),
    [
        ({"gnss": {"coupling": "reset"}}, "gnss.coupling"),
        ({"filter": {"tune": True}}, "filter.tune"),
        ({"outages": {"windows_s": [[1.0, 2.0]]}}, "outages"),
        ({"recording": {"imu": {"units": "furlong,deg/s"}}}, "recording"),
    ],
)
def test_a_configuration_that_a_live_run_cannot_follow_is_refused(change, entry):
    with pytest.raises(ConfigError, match=entry):
        LiveNavigator.from_config({**cases.CONFIG, **change})


def test_raw_samples_are_taken_in_the_units_and_axes_of_the_log(recording):
    """Degrees, g and right-forward-up in; the solution of SI, forward-right-down."""
    part = recording.between(0.0, 40.0)
    si = live_run(part)
    rows = cases.fed(si, part)
    h = recording.imu.interval
    hints = {"imu": {"units": "g,deg/s", "axes": "RFU", "scale": {"gyro": 0.5}}}
    rates = [np.diff(part.imu.t, prepend=part.imu.t[0] - h)[:, None]]
    gyro, accel = part.imu.gyro / rates[0], part.imu.accel / rates[0]
    C = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    raw = type(part)(
        imu=type(part.imu)(part.imu.t, np.degrees(gyro @ C.T) / 0.5, accel @ C.T / 9.80665), gnss=part.gnss
    )
    config = {**cases.CONFIG, "imu": {**cases.CONFIG["imu"], "rate_order": 1}, "recording": hints}
    live = LiveNavigator.from_config(config)
    np.testing.assert_allclose(cases.fed(live, raw)[-1], rows[-1], rtol=0.0, atol=1e-6)  # rates held: to rounding


@pytest.mark.campaign
@pytest.mark.realdata
@pytest.mark.thinned(2)
@pytest.mark.parametrize("late", [0.0, 1.0])
def test_a_real_drive(shared_data, late):
    """rtkexp_drive, loosely coupled: 9 minutes of MEMS at 100 Hz, stamps of whole milliseconds."""
    data = tomllib.loads((ROOT / "examples" / "rtkexp_drive.toml").read_text(encoding="utf-8"))
    recording = read(shared_data / "rtkexp_drive", **data["recording"]).between(0.0, np.inf)
    data["filter"] |= {"tune": False, "smooth": False}
    del data["outages"], data["aiding"]
    live = live_run(recording, data)
    rows = cases.fed(live, recording, late)
    same, whole = navigate(recording, data, initial=live.initial), navigate(recording, data)
    assert distances(rows[-1:], same)[0] < ROUNDING  # seen 4e-9
    settled = rows[:, 0] > live.initial.nav.t + 61.0
    if late == 0.0:
        assert distances(rows, same)[settled].max() < ROUNDING
        assert distances(rows, whole)[settled].max() < 0.01  # seen 1.7 mm: the start learns from less of the log
