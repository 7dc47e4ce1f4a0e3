"""Units of angular rates that their size and the swing of a foot leave, and counts."""

import re

import numpy as np
import pytest

import schuler
from schuler.calibration.freepose.simulation import hand_log, spread_turns
from schuler.diagnosis import diagnose
from schuler.diagnosis.gyro_unit import COUNTS_PER_DEG_S, are_counts, possible_units
from schuler.recording.recording import Metadata, Recording
from schuler.recording.series import ImuSeries
from schuler.sensors.errors import ImuErrors
from schuler.simulation.gait import walk
from schuler.simulation.motion import ideal_rates
from schuler.units import DEG, G0


@pytest.fixture(scope="module")
def foot():
    """A foot that walks, with a little noise."""
    motion = walk([45.0 * DEG, 0.0, 0.0], strides=12, tip=1.2, clearance=0.05, stand=0.5)
    t = np.arange(int(motion.duration * 100.0)) / 100.0
    omega, f = ideal_rates(motion, t)
    rng = np.random.default_rng(4)
    return ImuSeries(t, omega + 0.002 * rng.standard_normal(f.shape), f + 0.02 * rng.standard_normal(f.shape))


def at_rest(rate, scatter=0.0):
    rng = np.random.default_rng(5)
    gyro = np.array([rate, 0.0, 0.0]) + scatter * rng.standard_normal((2000, 3))
    return ImuSeries(np.arange(2000) / 100.0, gyro, [0.0, 0.0, -G0] + 0.02 * rng.standard_normal((2000, 3)))


@pytest.mark.parametrize(("unit", "factor"), [("rad/s", 1.0), ("deg/s", 1.0 / DEG), ("mdeg/s", 1e3 / DEG)])
def test_a_swinging_foot_tells_the_unit(foot, unit, factor):
    """Whatever the accelerometers' unit is."""
    for scale in (1.0, 1.0 / G0):
        left, why = possible_units(ImuSeries(foot.t, factor * foot.gyro, scale * foot.accel))
        assert left == [unit]
        assert why


@pytest.mark.parametrize(
    ("rate", "left"), [(0.01, ["deg/s", "rad/s"]), (1.0, ["deg/s"]), (20.0, ["deg/s"]), (500.0, ["mdeg/s"])]
)
def test_a_rate_at_rest_is_no_larger_than_a_bias(rate, left):
    """57 deg/s is none; of what both units leave it is said what they would mean."""
    units, why = possible_units(at_rest(rate, 0.02 * rate))
    assert units == left
    assert ("more than gyroscopes have" in why) == (len(left) == 1)


@pytest.mark.parametrize("tilt", [0.0, 8.0 * DEG])
def test_a_table_that_turns_is_no_bias(tilt):
    """57 deg/s about the vertical throughout: nothing tells it from 1 deg/s of bias, so it is asked."""
    axis = np.array([np.sin(tilt), 0.0, np.cos(tilt)])
    still = at_rest(0.0)
    units, _ = possible_units(
        ImuSeries(still.t, axis + still.gyro, still.accel + G0 * (np.array([0.0, 0.0, 1.0]) - axis))
    )
    assert units == ["deg/s", "rad/s"]


def test_counts_are_of_16_bits():
    gyro = np.full((3, 3), 32768.0)
    assert are_counts(gyro)
    assert not are_counts(gyro + 1.0)
    assert not are_counts(gyro - 0.5)


@pytest.mark.parametrize("lsb", COUNTS_PER_DEG_S)
def test_counts_are_told_from_units_near_them(lsb):
    """16.4 counts in a deg/s are 1.06 mrad/s each: of whole numbers the counts are likelier. Counts in a g likewise."""
    rng = np.random.default_rng(2)
    errors = ImuErrors(b_a=[0.2, -0.2, 0.3], b_g=[0.01, -0.01, 0.02])
    imu = hand_log(errors, rng, rotvecs=spread_turns(12, rng), rate_hz=50.0).rates()
    gyro, accel = np.round(lsb * imu.gyro / DEG), np.round(2048.0 * imu.accel / G0)
    diagnosis = diagnose(Recording(imu=ImuSeries(imu.t, gyro, accel), metadata=Metadata("counts")))
    fixes = {f.code: f.fix for f in diagnosis.findings}
    assert fixes["gyro_unit"] == f"scale='gyro={DEG / lsb:.6g}'"
    assert fixes["accel_unit"].startswith(f"scale='accel={G0 / 2048.0:.6g}'")


@pytest.mark.parametrize("fault", [0.5, 1.0, 2.1])
def test_a_rate_that_was_said_may_be_what_is_wrong(tmp_path, fault):
    """Turned by hand, degrees a second, no stamps, read at a multiple of its rate: no scale is taken for sure."""
    imu = hand_log(ImuErrors(), np.random.default_rng(5), poses=12, initial_rest_s=5.0).rates()
    rng = np.random.default_rng(6)
    accel, gyro = (x + 0.01 * rng.standard_normal(x.shape) for x in (imu.accel, imu.gyro / DEG))
    path = tmp_path / "hand.csv"
    np.savetxt(path, np.hstack((accel, gyro)), delimiter=",", header="ax,ay,az,gx,gy,gz", comments="")
    rate_hz = 1.0 / imu.interval
    diagnosis = diagnose(schuler.read(path, rate=fault * rate_hz, units="m/s^2,rad/s"))
    [finding] = [f for f in diagnosis.findings if f.code == "gyro_unit"]
    if fault == 1.0:
        assert "deg/s" in finding.fix
        assert finding.confidence > 0.98
    else:
        assert finding.confidence < 0.98
        [rate] = re.findall(r"([\d.]+) Hz if they are deg/s", finding.text)
        assert float(rate) == pytest.approx(rate_hz, rel=0.05)  # noise, and where rests end
