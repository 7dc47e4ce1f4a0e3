"""Deep coupling in simulation: exact signals, honesty, fades and what survives them."""

import re

import numpy as np
import pytest
from places import ROOT

from schuler import frames
from schuler.exceptions import InputError
from schuler.filtering.engine import FilterOptions, run
from schuler.filtering.measurements import PSEUDORANGE, RANGE_RATE, MeasurementSchedule, merged
from schuler.navigation.evaluation.consistency import chi_square_band, state_errors
from schuler.navigation.result import NavigationResult
from schuler.reproduce.stefanisko.study.deep import correlator
from schuler.reproduce.stefanisko.study.deep import discriminators as tracking_study
from schuler.reproduce.stefanisko.study.deep import figures as deep_figures
from schuler.reproduce.stefanisko.study.deep import loops as tracking_loops
from schuler.reproduce.stefanisko.study.deep import runs as deep_runs
from schuler.reproduce.stefanisko.study.deep import scene as deep_scene
from schuler.reproduce.stefanisko.study.deep import study as deep_study
from schuler.reproduce.stefanisko.study.deep.loops import ScalarLoops
from schuler.reproduce.stefanisko.study.deep.runs import DeepOptions, deep_run, tight_run
from schuler.reproduce.stefanisko.study.deep.scene import agile, calm, draw, signal_strength

RUNS = [14, pytest.param(300, marks=pytest.mark.slow)]


@pytest.fixture(scope="module")
def turning():
    return deep_scene.deep_scene(agile, 13.0)


@pytest.fixture(scope="module")
def short():
    return deep_scene.deep_scene(agile, 6.0)


@pytest.fixture(scope="module")
def straight():
    return deep_scene.deep_scene(calm, 13.0)


@pytest.fixture(scope="module")
def fades():
    return deep_study.deep_study(agile, (30.0, 20.0), runs=2, seconds=27.5, window=(5.0, 23.0))


def steady(scene, dbhz=45.0):
    return signal_strength(scene, dbhz, (0.0, 1e9))


@pytest.mark.parametrize("update", [0.02, 0.2])
def test_a_perfect_world_is_left_alone(short, update):
    """Exact start, sensors, clock and signals: neither oscillators nor averaging pull the solution away."""
    world = draw(short, np.random.default_rng(0), scale=0.0, start=0.0)
    one = deep_run(world, steady(short), np.random.default_rng(0), DeepOptions(update=update), scale=0.0)
    # discretisation: an update a microsecond late at 900 m/s of range rate, oscillators that do not know of jerk
    assert np.abs(one.position_n).max() < 3e-3
    assert np.abs(one.velocity_n).max() < 2e-3
    assert np.abs(one.range_error).max() < 5e-3
    assert np.abs(one.rate_error).max() < 0.02  # 58 m/s^3 over 15 ms
    assert one.accepted == 1.0


def tight_with_exact_ranges(world, update):
    """The filter given true pseudoranges and range rates at the times and with the variances of the deep one."""
    scene, cor = world.scene, world.scene.correlator
    per = round(update / cor.signal.bit)
    c = np.full(len(scene.sat), 10.0**4.5)
    sigma, sigma_rate = tracking_study.range_sigma(cor, "dot", c), tracking_study.rate_sigma(cor, c)
    parts = []
    for bit in range(per, scene.bits - per + 1, per):
        k = 2 * bit
        t = np.full(len(c), scene.t[k] + 1e-6)
        z = np.column_stack((scene.r_sat_e[k], world.pseudorange[k]))
        z_rate = np.column_stack((scene.r_sat_e[k], scene.v_sat_e[k], world.range_rate[k]))
        parts.append(MeasurementSchedule.of(PSEUDORANGE, t, z, sigma**2 / per))
        parts.append(MeasurementSchedule.of(RANGE_RATE, t, z_rate, sigma_rate**2 / per))
    schedule = merged(*parts)
    options = FilterOptions(covariance_rate_hz=None, lockout=0, record_s=cor.half)
    forward = run(world.increments, schedule, world.initial, scene.layout, scene.gyro_psd, scene.accel_psd, options)
    result = NavigationResult.from_run(forward, schedule.t, schedule.kind, scene.layout)
    t, dx, _ = state_errors(result, scene.truth)
    C = frames.C_en(result.states.llh)
    return t, np.einsum("kji,kj->ki", C, dx[:, 6:9]), np.einsum("kji,kj->ki", C, dx[:, 3:6]), result.sigma("dr")


