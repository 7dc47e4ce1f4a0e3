"""Series and recordings: what they derive, how they are cut and merged, and what they refuse."""

from dataclasses import replace

import numpy as np
import pytest

from schuler import frames, rotation
from schuler.cli.convert import described
from schuler.exceptions import InputError
from schuler.recording import trajectory as trajectory_module
from schuler.recording.recording import Metadata, Recording
from schuler.recording.series import GnssSeries, ImuSeries, Increments, OdometerSeries, stated_dilution
from schuler.recording.trajectory import FullTrajectory, Trajectory
from schuler.timebase import TimeBase

EYE = np.eye(3)


def imu(n=10, dt=0.1, kind="rate", **rest):
    t = dt * np.arange(n)
    return ImuSeries(t, np.tile([0.1, 0.2, 0.3], (n, 1)), np.tile([0.0, 0.0, -9.8], (n, 1)), kind, **rest)


def gnss(n=5, **rest):
    llh = np.tile([0.8, 0.2, 100.0], (n, 1))
    return GnssSeries(np.arange(float(n)), llh, np.tile(4.0 * EYE, (n, 1, 1)), **rest)


def flight(n, rng):
    """Anywhere on Earth, poles and antimeridian included, with any attitude."""
    llh = np.stack(
        (rng.uniform(-np.pi / 2, np.pi / 2, n), rng.uniform(-np.pi, np.pi, n), rng.uniform(-5e3, 9e4, n)), -1
    )
    llh[:4, 0] = np.pi / 2, -np.pi / 2, 0.0, 0.3
    llh[:4, 1] = 0.0, 1.0, np.pi, -np.pi
    q = rng.standard_normal((n, 4))
    q /= np.linalg.norm(q, axis=1)[:, None]
    return Trajectory(np.arange(float(n)), frames.ecef_from_llh(llh), rng.standard_normal((n, 3)) * 100.0, q)


def test_compiled_axes_are_their_numpy_twins(rng, monkeypatch):
    """Long trajectories change axes in compiled loops, short ones in NumPy; both give the same."""
    path = flight(500, rng)
    monkeypatch.setattr(trajectory_module, "_MANY", 1)
    compiled = replace(path, _cache={})
    got = (compiled.llh, compiled.v_eb_n, compiled.q_nb)
    monkeypatch.setattr(trajectory_module, "_MANY", 10**9)
    plain = replace(path, _cache={})
    place, velocity, attitude = plain.llh, plain.v_eb_n, plain.q_nb
    np.testing.assert_allclose(got[0][:, 0], place[:, 0], atol=1e-15, rtol=1e-15)  # rounding
    turn = frames.wrap_angle(got[0][:, 1] - place[:, 1])
    np.testing.assert_allclose(turn * np.cos(place[:, 0]), 0.0, atol=1e-15)  # rounding
    np.testing.assert_allclose(got[0][:, 2], place[:, 2], atol=5e-9)  # rounding of 6.4e6 m
    np.testing.assert_allclose(got[1], velocity, atol=1e-12)  # rounding
    np.testing.assert_allclose(np.abs(np.sum(got[2] * attitude, axis=1)), 1.0, atol=1e-14)  # rounding; sign is free


def test_axes_of_a_trajectory_belong_to_each_other(rng):
    path = flight(50, rng)
    again = Trajectory.from_geodetic(path.t, path.llh, path.v_eb_n, path.C_nb)
    np.testing.assert_allclose(again.r_eb_e, path.r_eb_e, atol=5e-9)  # rounding of 6.4e6 m
    np.testing.assert_allclose(again.v_eb_e, path.v_eb_e, atol=1e-12)  # rounding
    np.testing.assert_allclose(np.abs(np.sum(again.q_eb * path.q_eb, axis=1)), 1.0, atol=1e-14)
    np.testing.assert_allclose(rotation.dcm_from_rpy(path.rpy_nb), path.C_nb, atol=1e-12)


def test_interpolation_keeps_cubics_and_uniform_turns():
    """Cubic motion and a constant rate are what the interpolation assumes: it must return them exactly."""
    t, fine = np.arange(0.0, 5.0, 1.0), np.linspace(0.0, 4.0, 41)

    def at(x):
        r = np.stack((x**3 - x, 2.0 * x**2, 5.0 - x), axis=-1) + np.array([6.4e6, 0.0, 0.0])
        v = np.stack((3.0 * x**2 - 1.0, 4.0 * x, -np.ones_like(x)), axis=-1)
        return Trajectory(x, r, v, rotation.quat_from_rotvec(np.outer(x, [0.2, -0.4, 0.5])))

    got, expected = at(t).at(fine), at(fine)
    np.testing.assert_allclose(got.r_eb_e, expected.r_eb_e, atol=5e-9)  # rounding of 6.4e6 m
    np.testing.assert_allclose(got.v_eb_e, expected.v_eb_e, atol=1e-8)  # the same, over 1 s
    np.testing.assert_allclose(np.abs(np.sum(got.q_eb * expected.q_eb, axis=1)), 1.0, atol=1e-14)  # rounding
    without = Trajectory(t, at(t).r_eb_e).at([0.5])
    np.testing.assert_allclose(without.r_eb_e[0], 0.5 * (at(t).r_eb_e[0] + at(t).r_eb_e[1]))
    np.testing.assert_array_equal(at(t[:1]).at([0.0]).r_eb_e, at(t[:1]).r_eb_e)


