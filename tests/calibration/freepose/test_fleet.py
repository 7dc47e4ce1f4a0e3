"""Calibration of many units in one call: the table, any number of workers, units that fail."""

import itertools
import sys
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace

import numpy as np
import pytest

from schuler.calibration.freepose.calibrate import calibrate_freepose
from schuler.calibration.freepose.fleet import _shared, calibrate_fleet
from schuler.calibration.freepose.simulation import hand_log
from schuler.calibration.result.parameters import vector
from schuler.exceptions import InputError
from schuler.recording.series import ImuSeries
from schuler.sensors.errors import ImuErrors
from schuler.sensors.noise import NoiseModel, White
from schuler.sensors.spec import ImuSpec, TriadSpec

N_G, N_A = 3e-4, 2e-3
SPEC = ImuSpec(
    name="of the fleet",
    gyro=TriadSpec.gyro(arw_deg_rthr=1.0, bias_deg_s=0.5, scale_percent=1.0, misalignment_percent=1.0),
    accel=TriadSpec.accelerometer(vrw_m_s_rthr=0.12, bias_mg=30.0, scale_percent=0.5, misalignment_percent=0.5),
)


def fleet(n, seed=1):
    """Units drawn from one specification, each with a log of its own."""
    logs, truth = [], []
    for sequence in np.random.SeedSequence(seed).spawn(n):
        rng = np.random.default_rng(sequence)
        errors = replace(
            ImuErrors.draw(SPEC, rng, gauge="upper"),
            gyro_noise=NoiseModel((White(N_G),)),
            accel_noise=NoiseModel((White(N_A),)),
        )
        truth.append(errors)
        logs.append(hand_log(errors, rng, poses=20, rest_s=3.0, turn_s=1.5, rate_hz=50.0))
    return logs, truth


@pytest.fixture(scope="module")
def some():
    logs, truth = fleet(30)
    return logs, truth, calibrate_fleet(logs, workers=1)


def test_every_row_is_the_single_calibration(some):
    logs, _, table = some
    assert len(table) == 30
    for k in (0, 17):
        single = calibrate_freepose(logs[k], halves=False)
        np.testing.assert_array_equal(table.values[k], single.values)
        np.testing.assert_array_equal(table.sigma[k], single.sigma)
        assert table.status[k] == single.status
        assert table.results[k].names == table.names
        assert "halves: not compared: fleets leave it out" in table.results[k].summary()


def test_errors_are_as_large_as_stated(some):
    """Statistical: 30 units, 21 parameters, noise estimated from each log; five standard errors of a mean square."""
    _, truth, table = some
    z = (table.values - np.array([vector(e, table.names) for e in truth])) / table.sigma
    assert abs(np.mean(z**2) - 1.0) < 5.0 * np.sqrt(2.0 / z.size) + 0.05


def test_the_spread_of_the_fleet_is_the_specification(some):
    """Statistical: a standard deviation of 30 is good to 13 %, four of these."""
    _, _, table = some
    mean, deviation = table.spread()["M_a_xx"]
    assert abs(deviation / SPEC.accel.scale_factor - 1.0) < 0.55
    assert abs(mean) < 4.0 * deviation / np.sqrt(30.0)
    values, sigma = table.column("M_a_xx")
    assert values.shape == sigma.shape == (30,)


@pytest.mark.campaign
def test_workers_do_not_change_a_digit(some):
    logs, _, table = some
    two = calibrate_fleet(logs[:8], workers=2)
    np.testing.assert_array_equal(two.values, table.values[:8])
    np.testing.assert_array_equal(two.sigma, table.sigma[:8])
    assert two.status == table.status[:8]
    assert two.verdict == table.verdict[:8]


