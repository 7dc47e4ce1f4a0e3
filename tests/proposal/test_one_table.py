"""A logger's one table: counts of an IMU turned about the vertical, and fixes of a receiver between its samples."""

import numpy as np
import pytest
from messy_folders import simulated

import schuler
from schuler import units
from schuler.diagnosis.gyro_unit import gyro_unit

BIASES = np.array([[0.1, -0.1, 0.05], [0.008, -0.004, 0.002]])  # [m/s^2], [rad/s]
BOARD = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])  # x left, y forward, z down


@pytest.fixture(scope="module")
def proposal(tmp_path_factory):
    """Of 16-bit counts over 2 g and 250 deg/s, positions without an accuracy, and micros() that begins again."""
    recording = simulated()[1]
    imu, g = recording.imu, recording.gnss
    counts = (
        np.rint((imu.accel + BIASES[0]) @ BOARD.T / units.G0 * 16384.0),
        np.rint((imu.gyro + BIASES[1]) @ BOARD.T / units.DEG * 131.0),
    )
    stamps = np.round(1e6 * (imu.t - imu.t[0] + 2.0**32 / 1e6 - 40.0)) % 2.0**32
    last = np.searchsorted(g.t, imu.t + 1e-6, side="right") - 1
    rows = [
        f"{t:.0f},{','.join(f'{x:.0f}' for x in (*a, *w))},"
        + ("0.0,0.0,0.0" if k < 0 else f"{g.llh[k, 0] / units.DEG:.7f},{g.llh[k, 1] / units.DEG:.7f},{g.llh[k, 2]:.2f}")
        for t, a, w, k in zip(stamps, *counts, last, strict=True)
    ]
    path = tmp_path_factory.mktemp("sd") / "DATA001.TXT"
    path.write_text("micros,AcX,AcY,AcZ,GyX,GyY,GyZ,lat,lon,alt\n" + "\n".join(rows) + "\n")
    return schuler.propose(path, trials=False)


@pytest.mark.campaign
def test_both_series_are_read(proposal):
    assert len(proposal.recording.gnss.t) == 150
    np.testing.assert_allclose(np.diff(proposal.recording.imu.t), 0.02, atol=2e-6)  # rounding of microseconds


def test_scale_and_axes_are_found_without_a_question(proposal):
    values = {d.entry: d.value for d in proposal.decisions}
    assert values["recording.axes"] == "LFD"
    scale = dict(pair.split("=") for pair in values["recording.scale"].split(","))
    # statistical: fixes of 1.5 m say how fast the course turns; the norm at rest has the biases in it
    assert float(scale["gyro"]) == pytest.approx(units.DEG / 131.0, rel=0.04)
    assert float(scale["accel"]) == pytest.approx(units.G0 / 16384.0, rel=0.02)


def test_a_scale_from_motion_gets_its_states(proposal):
    assert proposal.config.filter.states == 33


def test_a_scale_is_the_exact_factor_and_a_unit_is_told_by_the_other():
    [counts] = gyro_unit(1.2e-4, 0.02, ("rad/s", 1.0), "rate", {}, "against turns", 1.3e-4)
    assert counts.fix == "scale='gyro=0.00013'"
    [degrees] = gyro_unit(units.DEG, 0.02, ("rad/s", 1.0), "rate", {}, "against turns", 1.3 * units.DEG)
    assert "gyro=deg/s" in degrees.fix
