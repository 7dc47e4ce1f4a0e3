"""What a live run compiles for usual samples and fixes has the numbers of the Python that takes the others."""

from dataclasses import replace

import live_cases as cases
import numpy as np
import pytest

from schuler import jit
from schuler.exceptions import InputError
from schuler.filtering.error_model import ecef_from_ned_states
from schuler.filtering.measurements import ACCEPTED, FORCED, HEADING, POSITION, REJECTED, VELOCITY
from schuler.live import Fix, LiveNavigator
from schuler.live.aids import LiveAids, series_of
from schuler.live.columns import Columns
from schuler.live.health import HealthMonitor
from schuler.live.preparation import SamplePreparation
from schuler.live.readings import imu_readings
from schuler.live.replay import Judged
from schuler.live.run import solution
from schuler.mechanization.strapdown import NavState
from schuler.navigation.config import NavigationConfig
from schuler.navigation.states import imu_spec

RNG = np.random.default_rng(11)
MATRIX = 4e-16  # rounding of a product with a matrix, relative


def rows(n=60):
    """Samples at 100 Hz with stamps that jitter by a tenth of a millisecond."""
    made = np.full((n, 8), np.nan)
    made[:, 0] = 5.0 + 0.01 * np.arange(n) + 1e-4 * RNG.standard_normal(n)
    made[:, 1:7] = RNG.standard_normal((n, 6)) * ([0.2] * 3 + [3.0] * 3) + (0.0, 0.0, 0.0, 0.0, 0.0, -9.8)
    return made


def config(kind="rate", **imu):
    recording = {"imu": {"kind": kind, **imu.pop("hints", {})}}
    return NavigationConfig.checked({**cases.CONFIG, "imu": {**cases.CONFIG["imu"], **imu}, "recording": recording})


def columns():
    return Columns(t=0, dt=0, dtheta=3, dv=3, unknown=2)


def both_ways(config, kind, given, cuts=(7, 30, 31)):
    """Samples made ready by Python and by the compiled function, in blocks."""
    readings, results = imu_readings(config), []
    for compiled in (False, True):
        preparation, out = SamplePreparation(config, kind, 0.01, None), columns()
        motion = []
        for k, block in enumerate(np.split(given, cuts)):
            if compiled and k:
                assert preparation.take_usual(block, float(given[cuts[k - 1] - 1, 0]), readings, out)
                motion.append(preparation.motion(len(block)).copy())
                continue
            gyro, accel = block[:, 1:4], block[:, 4:7]
            if not readings.is_si:
                gyro, accel = readings.to_si(gyro, accel)
            s, sentences = preparation.take(block[:, 0], gyro, accel, block[:, 7])
            assert not sentences
            out.append(t=s.t, dt=s.dt, dtheta=s.dtheta, dv=s.dv, unknown=s.unknown)
            motion.append(np.hstack((s.rate, s.force)))
        results.append((preparation, {**out.document(), "motion": np.vstack(motion)}))
    return results


@pytest.mark.parametrize("kind", ["rate", "increment"])
@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("turned", [False, True])
def test_usual_samples_are_those_of_python(kind, order, turned):
    given = rows()
    if kind == "increment":
        given[:, 1:7] *= 0.01
    more = {"hints": {"axes": "FLU"}, "mount_rpy_deg": [1.0, -2.0, 30.0], "clock_shift_s": 0.125} if turned else {}
    (python, a), (compiled, b) = both_ways(config(kind, rate_order=order, **more), kind, given)
    for name, expected in a.items():
        # without axes to turn the last bit; products with a matrix round otherwise
        np.testing.assert_allclose(b[name], expected, rtol=MATRIX if turned else 0.0, atol=2e-15 if turned else 0.0)
    np.testing.assert_allclose(compiled.before, python.before, rtol=MATRIX, atol=2e-15)
    np.testing.assert_allclose(compiled.recent.rows, python.recent.rows, rtol=MATRIX, atol=2e-15)
    np.testing.assert_allclose(compiled.recent.largest, python.recent.largest, rtol=1e-14)  # powers, products
    assert compiled.recent.count[0] == python.recent.count[0]