def test_a_process_that_joins_does_not_wait_for_half_of_scipy(some, monkeypatch):
    """``scipy.stats`` takes as long to import as the rest of a start; its distributions are in ``scipy.special``."""
    logs, _, table = some
    monkeypatch.setitem(sys.modules, "scipy.stats", None)
    monkeypatch.setitem(sys.modules, "scipy.optimize", None)
    without = calibrate_fleet(logs[:2], workers=1, halves=True)
    np.testing.assert_array_equal(without.values, table.values[:2])
    assert all(r.extra["halves"]["splits"] for r in without.results)
    assert "calibration:" in without.results[0].summary()


class Dying(Executor):
    """Does so many chunks, then its processes are gone."""

    def __init__(self, chunks):
        self.chunks = chunks

    def submit(self, function, /, *args):
        future = Future()
        if self.chunks:
            future.set_result(function(*args))
        else:
            future.set_exception(BrokenProcessPool("gone"))
        self.chunks = max(self.chunks - 1, 0)
        return future


@pytest.mark.parametrize("logs", [1, 2, 9, 50])
@pytest.mark.parametrize("others", [1, 3])
def test_every_log_is_done_once_and_in_its_place_whoever_does_it(logs, others):
    with ThreadPoolExecutor(others) as pool:
        assert _shared(str, range(logs), pool, others) == [str(k) for k in range(logs)]


def test_logs_of_a_process_that_dies_are_done_here():
    for chunks in (0, 3):
        assert _shared(str, range(50), Dying(chunks), 2) == [str(k) for k in range(50)]


@pytest.mark.parametrize(("log_s", "processes"), [(9.0, []), (11.0, [1])])
def test_a_process_is_started_only_for_work_that_is_worth_it(monkeypatch, log_s, processes):
    """Closed form: of nine logs one is left after the eight that are timed; ten seconds of work are worth a process."""
    started, clock = [], itertools.count()

    def pool(n, _context):
        started.append(n)
        return ThreadPoolExecutor(n)

    module = "schuler.calibration.freepose.fleet"
    monkeypatch.setattr("concurrent.futures.ProcessPoolExecutor", pool)
    monkeypatch.setattr(f"{module}.time.perf_counter", lambda: log_s * next(clock))
    monkeypatch.setattr(f"{module}.os.cpu_count", lambda: 2)
    monkeypatch.setattr(f"{module}._one", lambda log, options: f"log {log}")
    table = calibrate_fleet(range(9))
    assert started == processes
    assert table.verdict == tuple(f"log {k}" for k in range(9))


def test_a_bad_unit_is_a_row(some):
    logs, _, _ = some
    still = logs[0].between(0.0, 15.0)
    short = ImuSeries(logs[0].t[:20], logs[0].gyro[:20], logs[0].accel[:20], "increment")
    table = calibrate_fleet([logs[0], still, short], labels=["A1", "A2", "A3"])
    assert table.status[1:] == ("refused", "error")
    assert np.isfinite(table.sigma[0]).all()
    assert np.isinf(table.sigma[1:]).all()
    assert "ten windows" in table.verdict[2]
    assert table.results[2] is None
    text = table.summary()
    assert text.startswith("3 units: ")
    assert "A2: refused." in text
    assert "A3: error." in text
    assert table.count("refused") == 1


def test_only_bad_units():
    imu = ImuSeries(np.arange(20) * 0.01, np.zeros((20, 3)), np.ones((20, 3)))
    table = calibrate_fleet([imu])
    assert table.status == ("error",)
    assert table.names == ()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"logs": []}, "logs: expected one"),
        ({"labels": ["a", "b"]}, "labels: expected 1"),
        ({"workers": 0}, "workers: expected"),
        ({"gravity": -1.0}, "gravity: expected"),
    ],
)
def test_what_makes_no_sense(some, arguments, message):
    with pytest.raises(InputError, match=message):
        calibrate_fleet(**({"logs": some[0][:1]} | arguments))


def test_unknown_parameter(some):
    with pytest.raises(InputError, match="name: expected one of"):
        some[2].column("Q_a_x")
