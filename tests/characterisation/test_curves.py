"""Curves from elsewhere: what the log itself gives, closed forms, and refusals."""

import numpy as np
import pytest
from command import answer, run

from schuler import units
from schuler.characterisation.allan import allan_deviation
from schuler.characterisation.curves import identify_curve, is_curve_file, read_curves
from schuler.characterisation.identification import identify_noise
from schuler.exceptions import FileFormatError, InputError
from schuler.recording.series import ImuSeries
from schuler.sensors.noise import RandomWalk, White

RATE, N = 100.0, 60_000
NOISE = White(1e-3) + RandomWalk(1e-4)


@pytest.fixture(scope="module")
def log():
    return NOISE.sample((N, 3), 1.0 / RATE, np.random.default_rng(4))


@pytest.mark.campaign
def test_a_curve_gives_the_terms_of_its_log(log):
    """The same moments, so N agrees to rounding with that of the log but for averaging times between octaves."""
    imu = ImuSeries(np.arange(N) / RATE, log, np.zeros((N, 3)))
    of_log = identify_noise(imu, models=("N", "N+K")).axes["gyro_x"]
    curve = allan_deviation(log[:, 0], RATE, taus="octave")
    axis = identify_curve(curve.tau[:-1], curve.deviation[:-1], duration_s=N / RATE, rate_hz=RATE)
    assert axis.names == of_log.names == ("N", "K")
    for term, true in (("N", 1e-3), ("K", 1e-4)):
        assert axis.terms[term].value == pytest.approx(
            of_log.terms[term].value, rel=0.5 * of_log.terms[term].sigma / true
        )
        assert axis.terms[term].low < true < axis.terms[term].high


def test_an_exact_curve_gives_its_terms_back():
    """Closed form sqrt(N^2 / tau + K^2 tau / 3). The bias that noise gives a logarithm is taken off: 1 %."""
    tau = 2.0 ** np.arange(14)
    axis = identify_curve(tau, np.sqrt(4.0 / tau + 1e-6 * tau / 3.0), axis="accel_z", duration_s=1e6)
    assert axis.terms["N"].value == pytest.approx(2.0, rel=0.01)
    assert axis.terms["K"].value == pytest.approx(1e-3, rel=0.05)
    assert axis.unit == "m/s^2"


@pytest.mark.campaign
@pytest.mark.thinned(4)
@pytest.mark.parametrize("count", [12, 40, 61])
def test_averaging_times_need_not_be_multiples_of_a_sample(count):
    """Times of equal ratios, as other programs choose them: short ones between two samples are not fitted."""
    tau = np.geomspace(0.01, 1000.0, count)
    axis = identify_curve(tau, np.sqrt(4.0 / tau + 1e-4 * tau / 3.0), duration_s=1e6)
    assert axis.terms["N"].value == pytest.approx(2.0, rel=0.02)  # 5 % of tau is 2.5 % of a deviation, scattered
    assert axis.terms["K"].value == pytest.approx(1e-2, rel=0.05)


@pytest.mark.campaign
def test_the_shortest_log_is_assumed_and_said(log):
    curve = allan_deviation(log[:, 1], RATE, taus="octave")
    assumed = identify_curve(curve.tau, curve.deviation)
    stated = identify_curve(curve.tau, curve.deviation, duration_s=N / RATE, rate_hz=RATE)
    assert assumed.duration_s == pytest.approx(2.0 * curve.tau[-1])
    assert np.all(assumed.curve.edf < stated.curve.edf)
    assert assumed.findings[0].code == "assumed"


@pytest.mark.campaign
def test_the_command_reads_a_table(log, tmp_path, capsys):
    curves = [allan_deviation(log[:, k], RATE, taus="octave") for k in (0, 1)]
    table = np.column_stack((curves[0].tau, *(c.deviation / (units.DEG / units.HR) for c in curves), curves[0].low))
    path = tmp_path / "curve.csv"
    np.savetxt(path, table, delimiter=",", header="tau_s,gyro_x,gyro_y,low", comments="")
    assert is_curve_file(path)
    assert set(read_curves(path)[1]) == {"gyro_x", "gyro_y"}
    data = answer(capsys, "allan", path, "--units", "deg/h", "--duration", "600", "--rate", "100", "--json")
    assert set(data["axes"]) == {"gyro_x", "gyro_y"}
    assert data["axes"]["gyro_y"]["terms"]["N"]["value"] == pytest.approx(1e-3, rel=0.05)  # statistical
    code, _, err = run(capsys, "allan", path)
    assert code != 0
    assert "say --units" in err
    code, _, err = run(capsys, "allan", path, "--units", "deg/h", "--robust")
    assert code != 0
    assert "need readings" in err


def test_what_is_no_curve_is_refused(tmp_path):
    with pytest.raises(InputError, match="averaging times that increase"):
        identify_curve([1.0, 1.0, 2.0], [1.0, 1.0, 1.0])
    with pytest.raises(InputError, match="expected 16 s or more"):
        identify_curve([1.0, 2.0, 4.0, 8.0], np.ones(4), duration_s=10.0)
    with pytest.raises(InputError, match="5 octaves"):
        identify_curve([1.0, 2.0, 4.0], np.ones(3))
    (tmp_path / "bad.csv").write_text("tau,x\n1,2\n2,oops\n")
    with pytest.raises(FileFormatError, match="row of numbers"):
        read_curves(tmp_path / "bad.csv")
    (tmp_path / "log.csv").write_text("t,ax,ay,az\n1,2,3,4\n")
    assert not is_curve_file(tmp_path / "log.csv")