def moved(scene, update, start, clock=1.0):
    """Deep against tight, exact signals, after 0.5 s: largest differences in m, m/s, sigmas; of the sigmas."""
    world = draw(scene, np.random.default_rng(3), scale=clock, start=start)
    options = DeepOptions(update=update, gate=None)
    one = deep_run(world, steady(scene), np.random.default_rng(0), options, scale=0.0)
    t, position, velocity, sigma = tight_with_exact_ranges(world, update)
    k = np.searchsorted(t, one.t - 1e-6)
    late = one.t > 0.5
    d = np.linalg.norm(one.position_n - position[k], axis=1)[late]
    d_v = np.linalg.norm(one.velocity_n - velocity[k], axis=1)[late]
    assert np.linalg.norm(position[k], axis=1)[late].max() > 3.0 * d.max()  # there is something to agree on
    return d.max(), d_v.max(), (d / sigma[k][late].max(axis=1)).max(), np.abs(one.sigma_n / sigma[k] - 1.0)[late].max()


def test_deep_is_tight_in_the_limit_of_exact_signals_and_single_bits(short):
    """Same filter, same information: what differs is the bend of the discriminators (1 % at 3 m) and half a bit."""
    _, _, sigmas, spread = moved(short, 0.02, 1.0)
    assert sigmas < 0.03  # seen: 0.024
    assert spread < 0.01  # the power lost by a code error widens the claimed sigma


def test_the_difference_falls_with_the_square_of_the_error(short):
    """Bend of the discriminators, a perfect clock and IMU: half the initial error, a quarter of the difference."""
    d = [moved(short, 0.02, start, clock=0.0)[0] for start in (2.0, 1.0, 0.5)]
    # half a bit at the velocity error is left besides: 1 mm, falling only as fast as the error
    assert d[0] / d[1] > 3.0
    assert d[1] / d[2] > 2.3


def test_the_difference_falls_with_the_update_interval(short):
    d = [moved(short, update, 1.0) for update in (0.2, 0.02)]
    assert d[0][1] > 4.0 * d[1][1]  # the velocity error that an averaged rate belongs to is older
    assert d[1][0] < 0.03


@pytest.mark.parametrize("runs", RUNS)
@pytest.mark.parametrize("motion", ["straight", "turning"])
def test_nees_of_the_vector_loop_is_in_its_band(motion, runs, request):
    """45 dB-Hz, 20 dB-Hz from 4 to 9 s, 45 again; errors of IMU, clock and start drawn with both signs."""
    scene = request.getfixturevalue(motion)
    cn0 = signal_strength(scene, 20.0, (4.0, 9.0))
    values, accepted = [], []
    for seed in range(runs):
        one = deep_run(draw(scene, np.random.default_rng([seed, 1])), cn0, np.random.default_rng([seed, 2]))
        values.append(one.nees)
        accepted.append(one.accepted)
        assert one.on_signal.all()
    at = np.searchsorted(one.t, [0.5, 2.0, 3.5, 4.5, 6.5, 8.5, 9.5, 12.5])
    low, high = chi_square_band(scene.layout.size, runs, 0.9999)
    outcome = np.array(values)[:, at].mean(axis=0)
    assert np.all((outcome > low) & (outcome < high)), (low, outcome, high)
    assert np.mean(accepted) > 0.999  # of 99.99 percent gates


@pytest.mark.parametrize("runs", [10, pytest.param(200, marks=pytest.mark.slow)])
def test_tight_coupling_it_is_held_against_is_honest_too(straight, runs):
    """Strong signals, ranges of conventional loops once a second: the comparison is with a filter that is well set."""
    values = [
        tight_run(
            draw(straight, np.random.default_rng([seed, 1])), steady(straight), np.random.default_rng([seed, 3])
        ).nees
        for seed in range(runs)
    ]
    low, high = chi_square_band(straight.layout.size, runs, 0.9999)
    outcome = np.array(values)[:, ::15].mean(axis=0)
    assert np.all((outcome > low) & (outcome < high)), (low, outcome, high)