@pytest.mark.parametrize(
    ("row", "column", "value"),
    [
        (3, 1, np.nan),
        (3, 4, 1e9),
        (4, 2, 25.0),  # a spike of the rate ...
        (4, 6, 193.0),  # ... and of the force
        (5, 0, 5.41),  # out of order
        (5, 0, np.nan),
        (9, 0, 9.0),  # a pause
    ],
)
def test_unusual_samples_are_left_to_python(row, column, value):
    """Nothing is taken of a block with one of them."""
    used, given, readings = config(), rows(), imu_readings(config())
    preparation, out = SamplePreparation(used, "rate", 0.01, None), columns()
    first, second = given[:50], given[50:]
    preparation.take(first[:, 0], first[:, 1:4], first[:, 4:7], first[:, 7])
    kept = [x.copy() for x in (preparation.before, preparation.recent.rows, preparation.recent.largest)]
    second[row, column] = value
    assert not preparation.take_usual(second, float(first[-1, 0]), readings, out)
    assert len(out) == 0
    for now, before in zip(
        (preparation.before, preparation.recent.rows, preparation.recent.largest), kept, strict=True
    ):
        np.testing.assert_array_equal(now, before)


GNSS = {
    "lever_arm_m": [0.6, -0.2, -1.1], "sigma_scale": 1.5, "position_sigma_floor_m": [0.5, 0.5, 2.0],
    "velocity_sigma_scale": [1.0, 2.0, 1.0],
}  # fmt: skip


def a_fix(t=1.0, **other):
    A, B = RNG.standard_normal((2, 3, 3))
    llh = np.array([0.84, -0.147, 523.0]) + 1e-6 * RNG.standard_normal(3)
    fix = Fix(t, llh, A @ A.T + np.eye(3), RNG.standard_normal(3), 0.01 * (B @ B.T + np.eye(3)), 4)
    return replace(fix, **other)


def aids(**gnss):
    used = NavigationConfig.checked({**cases.CONFIG, "gnss": {**GNSS, **gnss}})
    made = LiveAids(used, imu_spec(used), 0.0, 0.0, None, 0.01)
    made.fixes = [a_fix(0.5)]
    return made


@pytest.mark.parametrize("gnss", [{}, {"velocity": False}, {"gate": "off"}, {"quality": [4, 5]}])
@pytest.mark.parametrize("without", [{}, {"v_n": None, "cov_v_n": None}])
def test_a_usual_fix_has_the_measurements_of_a_log(gnss, without):
    for k in range(20):
        fix, quick, slow = a_fix(1.0 + k, **without), aids(**gnss), aids(**gnss)
        made, expected = quick.usual_fix(fix), slow.fix([fix], series_of([fix]), [])
        assert made is not None
        assert len(made) == len(expected)
        for name in ("t", "kind", "R", "lever", "gate"):
            np.testing.assert_array_equal(getattr(made, name), getattr(expected, name))
        np.testing.assert_allclose(made.z, expected.z, rtol=3e-16, atol=2e-9)  # sines of other libraries
        assert quick.fixes[-1] is fix
        assert quick.last_used == slow.last_used


@pytest.mark.parametrize(
    "other",
    [
        {"t": np.nan},
        {"t": 0.5},
        {"llh": np.array([0.84, np.nan, 523.0])},
        {"llh": np.array([48.0, -8.0, 523.0])},
        {"cov_r_n": np.diag([1.0, -1.0, 1.0])},
        {"cov_r_n": np.diag([1e7, 1.0, 1.0])},
        {"cov_r_n": np.diag([1.0, 1.0, 1e9])},
        {"cov_r_n": np.array([[1.0, 2.0, 0.0], [2.0, 1.0, 0.0], [0.0, 0.0, 1.0]])},
        {"cov_r_n": np.array([[1.0, 0.1, 0.0], [0.2, 1.0, 0.0], [0.0, 0.0, 1.0]])},
        {"v_n": np.array([1.0, np.nan, 0.0])},
        {"cov_v_n": np.diag([0.1, 0.1, 1e7])},
        {"cov_v_n": None},
        {"quality": 1},
    ],
)
def test_unusual_fixes_are_left_to_python(other):
    made = aids(quality=[4])
    assert made.usual_fix(a_fix(**other)) is None
    assert len(made.fixes) == 1
    again = replace(a_fix(), llh=made.fixes[0].llh)
    assert made.usual_fix(again) is None  # held


@pytest.mark.parametrize("gnss", [{"every_s": 2.0}, {"velocity_delay_s": 0.1}, {"coupling": "off"}])
def test_configurations_that_do_not_take_every_fix_at_its_stamp(gnss):
    assert aids(**gnss).usual_fix(a_fix()) is None


