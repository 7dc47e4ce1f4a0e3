"""Free-inertial drives: the drive itself, floors, improvement by rotation and the thesis's claims."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from schuler.exceptions import InputError
from schuler.reproduce.du.study import tables as thesis
from schuler.reproduce.du.study.drives import DRIVE_S, drive
from schuler.reproduce.du.study.floor import noise_floor
from schuler.reproduce.du.study.imus import emulation
from schuler.reproduce.du.study.kinematic import claims, kinematic_test
from schuler.reproduce.du.study.metrics import Improvement, index
from schuler.units import DEG

RUNS = 60
POSITION = index("horizontal_position")


@pytest.fixture(scope="module")
def tests():
    """Both IMUs at a tenth of the sampling rate."""
    return {n: kinematic_test(emulation(n, rate_hz=10.0), runs=RUNS, seed=2) for n in thesis.IMUS}


def test_the_drive_is_the_thesis_s():
    """2.3 km in 210 s with loops both ways, from rest to rest; the heading is continuous."""
    motion = drive([0.8, 0.1, 100.0], rest_s=10.0)
    assert motion.duration == pytest.approx(10.0 + DRIVE_S)
    t = np.arange(0.0, motion.duration, 0.1)
    state = motion.state(t)
    speed = np.linalg.norm(state.v_eb_e, axis=1)
    assert np.sum(speed) * 0.1 == pytest.approx(2300.0, rel=0.02)
    assert_allclose(speed[[0, 99, -1]], 0.0, atol=0.1)
    turned = state.omega_eb_b[:, 2].cumsum() * 0.1 / DEG
    assert turned.max() == pytest.approx(450.0, abs=2.0)
    assert abs(turned[-1] - 180.0) < 2.0


def test_rotation_helps_both(tests):
    """The interval of the ratio of mean horizontal position errors is above 1 for NAV440 by far; MTi-G gains little."""
    nav, mti = (tests[n].improvement() for n in thesis.IMUS)
    assert nav.certain
    assert nav.low > 2.5
    assert nav.wins > 0.9
    assert 0.9 < mti.low < mti.high < 1.6


def test_mti_g_is_at_the_floor_of_its_noise(tests):
    """Rotary: 706 m, 10.6 m/s, 0.51 deg root mean square, within 4 standard errors; as measured (679 m, 10.4 m/s)."""
    rms = np.sqrt(np.mean(tests["MTi-G"].rotary ** 2, axis=0))
    floor = noise_floor(emulation("MTi-G").gyro_random_walk, DRIVE_S)
    error = 4.0 * 0.6 / np.sqrt(RUNS)
    assert rms[POSITION] == pytest.approx(floor.horizontal_position, rel=0.1 + error)
    assert rms[1] == pytest.approx(floor.horizontal_velocity, rel=0.1 + error)
    assert_allclose(rms[4:6], floor.attitude, rtol=0.1 + error)
    _, six = thesis.KINEMATIC["MTi-G"]
    measured = np.mean(six, axis=0)
    mean = tests["MTi-G"].rotary.mean(axis=0)
    assert_allclose(mean[:2], measured[:2], rtol=0.25)


def test_a_tenth_of_a_degree_explains_nav440(tests):
    """Rotary means of measured size with an initial attitude good to 0.1 deg; from a perfect start half of them."""
    _, six = thesis.KINEMATIC["NAV440"]
    measured = np.mean(six, axis=0)[:2]
    assert_allclose(tests["NAV440"].rotary.mean(axis=0)[:2], measured, rtol=0.25)
    perfect = kinematic_test(emulation("NAV440", rate_hz=10.0), runs=30, initial_attitude_deg=0.0)
    assert np.all(perfect.rotary.mean(axis=0)[:2] < 0.65 * measured)


def test_claims_are_judged(tests):
    """The claim of 2 to 3 times for MTi-G does not hold: less; the table says so beside the thesis's own numbers."""
    table = claims(list(tests.values()))
    row = table.row(imu="MTi-G", quantity="horizontal_position")
    assert row["verdict_on_claim"] == "does not hold: less"
    assert row["thesis_mean"] == pytest.approx(1.98, abs=0.01)
    row = table.row(imu="NAV440", quantity="horizontal_position")
    assert (row["thesis_least"], row["thesis_most"]) == pytest.approx((2.2, 4.7), abs=0.05)
    assert row["thesis_mean"] == pytest.approx(3.0, abs=0.01)
    assert table.row(imu="NAV440", quantity="azimuth")["claimed"] == "-"
    for test in tests.values():
        assert "claimed" in test.verdict()
        assert "share_below_percent" in test.summary()


def test_verdicts():
    def result(low, high):
        return Improvement(0.5 * (low + high), low, high, 0.95, 1.0, low, high, 100)

    assert result(3.2, 4.0).compared((3.0, 5.0)) == "holds"
    assert result(2.0, 2.9).compared((3.0, 5.0)) == "does not hold: less"
    assert result(5.2, 6.0).compared((3.0, 5.0)) == "does not hold: more"
    assert "in part" in result(2.5, 3.5).compared((3.0, 5.0))


def test_printed_means():
    """Means of the tables as printed, azimuth of MTi-G corrected to 2.99; printed digits."""
    nav, mti = (np.mean(thesis.KINEMATIC[n][1], axis=0) for n in thesis.IMUS)
    assert_allclose(nav, [241.5, 3.5, 0.15, 0.16, 1.02], atol=0.06)
    assert_allclose(mti, [678.9, 10.4, 0.57, 0.54, 2.99], atol=0.06)


def test_the_sense_of_rotation_does_not_matter():
    """Turned the other way it helps as well: the loops go both ways."""
    imu = emulation("NAV440", rate_hz=10.0)
    back = kinematic_test(imu, runs=20, rate_deg_s=-20.0)
    assert back.improvement().low > 2.0


def test_example_and_figure(tests):
    one = tests["NAV440"].example(3)
    assert set(one) == {"truth", "conventional", "rotary"}
    assert len(one["truth"].t) == len(one["rotary"].t)
    assert len(tests["NAV440"].plot().axes) == 6
    with pytest.raises(InputError, match="expected 0 to"):
        tests["NAV440"].example(RUNS)


def test_wrong_questions():
    with pytest.raises(InputError, match="imu"):
        kinematic_test("VN-200")
    with pytest.raises(InputError, match="other than zero"):
        kinematic_test("NAV440", rate_deg_s=0.0)