def test_fades_end_conventional_tracking_and_not_the_vector_loop(fades):
    rows = {(r.level_dbhz, r.architecture): r for r in fades.rows()}
    assert rows[30.0, "deep"].tracked == rows[20.0, "deep"].tracked == 1.0
    assert rows[30.0, "tight"].tracked == 1.0
    assert rows[20.0, "tight"].tracked < 0.6
    assert fades.threshold("deep") == 20.0
    assert fades.threshold("tight") == 30.0
    for level in fades.levels:
        assert rows[level, "deep"].sigma < 0.5 * rows[level, "tight"].sigma
        assert rows[level, "deep"].end < 4.0 * rows[level, "deep"].sigma
    # back at once, where conventional channels have to search first
    assert rows[20.0, "deep"].largest_after < 1.5


def test_a_vector_loop_coasts_through_silence_and_is_back_at_once(straight):
    """No signal at all for 8 s: the oscillators follow the inertial solution, nothing goes to the filter."""
    cn0 = signal_strength(straight, -20.0, (3.0, 11.0))
    world = draw(straight, np.random.default_rng(5))
    one = deep_run(world, cn0, np.random.default_rng(6))
    assert one.on_signal.all()
    sigma = np.linalg.norm(one.sigma_n[:, :2], axis=1)
    at = {s: int(np.argmin(np.abs(one.t - s))) for s in (3.0, 10.8, 12.0)}
    assert sigma[at[10.8]] > 1.5 * sigma[at[3.0]]
    assert sigma[at[12.0]] < 0.6 * sigma[at[10.8]]
    assert one.horizontal[at[12.0]] < 4.0 * sigma[at[12.0]]


def test_some_satellites_fade_and_the_others_carry_them(turning):
    """Five of eight at 15 dB-Hz: their replicas stay, since three and the inertial solution say where they are."""
    cn0 = signal_strength(turning, 15.0, (3.0, 12.0), satellites=5)
    one = deep_run(draw(turning, np.random.default_rng(1)), cn0, np.random.default_rng(2))
    other = tight_run(draw(turning, np.random.default_rng(1)), cn0, np.random.default_rng(2))
    assert one.on_signal.all()
    assert one.largest(3.0, 12.0) < 2.5
    during = (other.channel_t > 5.0) & (other.channel_t < 12.0)
    assert not other.on_signal[during][:, :5].all(axis=0).any()
    assert other.on_signal[during][:, 5:].all()


def test_no_bandwidth_of_a_conventional_loop_does_for_both(straight, turning):
    """Narrow: weak signals of a calm receiver; wide: strong signals of an agile one; both together: none."""
    rng = np.random.default_rng(4)
    window, levels = (3.0, 12.5), (40.0, 20.0)
    calm_shares = deep_study.loop_shares(straight, (1.0, 10.0), levels, rng, window=window, runs=3)
    agile_shares = deep_study.loop_shares(turning, (1.0, 10.0), levels, rng, window=window, runs=3)
    assert calm_shares[0, 0] == calm_shares[0, 1] == 1.0
    assert calm_shares[1, 0] == agile_shares[1, 0] == 1.0
    assert calm_shares[1, 1] < 0.2
    assert agile_shares[0, 1] < 0.2
    assert agile_shares[1, 1] < 0.2


@pytest.mark.parametrize("kind", tracking_study.CODE_KINDS)
def test_both_code_discriminators_are_honest(short, kind):
    runs = [
        deep_run(
            draw(short, np.random.default_rng([seed, 1])), steady(short, 25.0), np.random.default_rng([seed, 2]),
            DeepOptions(kind=kind),
        )
        for seed in range(12)
    ]  # fmt: skip
    low, high = chi_square_band(short.layout.size, len(runs), 0.9999)
    outcome = np.mean([one.nees[::10] for one in runs], axis=0)
    assert np.all((outcome > low) & (outcome < high)), (low, outcome, high)
    assert all(one.on_signal.all() for one in runs)