@pytest.mark.parametrize("llh", [(0.84, -0.147, 523.0), (-1.2, 3.14, -50.0), (0.0, 0.0, 0.0), (1.55, 2.0, 2e4)])
@pytest.mark.parametrize("pitch", [0.1, -1.2, np.pi / 2])
def test_a_solution_is_that_of_the_state(llh, pitch):
    state = NavState.from_geodetic(3.0, llh, (3.0, -4.0, 0.5), (2.0, pitch, -0.7))
    A = RNG.standard_normal((15, 15))
    P = A @ A.T
    made = solution(3.0, np.concatenate((state.q_eb, state.v_eb_e, state.r_eb_e)), P, "ok")
    np.testing.assert_allclose(made.llh[:2], state.llh[:2], rtol=0.0, atol=1e-15)  # rounding
    np.testing.assert_allclose(made.llh[2], state.llh[2], rtol=0.0, atol=1e-8)
    np.testing.assert_allclose(made.v_eb_n, state.v_eb_n, atol=1e-14)
    np.testing.assert_allclose(made.rpy_nb, state.rpy_nb, atol=1e-14 if abs(pitch) < 1.5 else 1e-7)
    T = ecef_from_ned_states(state.llh, 9)
    sigma = np.sqrt(np.diag(T.T @ P[:9, :9] @ T))
    np.testing.assert_allclose(
        np.concatenate((made.sigma_psi_n, made.sigma_v_n, made.sigma_r_n)), sigma, rtol=1e-13, atol=0.0
    )


def test_health_counts_the_last_minute():
    """Twenty innovations of positions, as many of velocities, headings that are not judged; half of them settled."""
    t = np.repeat(np.arange(40.0, 60.0), 3)
    kind = np.tile(np.array([POSITION, VELOCITY, HEADING]), 20)
    nis = np.where(kind == HEADING, 1e6, 3.0)

    def health(status, squares, now=61.0, split=30):
        monitor = HealthMonitor(placed=0.0)
        monitor.settle(Judged(t[:split], kind[:split], status[:split], squares[:split]))
        return monitor.health(now, Judged(t[split:], kind[split:], status[split:], squares[split:])), monitor

    fine = np.full(60, ACCEPTED)
    state, monitor = health(fine, nis)
    assert (state, monitor.usual_s, monitor.placed) == ("ok", 1.0, 59.0)
    for split in (0, 60):
        assert health(fine, nis, split=split)[0] == "ok"
    assert health(fine, nis, now=62.5)[0] == "coasting"
    assert health(fine, 3.1 * nis)[0] == "doubtful"
    assert health(fine, 10.1 * nis)[0] == "failed"
    for share, expected in ((0.15, "ok"), (0.25, "doubtful"), (0.85, "failed")):
        refused = fine.copy()
        refused[np.flatnonzero(kind == VELOCITY)[: round(40 * min(share, 0.5))]] = REJECTED
        refused[np.flatnonzero(kind == POSITION)[: round(40 * max(share - 0.5, 0.0))]] = REJECTED
        assert health(refused, nis)[0] == expected
    forced = fine.copy()
    forced[np.flatnonzero(kind == POSITION)[3]] = FORCED
    assert health(forced, nis)[0] == "doubtful"
    old = Judged(t - 60.0, kind, np.full(60, REJECTED), nis)  # more than a minute ago
    monitor = HealthMonitor(placed=60.0)
    monitor.settle(old)
    assert monitor.health(61.0, Judged(t, kind, fine, nis)) == "ok"


def test_a_prepared_kernel_is_called_directly():
    from schuler.live import _kernels

    _kernels.prepare_live()
    direct = jit.direct(_kernels.usual_step)
    t = np.array([0.0, 1.0, 2.0, 5.0, 6.0])
    assert direct(t) == 1.0 == _kernels.usual_step(t)
    assert direct(t[:3].copy()) == 1.0
    assert jit.direct(np.sum) is np.sum


@pytest.mark.parametrize("size", [2000, 2001, 1])
def test_blocks_longer_than_the_queue(size):
    """More samples at once than the queue holds are those samples."""
    t = np.arange(size) * 0.01
    runs = [LiveNavigator.from_config(cases.CONFIG, kind="increment") for _ in range(2)]
    gyro, accel = np.zeros((size, 3)), np.tile([0.0, 0.0, -0.098], (size, 1))
    runs[0].imu_many(t, gyro, accel, np.full(size, 20.0))
    for k in range(size):
        runs[1].imu(t[k], gyro[k], accel[k], 20.0)
    kept = [(run._work(), run._stream._collection.imu.document())[1] for run in runs]
    for name, values in kept[0].items():
        np.testing.assert_array_equal(values, kept[1][name])
    runs[0].imu_many(np.empty(0), np.empty((0, 3)), np.empty((0, 3)))
    with pytest.raises((InputError, ValueError)):
        runs[0].imu_many(t[:1], np.zeros((1, 4)), accel[:1])