def test_at_its_own_times_a_trajectory_is_its_samples(rng):
    path = flight(9, rng)
    some = path.at(path.t[2:8:2])
    for name in ("t", "r_eb_e", "v_eb_e", "q_eb"):
        np.testing.assert_array_equal(getattr(some, name), getattr(path, name)[2:8:2])


def test_nothing_is_extrapolated(rng):
    path = flight(5, rng)
    with pytest.raises(InputError, match=r"asked for 3\.000\.\.4\.500 s of a trajectory that runs 0\.000\.\.4\.000 s"):
        path.at([3.0, 4.5])
    with pytest.raises(InputError, match=r"asked for -0\.100"):
        path.at([-0.1, 1.0])


def test_increments_of_rates_and_rates_of_increments_are_inverse():
    log = imu(50, kind="increment")
    rates = log.rates()
    assert rates.kind == "rate"
    np.testing.assert_allclose(rates.gyro, log.gyro / 0.1)
    inc = log.increments()
    assert inc.start == pytest.approx(-0.1)
    assert len(inc) == 50
    assert len(imu(50).increments()) == 49
    assert imu().rates() is not None


def test_gaps_have_start_and_length():
    t = np.array([0.0, 0.1, 0.2, 0.7, 0.8, 1.0])
    log = ImuSeries(t, np.zeros((6, 3)), np.zeros((6, 3)))
    np.testing.assert_allclose(log.gaps(), [[0.2, 0.5], [0.8, 0.2]])
    np.testing.assert_allclose(log.gaps(2.5), [[0.2, 0.5]])
    assert log.gaps(10.0).shape == (0, 2)


def test_axes_of_an_imu_can_be_turned():
    C = rotation.dcm_from_rpy([0.0, 0.0, np.pi / 2.0])  # the sensor's x axis points to the vehicle's right
    turned = imu().rotated(C)
    np.testing.assert_allclose(turned.gyro[0], [-0.2, 0.1, 0.3], atol=1e-15)
    with pytest.raises(InputError, match="expected a rotation matrix"):
        imu().rotated(np.diag([1.0, 1.0, -1.0]))


