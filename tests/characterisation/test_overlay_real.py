"""The model identified in a real log, simulated, against that log."""

import numpy as np
import pytest

from schuler.characterisation import NoiseIdentification, identify_noise
from schuler.characterisation.result import AXES
from schuler.recording.series import ImuSeries
from schuler.reproduce.flenniken.study.grade_comparison import overlay
from schuler.sensors.noise import Counted
from schuler.units import ARCSEC, DEG, G0, UG

pytestmark = [pytest.mark.realdata, pytest.mark.campaign]  # hours of two IMUs; test_health.py reads them, too


def adis(folder, number: int) -> ImuSeries:
    """2.8 h at 100 Hz of one ADIS16405."""
    with np.load(folder / "adis16405_static" / f"adis16405_imu{number}.npz") as data:
        x = data["counts"] * data["lsb"]
    return ImuSeries(np.arange(len(x)) / 100.0, x[:, :3] * DEG, x[:, 3:] * G0)


def laser_gyro(folder) -> ImuSeries:
    """Half an hour at 100 Hz of a laser-gyro unit in a parked car, people in it; increments."""
    lines = (folder / "psins_lasergyro" / "lasergyro.imu").read_text(encoding="latin-1").splitlines()
    rows = [line.split() for line in lines if not line.startswith("%")]
    counts = np.array([row[:6] for row in rows[3:] if len(row) >= 6], dtype=np.float64)
    t = np.arange(1, len(counts) + 1) / 100.0
    return ImuSeries(t, counts[:, :3] * 0.1 * ARCSEC, counts[:, 3:] * 125.0 * UG, kind="increment")


@pytest.fixture(scope="module", params=[1, 2], ids="imu{}".format)
def identified(request, shared_data) -> tuple[ImuSeries, NoiseIdentification]:
    imu = adis(shared_data, request.param)
    return imu, identify_noise(imu)


def test_every_axis_is_identified_without_departure(identified):
    """What the terms cannot describe (filter, vibration) is at short times and has the measured spectrum."""
    _, noise = identified
    assert not noise.refused
    assert set(noise.axes) == set(AXES)
    for axis in noise.axes.values():
        codes = {f.code for f in axis.findings}
        assert not codes & {"departure", "no_model"}, axis.axis
        tau = axis.curve.tau
        inside = (axis.fitted(tau) > axis.curve.low) & (axis.fitted(tau) < axis.curve.high)
        assert inside.mean() > 0.93, axis.axis  # 95 % bounds; neighbours go together


@pytest.mark.parametrize("name", ["gyro_z", "accel_z"])
def test_simulated_the_model_reproduces_the_curve(identified, name):
    """Statistical: the log's Allan curve is an ordinary one among 39 simulated ones (p > 2.5 %)."""
    imu, noise = identified
    check(imu, noise, name)


@pytest.mark.slow
@pytest.mark.parametrize("name", AXES)
def test_simulated_every_axis_reproduces_the_curve(identified, name):
    imu, noise = identified
    check(imu, noise, name)


def test_a_parked_car_is_reproduced_and_said_to_be_no_sensor_noise(shared_data):
    """Disturbances have their places; the model is the measured spectrum. The z accelerometer shows its pulses, five
    readings of six being the same, which no Gaussian process has: its model counts. That passes here, not with 199
    realisations (docs/noise-validation.md)."""
    imu = laser_gyro(shared_data)
    noise = identify_noise(imu)
    for name in ("gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y"):
        codes = {f.code for f in noise.axes[name].findings}
        assert codes & {"departure", "no_model"}, name
        check(imu.rates(), noise, name)
    assert {"motion", "step"} <= {f.code for f in noise.axes["gyro_x"].findings}
    counted = noise.axes["accel_z"]
    assert {"coarse", "counted"} <= {f.code for f in counted.findings}
    (process,) = counted.model.terms
    assert isinstance(process, Counted)
    # four counts of the file a pulse, read at 125 Hz: 99.98 % of the readings can be told from the log, and are whole
    assert process.quantum == pytest.approx(4.0 * 125.0 * UG, rel=1e-6)
    assert process.read_rate_hz == pytest.approx(125.0)
    check(imu.rates(), noise, "accel_z")


def check(imu: ImuSeries, noise: NoiseIdentification, name: str) -> None:
    k = AXES.index(name)
    x = (imu.gyro if k < 3 else imu.accel)[:, k % 3]
    laid = overlay(noise.axes[name], x, imu.rate_hz, np.random.default_rng(1))
    print(name, laid.summary())
    assert laid.allan.share > 0.9
    assert laid.allan.p > 0.025