def test_strength_and_scene(straight):
    cn0 = signal_strength(straight, 20.0, (4.0, 8.0), satellites=3)
    t = straight.t[1::2]
    inside = (t >= 4.0) & (t < 8.0)
    assert cn0.shape == (straight.bits, 8)
    np.testing.assert_allclose(cn0[inside][:, :3], 100.0)
    np.testing.assert_allclose(cn0[~inside], 10.0**4.5)
    np.testing.assert_allclose(cn0[:, 3:], 10.0**4.5)
    # rates are the derivative of ranges per second of reception: 1 + (range rate / c) apart, 3 mm/s at 1 km/s
    rate = (straight.range[2:] - straight.range[:-2]) / (straight.t[2:] - straight.t[:-2])[:, None]
    np.testing.assert_allclose(rate, straight.rate[1:-1], atol=4e-3)
    assert straight.jerk < 1e-3


def test_running_power_begins_anew_after_a_jump():
    power = deep_runs._Power(5, 10)
    for _ in range(5):
        power.mean_with(np.array([100.0, 100.0]))
    outcome = power.mean_with(np.array([6.0, 103.0]))
    assert outcome[0] == pytest.approx(6.0)
    assert outcome[1] == pytest.approx((4 * 100.0 + 103.0) / 5)


def test_summary_and_marks(fades):
    text = fades.summary()
    assert "SIMULATION ONLY" in text
    assert "dB-Hz" in text
    modules = (correlator, tracking_study, tracking_loops, deep_scene, deep_runs, deep_study, deep_figures)
    assert all("SIMULATION ONLY" in (m.__doc__ or "") for m in modules)


def test_the_program_of_the_page_runs_as_documented(capsys, tmp_path, monkeypatch):
    """With a shorter fade; what it prints says what it is."""
    page = (ROOT / "docs" / "deep-coupling.md").read_text(encoding="utf-8")
    (program,) = re.findall(r"```python\n(.*?)```", page, re.S)
    monkeypatch.chdir(tmp_path)
    exec(program.replace("seconds=45.0, window=(15.0, 35.0)", "seconds=8.0, window=(2.0, 4.0)"), {})
    assert "SIMULATION ONLY" in capsys.readouterr().out
    assert (tmp_path / "deep.png").stat().st_size > 0


def test_figures(fades):
    axes = fades.plot().axes
    assert len(axes) == 4
    assert all("SIMULATION" in a.get_title(loc="left") for a in axes)
    assert all("SIMULATION" in a.get_title(loc="left") for a in deep_figures.discriminators().axes)
    with pytest.raises(InputError, match="level_dbhz"):
        fades.plot(33.0)


def test_interrupted_study_keeps_what_was_done():
    def stop(_):
        raise KeyboardInterrupt

    study = deep_study.deep_study(calm, (30.0,), runs=3, seconds=6.0, window=(2.0, 3.0), progress=stop)
    assert not study.complete
    assert study.rows()[0].runs == 1
    assert "interrupted" in study.summary()


def test_refusals(straight):
    with pytest.raises(InputError, match="update"):
        DeepOptions(update=2.0)
    with pytest.raises(InputError, match="window"):
        deep_study.deep_study(seconds=20.0, window=(5.0, 30.0))
    with pytest.raises(InputError, match="at least one run"):
        deep_study.deep_study(runs=0)
    with pytest.raises(InputError, match="satellites"):
        signal_strength(straight, 20.0, (1.0, 2.0), satellites=9)
    with pytest.raises(InputError, match="satellites"):
        deep_scene.deep_scene(calm, 2.0, satellites=3)
    with pytest.raises(InputError, match="window"):
        deep_study.loop_shares(straight, (5.0,), (30.0,), np.random.default_rng(0))
    study = deep_study.deep_study(calm, (40.0,), runs=1, seconds=4.0, window=(0.5, 1.0))
    with pytest.raises(InputError, match="deep or tight"):
        study.threshold("loose")
    for look in (study.runs[40.0, "deep"][0].largest, study.runs[40.0, "deep"][0].tracked):
        with pytest.raises(InputError, match="no epoch"):
            look(50.0, 60.0)
    assert ScalarLoops().jerk == 0.0