def test_cuts_take_whole_samples_and_intervals():
    log = imu(10, temperature=np.arange(10.0))
    part = log.between(0.25, 0.6)
    np.testing.assert_allclose(part.t, [0.3, 0.4, 0.5, 0.6])
    np.testing.assert_array_equal(part.temperature, [3, 4, 5, 6])
    inc = log.increments().between(0.2, 0.5)
    np.testing.assert_allclose(inc.t, [0.3, 0.4, 0.5])
    assert inc.start == pytest.approx(0.2)
    fixes = gnss(5, quality=np.arange(5), v_n=np.zeros((5, 3)), cov_v_n=np.tile(EYE, (5, 1, 1)))
    np.testing.assert_array_equal(fixes.between(1.0, 2.5).quality, [1, 2])
    for cut in (log, log.increments()):
        with pytest.raises(InputError, match=r"lies within 7\.000\.\.8\.000 s"):
            cut.between(7.0, 8.0)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: ImuSeries([0.0, 0.1, 0.1], EYE, EYE), r"sample 2 repeats: 0\.1\d* s after 0\.1\d* s; remove repeated"),
        (lambda: ImuSeries([0.0, 0.2, 0.1], EYE, EYE), r"sample 2 goes back"),
        (lambda: ImuSeries([], np.zeros((0, 3)), np.zeros((0, 3))), "expected at least one sample"),
        (lambda: imu(kind="rates"), "expected 'rate' or 'increment', got 'rates'"),
        (lambda: ImuSeries([0.0, 1.0], EYE, EYE), r"ImuSeries\.gyro: expected shape \(2, 3\), got \(3, 3\)"),
        (lambda: Increments([1.0], [0.0], [[0.0] * 3], [[0.0] * 3]), "expected positive intervals"),
        (lambda: gnss(llh=[[48.0, 11.0, 500.0]]), "multiple values"),
        (lambda: GnssSeries([0.0], [[48.0, 11.0, 500.0]], [EYE]), r"beyond \+-90 deg; angles are radians"),
        (lambda: GnssSeries([0.0], [[0.8, 0.2, 0.0]], [0.0 * EYE]), "positive variances"),
        (lambda: GnssSeries([0.0], [[0.8, 0.2, 0.0]], [EYE + np.triu(EYE[::-1])]), "symmetric"),
        (lambda: gnss(2, v_n=np.zeros((2, 3))), "given together or not at all"),
        (lambda: gnss(2, quality=[1]), r"GnssSeries\.quality: expected shape \(2,\)"),
        (lambda: OdometerSeries([0.0], [[1.0]], [1.0]), r"OdometerSeries\.speed: expected shape"),
        (lambda: Trajectory([0.0], [[6e6, 0.0, 0.0]]).v_eb_n, "has no velocity"),
        (lambda: Trajectory([0.0], [[6e6, 0.0, 0.0]]).q_nb, "has no attitude"),
        (lambda: Trajectory([0.0], [[6e6, 0.0, 0.0]]).full(), "has no velocity"),
        (lambda: Trajectory([0.0], [[6e6, 0.0, 0.0]], [[1.0, 0.0, 0.0]]).full(), "has no attitude"),
        (lambda: FullTrajectory([0.0], [[6e6, 0.0, 0.0]], None, [[1.0, 0.0, 0.0, 0.0]]), "has no velocity"),
        (lambda: gnss().need_velocity(), "has no velocity"),
        (lambda: Recording(gnss=gnss()).need_reference(), "has no reference"),
        (lambda: Trajectory([0.0], [[6e6, 0.0, 0.0]]).moved_by([1.0, 0.0, 0.0]), "needs an attitude"),
        (lambda: Trajectory.from_geodetic([0.0], [[0.0, 0.0, 0.0]], [[1.0, 0.0]]), r"v_eb_n: expected shape \(1, 3\)"),
        (lambda: Recording(), "at least one series"),
        (lambda: Recording(gnss=gnss()).need_imu(), "has no IMU series"),
        (lambda: Recording(imu=imu()).need_gnss(), "has no GNSS series"),
    ],
)
def test_what_makes_no_series_is_refused(make, message):
    with pytest.raises((InputError, TypeError), match=message):
        make()


def test_a_full_trajectory_stays_full_where_it_is_cut_thinned_and_interpolated():
    t = np.arange(4.0)
    v, C = np.tile([1.0, 2.0, 0.0], (4, 1)), np.tile(EYE, (4, 1, 1))
    partial = Trajectory.from_geodetic(t, np.column_stack((0.8 + 1e-7 * t, np.full(4, 0.2), t)), v, C)
    full = partial.full()
    assert type(partial) is Trajectory
    assert full.full() is full
    for cut in (full.at([0.5, 2.5]), full.between(1.0, 2.0), full.samples(np.array([0, 3]))):
        assert type(cut) is FullTrajectory
        same = partial.at(cut.t)
        for name in ("r_eb_e", "v_eb_e", "q_eb"):
            np.testing.assert_allclose(getattr(cut, name), getattr(same, name), rtol=1e-12, atol=1e-12)  # rounding


def test_recordings_merge_on_one_time_axis():
    """Two receivers with their own zero: the second begins 100 s of GPS time later."""
    a = Recording(imu=imu(), metadata=Metadata("a", TimeBase(scale="gps", epoch_gps_s=1e9), sources={"a.txt": "1"}))
    b = Recording(gnss=gnss(), metadata=Metadata("b", TimeBase(scale="gps", epoch_gps_s=1e9 + 100.0), {"b.pos": "2"}))
    both = a.merged_with(b)
    np.testing.assert_allclose(both.gnss.t, 100.0 + np.arange(5.0))
    assert both.start == 0.0
    assert both.stop == 104.0
    assert both.metadata.sources == {"a.txt": "1", "b.pos": "2"}
    noted = [replace(r, metadata=r.metadata.noting("x.txt: said of the file")) for r in (a, b)]
    assert noted[0].merged_with(noted[1]).metadata.notes == ("x.txt: said of the file",)  # one file with two series
    with pytest.raises(InputError, match="both have: imu"):
        a.merged_with(a)
    local = replace(b, metadata=Metadata("c"))
    with pytest.raises(InputError, match="runs on gps time, c on local time; say what the stamps"):
        a.merged_with(local)
    merged = replace(a, metadata=Metadata("d")).merged_with(local)
    assert "taken to run on one clock" in merged.metadata.notes[-1]


def test_a_shift_moves_every_series_and_keeps_the_instants():
    whole = Recording(
        imu=imu(),
        gnss=gnss(received=np.arange(5.0) + 0.2),
        odometer=OdometerSeries([0.0, 1.0], [1.0, 2.0], [0.1, 0.1]),
        reference=Trajectory([0.0, 1.0], [[6e6, 0.0, 0.0], [6e6, 1.0, 0.0]]),
        metadata=Metadata(time=TimeBase(scale="gps", epoch_gps_s=1e9)),
    )
    moved = whole.shifted(2.5)
    assert moved.imu.t[0] == moved.odometer.t[0] == moved.reference.t[0] == 2.5
    assert moved.gnss.received[0] == pytest.approx(2.7)
    assert moved.metadata.time.epoch_gps_s + moved.start == 1e9
    assert whole.shifted(0.0) is whole


def test_summary_names_every_series():
    whole = Recording(
        imu=imu(),
        gnss=gnss(),
        odometer=OdometerSeries([0.0, 1.0], [1.0, 2.0], [0.1, 0.1]),
        reference=Trajectory([0.0, 1.0], [[6e6, 0.0, 0.0], [6e6, 1.0, 0.0]]),
        metadata=Metadata("town", notes=("heights were above sea level",)),
    )
    text = whole.summary()
    for part in ("town: 4.0 s", "10 samples at 10 Hz (rate)", "0 gaps", "5 epochs", "2.828 m horizontal", "no velocity",
                 "odometer   2 samples, up to 2.0 m/s", "reference  2 samples", "- heights were above"):  # fmt: skip
        assert part in text
    turned = whole.rotated(rotation.dcm_from_rpy([0.0, 0.0, 1.0]), "axes turned by 1 rad")
    assert turned.metadata.notes[-1] == "axes turned by 1 rad"


def test_dilutions_are_kept_cut_and_summed_up():
    """Epochs keep theirs; medians pass over what is not known; a part in which none is known has none."""
    nan = np.nan
    dop = np.array([[0.8, 1.5], [0.9, nan], [1.2, 2.5], [nan, nan], [nan, nan]])
    whole = gnss(dop=dop, n_satellites=[9, 10, 11, 12, 13])
    np.testing.assert_array_equal(whole.where([0, 2]).dop, dop[[0, 2]])
    np.testing.assert_array_equal(whole.between(1.0, 3.0).dop, dop[1:4])
    assert whole.between(3.0, 4.0).dop is None
    assert whole.median_dop() == {"HDOP": 0.9, "VDOP": 2.0}
    log = Recording(gnss=whole, metadata=Metadata("town"))
    assert "        11 satellites, HDOP 0.9, VDOP 2 (median)" in log.summary().splitlines()
    np.testing.assert_array_equal(log.shifted(5.0).gnss.dop, dop)
    numbers = described(log)["gnss"]
    assert (numbers["median_hdop"], numbers["median_vdop"]) == (0.9, 2.0)
    assert gnss().median_dop() == {}
    assert "median_hdop" not in described(replace(log, gnss=gnss()))["gnss"]


def test_what_is_no_dilution():
    """Zero, 99.99 and more, infinity and what is no number are not known to a reader; a series refuses them."""
    stated = stated_dilution([0.7, 0.0, 99.99, np.inf, -1.0], [nan := np.nan, 1.2, 655.35, 9999.0, nan])
    np.testing.assert_array_equal(stated, [[0.7, nan], [nan, 1.2], [nan, nan], [nan, nan], [nan, nan]])
    np.testing.assert_array_equal(stated_dilution(None, [1.5]), [[nan, 1.5]])
    assert stated_dilution(None, None) is None
    assert stated_dilution([99.99], [0.0]) is None
    for bad in (0.0, 99.0, -1.0, np.inf):
        with pytest.raises(InputError, match=r"GnssSeries\.dop: expected numbers above 0 and below 99"):
            gnss(dop=np.full((5, 2), bad))
    with pytest.raises(InputError, match=r"GnssSeries\.dop: expected shape \(5, 2\)"):
        gnss(dop=np.ones(5))


def test_an_increment_after_a_pause_is_stretched_over_it_only_if_samples_were_lost():
    """At rest, 0.4 s without samples: lost ones are held; a sensor that went on integrating is left as it is."""
    t = np.arange(1, 1001) / 100.0
    kept = (t < 4.0) | (t >= 4.4)
    dv = np.tile((0.0, 0.0, -0.0981), (int(kept.sum()), 1))
    after = int(np.argmax(t[kept] >= 4.4))
    for factor in (1.0, 41.0):
        given = dv.copy()
        given[after] *= factor
        inc = ImuSeries(t[kept], np.zeros_like(dv), given, "increment").increments()
        np.testing.assert_allclose(inc.dv_ib_b[:, 2] / inc.dt, -9.81, rtol=1e-6)
        np.testing.assert_allclose(inc.dv_ib_b[:, 2].sum(), -98.1, rtol=1e-6)
